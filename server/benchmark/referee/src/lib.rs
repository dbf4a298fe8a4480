//! Referee of an episode: legal actions, budgets, sound schedule. The only place that builds observations.
//!
//! Entry point: [`Referee`].
//!
//! *Never*: reads a clock; draws without the episode's seed; sends agents more than an
//! [`Observation`](avln_episode::Observation).

mod error;
mod referee;
mod schedule;
mod sounds;
mod success;

pub use avln_world::{Bank, Head};
pub use error::RefereeError;
pub use referee::{Audio, Referee, StepOutcome};
pub use sounds::{made_bank, source_positions};
