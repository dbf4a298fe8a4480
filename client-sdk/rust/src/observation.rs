use crate::Image;
use std::fmt;

/// What the agent senses after a step. Sensors that were not asked for are `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observation {
    /// Steps taken so far; 0 is the observation before the first action.
    pub step: u32,
    /// The colour picture.
    pub rgb: Option<Image>,
    /// The depth picture.
    pub depth: Option<DepthImage>,
    /// What the ears heard during the step.
    pub audio: Option<Audio>,
    /// Base of the body, in the frame that [`TaskSpec::pose_frame`](crate::TaskSpec::pose_frame) names.
    pub pose: Pose,
    /// Steps that are left.
    pub remaining_steps: u32,
    /// Submits that are left before one is final.
    pub remaining_submits: u32,
    /// What the rules let the agent know about a Submit made in this step.
    pub feedback: Feedback,
}

/// Distances along the optical axis: `height × width` metres, row-major from the top-left pixel; 0 where nothing was
/// hit within the sensor's range.
#[derive(Clone, Default, PartialEq)]
pub struct DepthImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The distances.
    pub metres: Vec<f32>,
}

/// Sound pressure at both ears during one step.
#[derive(Clone, Default, PartialEq)]
pub struct Audio {
    /// Samples a second.
    pub sample_rate_hz: u32,
    /// The left ear's samples.
    pub left: Vec<f32>,
    /// The right ear's samples, as many.
    pub right: Vec<f32>,
}

/// Place and heading. Right-handed, Y up; at heading 0 the agent looks along -Z, a positive heading is a left turn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Metres: x right, y up, z back.
    pub position: [f32; 3],
    /// Radians about +Y, -π to π.
    pub heading_rad: f32,
}

/// What the agent learns from a Submit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Feedback {
    /// Nothing: no Submit was made, or the rules are silent.
    #[default]
    None,
    /// The Submit was counted; nothing is said about the match.
    Accepted,
    /// Whether the Submit completed a goal.
    Verdict(bool),
}

impl fmt::Debug for DepthImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "DepthImage({} x {})", self.width, self.height)
    }
}

impl fmt::Debug for Audio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Audio(2 x {} at {} Hz)", self.left.len(), self.sample_rate_hz)
    }
}
