use crate::{
    Action, EpisodeEnd, Error, Mission, Observation, Play, Progress,
    connection::{Connection, Event},
    error::closed,
};
use avln_proto::v1::{self, play_request::Frame};
use std::{
    ops::{Deref, DerefMut},
    time::Duration,
};
use tokio::sync::{OwnedMutexGuard, mpsc};

/// An episode in progress: borrowed from [`Play::next_episode`], or an owned item of the stream
/// [`Play::episodes`].
#[derive(Debug)]
pub struct Episode<'play> {
    play: Hold<'play>,
}

/// An episode's access to its slot.
#[derive(Debug)]
enum Hold<'play> {
    Lent(&'play mut Play),
    Kept(OwnedMutexGuard<Play>),
}

impl Deref for Hold<'_> {
    type Target = Play;

    fn deref(&self) -> &Play {
        match self {
            Self::Lent(play) => play,
            Self::Kept(play) => play,
        }
    }
}

impl DerefMut for Hold<'_> {
    fn deref_mut(&mut self) -> &mut Play {
        match self {
            Self::Lent(play) => play,
            Self::Kept(play) => play,
        }
    }
}

/// Remaining time for the next action.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeLeft {
    /// Free thinking time; `None`: unlimited.
    pub step: Option<Duration>,
    /// Remaining episode bank beyond `step`.
    pub bank: Duration,
}

impl<'play> Episode<'play> {
    pub(crate) fn lent(play: &'play mut Play) -> Self {
        Self { play: Hold::Lent(play) }
    }
}

impl Episode<'static> {
    pub(crate) fn kept(play: OwnedMutexGuard<Play>) -> Self {
        Self { play: Hold::Kept(play) }
    }
}

impl Episode<'_> {
    /// Random episode handle, valid in this run only.
    pub fn id(&self) -> &str {
        &self.play.state.id
    }

    /// Episode number in start order, from 1.
    pub fn ordinal(&self) -> u32 {
        self.play.state.ordinal
    }

    /// The mission.
    pub fn mission(&self) -> &Mission {
        &self.play.state.mission
    }

    /// The latest observation: at the start, or after the last step.
    pub fn observation(&self) -> &Observation {
        &self.play.state.observation
    }

    /// Time for the next action.
    pub fn time_left(&self) -> TimeLeft {
        self.play.state.time
    }

    /// Run progress.
    pub fn progress(&self) -> Progress {
        self.play.progress()
    }

    /// Returns true if the episode has ended; see [`end`](Self::end).
    pub fn is_over(&self) -> bool {
        self.play.state.is_over()
    }

    /// Episode result; `None` before its end.
    pub fn end(&self) -> Option<&EpisodeEnd> {
        self.play.state.end()
    }

    /// The server failure behind [`EndReason::ServerFault`](crate::EndReason::ServerFault).
    pub fn fault(&self) -> Option<&Error> {
        self.play.state.fault.as_ref()
    }

    /// Takes a step. A limit may end the episode before the step: check [`is_over`](Self::is_over).
    ///
    /// # Errors
    /// [`Error::EpisodeOver`] after the end; [`Error::Refused`] if the server refuses the step and the
    /// episode continues; otherwise if the protocol is violated or the connection is lost.
    pub async fn step(&mut self, action: Action) -> Result<&Observation, Error> {
        let play = &mut *self.play;
        play.state.step(&play.connection, action).await?;
        play.note_progress();
        Ok(&play.state.observation)
    }

    /// Abandons the episode: it is scored up to the last step. No effect after the end.
    ///
    /// # Errors
    /// If the protocol is violated, or the connection is lost.
    pub async fn abandon(&mut self) -> Result<(), Error> {
        let play = &mut *self.play;
        if !play.state.is_over() {
            play.state.abandon(&play.connection).await?;
        }
        play.note_progress();
        Ok(())
    }
}

/// Slot state: the episode as last reported by the server.
#[derive(Debug)]
pub(crate) struct SlotState {
    slot: u32,
    events: mpsc::Receiver<Event>,
    id: String,
    ordinal: u32,
    mission: Mission,
    observation: Observation,
    time: TimeLeft,
    fault: Option<Error>,
    phase: SlotPhase,
}

#[derive(Debug)]
enum SlotPhase {
    Idle,
    Playing,
    Over(EpisodeEnd),
}

/// Answer to Ready.
pub(crate) enum Begun {
    Episode(Progress),
    RunEnd(v1::RunEnd),
}

const BEGIN: &str = "begin an episode";
const STEP: &str = "take a step";
const ABANDON: &str = "give an episode up";

impl SlotState {
    pub(crate) fn new(slot: u32, events: mpsc::Receiver<Event>) -> Self {
        Self {
            slot,
            events,
            id: String::new(),
            ordinal: 0,
            mission: Mission::default(),
            observation: Observation::default(),
            time: TimeLeft::default(),
            fault: None,
            phase: SlotPhase::Idle,
        }
    }

    pub(crate) fn is_over(&self) -> bool {
        !matches!(self.phase, SlotPhase::Playing)
    }

    pub(crate) fn end(&self) -> Option<&EpisodeEnd> {
        match &self.phase {
            SlotPhase::Over(end) => Some(end),
            SlotPhase::Idle | SlotPhase::Playing => None,
        }
    }

    /// Waits for the next slot event.
    pub(crate) async fn next(&mut self) -> Event {
        self.events.recv().await.unwrap_or(Event::Closed(None))
    }

    /// Waits for the answer to Ready.
    pub(crate) async fn begin(&mut self, connection: &Connection) -> Result<Begun, Error> {
        loop {
            match self.next().await {
                Event::Start(start) => return self.start(connection, *start).map(Begun::Episode),
                Event::RunEnd(end) => return Ok(Begun::RunEnd(end)),
                Event::Fault(fault) if fault.episode.is_empty() => {
                    return Err(Error::from_fault(BEGIN, &fault));
                }
                Event::Closed(end) => return Err(closed(BEGIN, end)),
                Event::Observation(_) | Event::End(_) | Event::Fault(_) => {} // of the episode before
            }
        }
    }

    fn start(&mut self, connection: &Connection, start: v1::EpisodeStart) -> Result<Progress, Error> {
        let first =
            start.observation.ok_or_else(|| Error::protocol("an episode began without an observation"))?;
        self.id = start.episode;
        self.ordinal = start.ordinal;
        self.mission = Mission::from_wire(start.mission)?;
        self.time = time_left(first.time);
        self.observation = connection.agreement.unpack(first)?;
        self.fault = None;
        self.phase = SlotPhase::Playing;
        Ok(Progress::from_wire(start.progress))
    }

    /// Sends an action and waits for the result.
    pub(crate) async fn step(&mut self, connection: &Connection, action: Action) -> Result<(), Error> {
        if self.is_over() {
            return Err(Error::EpisodeOver);
        }
        let step = self.observation.step + 1;
        let act =
            v1::Act { slot: self.slot, episode: self.id.clone(), step, action: action.to_wire() as i32 };
        connection.send(Frame::Act(act)).await;
        loop {
            match self.next().await {
                Event::Observation(seen) if seen.episode == self.id => {
                    let last = seen.terminated || seen.truncated;
                    self.see(connection, *seen, step)?;
                    return if last { self.await_end(STEP).await } else { Ok(()) };
                }
                other => {
                    if self.settle(STEP, other)? {
                        return Ok(());
                    }
                }
            }
        }
    }

    pub(crate) async fn abandon(&mut self, connection: &Connection) -> Result<(), Error> {
        let abandon = v1::Abandon { slot: self.slot, episode: self.id.clone(), step: self.observation.step };
        connection.send(Frame::Abandon(abandon)).await;
        self.await_end(ABANDON).await
    }

    async fn await_end(&mut self, attempted: &'static str) -> Result<(), Error> {
        loop {
            let event = self.next().await;
            if self.settle(attempted, event)? {
                return Ok(());
            }
        }
    }

    /// Handles whatever may come while an answer is awaited; true when the episode is over.
    fn settle(&mut self, attempted: &'static str, event: Event) -> Result<bool, Error> {
        match event {
            Event::End(end) if end.episode == self.id => {
                self.phase = SlotPhase::Over(EpisodeEnd::from_wire(end));
                return Ok(true);
            }
            Event::Fault(fault) => self.weigh(attempted, &fault)?,
            Event::Closed(end) => return Err(closed(attempted, end)),
            Event::RunEnd(_) => return Err(Error::protocol("the run ended while an episode was open")),
            Event::Start(_) => return Err(Error::protocol("an episode began while another was open")),
            Event::Observation(_) | Event::End(_) => {} // of the episode before
        }
        Ok(false)
    }

    /// Stores a fault that ends the episode, because EpisodeEnd follows; other episodes' faults are
    /// outdated.
    fn weigh(&mut self, attempted: &'static str, fault: &v1::Fault) -> Result<(), Error> {
        let stale = !fault.episode.is_empty() && fault.episode != self.id;
        if stale {
            return Ok(());
        }
        let error = Error::from_fault(attempted, fault);
        if fault.recoverable || fault.slot.is_none() {
            return Err(error);
        }
        self.fault = Some(error);
        Ok(())
    }

    fn see(&mut self, connection: &Connection, seen: v1::Observation, step: u32) -> Result<(), Error> {
        if seen.step != step {
            return Err(Error::protocol(format!(
                "step {step} was answered by the observation of step {}",
                seen.step
            )));
        }
        self.time = time_left(seen.time);
        self.observation = connection.agreement.unpack(seen)?;
        Ok(())
    }
}

fn time_left(time: Option<v1::TimeAccount>) -> TimeLeft {
    let millis = |ms: u32| Duration::from_millis(u64::from(ms));
    let time = time.unwrap_or_default();
    TimeLeft { step: (time.step_ms > 0).then(|| millis(time.step_ms)), bank: millis(time.bank_ms) }
}
