use serde::{Deserialize, Serialize};

/// The rules of the task: every disputed point is a named option that each result carries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Name and version of the rule set.
    pub name: String,
    /// Length of MoveForward, metres.
    pub forward_m: f32,
    /// Angle of TurnLeft and TurnRight, degrees; a whole number of them makes 360.
    pub turn_deg: u32,
    /// Simulated time of one step, seconds.
    pub step_s: f32,
    /// Most actions in an episode; all five kinds count.
    pub max_steps: u32,
    /// Radius of the body, metres.
    pub body_radius_m: f32,
    /// Height of the body, metres.
    pub body_height_m: f32,
    /// Height of the camera above the base, metres.
    pub camera_height_m: f32,
    /// Height of the ears above the base, metres.
    pub ear_height_m: f32,
    /// Range of the depth camera, metres; beyond it depth is 0.
    pub depth_max_m: f32,
    /// What depth is divided by before it is sent.
    pub depth_divisor: f32,
    /// Samples of each ear in an observation; what the step does not fill is 0.
    pub audio_samples: u32,
    /// Frame of the pose that the agent is told.
    pub pose_frame: PoseFrame,
    /// Which targets sound, and when.
    pub sounding: SoundingRule,
    /// Steps for which one target sounds before the next.
    pub sounding_window_steps: u32,
    /// Height added to a source above the centre of its target, metres.
    pub source_lift_m: f32,
    /// Where the sound itself comes from.
    pub sound_clip: SoundClip,
    /// Radius of success, metres.
    pub success_radius_m: f32,
    /// What the radius is measured between.
    pub success_distance: DistanceRule,
    /// What a wrong Submit does in an ordered mission.
    pub wrong_submit: WrongSubmit,
    /// What the agent learns from a Submit.
    pub feedback: FeedbackRule,
}

/// Frame of the pose that the agent is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseFrame {
    /// Relative to the pose at the start.
    Start,
    /// The world's frame.
    World,
}

/// Which targets sound, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SoundingRule {
    /// Unfinished targets in turn, in an order drawn per episode; a found one falls silent at once.
    UnfinishedInDrawnOrder,
    /// All targets in goal order for ever.
    AllInGoalOrder,
}

/// Where the sound itself comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SoundClip {
    /// One clip for the whole episode, drawn without regard to its targets.
    Anonymous,
    /// A clip chosen by the target's category: it gives the category away.
    ByCategory,
}

/// What the radius of success is measured between, and what must be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DistanceRule {
    /// Camera to the target's box, Euclidean, on the target's floor, with a line of sight at some heading.
    CameraToBox,
    /// Base to the nearest viewpoint along the floor, with a pixel of the target in the picture.
    BaseToViewpoint,
}

/// What a wrong Submit does in an ordered mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WrongSubmit {
    /// The Submit is spent, the goal stays next.
    KeepsGoal,
    /// The Submit is spent and the goal can no longer be found.
    SkipsGoal,
}

/// What the agent learns from a Submit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FeedbackRule {
    /// Nothing.
    None,
    /// That it was counted.
    Accepted,
    /// Whether it completed a goal.
    Verdict,
}

/// A name that no rule set has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("rule set '{0}' does not exist; use {paper} or {authors}", paper = Rules::PAPER, authors = Rules::AUTHORS)]
pub struct UnknownRules(pub String);

impl Rules {
    /// Name of the default rule set.
    pub const PAPER: &str = "lh-avln-v1";
    /// Name of the rule set of the authors' released code.
    pub const AUTHORS: &str = "lh-avln-authors-v1";
    /// Elevation up and down that counts as in view, radians: a square picture of 90 degrees.
    pub const HALF_VIEW_RAD: f32 = std::f32::consts::FRAC_PI_4;

    /// The rule set called `name`.
    ///
    /// # Errors
    /// When there is none.
    pub fn named(name: &str) -> Result<Self, UnknownRules> {
        match name {
            Self::PAPER => Ok(Self::paper()),
            Self::AUTHORS => Ok(Self::authors()),
            other => Err(UnknownRules(other.to_owned())),
        }
    }

    /// The rules as the paper states them, made precise.
    pub fn paper() -> Self {
        Self {
            name: Self::PAPER.to_owned(),
            forward_m: 0.25,
            turn_deg: 30,
            step_s: 0.25,
            max_steps: 1000,
            body_radius_m: 0.1,
            body_height_m: 1.5,
            camera_height_m: 1.0,
            ear_height_m: 1.0,
            depth_max_m: 10.0,
            depth_divisor: 1.0,
            audio_samples: 4000,
            pose_frame: PoseFrame::Start,
            sounding: SoundingRule::UnfinishedInDrawnOrder,
            sounding_window_steps: 25,
            source_lift_m: 0.0,
            sound_clip: SoundClip::Anonymous,
            success_radius_m: 2.0,
            success_distance: DistanceRule::CameraToBox,
            wrong_submit: WrongSubmit::KeepsGoal,
            feedback: FeedbackRule::None,
        }
    }

    /// What the authors' released code effectively does.
    pub fn authors() -> Self {
        Self {
            name: Self::AUTHORS.to_owned(),
            camera_height_m: 1.25,
            ear_height_m: 1.5,
            depth_divisor: 10.0,
            audio_samples: 16_000,
            pose_frame: PoseFrame::World,
            sounding: SoundingRule::AllInGoalOrder,
            source_lift_m: 1.5,
            sound_clip: SoundClip::ByCategory,
            success_radius_m: 1.0,
            success_distance: DistanceRule::BaseToViewpoint,
            wrong_submit: WrongSubmit::SkipsGoal,
            feedback: FeedbackRule::Verdict,
            ..Self::paper()
        }
    }

    /// Samples of each ear that one step of simulated time fills.
    pub fn samples_per_step(&self) -> u32 {
        (self.step_s * crate::Sensors::SAMPLE_RATE_HZ as f32).round() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_rule_sets_have_names_and_an_unknown_one_is_refused() {
        assert_eq!(Rules::named(Rules::PAPER), Ok(Rules::paper()));
        assert_eq!(Rules::named(Rules::AUTHORS), Ok(Rules::authors()));
        assert!(Rules::named("habitat").is_err());
    }

    #[test]
    fn a_step_of_the_paper_fills_four_thousand_samples() {
        assert_eq!(Rules::paper().samples_per_step(), 4000);
    }
}
