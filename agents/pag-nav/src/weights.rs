//! Weights and ablations, read from `pag-nav.toml`.

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::{fs, io};
use toml::{Table, Value};

/// Defaults, units and ranges.
const DEFAULTS: &str = include_str!("../pag-nav.toml");

const LIMITS: [(&str, f64, f64); 29] = [
    ("steps_per_m", 0.1, 100.0),
    ("loyalty_steps", 0.0, 1000.0),
    ("vain", 0.0, 10.0),
    ("storey_steps", 1.0, 10_000.0),
    ("doubt_steps", 0.0, 1000.0),
    ("search_audio", 0.0, 10.0),
    ("search_scale_m", 0.01, 100.0),
    ("search_context", 0.0, 10.0),
    ("search_way", 0.0, 10.0),
    ("arrived_m", 0.0, 100.0),
    ("lost_m", 0.0, 100.0),
    ("ground_vis", 0.01, 1.0),
    ("ground_context", 0.0, 1.0),
    ("ground_audio", 0.0, 1.0),
    ("sound_scale_m", 0.01, 100.0),
    ("certain", 0.01, 1.0),
    ("any_certain", 0.0, 1.0),
    ("last_certain", 0.0, 1.0),
    ("plausible", 0.0, 3.0),
    ("verify_looks", 1.0, 100.0),
    ("verify_fit", 0.0, 1.0),
    ("submit_m", 0.1, 10.0),
    ("submit_rad", 0.01, 3.15),
    ("nearer", 0.1, 1.0),
    ("found_level", 0.0, 1.0),
    ("look_range_m", 0.1, 100.0),
    ("commit", 0.0, 1.0),
    ("patience_steps", 1.0, 10_000.0),
    ("hurry_steps", 0.0, 10_000.0),
];

/// The tunable numbers of [`PagNav`](crate::PagNav). `pag-nav.toml` documents defaults and ranges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// Steps and turns per metre of path.
    pub steps_per_m: f32,
    /// Advantage for the current source, steps.
    pub loyalty_steps: f32,
    /// Weight of visual compatibility in S_ground (lambda_v).
    pub ground_vis: f32,
    /// Weight of rooms and neighbouring objects in S_ground (lambda_c).
    pub ground_context: f32,
    /// Weight of consistency with sound in S_ground (lambda_a).
    pub ground_audio: f32,
    /// Distance to the estimated source at which the consistency falls to 1/sqrt(e), metres.
    pub sound_scale_m: f32,
    /// Certainty from which an estimate has full weight, 0 to 1.
    pub certain: f32,
    /// Certainty for a Submit in unordered missions, 0 to 1; see `patience_steps`.
    pub any_certain: f32,
    /// Certainty for a Submit for the last goal, which ends the episode.
    pub last_certain: f32,
    /// Least score of a plausible candidate.
    pub plausible: f32,
    /// Near views for verification.
    pub verify_looks: u32,
    /// Visual compatibility for verification, 0 to 1; see `patience_steps`.
    pub verify_fit: f32,
    /// Largest distance at a Submit (the paper's delta_sub), metres.
    pub submit_m: f32,
    /// Largest bearing at a Submit (theta_sub), radians.
    pub submit_rad: f32,
    /// Share of the level at a Submit below which the source fell silent: the target was found.
    pub found_level: f32,
    /// Range, by level, within which a source must have been heard before views count, metres.
    pub look_range_m: f32,
    /// Probability of the right goal from which the agent submits without viewing other sources.
    pub commit: f32,
    /// Steps towards a source after which it counts as viewed, and verification relaxes.
    pub patience_steps: u32,
    /// Cost, in steps, per past step towards a source.
    pub vain: f32,
    /// Steps towards a source after which the agent takes known stairs.
    pub storey_steps: u32,
    /// Cost for a source that is certainly not the next goal, steps.
    pub doubt_steps: f32,
    /// Steps before the end from which verification demands a single view.
    pub hurry_steps: u32,
    /// Distance to the estimated source at which the agent looks around instead of exploring, metres.
    pub arrived_m: f32,
    /// Distance of a path's end to the estimated source from which the agent explores, metres.
    pub lost_m: f32,
    /// Weight of sound in S_search (lambda_a).
    pub search_audio: f32,
    /// Distance to the estimated source at which that weight falls to 1/e, metres.
    pub search_scale_m: f32,
    /// Weight of rooms and objects around a frontier (lambda_r and lambda_o).
    pub search_context: f32,
    /// Cost per metre of path to a frontier.
    pub search_way: f32,
    /// Factor on the Submit distance after an unsuccessful Submit.
    pub nearer: f32,
}

impl Weights {
    /// Reads a file like `pag-nav.toml`; missing keys keep their defaults, unknown keys are errors.
    pub fn read(path: &Path) -> Result<Self, WeightsError> {
        let failed = |problem| WeightsError { path: path.to_owned(), problem };
        let text = fs::read_to_string(path).map_err(|error| failed(WeightsProblem::Unreadable(error)))?;
        Self::parse(&text).map_err(failed)
    }

    fn parse(text: &str) -> Result<Self, WeightsProblem> {
        let mut table: Table = DEFAULTS.parse().map_err(|error| WeightsProblem::of_toml(DEFAULTS, &error))?;
        let said: Table = text.parse().map_err(|error| WeightsProblem::of_toml(text, &error))?;
        table.extend(said);
        LIMITS.iter().try_for_each(|&(key, low, high)| within(&table, key, low, high))?;
        table.try_into().map_err(|error| WeightsProblem::of_toml(text, &error))
    }

    /// Returns the weights for an agent without audio: sight takes over the weight of sound.
    pub fn silent(self) -> Self {
        let seen = (self.ground_vis + self.ground_context).max(f32::EPSILON);
        let share = (seen + self.ground_audio) / seen;
        let (ground_vis, ground_context) = (self.ground_vis * share, self.ground_context * share);
        Self { ground_vis, ground_context, ground_audio: 0.0, search_audio: 0.0, ..self }
    }
}

impl Default for Weights {
    fn default() -> Self {
        static READ: LazyLock<Weights> =
            LazyLock::new(|| Weights::parse("").expect("a test reads the defaults"));
        READ.clone()
    }
}

/// Reasons for invalid weights.
#[derive(Debug, thiserror::Error)]
#[error("weights {}: {problem}", path.display())]
pub struct WeightsError {
    path: PathBuf,
    problem: WeightsProblem,
}

#[derive(Debug, thiserror::Error)]
enum WeightsProblem {
    #[error("cannot be read: {0}; agents/pag-nav/pag-nav.toml is an example")]
    Unreadable(io::Error),
    #[error("{0}; agents/pag-nav/pag-nav.toml lists all keys")]
    Malformed(String),
    #[error("{key} is {value}, and must be a number from {low} to {high}")]
    OutOfRange { key: &'static str, value: Value, low: f64, high: f64 },
}

impl WeightsProblem {
    fn of_toml(text: &str, error: &toml::de::Error) -> Self {
        let line = |at: usize| 1 + text[..at.min(text.len())].matches('\n').count();
        Self::Malformed(match error.span() {
            Some(span) => format!("line {}: {}", line(span.start), error.message()),
            None => error.to_string().trim().replace('\n', " "),
        })
    }
}

fn within(table: &Table, key: &'static str, low: f64, high: f64) -> Result<(), WeightsProblem> {
    let Some(value) = table.get(key) else { return Ok(()) };
    let number = value.as_float().or(value.as_integer().map(|whole| whole as f64));
    match number {
        Some(number) if (low..=high).contains(&number) => Ok(()),
        _ => Err(WeightsProblem::OutOfRange { key, value: value.clone(), low, high }),
    }
}

/// Disabled parts of [`PagNav`](crate::PagNav), to measure their value. By default all parts are enabled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ablation {
    /// No audio: search by frontiers, grounding by sight; without verdicts every Submit counts as correct.
    pub no_audio: bool,
    /// No priors from rooms and neighbouring objects.
    pub no_priors: bool,
    /// No object memory: objects out of view are forgotten, and verification demands a single view.
    pub no_memory: bool,
    /// No verification: a candidate is submitted as soon as it is near and faced.
    pub no_gate: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::PagNav;
    use avln_client::{Action, Agent, Audio, GoalCue, Mission, Observation, TaskSpec};

    fn refusal(text: &str) -> String {
        Weights::parse(text).expect_err(text).to_string()
    }

    #[test]
    fn missing_keys_keep_their_defaults() {
        let weights = Weights::parse("submit_m = 2 # near enough\nverify_looks = 5").unwrap();
        assert_eq!(weights, Weights { submit_m: 2.0, verify_looks: 5, ..Weights::default() });
        assert_eq!(Weights::parse(DEFAULTS).unwrap(), Weights::default());
    }

    #[test]
    fn errors_name_key_value_and_range() {
        assert_eq!(refusal("certain = 1.5"), "certain is 1.5, and must be a number from 0.01 to 1");
        assert_eq!(refusal("vain = nan"), "vain is nan, and must be a number from 0 to 10");
        assert_eq!(
            refusal("patience_steps = 0"),
            "patience_steps is 0, and must be a number from 1 to 10000"
        );
        assert_eq!(refusal("nearer = 'half'"), "nearer is \"half\", and must be a number from 0.1 to 1");
        for (text, words) in
            [("submit = 1.0", "`submit`"), ("verify_looks = 2.5", "2.5"), ("\nvain =", "line 2")]
        {
            assert!(refusal(text).contains(words), "{text}: {}", refusal(text));
        }
    }

    #[test]
    fn unreadable_files_are_named() {
        let error = Weights::read(Path::new("absent.toml")).unwrap_err().to_string();
        assert!(error.starts_with("weights absent.toml: cannot be read: "), "{error}");
    }

    /// Each comment in the file states the enforced range.
    #[test]
    fn documented_ranges_are_enforced() {
        let defaults: Table = DEFAULTS.parse().unwrap();
        let keys = |key: &str| LIMITS.iter().filter(|(limited, ..)| *limited == key).count();
        assert!(defaults.len() == LIMITS.len() && defaults.keys().all(|key| keys(key) == 1), "{defaults:?}");
        let lines: Vec<&str> = DEFAULTS.lines().collect();
        for (key, low, high) in LIMITS {
            let at = lines.iter().position(|line| line.starts_with(&format!("{key} = "))).expect(key);
            let comment = at.checked_sub(1).map_or("", |above| lines[above]);
            let said = comment.starts_with("# ") && comment.ends_with(&format!(" {low} to {high}."));
            assert!(said, "{key}: '{comment}' for {low} to {high}");
        }
    }

    /// Actions for an agent at rest that hears noise in its left ear, or silence.
    fn acts(mut agent: PagNav, hears: bool) -> Vec<Action> {
        let noise = |sample: u32| (sample.wrapping_mul(2_654_435_761) >> 16) as f32 / 65_536.0 - 0.5;
        let left: Vec<f32> = (0..4000).map(noise).collect();
        let audio = Audio { sample_rate_hz: 16_000, right: vec![0.0; left.len()], left };
        let goals = vec![GoalCue::Category("bed".to_owned()); 2];
        agent.begin(&TaskSpec::default(), &Mission { goals, ..Mission::default() });
        let seen = |step| Observation {
            step,
            remaining_steps: 1000 - step,
            audio: hears.then(|| audio.clone()),
            ..Observation::default()
        };
        (0..20).map(|step| agent.act(&seen(step))).collect()
    }

    #[test]
    fn without_audio_sound_has_no_effect() {
        let deaf = || PagNav::default().without(Ablation { no_audio: true, ..Ablation::default() });
        assert_eq!(acts(deaf(), true), acts(deaf(), false));
        assert_ne!(acts(PagNav::default(), true), acts(PagNav::default(), false));
    }

    #[test]
    fn without_audio_sight_has_all_weight() {
        let (all, silent) = (Weights::default(), Weights::default().silent());
        let sum = |weights: &Weights| weights.ground_vis + weights.ground_context + weights.ground_audio;
        assert!((sum(&all) - sum(&silent)).abs() < 1e-6 && silent.ground_audio == 0.0);
        assert!(
            (silent.ground_vis / silent.ground_context - all.ground_vis / all.ground_context).abs() < 1e-5
        );
    }
}
