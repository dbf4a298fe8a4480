//! Referee for an episode: legal actions, budgets, sound schedule. Only this crate builds observations.
//!
//! Entry point: [`Referee`].
//!
//! This crate never reads a clock, draws without the episode's seed, or sends agents more than an
//! [`Observation`](avln_episode::Observation).

mod referee;
mod rules;
mod sounds;

pub use avln_world::{Bank, Head};
pub use referee::{Audio, Referee, RefereeError, StepOutcome};
pub use sounds::{TooFewClips, episode_sounds, episode_sources, made_bank, source_positions};
