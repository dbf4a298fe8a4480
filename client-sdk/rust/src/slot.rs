//! Slot state with the current episode.

use crate::action::Action;
use crate::connection::{Connection, Event};
use crate::error::{Error, closed};
use crate::observation::{Mission, Observation};
use crate::summary::{EpisodeEnd, Progress};
use avln_proto::v1::{self, play_request::Frame};
use std::time::Duration;
use tokio::sync::mpsc;

/// Remaining time for the next action.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeLeft {
    /// Free thinking time; `None`: unlimited.
    pub step: Option<Duration>,
    /// Remaining episode bank beyond `step`.
    pub bank: Duration,
}

/// A slot's episode as last reported by the server.
#[derive(Debug)]
pub(crate) struct SlotState {
    slot: u32,
    events: mpsc::Receiver<Event>,
    pub(crate) id: String,
    pub(crate) ordinal: u32,
    pub(crate) mission: Mission,
    pub(crate) observation: Observation,
    pub(crate) time: TimeLeft,
    pub(crate) fault: Option<Error>,
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
const ABANDON: &str = "abandon an episode";

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

    pub(crate) async fn next(&mut self) -> Event {
        self.events.recv().await.unwrap_or(Event::Closed(None))
    }

    pub(crate) async fn begin(&mut self, connection: &Connection) -> Result<Begun, Error> {
        loop {
            match self.next().await {
                Event::Start(start) => return self.start(connection, *start).map(Begun::Episode),
                Event::RunEnd(end) => return Ok(Begun::RunEnd(end)),
                Event::Fault(fault) if fault.episode.is_empty() => {
                    return Err(Error::from_fault(BEGIN, &fault));
                }
                Event::Closed(end) => return Err(closed(BEGIN, end)),
                // Frames of the previous episode may still be queued.
                Event::Observation(_) | Event::End(_) | Event::Fault(_) => {}
            }
        }
    }

    fn start(&mut self, connection: &Connection, start: v1::EpisodeStart) -> Result<Progress, Error> {
        let first = start.observation.ok_or_else(|| Error::protocol("EpisodeStart has no observation"))?;
        self.id = start.episode;
        self.ordinal = start.ordinal;
        self.mission = Mission::from_wire(start.mission)?;
        self.time = time_left(first.time);
        self.observation = connection.agreement.unpack(first)?;
        self.fault = None;
        self.phase = SlotPhase::Playing;
        Ok(Progress::from_wire(start.progress))
    }

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

    /// Handles an event before the awaited answer; returns true at the episode's end.
    fn settle(&mut self, attempted: &'static str, event: Event) -> Result<bool, Error> {
        match event {
            Event::End(end) if end.episode == self.id => {
                self.phase = SlotPhase::Over(EpisodeEnd::from_wire(end));
                return Ok(true);
            }
            Event::Fault(fault) => self.handle_fault(attempted, &fault)?,
            Event::Closed(end) => return Err(closed(attempted, end)),
            Event::RunEnd(_) => return Err(Error::protocol("the run ended while an episode was open")),
            Event::Start(_) => return Err(Error::protocol("an episode began while another was open")),
            // Frames of the previous episode may still be queued.
            Event::Observation(_) | Event::End(_) => {}
        }
        Ok(false)
    }

    fn handle_fault(&mut self, attempted: &'static str, fault: &v1::Fault) -> Result<(), Error> {
        let stale = !fault.episode.is_empty() && fault.episode != self.id;
        if stale {
            return Ok(());
        }
        let error = Error::from_fault(attempted, fault);
        if fault.recoverable || fault.slot.is_none() {
            return Err(error);
        }
        // EpisodeEnd follows and completes the step.
        self.fault = Some(error);
        Ok(())
    }

    fn see(&mut self, connection: &Connection, seen: v1::Observation, step: u32) -> Result<(), Error> {
        if seen.step != step {
            return Err(Error::protocol(format!("observation: expected step {step}, got {}", seen.step)));
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
