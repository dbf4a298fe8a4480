use avln_episode::{Action, EndReason, Mission, Observation, Rules, Sensors};
use avln_referee::{Referee, RefereeError, StepOutcome};
use std::{any::Any, time::Duration};

/// One running episode as the door sees it: what [`Referee`] does, and nothing about truth.
///
/// `start`, `step` and `truncate` are called on blocking threads and may panic: that ends this episode alone.
pub trait EpisodeRunner: Send + 'static {
    /// What the agent is told.
    fn mission(&self) -> &Mission;
    /// The rules in force.
    fn rules(&self) -> &Rules;
    /// The sensors that the agent asked for.
    fn sensors(&self) -> &Sensors;
    /// The observation before the first action.
    fn start(&mut self) -> Observation;
    /// Carries out one action.
    ///
    /// # Errors
    /// When the episode is over.
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError>;
    /// Ends the episode from outside.
    fn truncate(&mut self, reason: EndReason);
    /// Why the episode is over, when it is.
    fn end(&self) -> Option<EndReason>;
    /// Steps taken.
    fn steps(&self) -> u32;
    /// Gives the host its own type back.
    fn into_any(self: Box<Self>) -> Box<dyn Any + Send>;
}

impl EpisodeRunner for Referee {
    fn mission(&self) -> &Mission {
        self.mission()
    }
    fn rules(&self) -> &Rules {
        self.rules()
    }
    fn sensors(&self) -> &Sensors {
        self.sensors()
    }
    fn start(&mut self) -> Observation {
        self.start()
    }
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        self.step(action)
    }
    fn truncate(&mut self, reason: EndReason) {
        self.truncate(reason);
    }
    fn end(&self) -> Option<EndReason> {
        self.end()
    }
    fn steps(&self) -> u32 {
        self.steps()
    }
    fn into_any(self: Box<Self>) -> Box<dyn Any + Send> {
        self
    }
}

/// An episode that the host hands out to be played, and takes back to be stored.
pub struct Seat {
    /// Random name of the episode in this run; agents see it.
    pub handle: String,
    /// The episode.
    pub referee: Box<dyn EpisodeRunner>,
    /// The host's own number for the episode; agents never see it.
    pub ticket: u64,
    /// Where the time went; zero when it is handed out, the door adds to it.
    pub time: TimeSpent,
}

/// Where the time of an episode went, wall clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeSpent {
    /// Simulating: motion, sight and sound.
    pub simulation: Duration,
    /// Making frames of observations.
    pub encoding: Duration,
    /// Waiting for a free core.
    pub queue: Duration,
    /// From the moment when an observation was queued for the agent until its action came, the wire both ways included.
    pub thinking: Duration,
}

impl Seat {
    /// The referee that the host put in, or `None` when something else sits here.
    pub fn into_referee(self) -> Option<Box<Referee>> {
        self.referee.into_any().downcast().ok()
    }
}

impl std::fmt::Debug for Seat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Seat")
            .field("handle", &self.handle)
            .field("ticket", &self.ticket)
            .finish_non_exhaustive()
    }
}
