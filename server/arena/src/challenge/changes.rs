//! Differences between two versions of a phase, per setting, for the audit list.

use super::{PhaseFile, json};
use avln_store::{AuditNote, Phase};
use serde_json::Value;
use std::collections::BTreeMap;

/// Actor of the command line for the audit list.
pub fn actor() -> String {
    let user = std::env::var("USER").ok().filter(|user| !user.trim().is_empty());
    user.map_or_else(|| "command line".to_owned(), |user| format!("{user} at the command line"))
}

/// Audit notes on a phase change by `actor`; empty without differences.
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

/// Settings of a phase by key, without unset ones.
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

/// Digest of the episode list.
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
        Value::String(text) => {
            into.insert(above.to_owned(), text.clone());
        }
        other => {
            into.insert(above.to_owned(), other.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Rules;

    #[test]
    fn a_change_is_noted_by_key_and_no_change_is_not() {
        let before = Phase::new("practice", "val", Rules::paper(), vec![]);
        assert_eq!(notes("ada", Some(&before), &before, ""), []);
        let mut after = before.clone();
        after.quotas.day = Some(3);
        after.schedule.opens_unix_ms = Some(0);
        let told: Vec<_> = notes("ada", Some(&before), &after, "start")
            .into_iter()
            .map(|n| (n.what, n.before, n.after))
            .collect();
        let moment = "1970-01-01T00:00:00Z".to_owned();
        assert_eq!(
            told,
            [("opens".to_owned(), None, Some(moment)), ("quota.day".to_owned(), None, Some("3".to_owned()))]
        );
        assert_eq!(notes("ada", None, &after, "")[0].what, "made");
    }
}
