//! Runs one episode: legal actions, budgets, alternation of sounds, and the only place that builds observations.
//!
//! Start reading at [`Referee`].
//!
//! *Never*: reads a clock, draws without the episode's seed, or tells the agent more than
//! [`Observation`](avln_episode::Observation) can hold.

mod referee;
mod schedule;
mod sounds;
mod success;

pub use avln_world::{Bank, Head};
pub use referee::{Audio, Referee, RefereeError, StepOutcome};
pub use sounds::{made_bank, source_positions};
