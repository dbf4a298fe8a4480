//! The challenge file: splits and phases with dates, quotas, budgets and visibility.
//!
//! Start reading at [`ChallengeFile`], the file, and [`Planner`], which computes the changes.

use crate::Failure;
use avln_store::{AuditNote, Phase};
pub use fault::Fault;
pub(crate) use file::SOUND_SHARES;
pub use file::{ChallengeFile, PhaseFile, SplitSource, json, moment_of};
pub use plan::{ChallengeChanges, PlanError, Planner, SummaryStyle};
use serde_json::Value;
use std::collections::BTreeMap;

mod conversion;
mod fault;
mod file;
pub(crate) mod overlap;
mod plan;

/// Returns the command line's actor for audit entries.
pub fn actor() -> String {
    let user = std::env::var("USER").ok().filter(|user| !user.trim().is_empty());
    user.map_or_else(|| "command line".to_owned(), |user| format!("{user} at the command line"))
}

/// Returns the audit entries for a phase change; none without differences.
pub fn notes(actor: &str, before: Option<&Phase>, after: &Phase, reason: &str) -> Vec<AuditNote> {
    let subject = format!("phase {}", after.id);
    let note = |what: &str, before: Option<String>, after: Option<String>| AuditNote {
        actor: actor.to_owned(),
        subject: subject.clone(),
        what: what.to_owned(),
        before,
        after,
        reason: reason.to_owned(),
    };
    let mut notes = Vec::new();
    if before.is_none() {
        notes.push(note("made", None, Some(format!("{} episodes", after.episodes.len()))));
    }
    let (old, new) = (before.map(settings).unwrap_or_default(), settings(after));
    for key in old.keys().chain(new.keys().filter(|key| !old.contains_key(*key))) {
        let (was, is) = (old.get(key), new.get(key));
        if was != is {
            notes.push(note(key, was.cloned(), is.cloned()));
        }
    }
    notes
}

/// Returns a phase's settings by key, without unset ones.
fn settings(phase: &Phase) -> BTreeMap<String, String> {
    let mut settings = BTreeMap::new();
    flatten("", &json(&PhaseFile::of(phase)), &mut settings);
    let schedule = &phase.schedule;
    settings.extend(schedule.paused.clone().map(|paused| ("paused".to_owned(), paused)));
    settings.extend(schedule.closed.then(|| ("closed".to_owned(), "by hand".to_owned())));
    settings.insert("position".to_owned(), phase.position.to_string());
    settings.insert("episode list".to_owned(), episode_digest(phase));
    settings
}

fn episode_digest(phase: &Phase) -> String {
    let ids = phase.episodes.iter().map(|episode| episode.episode.as_str());
    avln_store::pool_digest(&phase.split, ids)[..16].to_owned()
}

fn flatten(above: &str, value: &Value, into: &mut BTreeMap<String, String>) {
    match value {
        Value::Null => {}
        Value::Object(fields) => {
            for (name, value) in fields {
                let key = if above.is_empty() { name.clone() } else { format!("{above}.{name}") };
                flatten(&key, value, into);
            }
        }
        leaf => {
            let text = leaf.as_str().map_or_else(|| leaf.to_string(), str::to_owned);
            into.insert(above.to_owned(), text);
        }
    }
}

fn one_line(failure: &Failure) -> String {
    failure.to_string().replace('\n', "; ")
}

/// Returns a number with a noun; the plural ends in s.
fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::challenge::fault::EXAMPLES;
    use avln_episode::Rules;
    use avln_store::Sample;
    use proptest::prelude::*;
    use std::path::Path;

    #[test]
    fn changes_are_noted_by_key() {
        let before = Phase::new("practice", "val", Rules::paper(), vec![]);
        assert_eq!(notes("ada", Some(&before), &before, ""), []);
        let mut after = before.clone();
        after.quotas.day = Some(3);
        after.schedule.opens_unix_ms = Some(0);
        let noted: Vec<_> = notes("ada", Some(&before), &after, "start")
            .into_iter()
            .map(|n| (n.what, n.before, n.after))
            .collect();
        let moment = "1970-01-01T00:00:00Z".to_owned();
        assert_eq!(
            noted,
            [("opens".to_owned(), None, Some(moment)), ("quota.day".to_owned(), None, Some("3".to_owned()))]
        );
        assert_eq!(notes("ada", None, &after, "")[0].what, "made");
    }

    const EXAMPLE: &str = include_str!("../../../../docs/challenge.toml");
    const SMALL: &str =
        "[[phases]]\nid = \"a\"\nsplit = \"val\"\nscores = \"public\"\nreplays = \"public\"\n";

    fn refused(text: &str) -> String {
        let faults = ChallengeFile::parse(text).expect_err(text);
        Fault::explain_all(&faults, Path::new("challenge.toml"), text).to_string()
    }

    #[test]
    fn documented_example_has_every_key() {
        let file = ChallengeFile::parse(EXAMPLE).expect("a file");
        let ids: Vec<_> = file.phases.iter().map(|phase| phase.id.as_str()).collect();
        assert_eq!(ids, ["practice", "standard", "challenge"]);
        let keys = json(&PhaseFile::of(&every_setting()));
        for key in keys.as_object().expect("an object").keys() {
            assert!(EXAMPLE.contains(&format!("{key} = ")), "{key} is not in docs/challenge.toml");
        }
    }

    /// Returns a phase with all settings.
    fn every_setting() -> Phase {
        let mut phase = Phase::new("every", "val", Rules::paper(), vec![]);
        phase.schedule.opens_unix_ms = Some(1_767_225_600_000);
        phase.schedule.closes_unix_ms = Some(1_782_864_000_000);
        phase.sampling.sample = Some(Sample { episodes: 3, anchors: 1 });
        phase.sealed = true;
        phase.quotas.day = Some(2);
        phase.admission.deny = vec!["a \"quoted\" team".to_owned()];
        phase
    }

    #[test]
    fn shown_files_parse_to_the_same_value() {
        let shown = ChallengeFile::of(&[every_setting()]);
        let text = shown.text().expect("TOML");
        assert!(text.contains("opens = 2026-01-01T00:00:00Z"), "{text}");
        assert_eq!(ChallengeFile::parse(&text).expect("the same file"), shown);
    }

    #[test]
    fn refusals_show_line_value_and_a_valid_example() {
        let cases = [
            ("id = 7\n", 1, "`phases`"),
            (
                &format!("{SMALL}max_slot = 4\n"),
                6,
                "did you mean `max_slots`?\nhint: for example: max_slots = 16",
            ),
            (&format!("{SMALL}max_slots = \"many\"\n"), 6, "max_slots = 16"),
            (&format!("{SMALL}max_slots = -1\n"), 6, "max_slots = 16"),
            (&format!("{SMALL}opens = \"tomorrow\"\n"), 6, "opens = 2026-07-01T00:00:00Z"),
            (&format!("{SMALL}quota = {{ week = 3 }}\n"), 6, "week"),
            (&format!("{SMALL}ranking = {{ key = \"luck\" }}\n"), 6, "ranking = { key = \"sr\""),
            (&format!("{SMALL}scores = \"public\"\n"), 6, "scores"),
            ("[[phases]]\nid = \"a\"\nsplit = \"val\"\nreplays = \"public\"\n", 1, "scores = \"organiser\""),
            (&format!("{SMALL}title = \"open\n"), 6, "title = \"Practice\""),
        ];
        for (text, line, named) in cases {
            let message = refused(text);
            assert!(message.starts_with(&format!("challenge.toml, line {line}: ")), "{text}: {message}");
            assert_eq!(message.lines().count(), 2, "{text}: {message}");
            assert!(message.contains(named), "{text}: {message}");
        }
    }

    #[test]
    fn all_faults_are_shown_by_line() {
        let text = "phase = []\n[[phases]]\nid = \"a\"\nsplit = \"val\"\nscore = \"public\"\nreplays = \"public\"\n\
                    quota = { days = 3, concurent = 1 }\n[[phases]]\nid = \"b\"\nsplit = \"val\"\n\
                    [splits.val]\ndataset = \"data\"\nsplits = 7\n";
        let message = refused(text);
        let problems: Vec<_> = message.lines().filter(|line| line.starts_with("challenge.toml, ")).collect();
        let expected = [
            (1, "did you mean `phases`?"),
            (5, "did you mean `scores`?"),
            (7, "did you mean `concurrent`?"),
            (7, "did you mean `day`?"),
            (8, "missing field `scores`"),
            (13, "did you mean `split`?"),
            (13, "invalid type"),
        ];
        assert_eq!(problems.len(), expected.len(), "{message}");
        for (problem, (line, named)) in problems.iter().zip(expected) {
            assert!(problem.starts_with(&format!("challenge.toml, line {line}: ")), "{problem}");
            assert!(problem.contains(named), "{problem}");
        }
    }

    #[test]
    fn faults_show_the_line_of_the_nearest_key() {
        let text = format!("{SMALL}\n{SMALL}quota = {{ day = 0 }}\n");
        let line = |path: &[&str]| {
            let message = Fault::at_key(path, "is wrong").explain(Path::new("c.toml"), &text).to_string();
            message
                .split_once(", line ")
                .and_then(|(_, rest)| rest.split_once(':'))
                .map(|(line, _)| line.to_owned())
        };
        assert_eq!(line(&["phases", "1", "quota", "day"]).as_deref(), Some("12"));
        assert_eq!(line(&["phases", "1", "quota"]).as_deref(), Some("12"));
        assert_eq!(line(&["phases", "1", "scores"]).as_deref(), Some("10"));
        assert_eq!(line(&["phases", "1", "opens"]).as_deref(), Some("7"));
        assert_eq!(line(&["phases", "0", "id"]).as_deref(), Some("2"));
    }

    #[test]
    fn every_example_line_is_accepted() {
        for (key, example) in
            EXAMPLES.iter().flat_map(|(keys, example)| keys.iter().map(move |key| (*key, *example)))
        {
            let text = match key {
                "phases" => SMALL.to_owned(),
                "splits" => format!("{example}\ndataset = \"a\"\nsplit = \"b\"\n{SMALL}"),
                "dataset" => format!("[splits.b]\n{example}\nsplit = \"b\"\n"),
                "id" | "split" | "scores" | "replays" => {
                    let others = SMALL.lines().filter(|line| !line.starts_with(&format!("{key} =")));
                    format!("{}\n{example}\n", others.collect::<Vec<_>>().join("\n"))
                }
                _ => format!("{SMALL}{example}\n"),
            };
            assert!(ChallengeFile::parse(&text).is_ok(), "{key}: {text}");
        }
        let file = json(&PhaseFile::of(&every_setting()));
        for (key, value) in file.as_object().expect("an object") {
            let inner = value.as_object().into_iter().flat_map(|inner| inner.keys());
            for key in inner.chain([key]) {
                assert!(
                    EXAMPLES.iter().any(|(known, _)| known.contains(&key.as_str())),
                    "no example of {key}"
                );
            }
        }
    }

    #[test]
    fn times_follow_rfc_3339() {
        assert_eq!(moment_of("1970-01-02T00:00:00Z"), Some(86_400_000));
        assert_eq!(moment_of("1970-01-02T01:30:00+01:30"), Some(86_400_000));
        assert_eq!(moment_of("2026-02-29T00:00:00Z"), None);
        assert_eq!(moment_of("2026-02-01"), None);
    }

    proptest! {
        #[test]
        fn random_files_are_parsed_or_refused(text in ".{0,300}", at in 0..EXAMPLE.len(), cut in 0..40_usize) {
            let start = EXAMPLE.floor_char_boundary(at);
            let end = EXAMPLE.floor_char_boundary((at + cut).min(EXAMPLE.len())).max(start);
            for file in [text.clone(), format!("{}{text}{}", &EXAMPLE[..start], &EXAMPLE[end..])] {
                if let Err(faults) = ChallengeFile::parse(&file) {
                    let message = Fault::explain_all(&faults, Path::new("challenge.toml"), &file).to_string();
                    prop_assert!(message.starts_with("challenge.toml, line "), "{}", message);
                }
            }
        }
    }
}
