//! Contents of a challenge file, and unknown keys with suggestions.

use super::Fault;
use avln_episode::{
    DistractorSources, Encodings, ExtraSubmit, FeedbackRule, HeadRule, Order, Sensors, SilenceRule, Sounds,
    StopClaims, TimeLimits,
};
use avln_store::{Admission, Phase, QuotaLimits, Ranking, Sample, Visibility, calendar};
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{DeserializeOwned, Error as _, Visitor, value},
    forward_to_deserialize_any,
};
use serde_json::Value;
use std::{borrow::Cow, collections::BTreeMap, path::PathBuf};
use toml::{
    Spanned,
    de::{DeTable, DeValue, ValueDeserializer},
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
    /// Sounding non-goals per episode; the rule set's by default.
    pub distractor_sources: Option<DistractorSources>,
    /// Effect of a Submit without Submits left; the rule set's by default.
    pub extra_submit: Option<ExtraSubmit>,
    /// Goals open to a Stop; the rule set's by default.
    pub stop_claims: Option<StopClaims>,
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
    /// Parses a TOML file; fails for unknown, missing and invalid keys, with all faults.
    pub fn parse(text: &str) -> Result<Self, Vec<Fault>> {
        let table = DeTable::parse(text).map_err(|error| vec![Fault::of_toml(text, &error)])?;
        let (mut table, mut faults) = (table.into_inner(), Vec::new());
        correct_file(&mut table, &mut faults);
        let mut reader = ItemReader { text, faults };
        let splits = table.remove("splits").map(|value| reader.splits(value)).unwrap_or_default();
        let phases = table.remove("phases").map(|value| reader.phases(value)).unwrap_or_default();
        if reader.faults.is_empty() { Ok(Self { splits, phases }) } else { Err(reader.faults) }
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

/// A reader of single items, so that a fault in one does not hide the faults in others.
struct ItemReader<'a> {
    text: &'a str,
    faults: Vec<Fault>,
}

impl ItemReader<'_> {
    fn splits(&mut self, value: Spanned<DeValue<'_>>) -> BTreeMap<String, SplitSource> {
        let span = value.span();
        match value.into_inner() {
            DeValue::Table(splits) => splits
                .into_iter()
                .filter_map(|(name, source)| Some((name.into_inner().into_owned(), self.item(source)?)))
                .collect(),
            other => self.item(Spanned::new(span, other)).unwrap_or_default(),
        }
    }

    fn phases(&mut self, value: Spanned<DeValue<'_>>) -> Vec<PhaseFile> {
        let span = value.span();
        match value.into_inner() {
            DeValue::Array(phases) => phases.into_iter().filter_map(|phase| self.item(phase)).collect(),
            other => self.item(Spanned::new(span, other)).unwrap_or_default(),
        }
    }

    fn item<T: DeserializeOwned>(&mut self, value: Spanned<DeValue<'_>>) -> Option<T> {
        let read = T::deserialize(ValueDeserializer::from(value));
        read.map_err(|error| self.faults.push(Fault::of_toml(self.text, &error))).ok()
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
            distractor_sources: Some(phase.rules.distractor_sources),
            extra_submit: Some(phase.rules.extra_submit),
            stop_claims: Some(phase.rules.stop_claims),
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

/// Shares of the procedural clips, with their words in challenge files and on the command line.
pub(crate) const SOUND_SHARES: [(&str, Sounds); 4] = [
    ("all", Sounds::All),
    ("train", Sounds::Train),
    ("validation", Sounds::Validation),
    ("test", Sounds::Test),
];

fn sounds_word(sounds: &Sounds) -> String {
    if let Sounds::Own(digest) = sounds {
        return format!("{KEPT}{digest}");
    }
    let share = SOUND_SHARES.iter().find(|(_, share)| share == sounds);
    share.map_or_else(String::new, |(word, _)| (*word).to_owned())
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
pub(super) fn unix_ms(written: Option<&Datetime>, path: &[&str]) -> Result<Option<i64>, Fault> {
    let Some(written) = written else { return Ok(None) };
    if written.date.is_none() || written.time.is_none() || written.offset.is_none() {
        return Err(Fault::at_key(path, format!("{written} needs date, time and offset from UTC")));
    }
    let moment =
        timestamp(written).ok_or_else(|| Fault::at_key(path, format!("{written} is not a valid time")))?;
    Ok(Some(moment))
}

/// Converts a time with date and offset; second fractions are dropped.
fn timestamp(written: &Datetime) -> Option<i64> {
    let moment: jiff::Timestamp = written.to_string().parse().ok()?;
    Some(1000 * moment.as_millisecond().div_euclid(1000))
}

/// Reports all unknown keys. A misspelt key gets its correct name, so that its value is read too; other unknown keys are
/// removed.
fn correct_file(file: &mut DeTable<'_>, faults: &mut Vec<Fault>) {
    correct::<ChallengeFile>(file, faults);
    if let Some(DeValue::Table(splits)) = file.get_mut("splits").map(Spanned::get_mut) {
        for (_, source) in splits.iter_mut() {
            correct_value::<SplitSource>(source, faults);
        }
    }
    if let Some(DeValue::Array(phases)) = file.get_mut("phases").map(Spanned::get_mut) {
        for phase in phases.iter_mut() {
            correct_phase(phase, faults);
        }
    }
}

fn correct_phase(phase: &mut Spanned<DeValue<'_>>, faults: &mut Vec<Fault>) {
    let DeValue::Table(phase) = phase.get_mut() else { return };
    correct::<PhaseFile>(phase, faults);
    correct_inner::<Sample>(phase, "sample", faults);
    correct_inner::<Encodings>(phase, "encodings", faults);
    correct_inner::<QuotaLimits>(phase, "quota", faults);
    correct_inner::<TimeLimits>(phase, "time", faults);
    correct_inner::<Ranking>(phase, "ranking", faults);
    correct_inner::<Admission>(phase, "teams", faults);
}

fn correct_inner<T: DeserializeOwned>(phase: &mut DeTable<'_>, key: &str, faults: &mut Vec<Fault>) {
    if let Some(value) = phase.get_mut(key) {
        correct_value::<T>(value, faults);
    }
}

fn correct_value<T: DeserializeOwned>(value: &mut Spanned<DeValue<'_>>, faults: &mut Vec<Fault>) {
    // Deserialisation reports a value of another type.
    if let DeValue::Table(table) = value.get_mut() {
        correct::<T>(table, faults);
    }
}

fn correct<T: DeserializeOwned>(table: &mut DeTable<'_>, faults: &mut Vec<Fault>) {
    let known = keys_of::<T>();
    let keys = table.keys().map(|key| key.get_ref().clone().into_owned());
    let unknown: Vec<String> = keys.filter(|key| !known.contains(&key.as_str())).collect();
    for key in unknown {
        let Some((written, value)) = table.remove_entry(key.as_str()) else { continue };
        let meant = nearest(&key, known);
        faults.push(Fault::at(written.span(), problem(&key, meant, known)));
        if let Some(meant) = meant
            && !table.contains_key(meant)
        {
            table.insert(Spanned::new(written.span(), Cow::Borrowed(meant)), value);
        }
    }
}

fn problem(key: &str, meant: Option<&str>, known: &[&str]) -> String {
    let key = key.escape_debug();
    match meant {
        Some(meant) => format!("unknown key `{key}`; did you mean `{meant}`?"),
        None => format!("unknown key `{key}`, expected one of `{}`", known.join("`, `")),
    }
}

/// Returns the most similar known key, if at most a third of the letters differ, or two letters of a short key.
fn nearest(key: &str, known: &[&'static str]) -> Option<&'static str> {
    let length = key.chars().count();
    let distances = known.iter().map(|known| (distance(key, known), *known));
    let (distance, found) = distances.min()?;
    // Any two letters are within two changes of `id`.
    (distance <= (length / 3).max(2) && distance < length).then_some(found)
}

/// Returns the Levenshtein distance in letters.
fn distance(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (index, letter) in from.chars().enumerate() {
        let mut diagonal = index;
        row[0] = index + 1;
        for (column, other) in to.iter().enumerate() {
            let replaced = diagonal + usize::from(letter != *other);
            diagonal = row[column + 1];
            row[column + 1] = replaced.min(diagonal + 1).min(row[column] + 1);
        }
    }
    row[to.len()]
}

/// Returns the keys of a struct, as its derived deserialisation names them.
fn keys_of<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut keys: &'static [&'static str] = &[];
    // Fails after recording the names, as there is no value.
    let _ = T::deserialize(FieldNames(&mut keys));
    keys
}

/// A deserialiser without a value, which records the field names of a struct.
struct FieldNames<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for FieldNames<'_> {
    type Error = value::Error;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Self::Error> {
        Err(value::Error::custom("no value"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, Self::Error> {
        *self.0 = fields;
        Err(value::Error::custom("no value"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit
        unit_struct newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_count_changed_letters() {
        let cases = [("scores", "scores", 0), ("score", "scores", 1), ("soudns", "sounds", 2), ("", "id", 2)];
        for (from, to, expected) in cases {
            assert_eq!((distance(from, to), distance(to, from)), (expected, expected), "{from}, {to}");
        }
    }

    #[test]
    fn similar_keys_are_suggested() {
        let phase = keys_of::<PhaseFile>();
        let cases = [
            ("max_slot", Some("max_slots")),
            ("score", Some("scores")),
            ("replay", Some("replays")),
            ("ab", None),
            ("visibility", None),
        ];
        for (key, meant) in cases {
            assert_eq!(nearest(key, phase), meant, "{key}");
        }
    }
}
