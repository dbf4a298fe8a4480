//! Contents of a challenge file.

use super::{Fault, KeyPath, keys};
use avln_episode::{
    DistractorSources, Encodings, ExtraSubmit, FeedbackRule, HeadRule, Order, Sensors, SilenceRule, Sounds,
    StopClaims, TimeLimits,
};
use avln_store::{Admission, Phase, QuotaLimits, Ranking, Sample, Visibility, calendar};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::Value;
use std::{collections::BTreeMap, path::PathBuf};
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
        keys::correct_file(&mut table, &mut faults);
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
