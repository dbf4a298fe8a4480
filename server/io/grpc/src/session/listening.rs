//! What a slot tells whoever listens, and what it tells again when a lost connection is back.

use super::{
    playing::{Known, start_frame},
    slot::{Answer, Audience, Slot, State},
};
use crate::{
    door::stored_end,
    refusal::{About, Failure},
};
use avln_proto::v1::{self, Reason, play_response::Frame};
use std::time::Duration;

impl Slot {
    /// Sends a stream what it has missed. Says whether the agent's clock started again, because the observation that it
    /// must answer had not arrived.
    pub(super) async fn catch_up(&mut self, known: Option<v1::SlotPosition>, away: Duration) -> bool {
        if !matches!(self.audience, Audience::Stream(_)) {
            return false;
        }
        let missed = match (&self.state, &known) {
            (State::Playing(playing), known) => {
                let knows = playing.known_by(known.as_ref());
                return self.catch_up_playing(knows, away).await;
            }
            (State::Over(over), Some(known)) if known.episode == over.end.episode => Ok(over.missed(known)),
            (_, Some(known)) => self.stored_end(known).await,
            (_, None) => return false,
        };
        let about = known.unwrap_or_default();
        self.tell(About { slot: Some(self.id), episode: &about.episode, step: about.step }, missed).await;
        false
    }

    async fn catch_up_playing(&mut self, known: Known, away: Duration) -> bool {
        let State::Playing(playing) = &mut self.state else { return false };
        let arrived = known == Known::Observation && playing.clock.runs();
        let frame = match known {
            Known::Nothing => Frame::EpisodeStart(start_frame(self.id, &self.shared, playing)),
            _ => Frame::Observation(playing.last.observation.clone()),
        };
        let Audience::Stream(out) = &self.audience else { return false };
        if let (Ok(departure), false) = (out.send(frame).await, arrived) {
            playing.clock.sent(departure);
        }
        let step = playing.last.observation.step;
        let restarted = !arrived && !away.is_zero();
        if restarted && let Err(error) = playing.seat.log.clock_restarted(step, away) {
            tracing::error!(run = self.shared.run, slot = self.id, %error, "a clock that started again was not recorded");
        }
        restarted
    }

    /// How an episode ended that the client still holds and that is stored.
    async fn stored_end(&mut self, known: &v1::SlotPosition) -> Result<Answer, Failure> {
        let Some(end) = stored_end(&self.shared.host, &self.shared.run, known).await? else {
            let message = "the episode is not this run's, or will be played again; send Ready";
            return Err(Failure::new(Reason::EpisodeUnknown, message));
        };
        let progress = Some(self.shared.board.progress());
        Ok(Answer::Ended(Box::new(v1::EpisodeEnd { progress, ..end })))
    }

    /// Sends an answer to the stream, if one listens. An agent that does not read is noticed by the stream itself; its
    /// time runs from the moment when its observation has left.
    pub(super) async fn tell(&mut self, about: About<'_>, answer: Result<Answer, Failure>) {
        let Audience::Stream(out) = &self.audience else { return };
        for frame in frames(about, answer) {
            let asks = matches!(frame, Frame::EpisodeStart(_) | Frame::Observation(_));
            let Ok(departure) = out.send(frame).await else { return };
            if let (State::Playing(playing), true) = (&mut self.state, asks)
                && !playing.clock.runs()
            {
                playing.clock.sent(departure);
            }
        }
    }
}

/// What a stream is sent as an answer.
fn frames(about: About<'_>, answer: Result<Answer, Failure>) -> Vec<Frame> {
    match answer {
        Ok(Answer::Start(start)) => vec![Frame::EpisodeStart(*start)],
        Ok(Answer::NothingLeft) => vec![],
        Ok(Answer::Ended(end)) => vec![Frame::EpisodeEnd(*end)],
        Ok(Answer::Step(step)) => {
            let observation = step.observation.map(Frame::Observation);
            observation.into_iter().chain(step.episode_end.map(Frame::EpisodeEnd)).collect()
        }
        Err(failure) => vec![Frame::Fault(failure.frame(about, true))],
    }
}
