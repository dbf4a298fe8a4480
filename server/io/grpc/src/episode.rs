//! Episodes between host and slot, their run log and their time accounts.

use avln_episode::{Action, EndReason, Mission, Observation, Rules};
use avln_referee::{Referee, RefereeError, StepOutcome};
use std::{io, time::Duration};

/// A running episode: the agent-visible part of a [`Referee`].
///
/// `start`, `step` and `truncate` are called on simulation threads and may panic, which ends only this episode.
pub trait Episode: Send + 'static {
    /// Returns the mission.
    fn mission(&self) -> &Mission;
    /// Returns the rules.
    fn rules(&self) -> &Rules;
    /// Returns the observation before the first action.
    fn start(&mut self) -> Observation;
    /// Carries out an action.
    ///
    /// # Errors
    /// If the episode is over.
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError>;
    /// Ends the episode from outside.
    fn truncate(&mut self, reason: EndReason);
    /// Returns the end reason; `None` while the episode is open.
    fn end(&self) -> Option<EndReason>;
    /// Returns the number of steps taken.
    fn steps(&self) -> u32;
    /// Returns a hash of the simulation state.
    fn state_hash(&self) -> u64;
}

impl Episode for Referee {
    fn mission(&self) -> &Mission {
        self.mission()
    }
    fn rules(&self) -> &Rules {
        self.rules()
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
}

/// Episode log, from which a restarted server restores the episode.
pub trait EpisodeLog: Send + 'static {
    /// Records that an action is about to be carried out.
    ///
    /// # Errors
    /// If it cannot be written. The episode is then a server fault.
    fn acting(&mut self, step: u32) -> io::Result<()>;

    /// Records an action, before the result is sent to the agent.
    ///
    /// # Errors
    /// If it cannot be written. The episode is then a server fault.
    fn acted(&mut self, acted: &Acted) -> io::Result<()>;

    /// Records a restart of the agent's clock after a disconnect of `away`, because an observation had not arrived.
    ///
    /// # Errors
    /// If it cannot be written. The episode continues.
    fn clock_restarted(&mut self, step: u32, away: Duration) -> io::Result<()>;
}

/// Logged action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Acted {
    /// Step number, from 1.
    pub step: u32,
    /// The action.
    pub action: Action,
    /// State hash after the action.
    pub state_hash: u64,
    /// The agent's thinking time.
    pub thought: Duration,
    /// Rest of the time bank.
    pub bank_left: Duration,
}

/// An episode on its way from the host to a slot and back.
pub struct HostedEpisode<E> {
    /// Random name within the run, visible to the agent.
    pub handle: String,
    /// The episode.
    pub episode: E,
    /// The host's episode number, never sent to agents.
    pub ticket: u64,
    /// Action log.
    pub log: Box<dyn EpisodeLog>,
    /// Time accounts, zero at first.
    pub time: TimeSpent,
}

/// Time accounts, wall clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeSpent {
    /// Simulation: motion, vision, sound.
    pub simulation: Duration,
    /// Observation encoding.
    pub encoding: Duration,
    /// Waiting for a simulation thread.
    pub queue: Duration,
    /// The agent's thinking, from the observation's departure to the action's arrival, without the round trip.
    pub thinking: Duration,
}

/// An episode restored after a restart.
#[derive(Debug)]
pub struct Restored<E> {
    /// Slot that played it.
    pub slot: u32,
    /// The episode.
    pub hosted: HostedEpisode<E>,
    /// Last observation and the action before it, which is `None` at the start.
    pub last: (Observation, Option<Action>),
    /// Rest of the time bank.
    pub bank_left: Duration,
}

impl<E> std::fmt::Debug for HostedEpisode<E> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("HostedEpisode")
            .field("handle", &self.handle)
            .field("ticket", &self.ticket)
            .finish_non_exhaustive()
    }
}
