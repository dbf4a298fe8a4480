//! Weights: the numbers and switches of a preset, read from TOML.

use crate::preset::{Ablation, Preset, Switches};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::{fs, io};
use toml::{Table, Value};

const LIMITS: [(&str, f64, f64); 39] = [
    ("search_room", 0.0, 10.0),
    ("search_object", 0.0, 10.0),
    ("search_audio", 0.0, 10.0),
    ("search_tie", 0.0, 1.0),
    ("keep_steps", 1.0, 1000.0),
    ("half_life_steps", 1.0, 10_000.0),
    ("search_scale_m", 0.01, 100.0),
    ("arrived_m", 0.0, 100.0),
    ("lost_m", 0.0, 100.0),
    ("steps_per_m", 0.1, 100.0),
    ("loyalty_steps", 0.0, 1000.0),
    ("vain", 0.0, 10.0),
    ("doubt_steps", 0.0, 1000.0),
    ("vague", 0.0, 1.0),
    ("vague_steps", 0.0, 1000.0),
    ("source_steps", 1.0, 10_000.0),
    ("storey_steps", 1.0, 10_000.0),
    ("ground_vis", 0.01, 1.0),
    ("ground_context", 0.0, 1.0),
    ("ground_audio", 0.0, 1.0),
    ("associate", 0.01, 1.0),
    ("plausible", 0.0, 3.0),
    ("loyalty", 0.0, 1.0),
    ("intensity_m", 0.1, 10.0),
    ("sound_scale_m", 0.01, 100.0),
    ("certain", 0.01, 1.0),
    ("view_near_m", 0.1, 5.0),
    ("view_far_m", 0.2, 10.0),
    ("view_way", 0.0, 10.0),
    ("verify_floor", 0.05, 1.0),
    ("verify_unheard", 0.05, 1.0),
    ("verify_looks", 1.0, 100.0),
    ("submit_m", 0.1, 10.0),
    ("submit_rad", 0.01, 3.15),
    ("patience_steps", 1.0, 10_000.0),
    ("hurry_steps", 0.0, 10_000.0),
    ("found_level", 0.0, 1.0),
    ("look_range_m", 0.1, 100.0),
    ("commit", 0.0, 1.0),
];
/// The tunable numbers and the switches of [`PagNav`](crate::PagNav). The files in `presets/` document values and ranges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// Weight of the room prior P_room (lambda_r). No unit.
    pub search_room: f32,
    /// Weight of the object prior P_obj (lambda_o). No unit.
    pub search_object: f32,
    /// Weight of sound, s_aud (lambda_a). No unit.
    pub search_audio: f32,
    /// Difference in score within which the shorter way decides. No unit.
    pub search_tie: f32,
    /// Steps for which a frontier stays the target, unless it is reached or explored. Steps.
    pub keep_steps: u32,
    /// Age at which a bearing has half of its weight: sources alternate. Steps.
    pub half_life_steps: f32,
    /// Distance of a frontier to the estimated source at which s_aud falls to 1/e. Metres.
    pub search_scale_m: f32,
    /// Distance to the estimated source at which the agent looks around instead of exploring. Metres.
    pub arrived_m: f32,
    /// Distance from a path's end to the estimated source at which the agent explores. Metres.
    pub lost_m: f32,
    /// Steps and turns per metre of path. Steps per metre.
    pub steps_per_m: f32,
    /// Advantage of the current source. Steps.
    pub loyalty_steps: f32,
    /// Cost per past step towards a source. Steps per step.
    pub vain: f32,
    /// Cost of a source that is certainly not the next goal. Steps.
    pub doubt_steps: f32,
    /// Certainty of an estimate below which the agent explores instead of approaching it. Probability.
    pub vague: f32,
    /// Cost of a source without any certainty. Steps.
    pub vague_steps: f32,
    /// Steps towards a source after which it counts as viewed. Steps.
    pub source_steps: u32,
    /// Steps of search on a storey after which the agent takes known stairs. Steps.
    pub storey_steps: u32,
    /// Weight of visual compatibility s_vis (lambda_v). No unit.
    pub ground_vis: f32,
    /// Weight of the context prior P_ctx (lambda_c). No unit.
    pub ground_context: f32,
    /// Weight of the audio-intensity memory s_int (lambda_a). No unit.
    pub ground_audio: f32,
    /// Least s_vis at which an object is associated with a goal. No unit.
    pub associate: f32,
    /// Least score of a plausible candidate. No unit.
    pub plausible: f32,
    /// Advantage of the current candidate in the choice. No unit.
    pub loyalty: f32,
    /// Radius around a candidate whose levels count in s_int. Metres.
    pub intensity_m: f32,
    /// With source_positions: distance to the estimated source at which s_int falls to 1/sqrt(e). Metres.
    pub sound_scale_m: f32,
    /// With source_positions: certainty at which an estimate has full weight. Probability.
    pub certain: f32,
    /// Least distance of a viewpoint to the candidate. Metres.
    pub view_near_m: f32,
    /// Greatest distance of a viewpoint to the candidate. Metres.
    pub view_far_m: f32,
    /// Cost of a viewpoint per metre of path, against 1 for a view from a new side. Score per metre.
    pub view_way: f32,
    /// Least s_vis of the fresh look; no rule lowers it. Probability.
    pub verify_floor: f32,
    /// Least s_vis without a located source at the candidate, if above `verify_floor`. Probability.
    pub verify_unheard: f32,
    /// Near views from different positions; see patience_steps. A whole number.
    pub verify_looks: u32,
    /// Greatest distance to the candidate (delta_sub). Metres.
    pub submit_m: f32,
    /// Greatest bearing (theta_sub). Radians.
    pub submit_rad: f32,
    /// Steps towards a candidate after which fewer looks suffice; after three times as many it is set aside. Steps.
    pub patience_steps: u32,
    /// Steps before the end at which one look suffices. Steps.
    pub hurry_steps: u32,
    /// Share of the level below which a source counts as silent after a Submit. No unit.
    pub found_level: f32,
    /// Range, by level, within which a source must be heard at a Submit. Metres.
    pub look_range_m: f32,
    /// Probability of the right goal at which other sources need no view. Probability.
    pub commit: f32,
    /// Extensions of the paper.
    pub switches: Switches,
}

impl Weights {
    /// Returns the least s_vis of a claim, with or without a located source at the candidate.
    pub(crate) fn least_vis(&self, is_supported: bool) -> f32 {
        if is_supported { self.verify_floor } else { self.verify_floor.max(self.verify_unheard) }
    }

    /// Reads a file with changes to a preset; missing keys keep the preset's values, unknown keys are errors.
    pub fn read(preset: Preset, path: &Path) -> Result<Self, WeightsError> {
        let failed = |problem| WeightsError { path: path.to_owned(), problem };
        let text = fs::read_to_string(path).map_err(|error| failed(WeightsProblem::Unreadable(error)))?;
        Self::parse(preset, &text).map_err(failed)
    }

    pub(crate) fn parse(preset: Preset, text: &str) -> Result<Self, WeightsProblem> {
        let defaults = preset.file();
        let mut table: Table = defaults.parse().map_err(|error| WeightsProblem::of_toml(defaults, &error))?;
        let mut changes: Table = text.parse().map_err(|error| WeightsProblem::of_toml(text, &error))?;
        if let (Some(Value::Table(all)), Some(Value::Table(some))) =
            (table.get_mut("switches"), changes.get_mut("switches"))
        {
            all.extend(std::mem::take(some));
            changes.remove("switches");
        }
        table.extend(changes);
        LIMITS.iter().try_for_each(|&(key, low, high)| within(&table, key, low, high))?;
        let weights: Self = table.try_into().map_err(|error| WeightsProblem::of_toml(text, &error))?;
        match weights.switches.missing() {
            Some((switch, needed)) => Err(WeightsProblem::Switch { switch, needed }),
            None => Ok(weights),
        }
    }

    /// Returns the weights for an agent with disabled parts.
    pub(crate) fn under(self, ablation: Ablation) -> Self {
        let switches = self.switches.under(ablation);
        let weights = if ablation.has_no_search_by_sound() { self.silent() } else { self };
        Self { switches, ..weights }
    }

    /// Returns the weights for search and grounding without sound. The others stay: a candidate without sound needs the same s_vis.
    fn silent(self) -> Self {
        Self { ground_audio: 0.0, search_audio: 0.0, ..self }
    }
}

impl Preset {
    /// Returns the weights.
    pub fn weights(self) -> Weights {
        static READ: LazyLock<[Weights; 2]> = LazyLock::new(|| {
            Preset::ALL.map(|preset| Weights::parse(preset, "").expect("a test reads the presets"))
        });
        READ[self as usize].clone()
    }
}

impl Default for Weights {
    /// Returns the weights of the preset `pag-nav`.
    fn default() -> Self {
        Preset::default().weights()
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
pub(crate) enum WeightsProblem {
    #[error("cannot be read: {0}; agents/pag-nav/presets/pag-nav.toml is an example")]
    Unreadable(io::Error),
    #[error("{0}; agents/pag-nav/presets/pag-nav.toml lists all keys")]
    Malformed(String),
    #[error("{key} is {value}, and must be a number from {low} to {high}")]
    OutOfRange { key: &'static str, value: Value, low: f64, high: f64 },
    #[error("the switch {switch} needs {needed}; enable {needed}, or disable {switch}")]
    Switch { switch: &'static str, needed: &'static str },
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

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Weights, WeightsProblem> {
        Weights::parse(Preset::PagNav, text)
    }

    fn refusal(text: &str) -> String {
        parse(text).expect_err(text).to_string()
    }

    #[test]
    fn missing_keys_keep_their_defaults() {
        let weights =
            parse("submit_m = 2 # near enough\nverify_looks = 5\n[switches]\nstairs = true").unwrap();
        let switches = Switches { stairs: true, ..Switches::default() };
        assert_eq!(weights, Weights { submit_m: 2.0, verify_looks: 5, switches, ..Weights::default() });
        assert_eq!(parse("").unwrap(), Weights::default());
        assert_eq!(parse(Preset::PagNavPlus.file()).unwrap(), Preset::PagNavPlus.weights());
    }

    #[test]
    fn errors_name_key_value_and_range() {
        assert_eq!(refusal("certain = 1.5"), "certain is 1.5, and must be a number from 0.01 to 1");
        assert_eq!(refusal("vain = nan"), "vain is nan, and must be a number from 0 to 10");
        assert_eq!(refusal("verify_floor = 0"), "verify_floor is 0, and must be a number from 0.05 to 1");
        assert_eq!(refusal("commit = 'half'"), "commit is \"half\", and must be a number from 0 to 1");
        for (text, words) in [
            ("submit = 1.0", "`submit`"),
            ("verify_looks = 2.5", "2.5"),
            ("\nvain =", "line 2"),
            ("[switches]\nlifts = true", "`lifts`"),
        ] {
            assert!(refusal(text).contains(words), "{text}: {}", refusal(text));
        }
    }

    #[test]
    fn switches_need_their_dependencies() {
        for (text, words) in [
            ("direct_approach = true", "direct_approach needs source_positions"),
            ("silence_outcomes = true", "silence_outcomes needs count_windows"),
            ("joint_association = true\nsource_positions = true", "joint_association needs count_windows"),
        ] {
            let problem = refusal(&format!("[switches]\n{text}"));
            assert!(problem.contains(words), "{text}: {problem}");
        }
    }

    #[test]
    fn unreadable_files_are_named() {
        let error = Weights::read(Preset::PagNav, Path::new("absent.toml")).unwrap_err().to_string();
        assert!(error.starts_with("weights absent.toml: cannot be read: "), "{error}");
    }

    /// Each comment in the files states the enforced range.
    #[test]
    fn documented_ranges_are_enforced() {
        for preset in Preset::ALL {
            let (text, defaults): (_, Table) = (preset.file(), preset.file().parse().unwrap());
            let keys = |key: &str| LIMITS.iter().filter(|(limited, ..)| *limited == key).count();
            assert_eq!(defaults.len(), LIMITS.len() + 1);
            assert!(defaults.keys().all(|key| key == "switches" || keys(key) == 1), "{defaults:?}");
            let lines: Vec<&str> = text.lines().collect();
            let comment = |key: &str| {
                let at = lines.iter().position(|line| line.starts_with(&format!("{key} = "))).expect(key);
                at.checked_sub(1).map_or("", |above| lines[above])
            };
            for (key, low, high) in LIMITS {
                let is_documented = comment(key).ends_with(&format!(" {low} to {high}."));
                assert!(is_documented, "{key}: '{}' for {low} to {high}", comment(key));
            }
            for key in defaults["switches"].as_table().unwrap().keys() {
                assert!(comment(key).ends_with(" true or false."), "{key}: '{}'", comment(key));
            }
        }
    }

    #[test]
    fn without_search_by_sound_other_weights_stay() {
        let all = Preset::PagNavPlus.weights();
        let silent = all.clone().under(Ablation { no_search_sound: true, ..Ablation::default() });
        assert_eq!((silent.ground_audio, silent.search_audio), (0.0, 0.0));
        assert_eq!((silent.ground_vis, silent.search_room), (all.ground_vis, all.search_room));
        assert!(silent.switches.silence_outcomes && !silent.switches.source_positions);
        assert_eq!(silent.verify_floor, all.verify_floor);
    }
}
