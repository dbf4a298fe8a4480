//! Slot requests, replies, and episodes, open or finished.

use super::{SessionContext, clock::ChessClock};
use crate::{
    episode::{Episode, HostedEpisode},
    limits::Limits,
    outbound::Outbound,
    refusal::{Failure, FaultSubject},
    wire,
};
use avln_episode::Action;
use avln_proto::v1::{self, Reason};

/// Agent request to a slot.
#[derive(Clone, Debug)]
pub(crate) enum SlotRequest {
    Ready,
    /// Continue the open episode of a unary caller, or begin the next.
    Resume,
    Act(v1::Act),
    Abandon(v1::Abandon),
}

/// Slot reply.
#[derive(Clone, Debug)]
pub(crate) enum SlotReply {
    Start(Box<v1::EpisodeStart>),
    NothingLeft,
    Step(Box<v1::StepResponse>),
    Ended(Box<v1::EpisodeEnd>),
}

/// Receiver for slot replies.
#[derive(Clone, Debug)]
pub(crate) enum Audience {
    Stream(Outbound),
    /// Unary calls that wait for replies.
    Callers,
    /// No client is attached; the last observation is kept.
    Nobody,
}

/// Open episode.
pub(super) struct OpenEpisode<E> {
    pub(super) hosted: HostedEpisode<E>,
    /// Number in the run, from 1.
    pub(super) ordinal: u32,
    pub(super) last: LastStep,
    pub(super) clock: ChessClock,
}

/// Last observation and the action before it, kept to answer repeated requests.
#[derive(Clone)]
pub(super) struct LastStep {
    pub(super) action: Option<i32>,
    pub(super) observation: v1::Observation,
}

/// Episode that is over and stored.
pub(super) struct FinishedEpisode {
    pub(super) last: LastStep,
    pub(super) end: v1::EpisodeEnd,
}

impl LastStep {
    /// Returns the action to carry out; `None` if `act` is a repetition.
    pub(super) fn due(&self, act: &v1::Act) -> Result<Option<Action>, Failure> {
        let action = wire::action(act.action).ok_or_else(|| unknown_action(act.action))?;
        let taken = self.observation.step;
        not_ahead(act.step, taken + 1)?;
        if act.step == taken + 1 {
            return Ok(Some(action));
        }
        if act.step == taken && self.action == Some(act.action) {
            return Ok(None);
        }
        let message = format!("step {} is past, {taken} steps were taken; send step {}", act.step, taken + 1);
        Err(Failure::new(Reason::StepConflict, message))
    }

    /// Returns whether this observation ended the episode.
    pub(super) fn is_last(&self) -> bool {
        self.observation.terminated || self.observation.truncated
    }
}

/// Received part of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Received {
    Nothing,
    /// The mission, but not the last observation.
    Mission,
    LastObservation,
}

impl<E: Episode> OpenEpisode<E> {
    /// Returns the part that a client with this last position has received.
    pub(super) fn received_by(&self, known: Option<&v1::SlotPosition>) -> Received {
        match known {
            Some(known) if known.episode != self.hosted.handle => Received::Nothing,
            Some(known) if known.step == self.last.observation.step => Received::LastObservation,
            Some(_) => Received::Mission,
            None => Received::Nothing,
        }
    }

    pub(super) fn position(&self, slot: u32) -> v1::SlotPosition {
        v1::SlotPosition { slot, episode: self.hosted.handle.clone(), step: self.last.observation.step }
    }

    /// Stops the clock and accounts for the thinking time.
    pub(super) fn stop_clock(&mut self) -> std::time::Duration {
        let thought = self.clock.stop();
        self.hosted.time.thinking += thought;
        thought
    }

    /// Builds an EpisodeStart with the last observation instead of the first.
    pub(super) fn start_frame<H>(&self, slot: u32, session: &SessionContext<H>) -> v1::EpisodeStart {
        v1::EpisodeStart {
            slot,
            episode: self.hosted.handle.clone(),
            mission: Some(wire::mission(self.hosted.episode.mission())),
            observation: Some(self.last.observation.clone()),
            ordinal: self.ordinal,
            progress: Some(session.progress.progress()),
        }
    }
}

impl FinishedEpisode {
    /// Repeats the last reply to a repeated action, and refuses any other.
    pub(super) fn act(&self, act: &v1::Act, is_unary: bool) -> Result<SlotReply, Failure> {
        same_episode(&self.end.episode, &act.episode)?;
        let taken = &self.last.observation;
        let mut response = v1::StepResponse { observation: None, episode_end: Some(self.end.clone()) };
        let again = act.step == taken.step && self.last.action == Some(act.action);
        if again && self.last.is_last() {
            response.observation = Some(taken.clone());
            return Ok(SlotReply::Step(Box::new(response)));
        }
        // An episode that ended while the agent was thinking: a stream has received the end, a unary caller learns it only here.
        let cut_short = !self.last.is_last();
        if is_unary && cut_short && self.end.reason() != v1::EndReason::Abandoned {
            return Ok(SlotReply::Step(Box::new(response)));
        }
        let ended = self.end.reason().as_str_name();
        let message =
            format!("the episode ended after {} steps ({ended}); send Ready for the next", taken.step);
        Err(Failure::new(Reason::EpisodeOver, message))
    }

    /// Returns the frames that a client with this last position has missed.
    pub(super) fn missed(&self, known: &v1::SlotPosition) -> SlotReply {
        let unseen = self.last.is_last() && known.step < self.last.observation.step;
        SlotReply::Step(Box::new(v1::StepResponse {
            observation: unseen.then(|| self.last.observation.clone()),
            episode_end: Some(self.end.clone()),
        }))
    }
}

impl SlotRequest {
    /// Returns the subject for faults about this request.
    pub(crate) fn subject(&self, slot: u32) -> FaultSubject<'_> {
        let (episode, step) = match self {
            Self::Ready | Self::Resume => ("", 0),
            Self::Act(act) => (act.episode.as_str(), act.step),
            Self::Abandon(abandon) => (abandon.episode.as_str(), abandon.step),
        };
        FaultSubject { slot: Some(slot), episode: Limits::shorten(episode), step }
    }
}

pub(super) fn same_episode(held: &str, named: &str) -> Result<(), Failure> {
    if held == named {
        return Ok(());
    }
    let message = format!("episode '{}' is not in this slot; '{held}' is", Limits::shorten(named));
    Err(Failure::new(Reason::EpisodeUnknown, message))
}

pub(super) fn not_ahead(step: u32, latest: u32) -> Result<(), Failure> {
    if step <= latest {
        return Ok(());
    }
    let message = format!("step {step} lies ahead; {latest} is the latest possible");
    Err(Failure::new(Reason::StepAhead, message))
}

fn unknown_action(number: i32) -> Failure {
    let message = format!(
        "action {number} does not exist; use 1 MOVE_FORWARD, 2 TURN_LEFT, 3 TURN_RIGHT, 4 SUBMIT or 5 STOP"
    );
    Failure::new(Reason::ActionOutOfRange, message)
}
