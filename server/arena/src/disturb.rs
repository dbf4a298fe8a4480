//! A simulator that fails as somebody wishes, so that one can see what a failure costs.

use avln_episode::{Action, EndReason, Mission, Observation, Rules, Sensors};
use avln_grpc::EpisodeRunner;
use avln_referee::{RefereeError, StepOutcome};
use std::{any::Any, sync::Arc};

/// Called on the simulator's thread before each step, with the number of steps taken.
pub(super) type Disturb = Arc<dyn Fn(u32) + Send + Sync>;

/// An episode that is disturbed.
pub(super) struct Disturbed {
    pub(super) inner: Box<dyn EpisodeRunner>,
    pub(super) disturb: Disturb,
}

impl EpisodeRunner for Disturbed {
    fn mission(&self) -> &Mission {
        self.inner.mission()
    }
    fn rules(&self) -> &Rules {
        self.inner.rules()
    }
    fn sensors(&self) -> &Sensors {
        self.inner.sensors()
    }
    fn start(&mut self) -> Observation {
        self.inner.start()
    }
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        (self.disturb)(self.inner.steps());
        self.inner.step(action)
    }
    fn truncate(&mut self, reason: EndReason) {
        self.inner.truncate(reason);
    }
    fn end(&self) -> Option<EndReason> {
        self.inner.end()
    }
    fn steps(&self) -> u32 {
        self.inner.steps()
    }
    fn state_hash(&self) -> u64 {
        self.inner.state_hash()
    }
    fn into_any(self: Box<Self>) -> Box<dyn Any + Send> {
        self.inner.into_any()
    }
}
