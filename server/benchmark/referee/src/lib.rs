//! Referee for an episode: legal actions, budgets, sound schedule. Only this crate builds observations.
//!
//! Entry point: [`Referee`].
//!
//! This crate never reads a clock, draws without the episode's seed, or sends agents more than an
//! [`Observation`].

mod referee;
mod rules;
mod sounds;

pub use avln_world::{Bank, Head};
pub use referee::Referee;
pub use sounds::{TooFewClips, episode_sounds, episode_sources, made_bank, source_positions};

use avln_episode::{EndReason, Observation, SensorsError};
use avln_world::StartError;

/// An action's result.
#[derive(Clone, Debug, PartialEq)]
pub struct StepOutcome {
    /// Observation after the action.
    pub observation: Observation,
    /// End reason, if the episode has ended.
    pub end: Option<EndReason>,
}

/// Audio assets named by the rules: clip bank and head.
#[derive(Clone, Debug, Default)]
pub struct Audio {
    /// Clip bank.
    pub bank: Bank,
    /// Listener's head.
    pub head: Head,
}

impl From<Bank> for Audio {
    /// Combines a bank with the spherical head.
    fn from(bank: Bank) -> Self {
        Self { bank, head: Head::default() }
    }
}

/// Error at the start or during an episode.
#[expect(missing_docs, reason = "the messages explain the fields")]
#[derive(Debug, thiserror::Error)]
pub enum RefereeError {
    /// Action after the episode's end.
    #[error("the episode ended after {steps} steps ({}); request the next episode", reason.as_str())]
    Over { reason: EndReason, steps: u32 },
    /// Different state in a replay.
    #[error(
        "step {step} now leads to state {replayed:016x} instead of {recorded:016x}; the scene, the rules or the program changed"
    )]
    Diverged { step: u32, recorded: u64, replayed: u64 },
    /// Sensors outside the limits.
    #[error(transparent)]
    Sensors(#[from] SensorsError),
    /// Different goal counts in mission and truth.
    #[error("episode {episode}: the mission has {goals} goals, its truth {targets} targets (the limit is 8)")]
    Mismatch { episode: String, goals: usize, targets: usize },
    /// Too few distractor sources in the truth.
    #[error("episode {episode}: rules '{rules}' need {needed} distractor sources, the truth has {found}")]
    Distractors { episode: String, rules: String, needed: usize, found: usize },
    /// Start pose outside the walkable floor.
    #[error("episode {episode}: {source}")]
    Start { episode: String, source: StartError },
    /// Too few clips in the bank.
    #[error("episode {episode}: {source}")]
    Sounds { episode: String, source: TooFewClips },
}
