use crate::Image;
use std::fmt;

/// Sensor readings after a step. Sensors not requested are `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observation {
    /// Steps taken; 0 before the first action.
    pub step: u32,
    /// The colour picture.
    pub rgb: Option<Image>,
    /// The depth picture.
    pub depth: Option<DepthImage>,
    /// Sound during the step.
    pub audio: Option<Audio>,
    /// Body base, in the frame that [`TaskSpec::pose_frame`](crate::TaskSpec::pose_frame) names.
    pub pose: Pose,
    /// Steps that are left.
    pub remaining_steps: u32,
    /// Remaining Submits before the final Submit.
    pub remaining_submits: u32,
    /// Feedback to a Submit in this step.
    pub feedback: Feedback,
}

/// Planar depth: `height × width` metres, row-major from the top-left pixel; 0 without a hit in sensor range.
#[derive(Clone, Default, PartialEq)]
pub struct DepthImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The distances.
    pub metres: Vec<f32>,
}

/// Sound pressure at both ears during a step.
#[derive(Clone, Default, PartialEq)]
pub struct Audio {
    /// Samples a second.
    pub sample_rate_hz: u32,
    /// The left ear's samples.
    pub left: Vec<f32>,
    /// Right ear, equal length.
    pub right: Vec<f32>,
}

/// Position and heading. Right-handed, Y up; heading 0 looks along -Z, positive is a left turn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Metres: x right, y up, z back.
    pub position: [f32; 3],
    /// Radians about +Y, -π to π.
    pub heading_rad: f32,
}

/// Feedback to a Submit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Feedback {
    /// No Submit, or no feedback by the rules.
    #[default]
    None,
    /// The Submit was counted; the verdict is hidden.
    Accepted,
    /// True if the Submit completed a goal.
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
