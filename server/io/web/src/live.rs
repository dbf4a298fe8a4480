//! Runs under way: what the store knows of them, with what whoever plays them knows at this moment.

mod stream;
mod words;

pub(crate) use stream::{Hub, run, runs};

use avln_store::LiveRun;
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt;

/// Most runs in the list of those under way.
pub(crate) const MAX_RUNS: u32 = 50;

/// A run that is open to be played, as whoever plays it knows it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SessionNow {
    /// Whether its agent is connected.
    pub is_there: bool,
    /// The slots that hold an episode.
    pub slots: Vec<SlotNow>,
}

/// A slot that holds an episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SlotNow {
    /// Its number.
    pub slot: u32,
    /// Steps that its episode has taken.
    pub step: u32,
    /// How long the last of them took, from answer to answer, seconds.
    pub last_step_s: Option<f64>,
    /// How long a step took in the mean, seconds.
    pub mean_step_s: Option<f64>,
    /// Since when the agent has the word, milliseconds since 1970-01-01 UTC.
    pub since_unix_ms: i64,
}

/// Who knows what is played at this moment.
pub trait Lookout: fmt::Debug + Send + Sync {
    /// How a run is played; `None` while it is not open to be.
    fn session(&self, run: &str) -> Option<SessionNow>;

    /// Why nothing new begins; `None` while it does.
    fn draining(&self) -> Option<String>;
}

/// A run under way, as a visitor may see it at this moment.
#[derive(Debug)]
pub(crate) struct Live {
    pub(crate) run: LiveRun,
    /// Without slots where their steps are hidden.
    session: Option<SessionNow>,
    draining: Option<String>,
    now_unix_ms: i64,
}

impl Live {
    /// What `lookout` knows of `run`, without what its viewer may not see.
    pub(crate) fn new(run: LiveRun, lookout: Option<&dyn Lookout>, now_unix_ms: i64) -> Self {
        let mut session = lookout.and_then(|lookout| lookout.session(&run.line.run));
        if let Some(session) = session.as_mut().filter(|_| !run.steps_visible) {
            session.slots.clear();
        }
        Self { session, draining: lookout.and_then(Lookout::draining), now_unix_ms, run }
    }

    /// Steps a second of all slots together; `None` where there is nothing to tell.
    fn steps_per_s(&self) -> Option<f64> {
        let means = self.slots().iter().filter_map(|slot| slot.mean_step_s);
        let rates: Vec<f64> = means.filter(|mean| *mean > 0.0).map(|mean| 1.0 / mean).collect();
        (!rates.is_empty()).then(|| rates.iter().sum())
    }

    fn slots(&self) -> &[SlotNow] {
        self.session.as_ref().map_or(&[], |session| &session.slots)
    }

    /// What programs are told.
    fn json(&self) -> Value {
        let LiveRun { line, playing, .. } = &self.run;
        json!({
            "run": line.run,
            "state": line.state,
            "episodes": line.episodes,
            "done": line.done,
            "playing": playing,
            "connected": self.session.as_ref().map(|session| session.is_there),
            "steps_per_s": self.steps_per_s(),
            "slots": self.slots(),
            "created_unix_ms": line.created_unix_ms,
            "finished_unix_ms": line.finished_unix_ms,
            "words": self.words(),
        })
    }
}
