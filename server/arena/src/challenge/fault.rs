//! Faults in a challenge file: position, problem and a valid example.

use crate::Failure;
use std::{fmt, ops::Range, path::Path};
use toml::de::{DeTable, DeValue};

/// Valid lines, each with the keys that it is an example for.
pub(super) const EXAMPLES: [(&[&str], &str); 42] = [
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
    (&["distractor_sources"], "distractor_sources = \"goals\""),
    (&["extra_submit"], "extra_submit = \"ignored\""),
    (&["stop_claims"], "stop_claims = \"any_open\""),
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

impl Fault {
    pub(super) fn of_toml(text: &str, error: &toml::de::Error) -> Self {
        Self::at(error.span().unwrap_or(0..text.len().min(1)), error.message().trim())
    }

    /// Returns a fault at a key: keys from the top, and list indices from 0.
    pub(super) fn at_key(path: &[&str], problem: impl fmt::Display) -> Self {
        let path = path.iter().map(|&step| step.to_owned()).collect();
        Self { span: None, path, problem: problem.to_string() }
    }

    /// Returns a fault at these bytes.
    pub(super) fn at(span: Range<usize>, problem: impl fmt::Display) -> Self {
        Self { span: Some(span), path: Vec::new(), problem: problem.to_string() }
    }

    /// Returns the line number, from 1.
    fn line(&self, text: &str, document: Option<&DeValue<'_>>) -> usize {
        let of_path = || document.and_then(|document| find(document, &self.path));
        let span = self.span.clone().or_else(of_path).unwrap_or(0..0);
        let before = text.get(..span.start).unwrap_or(text);
        before.matches('\n').count() + 1
    }

    /// Returns the message: file, line, value, problem and a valid example.
    pub fn explain(&self, file: &Path, text: &str) -> Failure {
        self.explain_at(self.line(text, document(text).as_ref()), file, text)
    }

    /// Returns all messages by line, in a single failure.
    pub fn explain_all(faults: &[Self], file: &Path, text: &str) -> Failure {
        let document = document(text);
        let located = |fault: &Self| (fault.line(text, document.as_ref()), fault.clone());
        let mut faults: Vec<_> = faults.iter().map(located).collect();
        faults.sort_by_key(|(line, _)| *line);
        let messages = faults.iter().map(|(line, fault)| fault.explain_at(*line, file, text).to_string());
        Failure::data(messages.collect::<Vec<_>>().join("\n"))
    }

    fn explain_at(&self, line: usize, file: &Path, text: &str) -> Failure {
        const SHOWN: usize = 120;
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

/// Parses the file for positions of keys; `None` for invalid TOML.
fn document(text: &str) -> Option<DeValue<'_>> {
    DeTable::parse(text).ok().map(|table| DeValue::Table(table.into_inner()))
}

/// Returns a key's position; a missing key has the nearest parent's position.
fn find(document: &DeValue<'_>, path: &[String]) -> Option<Range<usize>> {
    let (mut here, mut span) = (document, None);
    for step in path {
        let next = match here {
            DeValue::Table(table) => {
                table.get_key_value(step.as_str()).map(|(key, value)| (key.span(), value))
            }
            DeValue::Array(items) => {
                let item = step.parse().ok().and_then(|index: usize| items.get(index));
                item.map(|item| (item.span(), item))
            }
            _ => None,
        };
        let Some((found, value)) = next else { break };
        (span, here) = (Some(found), value.get_ref());
    }
    span
}
