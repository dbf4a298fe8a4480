//! Missions and observations.

use crate::action::{Action, Order};
use crate::error::Error;
use avln_proto::v1;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::fmt;

/// An episode's mission.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mission {
    /// Goal order.
    pub order: Order,
    /// 2 to 4 goals.
    pub goals: Vec<GoalCue>,
}

/// A goal cue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GoalCue {
    /// The target's category label.
    Category(String),
    /// A sentence that matches only the target.
    Description(String),
    /// A target image.
    Image(RgbImage),
}

/// An image: `height × width × 3` bytes, row-major from the top-left pixel, RGB.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct RgbImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes.
    pub pixels: Vec<u8>,
}

/// An image from the agent's camera.
pub type Image = RgbImage;

impl fmt::Debug for RgbImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "RgbImage({} x {})", self.width, self.height)
    }
}

impl Mission {
    pub(crate) fn from_wire(mission: Option<v1::Mission>) -> Result<Self, Error> {
        let mission = mission.ok_or_else(|| Error::protocol("EpisodeStart has no mission"))?;
        let order = Order::from_wire(mission.order)
            .ok_or_else(|| Error::protocol(format!("order {} does not exist", mission.order)))?;
        let goals = mission.goals.into_iter().map(GoalCue::from_wire).collect::<Result<_, _>>()?;
        Ok(Self { order, goals })
    }
}

impl GoalCue {
    fn from_wire(goal: v1::Goal) -> Result<Self, Error> {
        use v1::goal::Cue;
        match goal.cue {
            Some(Cue::Category(label)) => Ok(Self::Category(label)),
            Some(Cue::Description(text)) => Ok(Self::Description(text)),
            Some(Cue::Image(tensor)) => image(tensor).map(Self::Image),
            None => Err(Error::protocol("a goal has no cue known to this client")),
        }
    }
}

fn image(tensor: v1::Tensor) -> Result<RgbImage, Error> {
    let raw = tensor.encoding() == v1::Encoding::Raw && tensor.dtype() == v1::Dtype::U8;
    let &[height, width, 3] = tensor.shape.as_slice() else {
        return Err(Error::protocol(format!(
            "goal image: expected shape [height, width, 3], got {:?}",
            tensor.shape
        )));
    };
    // In 64 bits and saturating, because the shape may contain any numbers.
    let bytes = (u64::from(height) * u64::from(width)).saturating_mul(3);
    if !raw || tensor.data.len() as u64 != bytes {
        return Err(Error::protocol(format!(
            "goal image of {width} x {height} pixels: expected {bytes} raw bytes, got {}",
            tensor.data.len()
        )));
    }
    Ok(RgbImage { width, height, pixels: tensor.data.into() })
}

/// Sensor readings after a step. Sensors not requested are `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observation {
    /// Steps taken; 0 before the first action.
    pub step: u32,
    /// Colour image.
    pub rgb: Option<Image>,
    /// Depth image.
    pub depth: Option<DepthImage>,
    /// Sound during the step.
    pub audio: Option<Audio>,
    /// Body base, in [`TaskSpec::pose_frame`](crate::TaskSpec::pose_frame).
    pub pose: Pose,
    /// Remaining steps.
    pub remaining_steps: u32,
    /// Remaining Submits, N - 1 at the start of a mission with N goals. At 0, claim the last goal with Stop.
    pub remaining_submits: u32,
    /// Feedback to a Submit in this step.
    pub feedback: Feedback,
}

impl Observation {
    /// Returns the action that claims a goal here: Submit, or Stop without Submits left.
    pub fn claim(&self) -> Action {
        if self.remaining_submits > 0 { Action::Submit } else { Action::Stop }
    }
}

/// Planar depth: `height × width` metres, row-major from the top-left pixel; 0 without a hit in sensor range.
#[derive(Clone, Default, PartialEq)]
pub struct DepthImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Distances.
    pub metres: Vec<f32>,
}

/// Sound pressure at both ears during a step.
#[derive(Clone, Default, PartialEq)]
pub struct Audio {
    /// Samples per second.
    pub sample_rate_hz: u32,
    /// Left ear.
    pub left: Vec<f32>,
    /// Right ear, equal length.
    pub right: Vec<f32>,
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

/// Position and heading of the body. Right-handed, Y up; heading 0 looks to -Z, positive is a left turn.
///
/// ```
/// use avln_client::{Pose, nalgebra::Point3};
///
/// // A wall 2 m ahead of a body that has turned left by a quarter.
/// let pose = Pose::new([1.0, 0.0, 0.0], std::f32::consts::FRAC_PI_2);
/// let wall = pose.isometry() * Point3::new(0.0, 1.0, -2.0);
/// assert!((wall - Point3::new(-1.0, 1.0, 0.0)).norm() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    isometry: Isometry3<f32>,
    // Kept beside the rotation, because an angle from a quaternion differs from the sent one in the last bits.
    heading_rad: f32,
}

impl Pose {
    /// Creates a pose from a position (x right, y up, z back, metres) and a heading about +Y.
    pub fn new(position: [f32; 3], heading_rad: f32) -> Self {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), heading_rad);
        Self { isometry: Isometry3::from_parts(Translation3::from(position), turn), heading_rad }
    }

    /// Returns the base of the body, metres: x right, y up, z back.
    pub fn position(&self) -> [f32; 3] {
        self.isometry.translation.vector.into()
    }

    /// Returns the heading about +Y, radians, -π to π.
    pub fn heading_rad(&self) -> f32 {
        self.heading_rad
    }

    /// Returns the transform from the body's frame (-Z ahead) to the frame of poses.
    pub fn isometry(&self) -> &Isometry3<f32> {
        &self.isometry
    }
}

impl From<Pose> for Isometry3<f32> {
    /// Returns [`Pose::isometry`].
    fn from(pose: Pose) -> Self {
        pose.isometry
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use v1::goal::Cue;

    fn goal_with_picture(shape: Vec<u32>, bytes: usize) -> v1::Goal {
        let tensor = v1::Tensor {
            id: 0,
            dtype: v1::Dtype::U8 as i32,
            shape,
            encoding: v1::Encoding::Raw as i32,
            data: vec![7; bytes].into(),
        };
        v1::Goal { cue: Some(Cue::Image(tensor)) }
    }

    #[test]
    fn claims_without_submits_left_are_stops() {
        let claim = |remaining_submits| Observation { remaining_submits, ..Observation::default() }.claim();
        assert_eq!([claim(2), claim(1), claim(0)], [Action::Submit, Action::Submit, Action::Stop]);
    }

    #[test]
    fn the_three_kinds_of_cue_arrive() {
        let wire = v1::Mission {
            order: v1::Order::Ordered as i32,
            goals: vec![
                v1::Goal { cue: Some(Cue::Category("chair".into())) },
                v1::Goal { cue: Some(Cue::Description("the red lamp".into())) },
                goal_with_picture(vec![2, 4, 3], 24),
            ],
        };
        let mission = Mission::from_wire(Some(wire)).unwrap();
        assert_eq!(mission.order, Order::Ordered);
        assert_eq!(mission.goals[0], GoalCue::Category("chair".into()));
        assert_eq!(mission.goals[1], GoalCue::Description("the red lamp".into()));
        assert_eq!(mission.goals[2], GoalCue::Image(RgbImage { width: 4, height: 2, pixels: vec![7; 24] }));
    }

    #[test]
    fn broken_cues_are_refused() {
        assert!(GoalCue::from_wire(v1::Goal { cue: None }).is_err());
        assert!(GoalCue::from_wire(goal_with_picture(vec![2, 4], 24)).is_err());
        assert!(GoalCue::from_wire(goal_with_picture(vec![2, 4, 3], 23)).is_err());
        assert!(GoalCue::from_wire(goal_with_picture(vec![u32::MAX, u32::MAX, 3], 23)).is_err());
        assert!(Mission::from_wire(None).is_err());
    }

    #[test]
    fn positions_and_headings_keep_their_bits() {
        let pose = Pose::new([0.1, -2.3, 1e-7], -1.000_000_1);
        assert_eq!(pose.position().map(f32::to_bits), [0.1_f32, -2.3, 1e-7].map(f32::to_bits));
        assert_eq!(pose.heading_rad().to_bits(), (-1.000_000_1_f32).to_bits());
        assert_eq!(Pose::default(), Pose::new([0.0; 3], 0.0));
    }

    #[test]
    fn isometries_map_ahead_to_the_heading() {
        let pose = Pose::new([3.0, 0.5, -1.0], 2.0);
        let ahead = Isometry3::from(pose) * Point3::new(0.0, 0.0, -1.0);
        let (sin, cos) = 2.0_f32.sin_cos();
        assert!((ahead - Point3::new(3.0 - sin, 0.5, -1.0 - cos)).norm() < 1e-6);
    }
}
