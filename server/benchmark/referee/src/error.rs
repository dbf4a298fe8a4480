use crate::sounds::TooFewClips;
use avln_episode::{EndReason, SensorsError};
use avln_world::StartError;

/// Error at the start or during an episode.
#[derive(Debug, thiserror::Error)]
pub enum RefereeError {
    /// Action after the end of the episode.
    #[error("the episode ended after {steps} steps ({}); request the next episode", reason.as_str())]
    Over {
        /// End reason.
        reason: EndReason,
        /// Steps taken.
        steps: u32,
    },
    /// Different state in a replay.
    #[error(
        "step {step} now leads to state {replayed:016x} instead of {recorded:016x}; the scene, the rules or the program changed"
    )]
    Diverged {
        /// Step number from 1.
        step: u32,
        /// Recorded state hash.
        recorded: u64,
        /// Replayed state hash.
        replayed: u64,
    },
    /// Sensors outside the limits.
    #[error(transparent)]
    Sensors(#[from] SensorsError),
    /// Different goal counts in mission and truth.
    #[error("episode {episode}: the mission has {goals} goals, its truth {targets} targets (the limit is 8)")]
    Mismatch {
        /// Id of the episode.
        episode: String,
        /// Goals of the mission.
        goals: usize,
        /// Targets of the truth.
        targets: usize,
    },
    /// Start pose outside the walkable floor.
    #[error("episode {episode}: {source}")]
    Start {
        /// Id of the episode.
        episode: String,
        /// Cause.
        source: StartError,
    },
    /// Too few clips in the bank.
    #[error("episode {episode}: {source}")]
    Sounds {
        /// Id of the episode.
        episode: String,
        /// Cause.
        source: TooFewClips,
    },
}
