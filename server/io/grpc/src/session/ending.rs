//! How the episode of a slot comes to its end, and what the host is told of it.

use super::{
    playing::{Last, Over},
    simulate,
    slot::{Answer, Audience, Slot, State},
};
use crate::{
    refusal::{About, Failure, ServerFault, ask},
    seat::Seat,
    wire,
};
use avln_episode::EndReason;
use avln_proto::v1::{self, play_response::Frame};

impl Slot {
    pub(super) async fn stillborn(&mut self, mut seat: Seat, fault: ServerFault) -> Result<Answer, Failure> {
        simulate::truncate(&mut seat, EndReason::ServerFault);
        self.conclude(seat).await;
        Err(fault.into())
    }

    /// The simulator failed in mid-step: this episode ends, nothing else does.
    pub(super) async fn broken(
        &mut self,
        mut seat: Seat,
        last: Last,
        act: &v1::Act,
        fault: ServerFault,
    ) -> Answer {
        if let Audience::Stream(out) = &self.audience {
            let about = About { slot: Some(self.id), episode: &seat.handle, step: act.step };
            let _ = out.send(Frame::Fault(Failure::from(fault).frame(about, false))).await;
        }
        simulate::truncate(&mut seat, EndReason::ServerFault);
        let episode_end = Some(self.end_with(seat, last).await);
        Answer::Step(Box::new(v1::StepResponse { observation: None, episode_end }))
    }

    /// The simulator hangs in mid-step, and the episode with it: this episode ends, nothing else does.
    pub(super) async fn hung(
        &mut self,
        handle: &str,
        ticket: u64,
        last: Last,
        act: &v1::Act,
        fault: ServerFault,
    ) -> Answer {
        if let Audience::Stream(out) = &self.audience {
            let about = About { slot: Some(self.id), episode: handle, step: act.step };
            let _ = out.send(Frame::Fault(Failure::from(fault).frame(about, false))).await;
        }
        self.lose(handle, ticket).await;
        let end = self.end_frame(handle, last.observation.step, EndReason::ServerFault, None);
        self.state = State::Over(Box::new(Over { last, end: end.clone() }));
        Answer::Step(Box::new(v1::StepResponse { observation: None, episode_end: Some(end) }))
    }

    /// The seat of an episode is gone: the host has it played again.
    pub(super) async fn lose(&mut self, handle: &str, ticket: u64) {
        let (host, run, name) = (self.shared.host.clone(), self.shared.run.clone(), handle.to_owned());
        if let Err(failure) = ask("lose", async move { host.lose(&run, &name, ticket).await }).await {
            tracing::error!(why = failure.message(), "an episode that hangs was not taken back");
        }
        self.count_end(EndReason::ServerFault);
    }

    /// Ends an open episode from outside and stores it.
    pub(super) async fn put_away(&mut self, reason: EndReason) -> Option<v1::EpisodeEnd> {
        match std::mem::replace(&mut self.state, State::Idle) {
            State::Playing(mut playing) => {
                playing.stop_clock();
                simulate::truncate(&mut playing.seat, reason);
                Some(self.end_with(playing.seat, playing.last).await)
            }
            other => {
                self.state = other;
                None
            }
        }
    }

    pub(super) async fn put_away_and_tell(&mut self, reason: EndReason) {
        if let Some(end) = self.put_away(reason).await {
            self.tell(About::default(), Ok(Answer::Ended(Box::new(end)))).await;
        }
    }

    pub(super) async fn end_with(&mut self, seat: Seat, last: Last) -> v1::EpisodeEnd {
        let end = self.conclude(seat).await;
        self.state = State::Over(Box::new(Over { last, end: end.clone() }));
        end
    }

    /// Gives the seat back to the host to be stored. What could not be stored does not count.
    pub(super) async fn conclude(&mut self, seat: Seat) -> v1::EpisodeEnd {
        let (episode, step) = (seat.handle.clone(), seat.referee.steps());
        let reason = seat.referee.end().unwrap_or(EndReason::ServerFault);
        let (host, run) = (self.shared.host.clone(), self.shared.run.clone());
        let stored = ask("conclude", async move { host.conclude(&run, seat).await }).await;
        let (reason, outcome) = match stored {
            Ok(outcome) => (reason, outcome),
            Err(failure) => {
                tracing::error!(episode, why = failure.message(), "episode not stored");
                (EndReason::ServerFault, None)
            }
        };
        self.count_end(reason);
        let metrics = outcome.map(|outcome| wire::public_metrics(outcome.metrics, 0));
        self.end_frame(&episode, step, reason, metrics)
    }

    pub(super) fn count_end(&self, reason: EndReason) {
        self.shared.board.ended(reason);
        if let Some(control) = self.shared.host.control() {
            control.ended(&self.shared.run, self.id, reason);
        }
    }

    pub(super) fn end_frame(
        &self,
        episode: &str,
        step: u32,
        reason: EndReason,
        metrics: Option<v1::PublicMetrics>,
    ) -> v1::EpisodeEnd {
        v1::EpisodeEnd {
            slot: self.id,
            episode: episode.to_owned(),
            step,
            reason: wire::end_reason(reason).into(),
            terminated: reason.is_terminated(),
            metrics,
            progress: Some(self.shared.board.progress()),
        }
    }
}
