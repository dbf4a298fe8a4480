//! Hosted episodes: a referee, with optional hooks for fault injection and observation.

use avln_episode::{Action, EndReason, Mission, Observation, Rules};
use avln_grpc::Episode;
use avln_referee::{Referee, RefereeError, StepOutcome};
use std::sync::Arc;

/// Fault injection: called on the simulation thread before each step, with the number of steps taken.
pub(super) type FaultInjection = Arc<dyn Fn(u32) + Send + Sync>;

/// Observer: called on the simulation thread before an observation is sent, with the episode's handle and referee.
pub(super) type Observer = Arc<dyn Fn(&str, &Referee) + Send + Sync>;

/// An episode of the arena.
pub struct ArenaEpisode {
    pub(super) referee: Referee,
    pub(super) handle: String,
    pub(super) faults: Option<FaultInjection>,
    pub(super) observer: Option<Observer>,
}

impl ArenaEpisode {
    fn observe(&self) {
        if let Some(observer) = &self.observer {
            observer(&self.handle, &self.referee);
        }
    }
}

impl Episode for ArenaEpisode {
    fn mission(&self) -> &Mission {
        self.referee.mission()
    }
    fn rules(&self) -> &Rules {
        self.referee.rules()
    }
    fn start(&mut self) -> Observation {
        let first = self.referee.start();
        self.observe();
        first
    }
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        if let Some(inject) = &self.faults {
            inject(self.referee.steps());
        }
        let outcome = self.referee.step(action)?;
        self.observe();
        Ok(outcome)
    }
    fn truncate(&mut self, reason: EndReason) {
        self.referee.truncate(reason);
    }
    fn end(&self) -> Option<EndReason> {
        self.referee.end()
    }
    fn steps(&self) -> u32 {
        self.referee.steps()
    }
    fn state_hash(&self) -> u64 {
        self.referee.state_hash()
    }
}

impl std::fmt::Debug for ArenaEpisode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ArenaEpisode").field("handle", &self.handle).finish_non_exhaustive()
    }
}
