//! Data set pipeline: scene instances, goal cues, missions, splits.
//!
//! In reading order: [`survey()`] finds potential targets in a scene, [`sample_missions`] draws missions, and a [`Split`]
//! has missions for several scenes in memory. [`build_scene`] runs the pipeline for a scene in a [`Recipe`] and returns
//! files in the [`mod@format`]; [`check_scene`] verifies them independently.
//!
//! This crate never depends on a clock or on hash order, puts hidden data into public files, or touches a
//! disk.

mod build;
mod check;
mod cue;
mod describe;
mod distractors;
mod error;
pub mod format;
mod mission;
mod recipe;
mod reference;
mod split;
mod stats;
mod survey;

pub use build::{BuiltScene, Job, build_scene, build_scene_with};
pub use check::{Constraint, Depth, Fault, check_recognition, check_scene};
pub use cue::{Claims, CueSpec, CueView, Description};
pub use distractors::SceneMissions;
pub use error::{DatasetError, FormatError};
pub use format::{Manifest, PublicGoal, PublicMission, SceneFacts, SceneLine, SecretFile, SplitLine};
pub use mission::{
    EpisodeSpec, GoalSpec, MissionOptions, ReferenceTour, StepGoal, reference_tours, sample_missions,
};
pub use recipe::{MissionRules, Recipe, SceneChoice, Seed, SplitRecipe, SplitSecret};
pub use split::{SceneSource, SceneSpec, Split};
pub use stats::{Lengths, Spread, Statistics, page, summary};
pub use survey::{
    DetectorView, Instance, Removals, Survey, SurveyOptions, ThresholdsOnly, Verifier, VerifierId,
    distractors, survey, survey_with, target_at,
};
