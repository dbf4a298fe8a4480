//! Live state of open runs, from the database and the running arena.

mod events;

pub(crate) use events::{LiveFeed, run, runs};

use crate::format::{self, NOTHING};
use avln_store::{LiveRun, RunState};
use serde::Serialize;
use std::fmt;

/// Limit for the list of open runs.
pub(crate) const MAX_RUNS: u32 = 50;
/// Wait for an agent after which the page names the slot, milliseconds.
const LONG_WAIT_MS: i64 = 10_000;

/// An open run's session.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LiveSession {
    /// True if the agent is connected.
    pub is_connected: bool,
    /// Slots with an open episode.
    pub slots: Vec<LiveSlot>,
}

/// A slot with an open episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LiveSlot {
    /// Slot number.
    pub slot: u32,
    /// Steps so far.
    pub step: u32,
    /// Last step's duration from observation to observation, seconds.
    pub last_step_s: Option<f64>,
    /// Mean step duration, seconds.
    pub mean_step_s: Option<f64>,
    /// Time when the agent received its last observation, milliseconds since 1970-01-01 UTC.
    #[serde(rename = "since_at", serialize_with = "format::at")]
    pub since_unix_ms: i64,
}

/// Live state, implemented by a running arena.
pub trait LiveStatus: fmt::Debug + Send + Sync {
    /// Returns the run session; `None` if it has none.
    fn session(&self, run: &str) -> Option<LiveSession>;

    /// Returns the reason if the server is draining.
    fn draining(&self) -> Option<String>;

    /// Returns the organiser's announcement for all pages; empty if there is none.
    fn announcement(&self) -> String;
}

/// An open run as shown to a viewer.
#[derive(Debug)]
pub(crate) struct LiveRunView {
    pub(crate) run: LiveRun,
    /// The session, without slots if the viewer may not see steps.
    session: Option<LiveSession>,
    draining: Option<String>,
    now_unix_ms: i64,
}

/// An open run for programs.
#[derive(Debug, Serialize)]
pub(crate) struct LiveRunJson {
    run: String,
    state: RunState,
    episodes: u32,
    done: u32,
    playing: u32,
    connected: Option<bool>,
    steps_per_s: Option<f64>,
    slots: Vec<LiveSlot>,
    #[serde(rename = "created_at", serialize_with = "format::at")]
    created_unix_ms: i64,
    #[serde(rename = "finished_at", serialize_with = "format::maybe_at")]
    finished_unix_ms: Option<i64>,
    words: LiveText,
}

/// Texts about an open run.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub(crate) struct LiveText {
    pub(crate) state: String,
    pub(crate) episodes: String,
    pub(crate) pace: String,
    /// The waiting side and the reason.
    pub(crate) waits: String,
}

impl LiveRunView {
    /// Adds the session, without hidden steps.
    pub(crate) fn new(run: LiveRun, live_status: Option<&dyn LiveStatus>, now_unix_ms: i64) -> Self {
        let mut session = live_status.and_then(|status| status.session(&run.line.run));
        if let Some(session) = session.as_mut().filter(|_| !run.steps_visible) {
            session.slots.clear();
        }
        Self { session, draining: live_status.and_then(LiveStatus::draining), now_unix_ms, run }
    }

    /// Returns the total speed, steps per second.
    fn steps_per_s(&self) -> Option<f64> {
        let means = self.slots().iter().filter_map(|slot| slot.mean_step_s);
        let rates: Vec<f64> = means.filter(|mean| *mean > 0.0).map(|mean| 1.0 / mean).collect();
        (!rates.is_empty()).then(|| rates.iter().sum())
    }

    fn slots(&self) -> &[LiveSlot] {
        self.session.as_ref().map_or(&[], |session| &session.slots)
    }

    pub(crate) fn json(&self) -> LiveRunJson {
        let LiveRun { line, playing, .. } = &self.run;
        LiveRunJson {
            run: line.run.clone(),
            state: line.state,
            episodes: line.episodes,
            done: line.done,
            playing: *playing,
            connected: self.session.as_ref().map(|session| session.is_connected),
            steps_per_s: self.steps_per_s(),
            slots: self.slots().to_vec(),
            created_unix_ms: line.created_unix_ms,
            finished_unix_ms: line.finished_unix_ms,
            words: self.text(),
        }
    }

    pub(crate) fn text(&self) -> LiveText {
        LiveText {
            state: format::run_state(&self.run.line.state).to_owned(),
            episodes: self.episodes(),
            pace: self.pace(),
            waits: self.waits(),
        }
    }

    fn episodes(&self) -> String {
        let line = &self.run.line;
        let playing = match self.run.playing {
            0 => String::new(),
            playing => format!(", {playing} in progress"),
        };
        format!("{} of {} done{playing}", line.done, line.episodes)
    }

    fn pace(&self) -> String {
        let Some(rate) = self.steps_per_s() else { return NOTHING.to_owned() };
        let newest = self.slots().iter().max_by_key(|slot| slot.since_unix_ms);
        let last = newest.and_then(|slot| slot.last_step_s);
        let last = last.map_or_else(String::new, |last| format!(", last step {last:.2} s"));
        format!("{rate:.1} steps per second{last}")
    }

    fn waits(&self) -> String {
        if !self.run.line.state.is_open() {
            return "none: the run has ended".to_owned();
        }
        if let Some(reason) = self.draining.as_ref().filter(|_| self.run.playing == 0) {
            return format!("the run waits for a restart of the server: {reason}");
        }
        let Some(session) = &self.session else { return self.waits_without_session().to_owned() };
        if !session.is_connected {
            return "the run waits for its agent to reconnect: the connection is lost".to_owned();
        }
        let is_slow = |slot: &&LiveSlot| self.now_unix_ms - slot.since_unix_ms >= LONG_WAIT_MS;
        if let Some(slot) = session.slots.iter().filter(is_slow).min_by_key(|slot| slot.since_unix_ms) {
            let since = format::rfc3339(slot.since_unix_ms);
            let clock = since.get(11..19).unwrap_or_default();
            return format!("slot {} has waited for its agent since {clock} UTC", slot.slot);
        }
        match self.run.playing {
            0 => "the server waits for the agent to request an episode".to_owned(),
            _ => "none: episodes are in progress".to_owned(),
        }
    }

    fn waits_without_session(&self) -> &'static str {
        match (self.run.line.state, self.run.playing) {
            (RunState::Created, _) => "the run waits for its agent to connect",
            (_, 0) => "the run waits for its agent to connect and request the next episode",
            _ => "open episodes wait for their agent to reconnect",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Order;
    use avln_store::RunLine;

    const NOW_MS: i64 = 100_000;

    #[derive(Clone, Debug, Default)]
    struct FakeStatus {
        session: Option<LiveSession>,
        draining: Option<String>,
    }

    impl LiveStatus for FakeStatus {
        fn session(&self, _: &str) -> Option<LiveSession> {
            self.session.clone()
        }
        fn draining(&self) -> Option<String> {
            self.draining.clone()
        }
        fn announcement(&self) -> String {
            String::new()
        }
    }

    fn run(state: RunState, playing: u32, steps_visible: bool) -> LiveRun {
        let line = RunLine {
            run: "run_a".to_owned(),
            phase: "open".to_owned(),
            team: "t".to_owned(),
            reference: None,
            verified: false,
            disqualified: None,
            method: "m".to_owned(),
            version: "1".to_owned(),
            order: Order::Ordered,
            state,
            episodes: 9,
            done: 3,
            isr: None,
            created_unix_ms: 1,
            finished_unix_ms: None,
        };
        LiveRun { line, playing, steps_visible }
    }

    fn text(run: LiveRun, status: &FakeStatus) -> LiveText {
        LiveRunView::new(run, Some(status), NOW_MS).text()
    }

    fn connected(slots: Vec<LiveSlot>) -> FakeStatus {
        FakeStatus { session: Some(LiveSession { is_connected: true, slots }), draining: None }
    }

    fn slot(slot: u32, since_unix_ms: i64) -> LiveSlot {
        LiveSlot { slot, step: 5, last_step_s: Some(0.25), mean_step_s: Some(0.5), since_unix_ms }
    }

    #[test]
    fn waiting_sides_are_named() {
        let waits = |state, playing, status: &FakeStatus| text(run(state, playing, true), status).waits;
        let none = FakeStatus::default();
        assert_eq!(waits(RunState::Created, 0, &none), "the run waits for its agent to connect");
        assert!(waits(RunState::Running, 0, &none).ends_with("connect and request the next episode"));
        assert_eq!(waits(RunState::Running, 1, &none), "open episodes wait for their agent to reconnect");
        assert_eq!(waits(RunState::Completed, 0, &none), "none: the run has ended");
        let lost = FakeStatus { session: Some(LiveSession::default()), draining: None };
        assert!(waits(RunState::Running, 1, &lost).ends_with("the connection is lost"));
        assert!(waits(RunState::Running, 0, &connected(vec![])).contains("to request an episode"));
        let fast = connected(vec![slot(0, NOW_MS - 1000)]);
        assert_eq!(waits(RunState::Running, 1, &fast), "none: episodes are in progress");
        let slow = connected(vec![slot(0, NOW_MS - 1000), slot(1, NOW_MS - 40_000)]);
        assert_eq!(waits(RunState::Running, 2, &slow), "slot 1 has waited for its agent since 00:01:00 UTC");
        let stopping = FakeStatus { session: None, draining: Some("new disks".to_owned()) };
        assert!(waits(RunState::Running, 0, &stopping).ends_with("restart of the server: new disks"));
    }

    #[test]
    fn hidden_steps_leave_only_counts() {
        let status = connected(vec![slot(0, NOW_MS), slot(1, 5)]);
        let shown = text(run(RunState::Running, 2, true), &status);
        assert_eq!(shown.episodes, "3 of 9 done, 2 in progress");
        assert_eq!(shown.pace, "4.0 steps per second, last step 0.25 s");
        let hidden = LiveRunView::new(run(RunState::Running, 2, false), Some(&status), NOW_MS);
        let text = hidden.text();
        assert_eq!((text.episodes, text.pace.as_str()), (shown.episodes, NOTHING));
        assert_eq!(text.waits, "none: episodes are in progress");
        let json = serde_json::to_value(hidden.json()).expect("JSON");
        assert_eq!(
            (&json["slots"], &json["steps_per_s"]),
            (&serde_json::json!([]), &serde_json::Value::Null)
        );
    }
}
