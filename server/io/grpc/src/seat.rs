use avln_episode::{Action, EndReason, Mission, Observation, Rules, Sensors};
use avln_referee::{Referee, RefereeError, StepOutcome};
use std::{any::Any, io, time::Duration};

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
    /// Tells the state after a step from others.
    fn state_hash(&self) -> u64;
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
    fn state_hash(&self) -> u64 {
        self.state_hash()
    }
    fn into_any(self: Box<Self>) -> Box<dyn Any + Send> {
        self
    }
}

/// Where what happens in an episode is written down, so that it outlives the server.
pub trait EpisodeLog: Send + 'static {
    /// An action is about to be carried out.
    ///
    /// # Errors
    /// As for [`EpisodeLog::acted`].
    fn acting(&mut self, step: u32) -> io::Result<()>;

    /// An action was carried out; its result is told to the agent when this returns.
    ///
    /// # Errors
    /// When it could not be written: then the episode is a server fault.
    fn acted(&mut self, acted: &Acted) -> io::Result<()>;

    /// An observation did not arrive, the connection was away for `away`, and the agent's clock starts again.
    ///
    /// # Errors
    /// As for [`EpisodeLog::acted`].
    fn clock_restarted(&mut self, step: u32, away: Duration) -> io::Result<()>;
}

/// An action that was carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Acted {
    /// Number of the step, counted from 1.
    pub step: u32,
    /// The action.
    pub action: Action,
    /// The state that it led to.
    pub state_hash: u64,
    /// For how long the agent thought, the wire both ways included.
    pub thought: Duration,
    /// What that left of the episode's bank.
    pub bank_left: Duration,
}

/// An episode that the host hands out to be played, and takes back to be stored.
pub struct Seat {
    /// Random name of the episode in this run; agents see it.
    pub handle: String,
    /// The episode.
    pub referee: Box<dyn EpisodeRunner>,
    /// The host's own number for the episode; agents never see it.
    pub ticket: u64,
    /// Where its actions are written down.
    pub log: Box<dyn EpisodeLog>,
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

/// An episode that was being played when the server stopped, back where it was.
#[derive(Debug)]
pub struct Restored {
    /// The slot that played it.
    pub slot: u32,
    /// The episode.
    pub seat: Seat,
    /// The last observation, and the action that led to it; `None` at the start.
    pub last: (Observation, Option<Action>),
    /// What is left of its bank.
    pub bank_left: Duration,
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
