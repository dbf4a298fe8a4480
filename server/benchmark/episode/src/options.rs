//! Options of a phase: claims and distractor sources in the rules, and time limits.

use serde::{Deserialize, Serialize};

/// Effect of a Submit without Submits left. A mission with N goals has N - 1 Submits and a Stop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExtraSubmit {
    /// Uses a step, without a judgement.
    Ignored,
    /// Judged, and ends the episode.
    // The default is the rule of earlier versions, whose databases contain rules without this field.
    #[default]
    EndsEpisode,
}

impl ExtraSubmit {
    pub(crate) fn ends_episode(&self) -> bool {
        *self == Self::EndsEpisode
    }
}

/// Goals open to a Stop: docs/decisions/0001.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StopClaims {
    /// As for a Submit: the next goal, or any open goal in an unordered mission.
    #[default]
    AnyOpen,
    /// The last open goal; none if several are open.
    LastOnly,
}

impl StopClaims {
    pub(crate) fn is_any_open(&self) -> bool {
        *self == Self::AnyOpen
    }
}

/// Sounding non-goals per episode: a number, or "goals" for as many as goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Spelling", into = "Spelling")]
pub enum DistractorSources {
    /// A number, at most [`DistractorSources::MOST`].
    Number(u32),
    /// As many as goals.
    Goals,
}

/// JSON form of [`DistractorSources`].
#[derive(Serialize, Deserialize, utoipa::ToSchema)]
#[serde(untagged)]
#[schema(as = DistractorSources)]
pub(crate) enum Spelling {
    /// A number.
    Number(u32),
    /// The word "goals".
    Word(String),
}

/// Invalid number of distractor sources.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("distractor_sources {0} is not allowed; use 0 to {most}, or \"goals\"", most = DistractorSources::MOST)]
pub struct UnknownDistractorSources(String);

impl DistractorSources {
    /// Largest number per episode.
    pub const MOST: u32 = 8;

    /// Returns the number in an episode with `goals` goals.
    pub fn count(self, goals: usize) -> usize {
        match self {
            Self::Number(number) => number as usize,
            Self::Goals => goals,
        }
    }

    pub(crate) fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

impl Default for DistractorSources {
    fn default() -> Self {
        Self::Number(0)
    }
}

impl TryFrom<Spelling> for DistractorSources {
    type Error = UnknownDistractorSources;

    fn try_from(spelling: Spelling) -> Result<Self, UnknownDistractorSources> {
        match spelling {
            Spelling::Number(number) if number <= Self::MOST => Ok(Self::Number(number)),
            Spelling::Number(number) => Err(UnknownDistractorSources(number.to_string())),
            Spelling::Word(word) if word == "goals" => Ok(Self::Goals),
            Spelling::Word(word) => Err(UnknownDistractorSources(format!("'{word}'"))),
        }
    }
}

impl From<DistractorSources> for Spelling {
    fn from(sources: DistractorSources) -> Self {
        match sources {
            DistractorSources::Number(number) => Self::Number(number),
            DistractorSources::Goals => Self::Word("goals".to_owned()),
        }
    }
}

/// Wall time limits for agents. 0 means unlimited, except for `bank_ms`.
///
/// An action beyond `step_ms` uses up the episode's `bank_ms`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TimeLimits {
    /// Free thinking time per action, milliseconds.
    pub step_ms: u32,
    /// Extra thinking time per episode, milliseconds.
    pub bank_ms: u32,
    /// Longest run, seconds; 0: until the phase ends.
    pub run_s: u32,
    /// Longest single disconnection, seconds; 0: lost episodes end at once.
    pub disconnect_s: u32,
    /// Longest disconnection per run in total, seconds.
    pub disconnect_total_s: u32,
}

impl Default for TimeLimits {
    /// One minute per action, for first trials; two minutes per disconnection, ten in total.
    fn default() -> Self {
        Self { step_ms: 60_000, bank_ms: 0, run_s: 0, disconnect_s: 120, disconnect_total_s: 600 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Rules, SilenceRule};

    #[test]
    fn distractor_sources_are_a_number_or_goals() {
        let parsed = serde_json::from_str::<[DistractorSources; 3]>(r#"[0, 3, "goals"]"#).expect("valid");
        assert_eq!(parsed.map(|sources| sources.count(4)), [0, 3, 4]);
        assert_eq!(serde_json::to_string(&parsed).expect("JSON"), r#"[0,3,"goals"]"#);
        for wrong in ["9", "\"many\"", "-1"] {
            assert!(serde_json::from_str::<DistractorSources>(wrong).is_err(), "{wrong}");
        }
        let refused = DistractorSources::try_from(Spelling::Number(9)).expect_err("too many").to_string();
        assert_eq!(refused, "distractor_sources 9 is not allowed; use 0 to 8, or \"goals\"");
    }

    #[test]
    fn rules_without_options_end_at_extra_submits() {
        let mut stored = serde_json::to_value(Rules::paper()).expect("JSON");
        let fields = stored.as_object_mut().expect("an object");
        assert_eq!(fields.remove("extra_submit"), Some("ignored".into()));
        assert!(!fields.contains_key("stop_claims") && !fields.contains_key("distractor_sources"));
        let earlier = Rules { extra_submit: ExtraSubmit::EndsEpisode, ..Rules::paper() };
        assert_eq!(serde_json::from_value::<Rules>(stored).expect("rules"), earlier);
        let authors = serde_json::to_string(&Rules::authors()).expect("JSON");
        assert!(!authors.contains("extra_submit"), "{authors}");
    }

    #[test]
    fn only_authors_rules_end_at_extra_submits() {
        for name in Rules::NAMES {
            let rules = Rules::named(name).expect("a rule set");
            let ends = rules.extra_submit == ExtraSubmit::EndsEpisode;
            assert_eq!((ends, rules.stop_claims), (name == Rules::AUTHORS, StopClaims::AnyOpen), "{name}");
        }
    }

    #[test]
    fn hard_rules_add_distractors_noise_and_late_silence() {
        let hard = Rules::hard();
        assert_eq!((hard.sounding_sources(3), Rules::paper().sounding_sources(3)), (6, 3));
        assert_eq!(hard.silence, SilenceRule::WindowEnd);
        let plain = Rules {
            name: Rules::NOISY.to_owned(),
            silence: SilenceRule::Immediate,
            distractor_sources: DistractorSources::default(),
            ..hard.clone()
        };
        assert_eq!(plain, Rules::noisy());
        assert!(hard.fits_episodes_of(&Rules::paper()) && !hard.fits_episodes_of(&Rules::authors()));
        let text = serde_json::to_string(&hard).expect("JSON");
        assert_eq!(serde_json::from_str::<Rules>(&text).expect("rules"), hard);
    }

    #[test]
    fn missing_limits_default_and_unknown_are_rejected() {
        let limits: TimeLimits = serde_json::from_str(r#"{"step_ms": 5000, "bank_ms": 60000}"#).unwrap();
        assert_eq!(limits, TimeLimits { step_ms: 5000, bank_ms: 60_000, ..TimeLimits::default() });
        assert!(serde_json::from_str::<TimeLimits>(r#"{"steps_ms": 5000}"#).is_err());
    }
}
