use super::{Live, SlotNow};
use crate::words::{self, NOTHING};
use avln_store::RunState;
use serde::Serialize;

/// An agent that has had the word for so long is waited for, milliseconds.
const WAITED_FOR_MS: i64 = 10_000;

/// What pages say of a run under way.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub(crate) struct LiveWords {
    /// How far it is.
    pub(crate) state: String,
    /// How many of its episodes are done.
    pub(crate) episodes: String,
    /// How fast it is.
    pub(crate) pace: String,
    /// Who waits for whom.
    pub(crate) waits: String,
}

impl Live {
    /// What pages say of it.
    pub(crate) fn words(&self) -> LiveWords {
        let line = &self.run.line;
        LiveWords {
            state: words::run_state(&line.state).to_owned(),
            episodes: self.episodes(),
            pace: self.pace(),
            waits: self.waits(),
        }
    }

    fn episodes(&self) -> String {
        let line = &self.run.line;
        let playing = match self.run.playing {
            0 => String::new(),
            playing => format!(", {playing} being played"),
        };
        format!("{} of {} done{playing}", line.done, line.episodes)
    }

    fn pace(&self) -> String {
        let Some(rate) = self.steps_per_s() else { return NOTHING.to_owned() };
        let newest = self.slots().iter().max_by_key(|slot| slot.since_unix_ms);
        let last = newest.and_then(|slot| slot.last_step_s);
        let last = last.map_or_else(String::new, |last| format!(", the last step took {last:.2} s"));
        format!("{rate:.1} steps a second{last}")
    }

    /// Who waits, and why.
    fn waits(&self) -> String {
        if !self.run.line.state.is_open() {
            return "nobody: the run is over".to_owned();
        }
        if let Some(reason) = self.draining.as_ref().filter(|_| self.run.playing == 0) {
            return format!("the run waits until the server is back, which is about to stop: {reason}");
        }
        let Some(session) = &self.session else { return self.nobody_plays().to_owned() };
        if !session.is_there {
            return "the run waits for its agent to come back: the connection is lost".to_owned();
        }
        let is_slow = |slot: &&SlotNow| self.now_unix_ms - slot.since_unix_ms >= WAITED_FOR_MS;
        if let Some(slot) = session.slots.iter().filter(is_slow).min_by_key(|slot| slot.since_unix_ms) {
            let since = words::rfc3339(slot.since_unix_ms);
            let clock = since.get(11..19).unwrap_or_default();
            return format!("slot {} waits for its agent since {clock} UTC", slot.slot);
        }
        match self.run.playing {
            0 => "the server waits for the agent to ask for an episode".to_owned(),
            _ => "nobody: it is played".to_owned(),
        }
    }

    /// Why a run that is not over is not open to be played.
    fn nobody_plays(&self) -> &'static str {
        match (self.run.line.state, self.run.playing) {
            (RunState::Created, _) => "the run waits for its agent to connect",
            (_, 0) => "the run waits for its agent to connect and ask for the next episode",
            _ => "open episodes wait for their agent to come back",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::{Lookout, SessionNow};
    use avln_episode::Order;
    use avln_store::{LiveRun, RunLine};

    const NOW_MS: i64 = 100_000;

    #[derive(Clone, Debug, Default)]
    struct Tower(Option<SessionNow>, Option<String>);

    impl Lookout for Tower {
        fn session(&self, _: &str) -> Option<SessionNow> {
            self.0.clone()
        }
        fn draining(&self) -> Option<String> {
            self.1.clone()
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

    fn told(run: LiveRun, tower: &Tower) -> LiveWords {
        Live::new(run, Some(tower), NOW_MS).words()
    }

    fn slot(slot: u32, since_unix_ms: i64) -> SlotNow {
        SlotNow { slot, step: 5, last_step_s: Some(0.25), mean_step_s: Some(0.5), since_unix_ms }
    }

    #[test]
    fn whoever_is_waited_for_is_named() {
        let waits = |state, playing, tower: &Tower| told(run(state, playing, true), tower).waits;
        let here = |slots: Vec<SlotNow>| Tower(Some(SessionNow { is_there: true, slots }), None);
        let nobody = Tower::default();
        assert_eq!(waits(RunState::Created, 0, &nobody), "the run waits for its agent to connect");
        assert!(waits(RunState::Running, 0, &nobody).ends_with("connect and ask for the next episode"));
        assert_eq!(waits(RunState::Running, 1, &nobody), "open episodes wait for their agent to come back");
        assert_eq!(waits(RunState::Completed, 0, &nobody), "nobody: the run is over");
        let lost = Tower(Some(SessionNow::default()), None);
        assert!(waits(RunState::Running, 1, &lost).ends_with("the connection is lost"));
        assert!(waits(RunState::Running, 0, &here(vec![])).contains("to ask for an episode"));
        let fast = here(vec![slot(0, NOW_MS - 1000)]);
        assert_eq!(waits(RunState::Running, 1, &fast), "nobody: it is played");
        let slow = here(vec![slot(0, NOW_MS - 1000), slot(1, NOW_MS - 40_000)]);
        assert_eq!(waits(RunState::Running, 2, &slow), "slot 1 waits for its agent since 00:01:00 UTC");
        let stopping = Tower(None, Some("new disks".to_owned()));
        assert!(waits(RunState::Running, 0, &stopping).ends_with("about to stop: new disks"));
    }

    #[test]
    fn steps_are_told_where_they_may_be_seen_and_counts_everywhere() {
        let tower =
            Tower(Some(SessionNow { is_there: true, slots: vec![slot(0, NOW_MS), slot(1, 5)] }), None);
        let shown = told(run(RunState::Running, 2, true), &tower);
        assert_eq!(shown.episodes, "3 of 9 done, 2 being played");
        assert_eq!(shown.pace, "4.0 steps a second, the last step took 0.25 s");
        let hidden = Live::new(run(RunState::Running, 2, false), Some(&tower), NOW_MS);
        let words = hidden.words();
        assert_eq!((words.episodes, words.pace.as_str()), (shown.episodes, NOTHING));
        assert_eq!(words.waits, "nobody: it is played");
        assert_eq!(hidden.json()["slots"], serde_json::json!([]));
        assert_eq!(hidden.json()["steps_per_s"], serde_json::Value::Null);
    }
}
