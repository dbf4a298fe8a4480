//! Faults of a challenge file: line, key, value and a valid example.

use crate::{Failure, FailureKind};
use std::{fmt, ops::Range, path::Path};
use toml::de::{DeTable, DeValue};

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
pub struct Place<'a> {
    /// Key by key from the top of the file; numbers count from 0 in lists.
    pub path: &'a [&'a str],
}

impl Place<'_> {
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
        let failure = Failure::new(FailureKind::Data, message);
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
