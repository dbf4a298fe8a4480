//! What an agent may not know: targets, sources, success regions, reference paths; and the sealed record.
//!
//! Start reading at [`EpisodeTruth`] and [`Record`].
//!
//! *Never*: is named by a crate that an agent or a visitor talks to (`avln-grpc`, `avln-web`), or re-exported.

mod record;
mod target;

pub use record::{Record, StepFacts, SubmitFacts};
pub use target::{EpisodeTruth, Target};
