//! Sensors and task rules.

use crate::{action::wire_enum, connect_options::Packing, error::Error};
use avln_proto::v1;
use std::f32::consts::{FRAC_PI_2, PI};

/// Requested sensors and their settings. Other sensors are not rendered or sent.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// True to request colour images.
    pub rgb: bool,
    /// True to request depth images.
    pub depth: bool,
    /// True to request sound.
    pub audio: bool,
    /// Pixels in a row, 64 to 1024.
    pub width: u32,
    /// Rows, 64 to 1024.
    pub height: u32,
    /// Horizontal view angle, radians, 0.35 to 2.4.
    pub hfov_rad: f32,
}

impl Default for Sensors {
    /// All sensors at 256 × 256 pixels with a view of 90 degrees.
    fn default() -> Self {
        Self::square(256)
    }
}

impl Sensors {
    /// All sensors at `side` × `side` pixels with a view of 90 degrees.
    pub fn square(side: u32) -> Self {
        Self { rgb: true, depth: true, audio: true, width: side, height: side, hfov_rad: FRAC_PI_2 }
    }

    pub(crate) fn to_wire(&self, packing: Packing) -> Result<v1::SensorSubscription, Error> {
        let Self { width, height, hfov_rad, .. } = *self;
        let side = 64..=1024;
        if !(side.contains(&width) && side.contains(&height) && (0.35..=2.4).contains(&hfov_rad)) {
            return Err(Error::Sensors { width, height, hfov_rad });
        }
        let wishes = self.kinds().map(|kind| {
            let encodings = packing.wishes(kind).into_iter().map(i32::from).collect();
            v1::SensorWish { kind: kind as i32, encodings }
        });
        Ok(v1::SensorSubscription { wishes: wishes.collect(), width, height, hfov_rad })
    }

    pub(crate) fn kinds(&self) -> impl Iterator<Item = v1::SensorKind> {
        use v1::SensorKind::{Audio, Depth, Rgb};
        let wanted = [(self.rgb, Rgb), (self.depth, Depth), (self.audio, Audio)];
        wanted.into_iter().filter_map(|(wanted, kind)| wanted.then_some(kind))
    }
}

wire_enum! {
    /// Pose frame.
    PoseFrame {
        /// Relative to the start pose; the first pose is zero.
        Start,
        /// Scene frame.
        World,
    }
}
wire_enum! {
    /// Success distance definition and visibility.
    DistanceRule {
        /// Camera to the target's box, Euclidean, on the target's floor, with a line of sight at some heading.
        CameraToBox,
        /// Base to the nearest viewpoint, geodesic, with a visible target pixel.
        BaseToViewpoint,
        /// Camera to the target's nearest triangle, Euclidean, otherwise as [`CameraToBox`](DistanceRule::CameraToBox).
        CameraToMesh,
    }
}
wire_enum! {
    /// Wrong Submit's effect in an ordered mission.
    WrongSubmit {
        /// The Submit is spent, the goal remains next.
        KeepsGoal,
        /// The Submit is spent and the goal can no longer be found.
        SkipsGoal,
    }
}
wire_enum! {
    /// Feedback to a Submit.
    FeedbackRule {
        /// No feedback.
        None,
        /// Acceptance without a verdict.
        Accepted,
        /// Correct or wrong.
        Verdict,
    }
}
wire_enum! {
    /// Sounding schedule.
    SoundingRule {
        /// Unfinished targets in turn, in an order drawn per episode; a found target falls silent, see [`SilenceRule`].
        UnfinishedInDrawnOrder,
        /// All targets in goal order, repeated. Leaks: the time reveals the goal index.
        AllInGoalOrder,
    }
}
wire_enum! {
    /// Silence of a found target; [`Other`](SilenceRule::Other) for older servers, where it is immediate.
    SilenceRule {
        /// At once, in the observation after the Submit.
        Immediate,
        /// 5 to 20 steps after the Submit, drawn for every episode and goal.
        Delayed,
        /// At the end of the target's present turn.
        WindowEnd,
    }
}
wire_enum! {
    /// Effect of a Submit without Submits left; [`Other`](ExtraSubmit::Other) for older servers, where it ends the episode.
    ExtraSubmit {
        /// Uses a step, without a judgement.
        Ignored,
        /// Judged, and ends the episode.
        EndsEpisode,
    }
}
wire_enum! {
    /// Goals open to a Stop; [`Other`](StopClaims::Other) for older servers, where any open goal counts.
    StopClaims {
        /// As for a Submit: the next goal, or any open goal in an unordered mission.
        AnyOpen,
        /// The last open goal; none if several are open.
        LastOnly,
    }
}
wire_enum! {
    /// Sound clip assignment.
    SoundClip {
        /// A single clip per episode, drawn independently of the targets.
        Anonymous,
        /// A clip per target, drawn independently of it.
        Distinct,
        /// A clip per category. Leaks: the clip reveals the category.
        ByCategory,
    }
}

wire_enum! {
    /// Depth noise; [`Other`](DepthNoise::Other) for servers without noise support, which send exact depth.
    DepthNoise {
        /// None.
        None,
        /// A structured-light camera (Choi, Zhou and Koltun 2015): edges jitter by 0.25 pixels on every other
        /// pixel; disparity, 35.13 pixels at 1 m, has a deviation of 1/36 pixel and steps of 1/8.
        Redwood,
    }
}
wire_enum! {
    /// Colour noise; [`Other`](RgbNoise::Other) for servers without noise support, which send exact colours.
    RgbNoise {
        /// None.
        None,
        /// A normal deviate with 51 grey levels in every channel, cut off at 0 and 255.
        Gaussian,
    }
}

/// Task rules for all episodes in a run.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskSpec {
    /// Rule set name and version, for example `lh-avln-v1`.
    pub rules: String,
    /// MoveForward length, metres.
    pub forward_m: f32,
    /// TurnLeft and TurnRight angle, radians.
    pub turn_rad: f32,
    /// TurnLeft and TurnRight angle, degrees; divides 360.
    pub turn_deg: u32,
    /// Simulated time per step, seconds.
    pub step_s: f32,
    /// Step limit per episode; every action counts.
    pub max_steps: u32,
    /// Body radius, metres.
    pub body_radius_m: f32,
    /// Body height, metres.
    pub body_height_m: f32,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Horizontal view angle, radians. Pixels are square, the camera looks level.
    pub hfov_rad: f32,
    /// Camera height above the base, metres.
    pub camera_height_m: f32,
    /// Ear height above the base, metres.
    pub ear_height_m: f32,
    /// Depth sensor range, metres; beyond it depth is 0.
    pub depth_max_m: f32,
    /// Samples per second and ear.
    pub sample_rate_hz: u32,
    /// Samples per ear and observation.
    pub audio_samples: u32,
    /// Samples per ear and simulated step; the rest is 0.
    pub samples_per_step: u32,
    /// Pose frame.
    pub pose_frame: PoseFrame,
    /// Success radius, metres.
    pub success_radius_m: f32,
    /// Success distance definition.
    pub success_distance: DistanceRule,
    /// Wrong Submit's effect in an ordered mission.
    pub wrong_submit: WrongSubmit,
    /// Effect of a Submit without Submits left.
    pub extra_submit: ExtraSubmit,
    /// Goals open to a Stop.
    pub stop_claims: StopClaims,
    /// Feedback to a Submit.
    pub feedback: FeedbackRule,
    /// Sounding schedule.
    pub sounding: SoundingRule,
    /// Sounding steps per target and turn.
    pub sounding_window_steps: u32,
    /// Silence of found targets.
    pub silence: SilenceRule,
    /// Sounding distractors per episode, besides those per goal; see [`TaskSpec::sounding_sources`].
    pub distractor_sources: u32,
    /// Sounding distractors per goal of the episode.
    pub distractor_sources_per_goal: u32,
    /// Sound clip assignment.
    pub sound_clip: SoundClip,
    /// Source height above the target centre, metres.
    pub source_lift_m: f32,
    /// Depth noise. The server judges without noise, and goal images have none.
    pub depth_noise: DepthNoise,
    /// Colour noise.
    pub rgb_noise: RgbNoise,
    /// Head model: `None` for a rigid sphere with a radius of 8.75 cm and ears at 100 degrees from straight
    /// ahead, otherwise the hexadecimal BLAKE3 hash of a measured head's SOFA file.
    pub head: Option<String>,
}

impl Default for TaskSpec {
    /// The rule set `lh-avln-v1` with [`Sensors::default`].
    fn default() -> Self {
        Self {
            rules: "lh-avln-v1".to_owned(),
            forward_m: 0.25,
            turn_rad: PI / 6.0,
            turn_deg: 30,
            step_s: 0.25,
            max_steps: 1000,
            body_radius_m: 0.1,
            body_height_m: 1.5,
            width: 256,
            height: 256,
            hfov_rad: FRAC_PI_2,
            camera_height_m: 1.0,
            ear_height_m: 1.0,
            depth_max_m: 10.0,
            sample_rate_hz: 16_000,
            audio_samples: 4000,
            samples_per_step: 4000,
            pose_frame: PoseFrame::Start,
            success_radius_m: 2.0,
            success_distance: DistanceRule::CameraToBox,
            wrong_submit: WrongSubmit::KeepsGoal,
            extra_submit: ExtraSubmit::Ignored,
            stop_claims: StopClaims::AnyOpen,
            feedback: FeedbackRule::None,
            sounding: SoundingRule::UnfinishedInDrawnOrder,
            sounding_window_steps: 25,
            silence: SilenceRule::Immediate,
            distractor_sources: 0,
            distractor_sources_per_goal: 0,
            sound_clip: SoundClip::Anonymous,
            source_lift_m: 0.0,
            depth_noise: DepthNoise::None,
            rgb_noise: RgbNoise::None,
            head: None,
        }
    }
}

impl TaskSpec {
    /// Most sources in an episode: a larger number from a server is an error.
    const MAX_SOURCES: u32 = 64;

    /// Returns the number of sound sources at the start of a mission with `goals` goals: targets and distractors, which have
    /// equal turns.
    pub fn sounding_sources(&self, goals: usize) -> usize {
        goals + self.distractor_sources as usize + self.distractor_sources_per_goal as usize * goals
    }

    pub(crate) fn from_wire(task: &v1::TaskSpec) -> Result<Self, Error> {
        check_numbers(task)?;
        Ok(Self {
            rules: task.rules.clone(),
            forward_m: task.forward_m,
            turn_rad: (task.turn_deg as f32).to_radians(),
            turn_deg: task.turn_deg,
            step_s: task.step_s,
            max_steps: task.max_steps,
            body_radius_m: task.body_radius_m,
            body_height_m: task.body_height_m,
            width: task.width,
            height: task.height,
            hfov_rad: task.hfov_rad,
            camera_height_m: task.camera_height_m,
            ear_height_m: task.ear_height_m,
            depth_max_m: task.depth_max_m,
            sample_rate_hz: task.sample_rate_hz,
            audio_samples: task.audio_samples,
            samples_per_step: task.samples_per_step,
            pose_frame: PoseFrame::from_wire(task.pose_frame),
            success_radius_m: task.success_radius_m,
            success_distance: DistanceRule::from_wire(task.success_distance),
            wrong_submit: WrongSubmit::from_wire(task.wrong_submit),
            extra_submit: ExtraSubmit::from_wire(task.extra_submit),
            stop_claims: StopClaims::from_wire(task.stop_claims),
            feedback: FeedbackRule::from_wire(task.feedback),
            sounding: SoundingRule::from_wire(task.sounding),
            sounding_window_steps: task.sounding_window_steps,
            silence: SilenceRule::from_wire(task.silence),
            distractor_sources: task.distractor_sources,
            distractor_sources_per_goal: task.distractor_sources_per_goal,
            sound_clip: SoundClip::from_wire(task.sound_clip),
            source_lift_m: task.source_lift_m,
            depth_noise: DepthNoise::from_wire(task.depth_noise),
            rgb_noise: RgbNoise::from_wire(task.rgb_noise),
            head: Some(task.head.clone()).filter(|digest| !digest.is_empty()),
        })
    }
}

fn check_numbers(task: &v1::TaskSpec) -> Result<(), Error> {
    // Agents divide by these numbers or loop over them.
    let positive = [
        ("forward_m", task.forward_m),
        ("step_s", task.step_s),
        ("hfov_rad", task.hfov_rad),
        ("depth_max_m", task.depth_max_m),
        ("depth_divisor", task.depth_divisor),
        ("success_radius_m", task.success_radius_m),
        ("turn_deg", task.turn_deg as f32),
        ("max_steps", task.max_steps as f32),
        ("sample_rate_hz", task.sample_rate_hz as f32),
    ];
    let sources = [task.distractor_sources, task.distractor_sources_per_goal];
    if let Some(value) = sources.into_iter().find(|&value| value > TaskSpec::MAX_SOURCES) {
        let most = TaskSpec::MAX_SOURCES;
        return Err(Error::protocol(format!(
            "Welcome.task: expected at most {most} distractor sources, got {value}"
        )));
    }
    match positive.iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
        Some((name, value)) => {
            Err(Error::protocol(format!("Welcome.task.{name}: expected a positive number, got {value}")))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_range_sensors_are_never_sent() {
        assert!(Sensors::default().to_wire(Packing::Raw).is_ok());
        assert!(matches!(Sensors::square(63).to_wire(Packing::Raw), Err(Error::Sensors { width: 63, .. })));
        assert!(Sensors { hfov_rad: f32::NAN, ..Sensors::default() }.to_wire(Packing::Raw).is_err());
    }

    #[test]
    fn only_wanted_sensors_are_subscribed() {
        let wire = Sensors { rgb: false, ..Sensors::default() }.to_wire(Packing::Raw).unwrap();
        let kinds: Vec<_> = wire.wishes.iter().map(v1::SensorWish::kind).collect();
        assert_eq!(kinds, [v1::SensorKind::Depth, v1::SensorKind::Audio]);
    }

    #[test]
    fn a_rule_of_a_newer_server_is_other() {
        assert_eq!(PoseFrame::from_wire(v1::PoseFrame::World as i32), PoseFrame::World);
        assert_eq!(FeedbackRule::from_wire(v1::FeedbackRule::None as i32), FeedbackRule::None);
        assert_eq!(SoundClip::from_wire(v1::SoundClip::Distinct as i32), SoundClip::Distinct);
        assert_eq!(SoundClip::from_wire(9), SoundClip::Other);
        assert_eq!(DepthNoise::from_wire(v1::DepthNoise::Redwood as i32), DepthNoise::Redwood);
        assert_eq!(RgbNoise::from_wire(0), RgbNoise::Other);
        assert_eq!(SilenceRule::from_wire(v1::SilenceRule::Delayed as i32), SilenceRule::Delayed);
        assert_eq!(SilenceRule::from_wire(0), SilenceRule::Other);
        assert_eq!(ExtraSubmit::from_wire(v1::ExtraSubmit::Ignored as i32), ExtraSubmit::Ignored);
        assert_eq!(ExtraSubmit::from_wire(0), ExtraSubmit::Other);
        assert_eq!(StopClaims::from_wire(v1::StopClaims::LastOnly as i32), StopClaims::LastOnly);
    }

    #[test]
    fn sounding_sources_include_distractors() {
        let task = TaskSpec { distractor_sources: 2, distractor_sources_per_goal: 1, ..TaskSpec::default() };
        assert_eq!((task.sounding_sources(3), TaskSpec::default().sounding_sources(3)), (8, 3));
    }
}
