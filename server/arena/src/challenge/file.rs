//! Contents and faults of a challenge file.

use crate::Failure;
use avln_episode::{Encodings, FeedbackRule, HeadRule, Order, Sensors, Sounds, TimeLimits};
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
    value::{Date, Datetime, Offset, Time},
};

/// The file of a challenge.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChallengeFile {
    /// Splits of data sets elsewhere, by the name that they get here.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub splits: BTreeMap<String, SplitSource>,
    /// The phases, in the order in which they are shown.
    #[serde(default)]
    pub phases: Vec<PhaseFile>,
}

/// Location of a split outside the data folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitSource {
    /// Folder of the data set; seen from the file when it is relative.
    pub dataset: PathBuf,
    /// Name of the split in it.
    pub split: String,
}

/// A phase of the file. Defaults are those of the types or of [`Phase::new`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseFile {
    /// Id in URLs and requests.
    pub id: String,
    /// Heading on pages; the id by default.
    #[serde(default)]
    pub title: Option<String>,
    /// Text for people.
    #[serde(default)]
    pub description: String,
    /// The split that is played.
    pub split: String,
    /// The rule set; the split's by default.
    #[serde(default)]
    pub rules: Option<String>,
    /// Sound bank: `all`, `train`, `validation`, `test`, `kept:DIGEST` or a folder of recordings.
    #[serde(default)]
    pub sounds: Option<String>,
    /// Head model: `sphere` (default), `kept:DIGEST` or a SOFA file.
    #[serde(default)]
    pub head: Option<String>,
    /// Feedback to a Submit; by default that of the rule set.
    #[serde(default)]
    pub feedback: Option<FeedbackRule>,
    /// Orders that a run may choose; both by default.
    #[serde(default)]
    pub orders: Option<Vec<Order>>,
    /// Sensors that agents may ask for; all by default.
    #[serde(default)]
    pub sensors: Option<Vec<Sensor>>,
    /// From when runs may start; at once by default.
    #[serde(default)]
    pub opens: Option<Datetime>,
    /// From when no more; never by default.
    #[serde(default)]
    pub closes: Option<Datetime>,
    /// Visibility of scores.
    pub scores: Visibility,
    /// Visibility of paths, maps and targets.
    pub replays: Visibility,
    /// Episodes that a run may play side by side.
    #[serde(default)]
    pub max_slots: Option<u32>,
    /// Largest side of a picture, pixels.
    #[serde(default)]
    pub max_side: Option<u32>,
    /// Gives each run an order of its own; by default where replays are not public.
    #[serde(default)]
    pub shuffle: Option<bool>,
    /// The draw of a run's episodes; all of them by default.
    #[serde(default)]
    pub sample: Option<Sample>,
    /// Only the organiser runs agents, in a sandbox without access to anything but the server.
    #[serde(default)]
    pub sealed: bool,
    /// Encodings that agents may ask for though they change values; by default those only that change none.
    #[serde(default)]
    pub encodings: Encodings,
    /// Number of runs that a team may start.
    #[serde(default)]
    pub quota: QuotaLimits,
    /// Wall time that agents have.
    #[serde(default)]
    pub time: TimeLimits,
    /// Ranking of runs.
    #[serde(default)]
    pub ranking: Ranking,
    /// Teams that may play.
    #[serde(default)]
    pub teams: Admission,
}

/// A sensor that agents may ask for.
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

/// Prefix of names of recordings and heads in the data folder: the digest follows.
pub(super) const KEPT: &str = "kept:";

impl ChallengeFile {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// When it is not TOML, or a key is unknown, missing or of another type; the fault tells the line.
    pub fn parse(text: &str) -> Result<Self, Fault> {
        toml::from_str(text).map_err(|error| Fault::of_toml(text, &error))
    }

    /// The file that has these phases and leaves nothing out.
    pub fn of(phases: &[Phase]) -> Self {
        Self { splits: BTreeMap::new(), phases: phases.iter().map(PhaseFile::of).collect() }
    }

    /// The text of the file.
    ///
    /// # Errors
    /// When a value cannot be written in TOML.
    pub fn text(&self) -> Result<String, toml::ser::Error> {
        toml::to_string_pretty(self)
    }
}

/// `value` as JSON, with moments as RFC 3339 writes them.
pub fn json(value: &impl Serialize) -> Value {
    let mut json = serde_json::to_value(value).unwrap_or_default();
    name_moments(&mut json);
    json
}

/// Field name of a datetime serialised by the TOML library.
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
    /// The complete entry of this phase.
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

/// The word for the head that is no file.
pub(super) const SPHERE: &str = "sphere";

fn head_word(head: &HeadRule) -> String {
    match head {
        HeadRule::Sphere => SPHERE.to_owned(),
        HeadRule::Measured(digest) => format!("{KEPT}{digest}"),
    }
}

/// A moment as TOML has it; `None` beyond the year 9999.
fn datetime(unix_ms: i64) -> Option<Datetime> {
    calendar::rfc3339(unix_ms).parse().ok()
}

/// Milliseconds since 1970-01-01 UTC of an RFC 3339 text; `None` if invalid.
pub fn moment_of(text: &str) -> Option<i64> {
    let Datetime { date: Some(date), time: Some(time), offset: Some(offset) } = text.parse().ok()? else {
        return None;
    };
    moment(date, time, offset)
}

/// Time of a key in the file.
pub(super) fn unix_ms(written: Option<&Datetime>, place: KeyPath<'_>) -> Result<Option<i64>, Fault> {
    let Some(written) = written else { return Ok(None) };
    let Datetime { date: Some(date), time: Some(time), offset: Some(offset) } = written else {
        return Err(place.fault(format!("{written} does not say date, time and offset from UTC")));
    };
    let moment = moment(*date, *time, *offset);
    moment.map(Some).ok_or_else(|| place.fault(format!("{written} is no moment of the calendar")))
}

fn moment(date: Date, time: Time, offset: Offset) -> Option<i64> {
    let minutes = match offset {
        Offset::Z => 0,
        Offset::Custom { minutes } => i64::from(minutes),
    };
    let seconds =
        u32::from(time.hour) * 3600 + u32::from(time.minute) * 60 + u32::from(time.second.unwrap_or(0));
    Some(calendar::unix_ms(date.year, date.month, date.day, seconds)? - minutes * 60_000)
}

/// An accepted line for each key.
pub(super) const EXAMPLES: [(&str, &str); 47] = [
    ("phases", "[[phases]]"),
    ("splits", "[splits.hidden]"),
    ("dataset", "dataset = \"../data\""),
    ("id", "id = \"practice\""),
    ("title", "title = \"Practice\""),
    ("description", "description = \"Play here first\""),
    ("split", "split = \"val\""),
    ("rules", "rules = \"lh-avln-v1\""),
    ("sounds", "sounds = \"test\""),
    ("head", "head = \"sphere\""),
    ("feedback", "feedback = \"none\""),
    ("orders", "orders = [\"ordered\", \"unordered\"]"),
    ("sensors", "sensors = [\"rgb\", \"depth\", \"audio\"]"),
    ("encodings", "encodings = { depth = \"millimetres\" }"),
    ("rgb", "encodings = { rgb = \"raw\" }"),
    ("depth", "encodings = { depth = \"millimetres\" }"),
    ("audio", "encodings = { audio = \"int16\" }"),
    ("opens", "opens = 2026-07-01T00:00:00Z"),
    ("closes", "closes = 2026-09-01T00:00:00Z"),
    ("scores", "scores = \"organiser\""),
    ("replays", "replays = \"organiser\""),
    ("max_slots", "max_slots = 16"),
    ("max_side", "max_side = 512"),
    ("sealed", "sealed = true"),
    ("shuffle", "shuffle = true"),
    ("sample", "sample = { episodes = 100, anchors = 20 }"),
    ("episodes", "sample = { episodes = 100, anchors = 20 }"),
    ("anchors", "sample = { episodes = 100, anchors = 20 }"),
    ("quota", "quota = { day = 3, total = 30, concurrent = 1 }"),
    ("day", "quota = { day = 3, total = 30, concurrent = 1 }"),
    ("month", "quota = { month = 30, concurrent = 1 }"),
    ("total", "quota = { day = 3, total = 30, concurrent = 1 }"),
    ("concurrent", "quota = { day = 3, total = 30, concurrent = 1 }"),
    ("uncharged", "quota = { total = 30, uncharged = 20 }"),
    ("time", "time = { step_ms = 5000, bank_ms = 60000, run_s = 86400 }"),
    ("step_ms", "time = { step_ms = 5000, bank_ms = 60000 }"),
    ("bank_ms", "time = { step_ms = 5000, bank_ms = 60000 }"),
    ("run_s", "time = { run_s = 86400 }"),
    ("disconnect_total_s", "time = { disconnect_s = 120, disconnect_total_s = 600 }"),
    ("disconnect_s", "time = { disconnect_s = 120, disconnect_total_s = 600 }"),
    ("ranking", "ranking = { key = \"sr\", entry = \"best\" }"),
    ("key", "ranking = { key = \"sr\", entry = \"best\" }"),
    ("entry", "ranking = { key = \"sr\", entry = \"latest\" }"),
    ("teams", "teams = { approval = true, deny = [\"last year's winner\"] }"),
    ("approval", "teams = { approval = true }"),
    ("allow", "teams = { allow = [\"our friends\"] }"),
    ("deny", "teams = { deny = [\"last year's winner\"] }"),
];

/// A fault of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Bytes of the text that are wrong; `None` while only `path` is known.
    span: Option<Range<usize>>,
    /// Key by key from the top of the file.
    path: Vec<String>,
    said: String,
}

/// A key of a file.
#[derive(Clone, Copy, Debug)]
pub struct KeyPath<'a> {
    /// Key by key from the top of the file; numbers count from 0 in lists.
    pub path: &'a [&'a str],
}

impl KeyPath<'_> {
    /// Something is wrong with the value of the key.
    pub fn fault(&self, said: impl fmt::Display) -> Fault {
        let path = self.path.iter().map(|&step| step.to_owned()).collect();
        Fault { span: None, path, said: said.to_string() }
    }
}

impl Fault {
    /// Converts a TOML error.
    pub(super) fn of_toml(text: &str, error: &toml::de::Error) -> Self {
        let span = error.span().unwrap_or(0..text.len().min(1));
        Self { span: Some(span), path: Vec::new(), said: error.message().trim().to_owned() }
    }

    /// Line in `text`, from 1.
    fn line(&self, text: &str) -> usize {
        let span = self.span.clone().or_else(|| find(text, &self.path)).unwrap_or(0..0);
        let before = text.get(..span.start).unwrap_or(text);
        before.matches('\n').count() + 1
    }

    /// Message for people: file, line, value, problem and a valid example.
    pub fn explain(&self, file: &Path, text: &str) -> Failure {
        const SHOWN: usize = 120;
        let line = self.line(text);
        let written: String =
            text.lines().nth(line - 1).unwrap_or_default().trim().chars().take(SHOWN).collect();
        let key = self.path.last().map_or("", String::as_str);
        let message = format!("{}, line {line}: `{}`: {}", file.display(), written, self.said);
        let failure = Failure::data(message);
        match example(key).or_else(|| example_in(&self.said)).or_else(|| example_in(&written)) {
            Some(example) => failure.hinted(format!("for example: {example}")),
            None => failure.hinted("docs/challenge.toml is an example with every key"),
        }
    }
}

fn example(key: &str) -> Option<&'static str> {
    EXAMPLES.iter().find(|(name, _)| *name == key).map(|(_, example)| *example)
}

/// The example of the first key that `words` names: in a message between backticks, in a line before `=`.
fn example_in(words: &str) -> Option<&'static str> {
    let quoted = words.split('`').skip(1).step_by(2);
    let assigned = words.split_once('=').map(|(key, _)| key.trim());
    assigned.into_iter().chain(quoted).find_map(example)
}

/// Position of a key, or of its parent if missing.
fn find(text: &str, path: &[String]) -> Option<Range<usize>> {
    let table = DeTable::parse(text).ok()?;
    let mut span = None;
    let mut here = DeValue::Table(table.into_inner());
    for step in path {
        let next = match here {
            DeValue::Table(table) => {
                table.into_iter().find(|(key, _)| key.get_ref() == step).map(|(key, value)| {
                    let inner = value.into_inner();
                    (key.span(), inner)
                })
            }
            DeValue::Array(items) => {
                let index: Option<usize> = step.parse().ok();
                index
                    .and_then(|index| items.into_iter().nth(index))
                    .map(|item| (item.span(), item.into_inner()))
            }
            _ => None,
        };
        let Some((found, value)) = next else { break };
        (span, here) = (Some(found), value);
    }
    span
}
