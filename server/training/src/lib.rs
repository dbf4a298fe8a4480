//! Episodes in process for training.
//!
//! In reading order: an [`EpisodeSource`] has the missions of training houses, an [`Env`] plays them one after another, and a
//! [`VectorEnv`] plays many environments on worker threads. [`Layout`] lists the arrays of an observation; a [`Row`] is the
//! caller's memory of one environment, and an [`OwnedRow`] has memory of its own.
//!
//! This crate never accepts validation or test pools or sealed splits, and it is never linked by servers or clients of an
//! evaluation: it shows ground truth to the learner.

mod env;
mod explorer;
mod layout;
mod map;
mod options;
mod privileged;
mod scenes;
mod senses;
mod source;
mod top_down;
mod vector;

pub use avln_world::Detail;
pub use env::{Env, EnvState, StepFlags};
pub use layout::{ArrayKind, ArraySpec, Layout, OwnedArray, OwnedRow, Row, RowArray};
pub use options::{AutoReset, Curriculum, EnvOptions, Goals, ProgressReward, RewardRule};
pub use privileged::Teacher;
pub use senses::CheapSenses;
pub use source::{EpisodeSource, SourceChoice, SourceOptions, TrainingEpisode};
pub use top_down::{Overview, TargetMark};
pub use vector::{Finished, RowSource, VectorEnv};

use avln_dataset::DatasetError;
use avln_referee::RefereeError;
use std::path::PathBuf;

/// Error in options, a source, or a step.
#[expect(missing_docs, reason = "the messages explain the fields")]
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// Unknown recipe.
    #[error("recipe '{name}' does not exist; use one of: {known}")]
    UnknownRecipe { name: String, known: String },
    /// Houses outside the training pool.
    #[error("{source_name} has houses of the pool '{pool}'; training needs houses of the pool 'train'")]
    Pool { source_name: String, pool: String },
    /// Scene file without a confirmed purpose.
    #[error("{source_name} may belong to a test split; confirm that it is for training with `training=True`")]
    Unconfirmed { source_name: String },
    /// Sealed split.
    #[error("split {} is sealed; training needs an open split", .0.display())]
    Sealed(PathBuf),
    /// Unreadable file.
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// Missing split in a data set.
    #[error("data set {} has no split '{split}'; it has: {known}", path.display())]
    UnknownSplit { path: PathBuf, split: String, known: String },
    /// No mission within the curriculum.
    #[error("scene {scene} has no mission within the curriculum ({curriculum}); widen its limits")]
    NoMission { scene: String, curriculum: String },
    /// Rules with more distractor sources than a scene has other targets.
    #[error(
        "rules '{rules}' need more distractor sources than any of the scenes has other targets; use larger scenes"
    )]
    FewSources { rules: String },
    /// Option outside its limits.
    #[error("`{option}` is {value}; {limits}")]
    Option { option: &'static str, value: String, limits: String },
    /// Invalid scene or data set.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Invalid episode or action.
    #[error(transparent)]
    Referee(#[from] RefereeError),
    /// Invalid action number.
    #[error("environment {env}: {source}")]
    Action { env: usize, source: avln_episode::UnknownAction },
    /// Step before the first reset.
    #[error("environment {0} has no episode; call reset first")]
    NotReset(usize),
    /// State of another environment or program.
    #[error("cannot restore the state: {0}")]
    State(String),
    /// Number beyond the environments.
    #[error("environment {env} does not exist; the last one is {}", count - 1)]
    UnknownEnv { env: usize, count: usize },
    /// Thread refused by the system.
    #[error("cannot start a worker thread: {0}; choose fewer `threads`")]
    Thread(std::io::Error),
    /// A failure that other environments share.
    #[error("{0}")]
    Shared(String),
}
