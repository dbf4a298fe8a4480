//! What a slot holds: an episode that is being played, or one that is over.

use super::{Shared, clock::Clock, slot::Answer};
use crate::{
    limits::Limits,
    refusal::{About, Failure},
    seat::Seat,
    wire,
};
use avln_episode::Action;
use avln_proto::v1::{self, Reason};

pub(super) struct Playing {
    pub(super) seat: Seat,
    /// Which episode of the run it is, counted from 1.
    pub(super) ordinal: u32,
    pub(super) last: Last,
    pub(super) clock: Clock,
}

/// The last observation and the action that led to it: sent again to an agent that asks again.
#[derive(Clone)]
pub(super) struct Last {
    pub(super) action: Option<i32>,
    pub(super) observation: v1::Observation,
}

pub(super) struct Over {
    pub(super) last: Last,
    pub(super) end: v1::EpisodeEnd,
}

impl Last {
    /// The action that is to be carried out now; `None` when `act` asks for this observation again.
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

    /// Whether this observation ended the episode.
    pub(super) fn is_last(&self) -> bool {
        self.observation.terminated || self.observation.truncated
    }
}

/// How much of an episode somebody has received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Known {
    /// Not even that it began.
    Nothing,
    /// Its mission, and not its last observation.
    Mission,
    /// Its last observation.
    Observation,
}

impl Playing {
    /// How much of it is known to somebody who received `known` last.
    pub(super) fn known_by(&self, known: Option<&v1::SlotPosition>) -> Known {
        match known {
            Some(known) if known.episode != self.seat.handle => Known::Nothing,
            Some(known) if known.step == self.last.observation.step => Known::Observation,
            Some(_) => Known::Mission,
            None => Known::Nothing,
        }
    }

    /// Where it is.
    pub(super) fn position(&self, slot: u32) -> v1::SlotPosition {
        v1::SlotPosition { slot, episode: self.seat.handle.clone(), step: self.last.observation.step }
    }

    /// The agent has answered, or is not asked any more: its thinking is counted.
    pub(super) fn stop_clock(&mut self) -> std::time::Duration {
        let thought = self.clock.stop();
        self.seat.time.thinking += thought;
        thought
    }
}

impl Over {
    /// The last action again yields the last answer again. An episode that ended while the agent thought is told
    /// as an end to a unary caller, who had no other way to learn of it.
    pub(super) fn act(&self, act: &v1::Act, unary: bool) -> Result<Answer, Failure> {
        same_episode(&self.end.episode, &act.episode)?;
        let taken = &self.last.observation;
        let mut response = v1::StepResponse { observation: None, episode_end: Some(self.end.clone()) };
        let again = act.step == taken.step && self.last.action == Some(act.action);
        if again && self.last.is_last() {
            response.observation = Some(taken.clone());
            return Ok(Answer::Step(Box::new(response)));
        }
        let cut_short = !self.last.is_last();
        if unary && cut_short && self.end.reason() != v1::EndReason::Abandoned {
            return Ok(Answer::Step(Box::new(response)));
        }
        let ended = self.end.reason().as_str_name();
        let message =
            format!("the episode ended after {} steps ({ended}); send Ready for the next", taken.step);
        Err(Failure::new(Reason::EpisodeOver, message))
    }

    /// What somebody has missed who received `known` last.
    pub(super) fn missed(&self, known: &v1::SlotPosition) -> Answer {
        let unseen = self.last.is_last() && known.step < self.last.observation.step;
        Answer::Step(Box::new(v1::StepResponse {
            observation: unseen.then(|| self.last.observation.clone()),
            episode_end: Some(self.end.clone()),
        }))
    }
}

/// The frame that tells of an episode from its mission on; its observation is the last one.
pub(super) fn start_frame(slot: u32, shared: &Shared, playing: &Playing) -> v1::EpisodeStart {
    v1::EpisodeStart {
        slot,
        episode: playing.seat.handle.clone(),
        mission: Some(wire::mission(playing.seat.referee.mission())),
        observation: Some(playing.last.observation.clone()),
        ordinal: playing.ordinal,
        progress: Some(shared.board.progress()),
    }
}

impl super::Order {
    /// What a fault about this order names.
    pub(crate) fn about(&self, slot: u32) -> About<'_> {
        let (episode, step) = match self {
            Self::Ready | Self::GoOn => ("", 0),
            Self::Act(act) => (act.episode.as_str(), act.step),
            Self::Abandon(abandon) => (abandon.episode.as_str(), abandon.step),
        };
        About { slot: Some(slot), episode: Limits::shorten(episode), step }
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
    let message = format!("step {step} lies ahead; {latest} is the latest that is possible");
    Err(Failure::new(Reason::StepAhead, message))
}

fn unknown_action(number: i32) -> Failure {
    let message = format!(
        "action {number} does not exist; use 1 MOVE_FORWARD, 2 TURN_LEFT, 3 TURN_RIGHT, 4 SUBMIT or 5 STOP"
    );
    Failure::new(Reason::ActionOutOfRange, message)
}
