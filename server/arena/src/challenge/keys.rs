//! Unknown keys of a challenge file, with suggestions.

use super::{ChallengeFile, Fault, PhaseFile, SplitSource};
use avln_episode::{Encodings, TimeLimits};
use avln_store::{Admission, QuotaLimits, Ranking, Sample};
use serde::{
    Deserializer,
    de::{DeserializeOwned, Error as _, Visitor, value},
    forward_to_deserialize_any,
};
use std::borrow::Cow;
use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

/// Reports all unknown keys. A misspelt key gets its correct name, so that its value is read too; other unknown keys are
/// removed.
pub(super) fn correct_file(file: &mut DeTable<'_>, faults: &mut Vec<Fault>) {
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
