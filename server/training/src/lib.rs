//! Episodes in process for training.
//!
//! In reading order: an [`EpisodeSource`] has the missions of training houses, an [`Env`] plays them one after another, and a
//! [`VectorEnv`] plays many environments on worker threads. [`Layout`] lists the arrays of an observation; a [`Row`] has the
//! memory of one environment.
//!
//! This crate never accepts validation or test pools or sealed splits, and it is never linked by servers or clients of an
//! evaluation: it shows ground truth to the learner.

mod ears;
mod env;
mod error;
mod explorer;
mod floor_grid;
mod layout;
mod lidar;
mod map;
mod options;
mod overview;
mod privileged;
mod results;
mod reward;
mod scenes;
mod senses;
mod source;
mod teacher;
mod top_down;
mod vector;

pub use env::{Env, EnvState, StepFlags};
pub use error::TrainingError;
pub use layout::{ArrayKind, ArraySpec, Layout, Row, RowArray};
pub use options::{AutoReset, Curriculum, EnvOptions, Goals, RewardRule};
pub use overview::{Overview, TargetMark};
pub use reward::ProgressReward;
pub use senses::CheapSenses;
pub use source::{EpisodeSource, SourceChoice, SourceOptions, TrainingEpisode};
pub use teacher::Teacher;
pub use vector::{Finished, RowSource, VectorEnv};
