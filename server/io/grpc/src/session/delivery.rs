//! Episode ends, and delivery of replies, also after a lost connection.

use super::{
    Hosted,
    playing::{Audience, FinishedEpisode, LastStep, SlotReply},
    slot::{Slot, SlotContent},
};
use crate::{
    host::{Episode, Host, StoredEnd},
    refusal::{Failure, FaultSubject, Result, call_host},
    sim_pool::truncate,
    wire,
};
use avln_episode::EndReason;
use avln_proto::v1::{self, Reason, play_response::Frame};
use std::{sync::Arc, time::Duration};

impl<H: Host> Slot<H> {
    pub(super) async fn failed_to_start(
        &mut self,
        mut hosted: Hosted<H>,
        fault: Failure,
    ) -> Result<SlotReply> {
        truncate(&mut hosted, EndReason::ServerFault);
        self.conclude(hosted).await;
        Err(fault)
    }

    /// Ends an episode after a failed step. Other episodes are not affected.
    pub(super) async fn broken(&mut self, mut hosted: Hosted<H>, last: LastStep) -> SlotReply {
        truncate(&mut hosted, EndReason::ServerFault);
        let episode_end = Some(self.end_with(hosted, last).await);
        SlotReply::step(None, episode_end)
    }

    /// Ends an episode after a hanging step. It is lost with the hanging thread.
    pub(super) async fn timed_out(&mut self, handle: &str, ticket: u64, last: LastStep) -> SlotReply {
        self.mark_lost(handle, ticket).await;
        let end = StoredEnd { reason: EndReason::ServerFault, steps: last.observation.step, outcome: None };
        let end = self.end_frame(handle, end);
        self.state = SlotContent::Finished(Box::new(FinishedEpisode { last, end: end.clone() }));
        SlotReply::step(None, Some(end))
    }

    /// Reports a fault to the stream, if one is attached.
    pub(super) async fn report_fault(&mut self, episode: &str, step: u32, fault: Failure) {
        if let Audience::Stream(out) = &self.audience {
            let subject = FaultSubject { slot: Some(self.id), episode, step };
            let _ = out.send(Frame::Fault(fault.frame(subject, false))).await;
        }
    }

    /// Reports a lost episode to the host, which restarts it.
    pub(super) async fn mark_lost(&mut self, handle: &str, ticket: u64) {
        let run = self.session.run.clone();
        let name = handle.to_owned();
        let lose = |host: Arc<H>| async move { host.lose(&run, &name, ticket).await };
        if let Err(failure) = call_host("lose", &self.session.host, lose).await {
            tracing::error!(why = failure.message, "cannot withdraw a hanging episode");
        }
        self.count_end(EndReason::ServerFault);
    }

    pub(super) async fn store_open_episode(&mut self, reason: EndReason) -> Option<v1::EpisodeEnd> {
        match std::mem::replace(&mut self.state, SlotContent::Idle) {
            SlotContent::Playing(mut playing) => {
                playing.stop_clock();
                truncate(&mut playing.hosted, reason);
                Some(self.end_with(playing.hosted, playing.last).await)
            }
            other => {
                self.state = other;
                None
            }
        }
    }

    /// Ends an open episode and reports the end to the client.
    pub(super) async fn cut(&mut self, reason: EndReason) {
        if let Some(end) = self.store_open_episode(reason).await {
            self.deliver(FaultSubject::default(), Ok(SlotReply::Ended(Box::new(end)))).await;
        }
    }

    pub(super) async fn end_with(&mut self, hosted: Hosted<H>, last: LastStep) -> v1::EpisodeEnd {
        let end = self.conclude(hosted).await;
        self.state = SlotContent::Finished(Box::new(FinishedEpisode { last, end: end.clone() }));
        end
    }

    /// Returns an episode to the host, which stores it.
    async fn conclude(&mut self, hosted: Hosted<H>) -> v1::EpisodeEnd {
        let episode = hosted.handle.clone();
        let steps = hosted.episode.steps();
        let reason = hosted.episode.end().unwrap_or(EndReason::ServerFault);
        let run = self.session.run.clone();
        let conclude = |host: Arc<H>| async move { host.conclude(&run, hosted).await };
        let (reason, outcome) = match call_host("conclude", &self.session.host, conclude).await {
            Ok(outcome) => (reason, outcome),
            // An episode without a stored result must not count for the agent.
            Err(failure) => {
                tracing::error!(episode, why = failure.message, "episode not stored");
                (EndReason::ServerFault, None)
            }
        };
        self.count_end(reason);
        self.end_frame(&episode, StoredEnd { reason, steps, outcome })
    }

    fn count_end(&mut self, reason: EndReason) {
        if let Some(span) = self.episode.take() {
            span.end(reason.as_str());
        }
        self.session.progress.ended(reason);
        if let Some(control) = self.session.host.control() {
            control.ended(&self.session.run, self.id, reason);
        }
    }

    fn end_frame(&self, episode: &str, end: StoredEnd) -> v1::EpisodeEnd {
        let progress = Some(self.session.progress.progress());
        v1::EpisodeEnd { progress, ..wire::episode_end(self.id, episode, end) }
    }

    /// Sends a reply to the stream, if one is attached.
    pub(super) async fn deliver(&mut self, subject: FaultSubject<'_>, reply: Result<SlotReply>) {
        let Audience::Stream(out) = &self.audience else { return };
        for frame in frames(subject, reply) {
            let starts_clock = matches!(frame, Frame::EpisodeStart(_) | Frame::Observation(_));
            // A client that does not read is noticed by the stream itself.
            let Ok(departure) = out.send(frame).await else { return };
            if let SlotContent::Playing(playing) = &mut self.state
                && starts_clock
                && !playing.clock.runs()
            {
                playing.clock.sent(departure);
            }
        }
    }

    /// Sends missed frames to a new stream. Returns whether the clock restarted because the last observation was lost.
    pub(super) async fn catch_up(&mut self, known: Option<v1::SlotPosition>, away: Duration) -> bool {
        if !matches!(self.audience, Audience::Stream(_)) {
            return false;
        }
        if matches!(self.state, SlotContent::Playing(_)) {
            return self.catch_up_playing(known.as_ref(), away).await;
        }
        let missed = match (&self.state, &known) {
            (SlotContent::Finished(over), Some(known)) if known.episode == over.end.episode => {
                Ok(over.missed(known))
            }
            (_, Some(known)) => self.earlier_end(known).await,
            (_, None) => return false,
        };
        let known = known.unwrap_or_default();
        let subject = FaultSubject { slot: Some(self.id), episode: &known.episode, step: known.step };
        self.deliver(subject, missed).await;
        false
    }

    async fn catch_up_playing(&mut self, known: Option<&v1::SlotPosition>, away: Duration) -> bool {
        let SlotContent::Playing(playing) = &mut self.state else { return false };
        // The clock of a received observation runs on: the agent could think while it was disconnected.
        let step = playing.last.observation.step;
        let known = known.filter(|known| known.episode == playing.hosted.handle);
        let arrived = known.is_some_and(|known| known.step == step) && playing.clock.runs();
        let frame = match known {
            None => Frame::EpisodeStart(playing.start_frame(self.id, &self.session)),
            Some(_) => Frame::Observation(playing.last.observation.clone()),
        };
        let Audience::Stream(out) = &self.audience else { return false };
        if let Ok(departure) = out.send(frame).await
            && !arrived
        {
            playing.clock.sent(departure);
        }
        let restarted = !arrived && !away.is_zero();
        if restarted && let Err(error) = playing.hosted.log.clock_restarted(step, away) {
            tracing::error!(run = self.session.run, slot = self.id, %error, "a restarted clock was not recorded");
        }
        restarted
    }

    async fn earlier_end(&mut self, known: &v1::SlotPosition) -> Result<SlotReply> {
        let Some(end) = stored_end(&self.session.host, &self.session.run, known).await? else {
            let message = "the episode is not of this run, or will be played again; send Ready";
            return Err(Failure::new(Reason::EpisodeUnknown, message));
        };
        let progress = Some(self.session.progress.progress());
        Ok(SlotReply::Ended(Box::new(v1::EpisodeEnd { progress, ..end })))
    }
}

pub(crate) async fn stored_end<H: Host>(
    host: &Arc<H>,
    run: &str,
    known: &v1::SlotPosition,
) -> Result<Option<v1::EpisodeEnd>> {
    let run = run.to_owned();
    let handle = known.episode.clone();
    let stored =
        call_host("look up an episode", host, |host| async move { host.ended(&run, &handle).await }).await?;
    Ok(stored.map(|end| wire::episode_end(known.slot, &known.episode, end)))
}

fn frames(subject: FaultSubject<'_>, reply: Result<SlotReply>) -> Vec<Frame> {
    match reply {
        Ok(SlotReply::Start(start)) => vec![Frame::EpisodeStart(*start)],
        Ok(SlotReply::NothingLeft | SlotReply::NothingYet) => vec![],
        Ok(SlotReply::Ended(end)) => vec![Frame::EpisodeEnd(*end)],
        Ok(SlotReply::Step(step)) => {
            let observation = step.observation.map(Frame::Observation);
            observation.into_iter().chain(step.episode_end.map(Frame::EpisodeEnd)).collect()
        }
        Err(failure) => vec![Frame::Fault(failure.frame(subject, true))],
    }
}
