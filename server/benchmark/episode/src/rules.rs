//! Rule sets.

use crate::options::{DistractorSources, ExtraSubmit, Spelling, StopClaims};
use serde::{Deserialize, Serialize};

/// A rule set for the task. Every disputed point is a named option, recorded with results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Rule set name with version.
    pub name: String,
    /// MoveForward length, metres.
    pub forward_m: f32,
    /// Angle for TurnLeft and TurnRight, degrees; divides 360.
    pub turn_deg: u32,
    /// Simulated time per step, seconds.
    pub step_s: f32,
    /// Most actions per episode, all five kinds.
    pub max_steps: u32,
    /// Body radius, metres.
    pub body_radius_m: f32,
    /// Body height, metres.
    pub body_height_m: f32,
    /// Camera height above the base, metres.
    pub camera_height_m: f32,
    /// Ear height above the base, metres.
    pub ear_height_m: f32,
    /// Depth camera range, metres; beyond it depth is 0.
    pub depth_max_m: f32,
    /// Divisor for depth before transport.
    pub depth_divisor: f32,
    /// Samples per ear in an observation; the rest after a step's samples is 0.
    pub audio_samples: u32,
    /// Pose frame in observations.
    pub pose_frame: PoseFrame,
    /// Sounding schedule.
    pub sounding: SoundingRule,
    /// Steps per sounding target.
    pub sounding_window_steps: u32,
    /// Silence of found targets under [`SoundingRule::UnfinishedInDrawnOrder`].
    // Not serialised by default, so that digests of earlier rules stay the same.
    #[serde(default, skip_serializing_if = "SilenceRule::is_immediate")]
    pub silence: SilenceRule,
    /// Sounding non-goals per episode.
    #[serde(default, skip_serializing_if = "DistractorSources::is_none")]
    #[schema(value_type = Spelling)]
    pub distractor_sources: DistractorSources,
    /// Source height above the target centre, metres.
    pub source_lift_m: f32,
    /// Sound clip choice.
    pub sound_clip: SoundClip,
    /// Clip bank.
    #[serde(default)]
    pub sounds: Sounds,
    /// Listener's head.
    #[serde(default, skip_serializing_if = "HeadRule::is_sphere")]
    pub head: HeadRule,
    /// Success radius, metres.
    pub success_radius_m: f32,
    /// Success distance definition.
    pub success_distance: DistanceRule,
    /// A wrong Submit's effect in an ordered mission.
    pub wrong_submit: WrongSubmit,
    /// Effect of a Submit without Submits left.
    #[serde(default, skip_serializing_if = "ExtraSubmit::ends_episode")]
    pub extra_submit: ExtraSubmit,
    /// Goals open to a Stop.
    #[serde(default, skip_serializing_if = "StopClaims::is_any_open")]
    pub stop_claims: StopClaims,
    /// Feedback to Submits.
    pub feedback: FeedbackRule,
    /// Depth noise for the agent. The referee uses exact depth.
    // Databases of earlier versions contain rules without noise, heads and sound banks: their defaults are the values of that time.
    #[serde(default)]
    pub depth_noise: DepthNoise,
    /// Colour noise for the agent.
    #[serde(default)]
    pub rgb_noise: RgbNoise,
}

/// Observed poses' frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseFrame {
    /// Relative to the start pose.
    Start,
    /// World frame.
    World,
}

/// Sounding schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SoundingRule {
    /// Unfinished targets in turn, in a drawn order; a found target falls silent, see [`SilenceRule`].
    UnfinishedInDrawnOrder,
    /// All targets in goal order, forever. Leaks: the time reveals the goal index.
    AllInGoalOrder,
}

/// Silence of a found target: the sound shows that a Submit was right, at once or later.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SilenceRule {
    /// At once, in the observation after the Submit.
    #[default]
    Immediate,
    /// 5 to 20 steps after the Submit, drawn for every episode and goal.
    Delayed,
    /// At the end of the target's present window.
    WindowEnd,
}

impl SilenceRule {
    fn is_immediate(&self) -> bool {
        *self == Self::Immediate
    }
}

/// Sound clip choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SoundClip {
    /// One random clip per episode, independent of the targets.
    Anonymous,
    /// Different random clips per target, independent of the target: only identity is audible.
    Distinct,
    /// Clip by target category. Leaks: the sound reveals the category.
    ByCategory,
}

/// Clip bank.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sounds {
    /// All procedural clips.
    #[default]
    All,
    /// Training clips.
    Train,
    /// Validation clips, disjoint from training.
    Validation,
    /// Test clips, disjoint from training and validation.
    Test,
    /// Recordings, identified by their joint digest.
    Own(String),
}

/// Listener's head.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeadRule {
    /// A rigid sphere.
    #[default]
    Sphere,
    /// Measured head, identified by the file digest.
    Measured(String),
}

impl HeadRule {
    fn is_sphere(&self) -> bool {
        *self == Self::Sphere
    }
}

/// Success distance definition, with the visibility condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DistanceRule {
    /// Camera to target box, Euclidean, on the same floor, with a line of sight at some heading.
    CameraToBox,
    /// Base to nearest viewpoint, geodesic, with a visible target pixel.
    BaseToViewpoint,
    /// Camera to the nearest triangle of the target, Euclidean, otherwise as [`Self::CameraToBox`].
    CameraToMesh,
}

/// A wrong Submit's effect in an ordered mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum WrongSubmit {
    /// The Submit is used; the goal remains next.
    KeepsGoal,
    /// The Submit is used; the goal becomes impossible.
    SkipsGoal,
}

/// Feedback to Submits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FeedbackRule {
    /// None.
    None,
    /// Accepted, without a result.
    Accepted,
    /// True if a goal was completed.
    Verdict,
}

/// Depth noise model, defined in `avln_render::DepthNoise`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DepthNoise {
    /// None.
    #[default]
    None,
    /// Structured-light camera: edge jitter, quantised and noisy disparity.
    Redwood,
}

/// Colour noise model, defined in `avln_render::RgbNoise`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RgbNoise {
    /// None.
    #[default]
    None,
    /// Normal deviates with 51 grey levels.
    Gaussian,
}

/// Unknown rule set.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("rule set '{0}' does not exist; use {names}", names = Rules::NAMES.join(", "))]
pub struct UnknownRules(pub String);

impl Rules {
    /// The default rule set's name.
    pub const PAPER: &str = "lh-avln-v1";
    /// Rule set name for the authors' released code.
    pub const AUTHORS: &str = "lh-avln-authors-v1";
    /// Name for the default rule set with noisy sensors.
    pub const NOISY: &str = "lh-avln-noisy-v1";
    /// Name for the default rule set with a clip per target.
    pub const DISTINCT: &str = "lh-avln-distinct-v1";
    /// Name for noisy rules with as many sounding distractors as goals.
    pub const HARD: &str = "lh-avln-hard-v1";
    /// Name for the default rule set with success distances to meshes.
    pub const MESH: &str = "lh-avln-mesh-v1";
    /// All rule set names.
    pub const NAMES: [&str; 6] =
        [Self::PAPER, Self::AUTHORS, Self::NOISY, Self::DISTINCT, Self::HARD, Self::MESH];
    /// Half the visible elevation range, radians: a square picture with 90 degrees.
    pub const HALF_VIEW_RAD: f32 = std::f32::consts::FRAC_PI_4;

    /// Returns the rule set called `name`.
    ///
    /// # Errors
    /// If no rule set has this name.
    pub fn named(name: &str) -> Result<Self, UnknownRules> {
        match name {
            Self::PAPER => Ok(Self::paper()),
            Self::AUTHORS => Ok(Self::authors()),
            Self::NOISY => Ok(Self::noisy()),
            Self::DISTINCT => Ok(Self::distinct()),
            Self::HARD => Ok(Self::hard()),
            Self::MESH => Ok(Self::mesh()),
            other => Err(UnknownRules(other.to_owned())),
        }
    }

    /// Returns the paper's rules with all details fixed.
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
            silence: SilenceRule::Immediate,
            distractor_sources: DistractorSources::default(),
            source_lift_m: 0.0,
            // The clip must reveal nothing about its target: docs/decisions/0010.
            sound_clip: SoundClip::Anonymous,
            sounds: Sounds::All,
            head: HeadRule::Sphere,
            success_radius_m: 2.0,
            success_distance: DistanceRule::CameraToBox,
            wrong_submit: WrongSubmit::KeepsGoal,
            extra_submit: ExtraSubmit::Ignored,
            stop_claims: StopClaims::AnyOpen,
            feedback: FeedbackRule::None,
            depth_noise: DepthNoise::None,
            rgb_noise: RgbNoise::None,
        }
    }

    /// Returns [`Rules::paper`] with noisy sensors.
    pub fn noisy() -> Self {
        Self {
            name: Self::NOISY.to_owned(),
            // Noise is drawn per pixel: docs/decisions/0007.
            depth_noise: DepthNoise::Redwood,
            rgb_noise: RgbNoise::Gaussian,
            ..Self::paper()
        }
    }

    /// Returns [`Rules::paper`] with a clip per target.
    pub fn distinct() -> Self {
        Self { name: Self::DISTINCT.to_owned(), sound_clip: SoundClip::Distinct, ..Self::paper() }
    }

    /// Returns [`Rules::noisy`] with as many sounding distractors as goals.
    pub fn hard() -> Self {
        Self {
            name: Self::HARD.to_owned(),
            // A found target completes its turn: no turn ends early, so a sudden silence is never a verdict.
            silence: SilenceRule::WindowEnd,
            distractor_sources: DistractorSources::Goals,
            ..Self::noisy()
        }
    }

    /// Returns [`Rules::paper`] with success distances to the targets' meshes.
    pub fn mesh() -> Self {
        Self { name: Self::MESH.to_owned(), success_distance: DistanceRule::CameraToMesh, ..Self::paper() }
    }

    /// Returns the effective rules in the authors' released code.
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
            extra_submit: ExtraSubmit::EndsEpisode,
            feedback: FeedbackRule::Verdict,
            ..Self::paper()
        }
    }

    /// Returns whether episodes for `other` are playable with these rules: only name, noise, clips, head, silence, distractor
    /// sources and the options of claims may differ.
    pub fn fits_episodes_of(&self, other: &Self) -> bool {
        // Success regions and reference tours depend on all other fields. A new field counts as a difference until it
        // is listed here.
        let Self { name, depth_noise, rgb_noise, sound_clip, sounds, head, silence, .. } = self.clone();
        let Self { distractor_sources, extra_submit, stop_claims, .. } = *self;
        let options = Self { distractor_sources, extra_submit, stop_claims, ..other.clone() };
        *self == Self { name, depth_noise, rgb_noise, sound_clip, sounds, head, silence, ..options }
    }

    /// Returns the number of sound sources in an episode: targets and distractors.
    pub fn sounding_sources(&self, goals: usize) -> usize {
        goals + self.distractor_sources.count(goals)
    }

    /// Returns the clip count of an episode with `goals` goals.
    pub fn clips_of_episode(&self, goals: usize) -> usize {
        if self.sound_clip == SoundClip::Distinct { self.sounding_sources(goals) } else { 1 }
    }

    /// Describes a leak of target properties through sound; `None` for rules without leaks.
    pub fn leaks(&self) -> Option<&'static str> {
        let (clip, order) = (self.sound_clip, self.sounding);
        match (clip == SoundClip::ByCategory, order == SoundingRule::AllInGoalOrder) {
            (true, true) => Some("the clip reveals a target's category, the time its number"),
            (true, false) => Some("the clip reveals a target's category"),
            (false, true) => Some("the time reveals a target's number"),
            (false, false) => None,
        }
    }

    /// Returns samples per ear in a step.
    pub fn samples_per_step(&self) -> u32 {
        (self.step_s * crate::Sensors::SAMPLE_RATE_HZ as f32).round() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_rule_sets_are_rejected() {
        for name in Rules::NAMES {
            assert_eq!(Rules::named(name).map(|rules| rules.name), Ok(name.to_owned()));
        }
        assert_eq!(Rules::named(Rules::PAPER), Ok(Rules::paper()));
        let refused = Rules::named("habitat").expect_err("no such rules").to_string();
        assert!(Rules::NAMES.iter().all(|name| refused.contains(name)), "{refused}");
    }

    #[test]
    fn only_noisy_rules_have_noise() {
        for rules in [Rules::paper(), Rules::authors()] {
            assert_eq!((rules.depth_noise, rules.rgb_noise), (DepthNoise::None, RgbNoise::None));
        }
        let noisy = Rules::noisy();
        assert_eq!((noisy.depth_noise, noisy.rgb_noise), (DepthNoise::Redwood, RgbNoise::Gaussian));
        assert!(noisy.fits_episodes_of(&Rules::paper()) && Rules::paper().fits_episodes_of(&noisy));
        assert!(!noisy.fits_episodes_of(&Rules::authors()));
    }

    #[test]
    fn only_authors_rules_leak() {
        let leaks = |name: &str| Rules::named(name).expect("a rule set").leaks().is_some();
        assert_eq!(Rules::NAMES.map(leaks), [false, true, false, false, false, false]);
        let (distinct, own) = (Rules::distinct(), Sounds::Own("c0ffee".to_owned()));
        assert!(distinct.fits_episodes_of(&Rules::paper()) && distinct.fits_episodes_of(&Rules::noisy()));
        assert!(Rules { sounds: own, ..distinct.clone() }.fits_episodes_of(&distinct));
        let head = HeadRule::Measured("c0ffee".to_owned());
        assert!(Rules { head, ..distinct.clone() }.fits_episodes_of(&distinct));
        assert!(!distinct.fits_episodes_of(&Rules::authors()));
        let leaky = Rules { sound_clip: SoundClip::ByCategory, ..Rules::paper() };
        assert_eq!(leaky.leaks(), Some("the clip reveals a target's category"));
    }

    #[test]
    fn mesh_rules_need_their_own_episodes() {
        let mesh = Rules::mesh();
        assert_eq!(
            Rules {
                name: Rules::PAPER.to_owned(),
                success_distance: DistanceRule::CameraToBox,
                ..mesh.clone()
            },
            Rules::paper()
        );
        assert!(!mesh.fits_episodes_of(&Rules::paper()) && !Rules::paper().fits_episodes_of(&mesh));
        let text = serde_json::to_string(&mesh).expect("JSON");
        assert!(text.contains(r#""success_distance":"camera_to_mesh""#), "{text}");
    }

    #[test]
    fn old_rules_have_no_noise_and_all_sounds() {
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
    fn default_silence_changes_no_digest() {
        for name in Rules::NAMES.into_iter().filter(|&name| name != Rules::HARD) {
            let rules = Rules::named(name).expect("a rule set");
            assert!(!serde_json::to_string(&rules).expect("JSON").contains("silence"), "{name}");
        }
        let late = Rules { silence: SilenceRule::WindowEnd, ..Rules::paper() };
        let text = serde_json::to_string(&late).expect("JSON");
        assert!(text.contains(r#""silence":"window_end""#), "{text}");
        assert_eq!(serde_json::from_str::<Rules>(&text).expect("rules"), late);
        assert!(late.fits_episodes_of(&Rules::paper()));
    }

    #[test]
    fn paper_step_has_4000_samples() {
        assert_eq!(Rules::paper().samples_per_step(), 4000);
    }
}
