//! Domain types for challenges: phases, runs, quotas, visibility, accounts, episode draws.
//!
//! The store, the gRPC server, the web server and the arena share these types. Enums convert to and from the words used in
//! database columns, JSON and URLs: `as_str`, `from_word`.
//!
//! Start reading at [`Schedule`], [`RunState`] and [`Quota`].
//!
//! *Never*: does I/O; reads a clock; depends on hidden data.

mod account;
pub mod calendar;
mod phase;
mod quota;
mod run;
mod sampling;
mod word;

pub use account::{Account, Reference, TokenScope};
pub use phase::{Admission, GoalText, PhaseEpisode, PhaseInfo, PhaseState, RunChoice, Schedule, Visibility};
pub use quota::{Charge, Quota, QuotaLimits, QuotaWindow, RunGrant, RunUse, quotas};
pub use run::{EpisodeOutcome, EpisodeState, MethodInfo, Ruling, RunState, RunStatus, TimeAccount};
pub use sampling::{CommitmentValues, PhaseSecret, Sample, Sampling, draw, pool_digest};
pub use word::UnknownWord;
