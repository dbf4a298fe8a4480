//! What an agent may know: mission, goal cues, actions, observations, limits, end reasons and the rules.
//!
//! Start reading at [`Mission`], [`Action`], [`Observation`] and [`Rules`].
//!
//! *Never*: holds a target's identity, place or category beside its cue; does I/O.

mod action;
mod encoding;
mod mission;
mod observation;
mod rules;
mod time_limits;

pub use action::{Action, UnknownAction};
pub use avln_geom::{Point3, Pose};
pub use encoding::{Encoding, Encodings};
pub use mission::{GoalCue, Mission, Modality, Order, RgbImage, UnknownOrder};
pub use observation::{EndReason, Feedback, Observation, Sensors, SensorsError};
pub use rules::{
    DepthNoise, DistanceRule, FeedbackRule, HeadRule, PoseFrame, RgbNoise, Rules, SoundClip, SoundingRule,
    Sounds, UnknownRules, WrongSubmit,
};
pub use time_limits::TimeLimits;
