//! From instances to cues, from cues to missions, from missions to splits.
//!
//! The pipeline, in reading order: [`survey()`] finds the instances of a scene that can be targets,
//! [`sample_missions`] draws missions among them, a [`Split`] holds the missions of several scenes.
//!
//! *Never*: depends on a clock or on the order of a hash; tells an agent more than its mission.

mod cue;
mod describe;
mod mission;
mod picture;
mod reference;
mod split;
mod survey;

pub use cue::{CueSpec, View};
pub use mission::{EpisodeSpec, GoalSpec, MissionOptions, ReferenceTour, sample_missions};
pub use split::{DatasetError, SceneSource, SceneSpec, Split};
pub use survey::{Instance, SurveyOptions, ThresholdsOnly, Verifier, survey, survey_with};
