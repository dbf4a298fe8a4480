//! Run logs: append-only records for restart and verification.
//!
//! `DATA/runs/<run>.log` is a text file with a line per [`Entry`]: 32 hexadecimal digits, a space, and the
//! entry as JSON. The digits are the first 16 bytes of a BLAKE3 hash over the previous line's digits and this
//! line's JSON. This detects changed, removed and inserted lines. An incomplete last line was interrupted by
//! a crash and is ignored.

use avln_episode::{Action, EndReason, Order, Sensors};
use avln_scoring::Metrics;
pub use history::{EpisodeHistory, History, LogError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
pub use writer::{RunLog, RunLogs, SigningKey, SlotLog, is_signed};

mod history;
mod writer;

const DIGITS: usize = 32;

/// Returns a line's digits; `before` is empty for the first line.
fn link(before: &str, json: &str) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(before.as_bytes()).update(b"\n").update(json.as_bytes());
    hasher.finalize().to_hex()[..DIGITS].to_owned()
}

/// A line. Times are Unix milliseconds (`_ms`) or microseconds (`_us`).
///
/// - `slot`, `step`: slot and step number; steps start at 1.
/// - `handle`, `ordinal`, `episode`: name for the agent, index in the run from 0, and id in the split.
/// - `digests`: digests and versions by name.
/// - `epoch`: number of the server start on the data folder, from 1.
/// - `state`: hash of the new state, 16 hexadecimal digits.
/// - `thought_us`, `bank_us`, `away_us`: thinking time, remaining time bank, disconnection time.
/// - `head`: digits of the previous line. `key`, `signature`: server's public key and Ed25519 signature over
///   `head`, hexadecimal.
#[expect(
    missing_docs,
    reason = "fields with the same name mean the same in all entries and are listed above"
)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Entry {
    /// First line: run and versions.
    Run {
        format: u32,
        run: String,
        phase: String,
        order: Order,
        digests: BTreeMap<String, String>,
        at_ms: i64,
    },
    /// A server has started since the line before; the run's next line follows.
    ServerStarted { epoch: u64, at_ms: i64 },
    /// An episode was issued.
    Began { slot: u32, handle: String, ordinal: u32, episode: String, sensors: Sensors, at_ms: i64 },
    /// A step was taken.
    Acted { slot: u32, step: u32, action: Action, state: String, thought_us: u64, bank_us: u64, at_ms: i64 },
    /// A new server has started to restore the episode after a server stop.
    #[serde(rename = "taken_up")]
    RestoreStarted { slot: u32, handle: String, at_ms: i64 },
    /// The episode is restored.
    #[serde(rename = "stands")]
    RestoreDone { slot: u32, at_ms: i64 },
    /// The first step after a restore is about to start.
    #[serde(rename = "tries")]
    StepAttempted { slot: u32, step: u32, at_ms: i64 },
    /// An observation was lost, and the answer time restarted.
    ClockRestarted { slot: u32, step: u32, away_us: u64, at_ms: i64 },
    /// The run has ended, and the server signs the lines before.
    Signed { head: String, key: String, signature: String },
    /// The episode has ended with a score; the database entry follows.
    Ended { slot: u32, handle: String, end: EndReason, metrics: Box<Metrics>, at_ms: i64 },
    /// The server lost the attempt, and the database could not store that.
    Lost { handle: String, at_ms: i64 },
}

impl Entry {
    /// Format version for new logs. Version 1 has no server starts and no lost attempts.
    pub const FORMAT: u32 = 2;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Clock;
    use avln_grpc::{Acted, EpisodeLog};
    use std::{path::Path, sync::Arc, time::Duration};

    fn first() -> Entry {
        let digests = BTreeMap::from([("split".to_owned(), "abc".to_owned())]);
        let (run, phase) = ("run_1".to_owned(), "practice".to_owned());
        Entry::Run { format: Entry::FORMAT, run, phase, order: Order::Ordered, digests, at_ms: 1 }
    }

    fn began(slot: u32, handle: &str) -> Entry {
        Entry::Began {
            slot,
            handle: handle.to_owned(),
            ordinal: slot,
            episode: format!("house-{slot}"),
            sensors: Sensors::all(64, 64),
            at_ms: 2,
        }
    }

    fn acted(step: u32, action: Action) -> Acted {
        let (thought, bank_left) = (Duration::from_millis(7), Duration::from_secs(60));
        Acted { step, action, state_hash: u64::from(step) << 60 | 5, thought, bank_left }
    }

    fn slot_log(log: &Arc<RunLog>, slot: u32, restored: bool) -> SlotLog {
        SlotLog { log: log.clone(), slot, restored, clock: Clock::default() }
    }

    /// Writes a log with two slots: two steps and one step.
    fn written(folder: &Path) -> RunLogs {
        let logs = RunLogs::at(folder);
        let log = logs.open("run_1", first).unwrap();
        log.write(&began(0, "ep_a")).unwrap();
        log.write(&began(1, "ep_b")).unwrap();
        let slot = |slot| slot_log(&log, slot, false);
        slot(0).acted(&acted(1, Action::MoveForward)).unwrap();
        slot(1).acted(&acted(1, Action::TurnLeft)).unwrap();
        slot(0).acted(&acted(2, Action::Submit)).unwrap();
        slot(0).clock_restarted(2, Duration::from_secs(3)).unwrap();
        slot(1).clock_restarted(1, Duration::from_secs(3)).unwrap();
        logs
    }

    #[test]
    fn written_entries_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let logs = written(folder.path());
        logs.sync();
        let history = logs.history("run_1").unwrap().expect("a log");
        let episodes = history.episodes().unwrap();
        let actions = [(Action::MoveForward, 1 << 60 | 5), (Action::Submit, 2 << 60 | 5)];
        assert_eq!(episodes["ep_a"].actions, actions);
        assert_eq!((episodes["ep_b"].slot, episodes["ep_b"].actions.len()), (1, 1));
        assert_eq!(episodes["ep_a"].bank_left, Some(Duration::from_secs(60)));
        assert_eq!(history.away(), Duration::from_secs(3), "both slots were away at the same time");
        assert_eq!(logs.history("run_2").unwrap(), None);
    }

    #[test]
    fn incomplete_last_line_is_ignored_and_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path()).path("run_1");
        let whole = std::fs::read(&path).unwrap();
        for cut in 1..40 {
            std::fs::write(&path, &whole[..whole.len() - cut]).unwrap();
            let logs = RunLogs::at(folder.path());
            let before = logs.history("run_1").unwrap().expect("a log").entries.len();
            assert_eq!(before, 7, "the last of eight is not whole");
            logs.open("run_1", first).unwrap().write(&began(2, "ep_c")).unwrap();
            let after = logs.history("run_1").unwrap().expect("a log");
            assert_eq!(after.entries.len(), 8);
            assert!(after.episodes().unwrap().contains_key("ep_c"));
        }
    }

    #[test]
    fn changed_removed_and_inserted_lines_are_detected() {
        let folder = tempfile::tempdir().unwrap();
        let bytes = std::fs::read(written(folder.path()).path("run_1")).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let lines: Vec<_> = text.lines().collect();
        for index in 0..lines.len() {
            let changed = text.replace(lines[index], &lines[index].replacen("_ms\":", "_ms\": ", 1));
            assert_eq!(History::parse(changed.as_bytes()).unwrap_err().0, index + 1, "changed");
            let doubled = text.replace(lines[index], &format!("{0}\n{0}", lines[index]));
            assert_eq!(History::parse(doubled.as_bytes()).unwrap_err().0, index + 2, "doubled");
            if index + 1 < lines.len() {
                let without = text.replace(&format!("{}\n", lines[index]), "");
                assert_eq!(History::parse(without.as_bytes()).unwrap_err().0, index + 1, "left out");
            }
        }
    }

    #[test]
    fn server_crashes_count_until_the_next_step() {
        let folder = tempfile::tempdir().unwrap();
        let logs = written(folder.path());
        let log = logs.open("run_1", first).unwrap();
        let deaths = || logs.history("run_1").unwrap().expect("a log").episodes().unwrap()["ep_a"].crashes();
        let restoring = Entry::RestoreStarted { slot: 0, handle: "ep_a".to_owned(), at_ms: 3 };
        log.write(&restoring).unwrap();
        assert_eq!(deaths(), 1, "it died bringing the episode back");
        log.write(&Entry::RestoreDone { slot: 0, at_ms: 3 }).unwrap();
        assert_eq!(deaths(), 0, "it died of something else");
        let mut slot = slot_log(&log, 0, true);
        slot.acting(3).unwrap();
        log.write(&restoring).unwrap();
        log.write(&restoring).unwrap();
        assert_eq!(deaths(), 2, "twice bringing it back, once in the step");
        log.write(&Entry::RestoreDone { slot: 0, at_ms: 3 }).unwrap();
        assert_eq!(deaths(), 1);
        slot.acted(&acted(3, Action::MoveForward)).unwrap();
        assert_eq!(deaths(), 0);
    }

    #[test]
    fn lost_attempts_are_marked() {
        let folder = tempfile::tempdir().unwrap();
        let logs = written(folder.path());
        logs.write_loss("run_1", "ep_b".to_owned(), 9).unwrap();
        logs.write_loss("run_1", "ep_unknown".to_owned(), 9).unwrap();
        let episodes = logs.history("run_1").unwrap().expect("a log").episodes().unwrap();
        assert_eq!((episodes["ep_a"].is_lost, episodes["ep_b"].is_lost), (false, true));
        logs.write_loss("run_2", "ep_a".to_owned(), 9).unwrap();
        assert_eq!(logs.history("run_2").unwrap(), None, "nothing of the run was logged");
    }

    #[test]
    fn steps_out_of_order_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let logs = RunLogs::at(folder.path());
        let log = logs.open("run_1", first).unwrap();
        log.write(&began(0, "ep_a")).unwrap();
        slot_log(&log, 0, false).acted(&acted(2, Action::Stop)).unwrap();
        let (line, what) = logs.history("run_1").unwrap().expect("a log").episodes().unwrap_err();
        assert_eq!(line, 3);
        assert!(what.contains("step 2 of slot 0 is out of order"), "{what}");
    }

    #[test]
    fn server_starts_increase_along_the_log() {
        let folder = tempfile::tempdir().unwrap();
        let start = |epoch| {
            let logs = RunLogs::at(folder.path()).with_epoch(epoch);
            for slot in 0..2 {
                logs.open("run_1", first)
                    .unwrap()
                    .write(&began(slot, &format!("ep_{epoch}_{slot}")))
                    .unwrap();
                // Unused logs are closed, and opened again without another line.
                logs.sync();
                logs.sync();
            }
            logs.history("run_1").unwrap().expect("a log")
        };
        let history = start(1);
        assert!(matches!(
            history.entries[..],
            [Entry::Run { .. }, Entry::ServerStarted { epoch: 1, .. }, _, _]
        ));
        assert_eq!(start(3).check_epochs(), Ok(()));
        let (line, what) = start(3).check_epochs().unwrap_err();
        assert_eq!((line, what.contains("server start 3 follows start 3")), (8, true), "{what}");
    }

    #[test]
    fn first_format_is_read() {
        let entry = serde_json::to_string(&first()).unwrap().replace("\"format\":2", "\"format\":1");
        let history = History::parse(format!("{} {entry}\n", link("", &entry)).as_bytes()).unwrap();
        assert_eq!((history.entries.len(), history.check_epochs()), (1, Ok(())));
    }

    #[test]
    fn other_formats_are_refused() {
        let entry = serde_json::to_string(&first()).unwrap().replace("\"format\":2", "\"format\":9");
        let line = format!("{} {entry}\n", link("", &entry));
        let (number, what) = History::parse(line.as_bytes()).unwrap_err();
        assert_eq!((number, what.as_str()), (1, "format 9 is not supported, only 1 to 2"));
    }

    #[test]
    fn random_changes_cause_no_panic() {
        let folder = tempfile::tempdir().unwrap();
        let whole = std::fs::read(written(folder.path()).path("run_1")).unwrap();
        let mut state = 1_u64;
        for _ in 0..2000 {
            let mut bytes = whole.clone();
            for _ in 0..3 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let at = (state >> 33) as usize % bytes.len();
                bytes[at] = (state >> 20) as u8;
            }
            if let Ok(history) = History::parse(&bytes) {
                assert!(history.entries.len() <= 8);
                let _ = history.episodes();
            }
        }
    }
}
