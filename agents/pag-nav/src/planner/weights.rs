use serde::{Deserialize, Serialize};
use std::{fs, io, path::Path, path::PathBuf, sync::LazyLock};
use toml::{Table, Value};

/// The defaults, with unit and range of each number.
const DEFAULTS: &str = include_str!("../../pag-nav.toml");

/// Each number, and the least and most that it may be.
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

/// The tunable numbers of [`PagNav`](crate::PagNav); `pag-nav.toml` has their defaults, and the range of each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// Steps forward and turns that a metre of a way takes.
    pub steps_per_m: f32,
    /// How many steps sooner another source must be reached to be preferred to the one that the agent is heading for.
    pub loyalty_steps: f32,
    /// Weight of visual compatibility in the score of a candidate (lambda_v).
    pub ground_vis: f32,
    /// Weight of the rooms and things around it (lambda_c).
    pub ground_context: f32,
    /// Weight of its consistency with what was heard (lambda_a).
    pub ground_audio: f32,
    /// Distance from the believed source at which that consistency has fallen to 1/sqrt(e), metres.
    pub sound_scale_m: f32,
    /// Certainty of a believed source from which on it counts fully, 0 to 1.
    pub certain: f32,
    /// The same that a Submit asks for where any target will do; see `patience_steps`.
    pub any_certain: f32,
    /// The same that a Submit for the last goal asks for, which ends the episode.
    pub last_certain: f32,
    /// Score from which on a candidate is plausible.
    pub plausible: f32,
    /// Looks from nearby that verification asks for.
    pub verify_looks: u32,
    /// Visual compatibility that verification asks for, 0 to 1; see `patience_steps`.
    pub verify_fit: f32,
    /// Distance to the candidate within which the agent submits (the paper's delta_sub), metres.
    pub submit_m: f32,
    /// Angle to the candidate within which the agent submits (theta_sub), radians.
    pub submit_rad: f32,
    /// A Submit in this share of the loudness before it was followed by silence of the source: it found its target.
    pub found_level: f32,
    /// Distance that the loudness must have allowed before what is seen at a source counts, metres.
    pub look_range_m: f32,
    /// Probability that a source is the goal that is next at which the agent submits without looking at the others.
    pub commit: f32,
    /// Steps of heading for a source after which it counts as looked at, and verification starts to ask for less.
    pub patience_steps: u32,
    /// What a step of having headed for a source in vain adds to what the rest of the way is thought to cost, in steps.
    pub vain: f32,
    /// Steps of heading for a source in vain after which it takes stairs, where it knows some.
    pub storey_steps: u32,
    /// What a source that is certainly not the goal that is next is thought to cost more to search, in steps.
    pub doubt_steps: f32,
    /// Steps before the end from which on verification asks for one look only.
    pub hurry_steps: u32,
    /// Distance from the believed source at which the agent looks around instead of exploring, metres.
    pub arrived_m: f32,
    /// Where ways end this far from the believed source the agent explores, metres.
    pub lost_m: f32,
    /// Weight of the sound in the choice of a frontier (lambda_a).
    pub search_audio: f32,
    /// Distance from the believed source at which that weight has fallen to 1/e, metres.
    pub search_scale_m: f32,
    /// Weight of rooms and things around a frontier (lambda_r and lambda_o).
    pub search_context: f32,
    /// What a metre of way to a frontier costs.
    pub search_way: f32,
    /// How much nearer the agent goes after a Submit that found nothing, as a factor on the distances.
    pub nearer: f32,
}

impl Weights {
    /// What a file like `pag-nav.toml` says; what it leaves out has its default.
    ///
    /// # Errors
    /// When it cannot be read, is no TOML, has a key that is none of these, or a number out of its range.
    pub fn read(path: &Path) -> Result<Self, WeightsError> {
        let failed = |problem| WeightsError { path: path.to_owned(), problem };
        let text = fs::read_to_string(path).map_err(|error| failed(Problem::Unreadable(error)))?;
        Self::parse(&text).map_err(failed)
    }

    fn parse(text: &str) -> Result<Self, Problem> {
        let mut table: Table = DEFAULTS.parse().map_err(|error| Problem::of_toml(DEFAULTS, &error))?;
        let said: Table = text.parse().map_err(|error| Problem::of_toml(text, &error))?;
        table.extend(said);
        LIMITS.iter().try_for_each(|&(key, low, high)| within(&table, key, low, high))?;
        table.try_into().map_err(|error| Problem::of_toml(text, &error))
    }

    /// The same for an agent that hears nothing: sight takes over what sound was worth.
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

/// Why weights cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("weights {}: {problem}", path.display())]
pub struct WeightsError {
    path: PathBuf,
    problem: Problem,
}

#[derive(Debug, thiserror::Error)]
enum Problem {
    #[error("cannot be read: {0}; agents/pag-nav/pag-nav.toml shows what such a file looks like")]
    Unreadable(io::Error),
    #[error("{0}; agents/pag-nav/pag-nav.toml has all keys")]
    Malformed(String),
    #[error("{key} is {value}, and must be a number from {low} to {high}")]
    OutOfRange { key: &'static str, value: Value, low: f64, high: f64 },
}

impl Problem {
    fn of_toml(text: &str, error: &toml::de::Error) -> Self {
        let line = |at: usize| 1 + text[..at.min(text.len())].matches('\n').count();
        Self::Malformed(match error.span() {
            Some(span) => format!("line {}: {}", line(span.start), error.message()),
            None => error.to_string().trim().replace('\n', " "),
        })
    }
}

fn within(table: &Table, key: &'static str, low: f64, high: f64) -> Result<(), Problem> {
    let Some(value) = table.get(key) else { return Ok(()) };
    let number = value.as_float().or(value.as_integer().map(|whole| whole as f64));
    match number {
        Some(number) if (low..=high).contains(&number) => Ok(()),
        _ => Err(Problem::OutOfRange { key, value: value.clone(), low, high }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &str) -> String {
        Weights::parse(text).expect_err(text).to_string()
    }

    #[test]
    fn what_a_file_leaves_out_has_its_default() {
        let weights = Weights::parse("submit_m = 2 # near enough\nverify_looks = 5").unwrap();
        assert_eq!(weights, Weights { submit_m: 2.0, verify_looks: 5, ..Weights::default() });
        assert_eq!(Weights::parse(DEFAULTS).unwrap(), Weights::default());
    }

    #[test]
    fn refusals_name_key_value_and_limits() {
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
    fn a_file_that_cannot_be_read_is_named() {
        let error = Weights::read(Path::new("absent.toml")).unwrap_err().to_string();
        assert!(error.starts_with("weights absent.toml: cannot be read: "), "{error}");
    }

    /// The comment above each key tells the range that is held.
    #[test]
    fn the_file_tells_every_range() {
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
}
