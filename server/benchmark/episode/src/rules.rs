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
    /// What clips are drawn from.
    #[serde(default)]
    pub sounds: Sounds,
    /// Who listens.
    #[serde(default, skip_serializing_if = "HeadRule::is_sphere")]
    pub head: HeadRule,
    /// Radius of success, metres.
    pub success_radius_m: f32,
    /// What the radius is measured between.
    pub success_distance: DistanceRule,
    /// What a wrong Submit does in an ordered mission.
    pub wrong_submit: WrongSubmit,
    /// What the agent learns from a Submit.
    pub feedback: FeedbackRule,
    /// Noise of the depth that the agent sees; the referee judges without.
    #[serde(default)]
    pub depth_noise: DepthNoise,
    /// Noise of the colours that the agent sees.
    #[serde(default)]
    pub rgb_noise: RgbNoise,
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
    /// All targets in goal order for ever. It leaks: the time tells a target's number.
    AllInGoalOrder,
}

/// Where the sound itself comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SoundClip {
    /// One clip for the whole episode, drawn without regard to its targets.
    Anonymous,
    /// Another clip for each target, drawn without regard to it: targets can be told apart by ear, and nothing else.
    Distinct,
    /// A clip chosen by the target's category. It leaks: who has heard it often enough knows the category.
    ByCategory,
}

/// What clips are drawn from.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sounds {
    /// All clips that are made by rule.
    #[default]
    All,
    /// Those for training.
    Train,
    /// Those for validation, of which none is for training.
    Validation,
    /// Those for tests, of which none is for training or validation.
    Test,
    /// Recordings, by the digest of them all.
    Own(String),
}

/// Who listens.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadRule {
    /// A rigid sphere.
    #[default]
    Sphere,
    /// A head that was measured, by the digest of its file.
    Measured(String),
}

impl HeadRule {
    fn is_sphere(&self) -> bool {
        *self == Self::Sphere
    }
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

/// Noise of the depth that the agent sees; `avln_render::DepthNoise` says what each model does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthNoise {
    /// None.
    #[default]
    None,
    /// A structured-light camera: edges jitter, disparity is rounded and noisy.
    Redwood,
}

/// Noise of the colours that the agent sees; `avln_render::RgbNoise` says what each model does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RgbNoise {
    /// None.
    #[default]
    None,
    /// A normal deviate of 51 grey levels.
    Gaussian,
}

/// A name that no rule set has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("rule set '{0}' does not exist; use {names}", names = Rules::NAMES.join(", "))]
pub struct UnknownRules(pub String);

impl Rules {
    /// Name of the default rule set.
    pub const PAPER: &str = "lh-avln-v1";
    /// Name of the rule set of the authors' released code.
    pub const AUTHORS: &str = "lh-avln-authors-v1";
    /// Name of the default rule set with noisy sensors.
    pub const NOISY: &str = "lh-avln-noisy-v1";
    /// Name of the default rule set with a clip for each target.
    pub const DISTINCT: &str = "lh-avln-distinct-v1";
    /// Names of all rule sets.
    pub const NAMES: [&str; 4] = [Self::PAPER, Self::AUTHORS, Self::NOISY, Self::DISTINCT];
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
            Self::NOISY => Ok(Self::noisy()),
            Self::DISTINCT => Ok(Self::distinct()),
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
            sounds: Sounds::All,
            head: HeadRule::Sphere,
            success_radius_m: 2.0,
            success_distance: DistanceRule::CameraToBox,
            wrong_submit: WrongSubmit::KeepsGoal,
            feedback: FeedbackRule::None,
            depth_noise: DepthNoise::None,
            rgb_noise: RgbNoise::None,
        }
    }

    /// [`Rules::paper`] seen through the sensors of a real robot.
    pub fn noisy() -> Self {
        Self {
            name: Self::NOISY.to_owned(),
            depth_noise: DepthNoise::Redwood,
            rgb_noise: RgbNoise::Gaussian,
            ..Self::paper()
        }
    }

    /// [`Rules::paper`] with a clip for each target.
    pub fn distinct() -> Self {
        Self { name: Self::DISTINCT.to_owned(), sound_clip: SoundClip::Distinct, ..Self::paper() }
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

    /// Whether an episode made for `other` can be played by these rules: they differ in name, noise, clips and head at most.
    pub fn fits_episodes_of(&self, other: &Self) -> bool {
        let Self { name, depth_noise, rgb_noise, sound_clip, sounds, head, .. } = self.clone();
        *self == Self { name, depth_noise, rgb_noise, sound_clip, sounds, head, ..other.clone() }
    }

    /// How many clips an episode with so many targets draws.
    pub fn clips_of_episode(&self, targets: usize) -> usize {
        if self.sound_clip == SoundClip::Distinct { targets } else { 1 }
    }

    /// What sound tells of the targets beside where they are; nothing by rules that do not leak.
    pub fn leaks(&self) -> Option<&'static str> {
        let (clip, order) = (self.sound_clip, self.sounding);
        match (clip == SoundClip::ByCategory, order == SoundingRule::AllInGoalOrder) {
            (true, true) => Some("the clip tells a target's category, the time its number"),
            (true, false) => Some("the clip tells a target's category"),
            (false, true) => Some("the time tells a target's number"),
            (false, false) => None,
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
    fn rule_sets_have_names_and_an_unknown_one_is_refused() {
        for name in Rules::NAMES {
            assert_eq!(Rules::named(name).map(|rules| rules.name), Ok(name.to_owned()));
        }
        assert_eq!(Rules::named(Rules::PAPER), Ok(Rules::paper()));
        let refused = Rules::named("habitat").expect_err("no such rules").to_string();
        assert!(Rules::NAMES.iter().all(|name| refused.contains(name)), "{refused}");
    }

    #[test]
    fn only_the_noisy_rules_have_noise_and_they_fit_the_episodes_of_the_paper() {
        for rules in [Rules::paper(), Rules::authors()] {
            assert_eq!((rules.depth_noise, rules.rgb_noise), (DepthNoise::None, RgbNoise::None));
        }
        let noisy = Rules::noisy();
        assert_eq!((noisy.depth_noise, noisy.rgb_noise), (DepthNoise::Redwood, RgbNoise::Gaussian));
        assert!(noisy.fits_episodes_of(&Rules::paper()) && Rules::paper().fits_episodes_of(&noisy));
        assert!(!noisy.fits_episodes_of(&Rules::authors()));
    }

    #[test]
    fn only_the_authors_rules_leak_and_distinct_ones_fit_the_episodes_of_the_paper() {
        let leaks = |name: &str| Rules::named(name).expect("a rule set").leaks().is_some();
        assert_eq!(Rules::NAMES.map(leaks), [false, true, false, false]);
        let (distinct, own) = (Rules::distinct(), Sounds::Own("c0ffee".to_owned()));
        assert!(distinct.fits_episodes_of(&Rules::paper()) && distinct.fits_episodes_of(&Rules::noisy()));
        assert!(Rules { sounds: own, ..distinct.clone() }.fits_episodes_of(&distinct));
        let head = HeadRule::Measured("c0ffee".to_owned());
        assert!(Rules { head, ..distinct.clone() }.fits_episodes_of(&distinct));
        assert!(!distinct.fits_episodes_of(&Rules::authors()));
        let leaky = Rules { sound_clip: SoundClip::ByCategory, ..Rules::paper() };
        assert_eq!(leaky.leaks(), Some("the clip tells a target's category"));
    }

    #[test]
    fn rules_that_were_stored_before_there_was_noise_have_none_and_all_sounds() {
        let mut stored = serde_json::to_value(Rules::paper()).expect("JSON");
        let fields = stored.as_object_mut().expect("an object");
        assert_eq!(fields.remove("depth_noise"), Some("none".into()));
        assert_eq!(fields.remove("rgb_noise"), Some("none".into()));
        assert_eq!(fields.remove("sounds"), Some("all".into()));
        assert_eq!(serde_json::from_value::<Rules>(stored).expect("rules"), Rules::paper());
        let noisy = serde_json::to_string(&Rules::noisy()).expect("JSON");
        assert!(noisy.contains(r#""depth_noise":"redwood","rgb_noise":"gaussian""#), "{noisy}");
        assert_eq!(serde_json::from_str::<Rules>(&noisy).expect("rules"), Rules::noisy());
    }

    #[test]
    fn a_step_of_the_paper_fills_four_thousand_samples() {
        assert_eq!(Rules::paper().samples_per_step(), 4000);
    }
}
