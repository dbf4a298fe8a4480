//! Contents and faults of a challenge file.

use crate::Failure;
use avln_episode::{Encodings, FeedbackRule, HeadRule, Order, Sensors, SilenceRule, Sounds, TimeLimits};
use avln_store::{Admission, Phase, QuotaLimits, Ranking, Sample, Visibility, calendar};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{
    collections::BTreeMap,
    fmt,
    ops::Range,
    path::{Path, PathBuf},
};
use toml::{
    de::{DeTable, DeValue},
    value::Datetime,
};

/// A challenge file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChallengeFile {
    /// Splits in other data sets, by local name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub splits: BTreeMap<String, SplitSource>,
    /// Phases in display order.
    #[serde(default)]
    pub phases: Vec<PhaseFile>,
}

/// A split outside the data folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitSource {
    /// Data set folder, relative to the file.
    pub dataset: PathBuf,
    /// Split name in the data set.
    pub split: String,
}

/// A phase. Defaults come from the types or [`Phase::new`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseFile {
    /// Id for URLs and requests.
    pub id: String,
    /// Heading on pages; the id by default.
    pub title: Option<String>,
    /// Description on pages.
    #[serde(default)]
    pub description: String,
    /// Split.
    pub split: String,
    /// Rule set; the split's by default.
    pub rules: Option<String>,
    /// Sound bank: `all`, `train`, `validation`, `test`, `kept:DIGEST` or a folder with recordings.
    pub sounds: Option<String>,
    /// Head model: `sphere` (default), `kept:DIGEST` or a SOFA file.
    pub head: Option<String>,
    /// Feedback to a Submit; the rule set's by default.
    pub feedback: Option<FeedbackRule>,
    /// Silence of found targets; the rule set's by default.
    pub silence: Option<SilenceRule>,
    /// Permitted orders; both by default.
    pub orders: Option<Vec<Order>>,
    /// Permitted sensors; all by default.
    pub sensors: Option<Vec<Sensor>>,
    /// Opening time; at once by default.
    pub opens: Option<Datetime>,
    /// Closing time; never by default.
    pub closes: Option<Datetime>,
    /// Score visibility.
    pub scores: Visibility,
    /// Visibility for paths, maps and targets.
    pub replays: Visibility,
    /// Limit for parallel episodes.
    pub max_slots: Option<u32>,
    /// Largest picture side, pixels.
    pub max_side: Option<u32>,
    /// Random episode order per run; by default if replays are not public.
    pub shuffle: Option<bool>,
    /// Episode draw per run; all episodes by default.
    pub sample: Option<Sample>,
    /// Sandboxed runs by the organiser only.
    #[serde(default)]
    pub sealed: bool,
    /// Permitted lossy encodings; none by default.
    #[serde(default)]
    pub encodings: Encodings,
    /// Runs per team.
    #[serde(default)]
    pub quota: QuotaLimits,
    /// Wall-time limits.
    #[serde(default)]
    pub time: TimeLimits,
    /// Ranking.
    #[serde(default)]
    pub ranking: Ranking,
    /// Admitted teams.
    #[serde(default)]
    pub teams: Admission,
}

/// A sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sensor {
    /// Colour.
    Rgb,
    /// Distance.
    Depth,
    /// Sound.
    Audio,
}

/// Prefix for recordings and heads in the data folder, before the digest.
pub(super) const KEPT: &str = "kept:";

impl ChallengeFile {
    /// Parses a TOML file; fails for an unknown, missing or invalid key.
    pub fn parse(text: &str) -> Result<Self, Fault> {
        toml::from_str(text).map_err(|error| Fault::of_toml(text, &error))
    }

    /// Returns the complete file for these phases.
    pub fn of(phases: &[Phase]) -> Self {
        Self { splits: BTreeMap::new(), phases: phases.iter().map(PhaseFile::of).collect() }
    }

    /// Returns the text.
    pub fn text(&self) -> Result<String, toml::ser::Error> {
        toml::to_string_pretty(self)
    }
}

/// Converts a value to JSON, with times by RFC 3339.
pub fn json(value: &impl Serialize) -> Value {
    let mut json = serde_json::to_value(value).unwrap_or_default();
    name_moments(&mut json);
    json
}

// The TOML library serialises a datetime as an object with this single field.
const MOMENT: &str = "$__toml_private_datetime";

fn name_moments(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(name_moments),
        Value::Object(fields) => match fields.remove(MOMENT) {
            Some(moment) => *value = moment,
            None => fields.values_mut().for_each(name_moments),
        },
        _ => {}
    }
}

impl PhaseFile {
    /// Returns the complete entry for a phase.
    pub fn of(phase: &Phase) -> Self {
        let Sensors { rgb, depth, audio, width, height, encodings, .. } = phase.sensors;
        let sensors = [(rgb, Sensor::Rgb), (depth, Sensor::Depth), (audio, Sensor::Audio)];
        Self {
            id: phase.id.clone(),
            title: Some(phase.title.clone()),
            description: phase.description.clone(),
            split: phase.split.clone(),
            rules: Some(phase.rules.name.clone()),
            sounds: Some(sounds_word(&phase.rules.sounds)),
            head: Some(head_word(&phase.rules.head)),
            feedback: Some(phase.rules.feedback),
            silence: Some(phase.rules.silence),
            orders: Some(phase.orders.clone()),
            sensors: Some(sensors.into_iter().filter(|(on, _)| *on).map(|(_, sensor)| sensor).collect()),
            opens: phase.schedule.opens_unix_ms.and_then(datetime),
            closes: phase.schedule.closes_unix_ms.and_then(datetime),
            scores: phase.scores,
            replays: phase.replays,
            max_slots: Some(phase.max_slots),
            max_side: Some(width.max(height)),
            shuffle: Some(phase.sampling.shuffle),
            sample: phase.sampling.sample,
            sealed: phase.sealed,
            encodings,
            quota: phase.quotas,
            time: phase.time,
            ranking: phase.ranking,
            teams: phase.admission.clone(),
        }
    }
}

fn sounds_word(sounds: &Sounds) -> String {
    match sounds {
        Sounds::All => "all".to_owned(),
        Sounds::Train => "train".to_owned(),
        Sounds::Validation => "validation".to_owned(),
        Sounds::Test => "test".to_owned(),
        Sounds::Own(digest) => format!("{KEPT}{digest}"),
    }
}

/// Word for the head without a file.
pub(super) const SPHERE: &str = "sphere";

fn head_word(head: &HeadRule) -> String {
    match head {
        HeadRule::Sphere => SPHERE.to_owned(),
        HeadRule::Measured(digest) => format!("{KEPT}{digest}"),
    }
}

/// Converts a timestamp; `None` beyond the year 9999.
fn datetime(unix_ms: i64) -> Option<Datetime> {
    calendar::rfc3339(unix_ms).parse().ok()
}

/// Parses an RFC 3339 time in whole seconds; Unix milliseconds.
pub fn moment_of(text: &str) -> Option<i64> {
    // By the TOML library, so that command line and file accept the same spellings.
    timestamp(&text.parse().ok()?)
}

/// Converts a time in the file; Unix milliseconds.
pub(super) fn unix_ms(written: Option<&Datetime>, path: KeyPath<'_>) -> Result<Option<i64>, Fault> {
    let Some(written) = written else { return Ok(None) };
    if written.date.is_none() || written.time.is_none() || written.offset.is_none() {
        return Err(path.fault(format!("{written} needs date, time and offset from UTC")));
    }
    let moment = timestamp(written).ok_or_else(|| path.fault(format!("{written} is not a valid time")))?;
    Ok(Some(moment))
}

/// Converts a time with date and offset; second fractions are dropped.
fn timestamp(written: &Datetime) -> Option<i64> {
    let moment: jiff::Timestamp = written.to_string().parse().ok()?;
    Some(1000 * moment.as_millisecond().div_euclid(1000))
}

/// Valid lines, each with the keys that it is an example for.
pub(super) const EXAMPLES: [(&[&str], &str); 39] = [
    (&["phases"], "[[phases]]"),
    (&["splits"], "[splits.hidden]"),
    (&["dataset"], "dataset = \"../data\""),
    (&["id"], "id = \"practice\""),
    (&["title"], "title = \"Practice\""),
    (&["description"], "description = \"Play here first\""),
    (&["split"], "split = \"val\""),
    (&["rules"], "rules = \"lh-avln-v1\""),
    (&["sounds"], "sounds = \"test\""),
    (&["head"], "head = \"sphere\""),
    (&["feedback"], "feedback = \"none\""),
    (&["silence"], "silence = \"window_end\""),
    (&["orders"], "orders = [\"ordered\", \"unordered\"]"),
    (&["sensors"], "sensors = [\"rgb\", \"depth\", \"audio\"]"),
    (&["encodings", "depth"], "encodings = { depth = \"millimetres\" }"),
    (&["rgb"], "encodings = { rgb = \"raw\" }"),
    (&["audio"], "encodings = { audio = \"int16\" }"),
    (&["opens"], "opens = 2026-07-01T00:00:00Z"),
    (&["closes"], "closes = 2026-09-01T00:00:00Z"),
    (&["scores"], "scores = \"organiser\""),
    (&["replays"], "replays = \"organiser\""),
    (&["max_slots"], "max_slots = 16"),
    (&["max_side"], "max_side = 512"),
    (&["sealed"], "sealed = true"),
    (&["shuffle"], "shuffle = true"),
    (&["sample", "episodes", "anchors"], "sample = { episodes = 100, anchors = 20 }"),
    (&["quota", "day", "total", "concurrent"], "quota = { day = 3, total = 30, concurrent = 1 }"),
    (&["month"], "quota = { month = 30, concurrent = 1 }"),
    (&["uncharged"], "quota = { total = 30, uncharged = 20 }"),
    (&["time"], "time = { step_ms = 5000, bank_ms = 60000, run_s = 86400 }"),
    (&["step_ms", "bank_ms"], "time = { step_ms = 5000, bank_ms = 60000 }"),
    (&["run_s"], "time = { run_s = 86400 }"),
    (&["disconnect_total_s", "disconnect_s"], "time = { disconnect_s = 120, disconnect_total_s = 600 }"),
    (&["ranking", "key"], "ranking = { key = \"sr\", entry = \"best\" }"),
    (&["entry"], "ranking = { key = \"sr\", entry = \"latest\" }"),
    (&["teams"], "teams = { approval = true, deny = [\"last year's winner\"] }"),
    (&["approval"], "teams = { approval = true }"),
    (&["allow"], "teams = { allow = [\"our friends\"] }"),
    (&["deny"], "teams = { deny = [\"last year's winner\"] }"),
];

/// A fault in a challenge file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Wrong bytes; `None` if only the path is known.
    span: Option<Range<usize>>,
    /// Keys from the top.
    path: Vec<String>,
    problem: String,
}

/// A key.
#[derive(Clone, Copy, Debug)]
pub struct KeyPath<'a> {
    /// Keys from the top, and list indices from 0.
    pub path: &'a [&'a str],
}

impl KeyPath<'_> {
    /// Returns a fault at this key.
    pub fn fault(&self, problem: impl fmt::Display) -> Fault {
        let path = self.path.iter().map(|&step| step.to_owned()).collect();
        Fault { span: None, path, problem: problem.to_string() }
    }
}

impl Fault {
    pub(super) fn of_toml(text: &str, error: &toml::de::Error) -> Self {
        let span = error.span().unwrap_or(0..text.len().min(1));
        Self { span: Some(span), path: Vec::new(), problem: error.message().trim().to_owned() }
    }

    /// Returns the line number, from 1.
    fn line(&self, text: &str) -> usize {
        let span = self.span.clone().or_else(|| find(text, &self.path)).unwrap_or(0..0);
        let before = text.get(..span.start).unwrap_or(text);
        before.matches('\n').count() + 1
    }

    /// Returns the message: file, line, value, problem and a valid example.
    pub fn explain(&self, file: &Path, text: &str) -> Failure {
        const SHOWN: usize = 120;
        let line = self.line(text);
        let written: String =
            text.lines().nth(line - 1).unwrap_or_default().trim().chars().take(SHOWN).collect();
        let key = self.path.last().map_or("", String::as_str);
        let message = format!("{}, line {line}: `{}`: {}", file.display(), written, self.problem);
        let failure = Failure::data(message);
        match example(key).or_else(|| example_in(&self.problem)).or_else(|| example_in(&written)) {
            Some(example) => failure.hinted(format!("for example: {example}")),
            None => failure.hinted("docs/challenge.toml is an example with every key"),
        }
    }
}

fn example(key: &str) -> Option<&'static str> {
    EXAMPLES.iter().find(|(keys, _)| keys.contains(&key)).map(|(_, example)| *example)
}

/// Returns the example for the first key in `words`: between backticks in a message, before `=` in a line.
fn example_in(words: &str) -> Option<&'static str> {
    let quoted = words.split('`').skip(1).step_by(2);
    let assigned = words.split_once('=').map(|(key, _)| key.trim());
    assigned.into_iter().chain(quoted).find_map(example)
}

/// Returns a key's position; a missing key has the nearest parent's position.
fn find(text: &str, path: &[String]) -> Option<Range<usize>> {
    let table = DeTable::parse(text).ok()?;
    let mut span = None;
    let mut here = DeValue::Table(table.into_inner());
    for step in path {
        let next = match here {
            DeValue::Table(table) => {
                let found = table.into_iter().find(|(key, _)| key.get_ref() == step);
                found.map(|(key, value)| (key.span(), value.into_inner()))
            }
            DeValue::Array(items) => {
                let item = step.parse().ok().and_then(|index| items.into_iter().nth(index));
                item.map(|item| (item.span(), item.into_inner()))
            }
            _ => None,
        };
        let Some((found, value)) = next else { break };
        (span, here) = (Some(found), value);
    }
    span
}
