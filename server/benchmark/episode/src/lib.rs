//! Public episode types: mission, goal cues, actions, observations, limits, end reasons, rules.
//!
//! Entry points: [`Mission`], [`Action`], [`Observation`] and [`Rules`].
//!
//! This crate never reveals a target's identity, position or category outside its cue or does I/O.

mod mission;
mod observation;
mod options;
mod rules;

pub use avln_geom::{Point3, Pose};
pub use mission::{Action, GoalCue, Mission, Modality, Order, RgbImage, UnknownAction, UnknownOrder};
pub use observation::{
    Encoding, Encodings, EndReason, Feedback, Observation, Sensors, SensorsError, UnknownEndReason,
};
pub use options::{DistractorSources, ExtraSubmit, StopClaims, TimeLimits, UnknownDistractorSources};
pub use rules::{
    DepthNoise, DistanceRule, FeedbackRule, HeadRule, PoseFrame, RgbNoise, Rules, SilenceRule, SoundClip,
    SoundingRule, Sounds, UnknownRules, WrongSubmit,
};
