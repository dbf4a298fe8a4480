//! From instances to cues, from cues to missions, from missions to splits and data sets.
//!
//! The pipeline, in reading order: [`survey()`] finds the instances of a scene that can be targets,
//! [`sample_missions`] draws missions among them, a [`Split`] holds the missions of several scenes in memory.
//! [`build_scene`] does all of it for one scene of a [`Recipe`] and gives back files of the [`mod@format`];
//! [`check_scene`] verifies them again by other means.
//!
//! *Never*: depends on a clock or on the order of a hash; tells an agent more than its mission; touches a disk.

mod build;
mod check;
mod cue;
mod describe;
pub mod format;
mod mission;
mod reference;
mod split;
mod stats;
mod survey;

pub use build::{BuiltScene, Job, MissionRules, Recipe, SceneChoice, SplitRecipe, build_scene};
pub use check::{Constraint, Depth, Fault, check_scene};
pub use cue::{CueSpec, Description, View};
pub use describe::Claims;
pub use format::{FormatError, Manifest, PublicGoal, PublicMission, SceneFacts, SceneLine, SplitLine};
pub use mission::{
    EpisodeSpec, GoalSpec, MissionOptions, ReferenceTour, StepGoal, reference_tours, sample_missions,
};
pub use split::{DatasetError, SceneSource, SceneSpec, Split};
pub use stats::{Spread, Statistics, page, summary};
pub use survey::{Instance, SurveyOptions, ThresholdsOnly, Verifier, survey, survey_with, target_at};
