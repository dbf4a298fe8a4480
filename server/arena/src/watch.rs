//! What a host in this process sees of the episodes that it hosts.

use avln_episode::{Action, EndReason, Mission, Observation, Rules, Sensors};
use avln_grpc::EpisodeRunner;
use avln_referee::{Referee, RefereeError, StepOutcome};
use std::{any::Any, sync::Arc};

/// Called on the simulator's thread with the handle of an episode before each of its observations is sent.
pub(super) type Watch = Arc<dyn Fn(&str, &Referee) + Send + Sync>;

/// An episode that is watched.
pub(super) struct Watched {
    pub(super) referee: Referee,
    pub(super) handle: String,
    pub(super) watch: Watch,
}

impl EpisodeRunner for Watched {
    fn mission(&self) -> &Mission {
        self.referee.mission()
    }
    fn rules(&self) -> &Rules {
        self.referee.rules()
    }
    fn sensors(&self) -> &Sensors {
        self.referee.sensors()
    }
    fn start(&mut self) -> Observation {
        let first = self.referee.start();
        (self.watch)(&self.handle, &self.referee);
        first
    }
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        let outcome = self.referee.step(action)?;
        (self.watch)(&self.handle, &self.referee);
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
    fn into_any(self: Box<Self>) -> Box<dyn Any + Send> {
        Box::new(self.referee)
    }
}
