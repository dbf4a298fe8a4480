//! State of the test server, and its streams: frames of the slots, and faults that break them.

use crate::frames;
use crate::scenario::InjectedFault;
use crate::trials::{FAULT_STEP, NONCE, OpenEpisode, Transport, TrialRun};
use avln_proto::v1::{self, play_request::Frame as Up, play_response::Frame as Down};
use std::{sync::Arc, time::Duration};
use tokio::{
    sync::{Mutex, mpsc, watch},
    time::sleep,
};
use tonic::{Status, Streaming};

pub(crate) const OBSERVATION_DELAY: Duration = Duration::from_secs(3);
/// Streams or unary calls refused by an unreachable server.
pub(crate) const REFUSED_CALLS: u32 = 3;

/// The test server's services.
#[derive(Clone)]
pub(crate) struct Fake {
    pub(crate) run: Arc<Mutex<TrialRun>>,
    pub(crate) frame_counter: Arc<watch::Sender<u64>>,
}

impl Fake {
    pub(crate) fn count_frame(&self) {
        self.frame_counter.send_modify(|frames_seen| *frames_seen += 1);
    }

    /// Ends the run.
    pub(crate) fn finish(&self, run: &mut TrialRun) {
        run.finish();
        self.count_frame();
    }

    /// Refuses a call after the end, in a second transport, or to an unreachable server.
    pub(crate) fn admit(&self, run: &mut TrialRun, transport: Transport) -> Result<(), Status> {
        self.count_frame();
        if run.is_done {
            run.violation(None, "the client made another call after the end");
            run.is_disturbed = true;
            self.count_frame();
            let reason = if run.is_over() { v1::Reason::RunOver } else { v1::Reason::Superseded };
            return Err(frames::refusal(reason, None));
        }
        if *run.transport.get_or_insert(transport) != transport {
            run.violation(None, "the client used a stream and unary calls in the same run");
            return Err(frames::refusal(v1::Reason::BadRequest, None));
        }
        if run.refuse > 0 {
            run.refuse -= 1;
            return Err(Status::unavailable("the conformance kit refuses this call"));
        }
        Ok(())
    }
}

/// Delay requested by a draining server, seconds.
const DRAIN_S: u32 = 1;

/// The end of a stream, with a status or without.
struct StreamEnd(Option<Status>);

pub(crate) struct Conversation {
    pub(crate) fake: Fake,
    pub(crate) requests: Streaming<v1::PlayRequest>,
    pub(crate) responses: mpsc::Sender<Result<v1::PlayResponse, Status>>,
}

impl Conversation {
    pub(crate) async fn hold(mut self) {
        if let Err(StreamEnd(Some(status))) = self.converse().await {
            let _ = self.responses.send(Err(status)).await;
        }
    }

    async fn send(&self, frame: Down) {
        let _ = self.responses.send(Ok(v1::PlayResponse { frame: Some(frame) })).await;
    }

    async fn receive(&mut self) -> Result<Up, StreamEnd> {
        let received = self.requests.message().await;
        self.fake.count_frame();
        let request = received.ok().flatten().ok_or(StreamEnd(None))?;
        request.frame.ok_or_else(|| StreamEnd(Some(Status::invalid_argument("the frame has no message"))))
    }

    async fn converse(&mut self) -> Result<(), StreamEnd> {
        let Up::Hello(hello) = self.receive().await? else {
            self.fake.run.lock().await.violation(None, "first frame: expected Hello");
            return Err(StreamEnd(Some(frames::refusal(v1::Reason::BadRequest, None))));
        };
        self.greet(&hello).await?;
        loop {
            match self.receive().await? {
                Up::Ready(ready) => self.ready(ready.slot).await?,
                Up::Act(act) => self.act(&act).await?,
                Up::Pong(pong) => self.fake.run.lock().await.pong(pong.nonce),
                Up::Abandon(abandon) => self.abandon(abandon.slot).await?,
                Up::Goodbye(_) => return self.end_run(&mut *self.fake.run.lock().await).await,
                Up::Hello(_) => {
                    self.fake.run.lock().await.violation(None, "the client sent a second Hello in a stream")
                }
            }
        }
    }

    /// Sends Welcome and the missed frames.
    async fn greet(&self, hello: &v1::Hello) -> Result<(), StreamEnd> {
        let mut run = self.fake.run.lock().await;
        run.hello(hello);
        if run.is_over() {
            return self.report_results(&mut run, hello).await;
        }
        self.send(Down::Welcome(frames::welcome(&run))).await;
        for lost in run.dropped(&hello.known) {
            run.report_loss(lost.slot, &lost.handle);
            let (slot, episode) = (Some(lost.slot), lost.handle);
            let fault = frames::fault(v1::Reason::EpisodeUnknown, true);
            self.send(Down::Fault(v1::Fault { slot, episode, ..fault })).await;
        }
        let open: Vec<OpenEpisode> = run.open.values().cloned().collect();
        for open in &open {
            self.catch_up(&mut run, open).await?;
        }
        Ok(())
    }

    async fn catch_up(&self, run: &mut TrialRun, open: &OpenEpisode) -> Result<(), StreamEnd> {
        match (open.over, open.sent_step) {
            (Some(reason), _) => return self.end_episode(run, open.slot, reason).await,
            (None, Some(_)) => self.send(Down::Observation(frames::observation(run, open))).await,
            (None, None) => self.send(Down::EpisodeStart(frames::start(run, open))).await,
        }
        run.observation_sent(open.slot);
        Ok(())
    }

    /// Reports the end of the run to a client that was disconnected.
    async fn report_results(&self, run: &mut TrialRun, hello: &v1::Hello) -> Result<(), StreamEnd> {
        run.finish();
        self.fake.count_frame();
        if !hello.resume {
            return Err(StreamEnd(Some(frames::refusal(v1::Reason::RunOver, None))));
        }
        for cut in run.cut.values() {
            let is_known = |known: &v1::SlotPosition| known.slot == cut.slot && known.episode == cut.handle;
            if hello.known.iter().any(is_known) {
                let end = frames::end(run, cut, v1::EndReason::Disconnected);
                self.send(Down::EpisodeEnd(end)).await;
            }
        }
        self.send(Down::RunEnd(frames::run_end(run))).await;
        Err(StreamEnd(None))
    }

    async fn ready(&self, slot: u32) -> Result<(), StreamEnd> {
        let mut run = self.fake.run.lock().await;
        if let Err(reason) = run.ready(slot) {
            self.send(Down::Fault(v1::Fault { slot: Some(slot), ..frames::fault(reason, true) })).await;
            return Ok(());
        }
        if !run.has_next(slot) {
            run.wait(slot);
            return self.end_if_complete(&mut run).await;
        }
        run.begin(slot);
        if run.fault(slot) == InjectedFault::LostStart && run.inject_at(slot, 0) {
            return Err(lost(&mut run));
        }
        let Some(open) = run.open.get(&slot).cloned() else { return Ok(()) };
        self.send(Down::EpisodeStart(frames::start(&run, &open))).await;
        run.observation_sent(slot);
        Ok(())
    }

    async fn act(&self, act: &v1::Act) -> Result<(), StreamEnd> {
        let mut run = self.fake.run.lock().await;
        let taken = if run.is_crossing(act) { Err(v1::Reason::EpisodeUnknown) } else { run.act(act) };
        if let Err(reason) = taken {
            self.send(Down::Fault(frames::refused_act(act, reason))).await;
            return Ok(());
        }
        let fault = run.fault(act.slot);
        let is_due = run.inject_at(act.slot, FAULT_STEP);
        if is_due {
            self.before_observation(&mut run, act.slot, fault).await?;
        }
        let Some(open) = run.open.get(&act.slot).cloned() else { return Ok(()) };
        self.send(Down::Observation(frames::observation(&run, &open))).await;
        run.observation_sent(act.slot);
        if is_due {
            self.after_observation(&mut run, act.slot, fault).await?;
        }
        match open.over {
            Some(_) if fault == InjectedFault::LostEnd => Err(lost(&mut run)),
            Some(reason) => self.end_episode(&mut run, act.slot, reason).await,
            None => Ok(()),
        }
    }

    async fn before_observation(
        &self,
        run: &mut TrialRun,
        slot: u32,
        fault: InjectedFault,
    ) -> Result<(), StreamEnd> {
        match fault {
            InjectedFault::NoticeAndPing => {
                let message = "notice of the conformance kit".to_owned();
                self.send(Down::Notice(v1::Notice { message, ..v1::Notice::default() })).await;
                self.send(Down::Ping(v1::Ping { nonce: NONCE, ..v1::Ping::default() })).await;
                run.ping_sent(slot);
            }
            // A newer frame reaches an older client as a message without a frame.
            InjectedFault::UnknownFrame => {
                drop(self.responses.send(Ok(v1::PlayResponse { frame: None })).await)
            }
            InjectedFault::LateObservation => sleep(OBSERVATION_DELAY).await,
            InjectedFault::LostObservation => return Err(lost(run)),
            InjectedFault::SimulatorFault => return self.fail_simulator(run, slot).await,
            _ => {}
        }
        Ok(())
    }

    async fn fail_simulator(&self, run: &mut TrialRun, slot: u32) -> Result<(), StreamEnd> {
        let Some(open) = run.open.get(&slot) else { return Ok(()) };
        let (step, episode) = (open.step(), open.handle.clone());
        let fault = frames::fault(v1::Reason::SimFault, false);
        self.send(Down::Fault(v1::Fault { slot: Some(slot), episode, step, ..fault })).await;
        self.end_episode(run, slot, v1::EndReason::ServerFault).await
    }

    async fn after_observation(
        &self,
        run: &mut TrialRun,
        slot: u32,
        fault: InjectedFault,
    ) -> Result<(), StreamEnd> {
        match fault {
            InjectedFault::Draining => return Err(self.drain(run).await),
            InjectedFault::Superseded => return Err(self.supersede(run, slot).await),
            InjectedFault::SilentEnd => {
                run.lose_stream();
                return Err(StreamEnd(None));
            }
            InjectedFault::BrokenStream => {}
            InjectedFault::Unreachable => run.refuse = REFUSED_CALLS,
            InjectedFault::Reissued => run.drop_episode(slot),
            InjectedFault::EndedAway => run.end_away(slot),
            _ => return Ok(()),
        }
        Err(lost(run))
    }

    async fn drain(&self, run: &mut TrialRun) -> StreamEnd {
        let message = "the server stops now; open episodes continue when it is back".to_owned();
        let kind = v1::NoticeKind::Draining.into();
        self.send(Down::Notice(v1::Notice { kind, message, ..v1::Notice::default() })).await;
        let fault = frames::fault(v1::Reason::Draining, false);
        self.send(Down::Fault(v1::Fault { retry_after_s: Some(DRAIN_S), ..fault })).await;
        run.lose_stream();
        StreamEnd(Some(frames::refusal(v1::Reason::Draining, Some(DRAIN_S))))
    }

    async fn supersede(&self, run: &mut TrialRun, slot: u32) -> StreamEnd {
        self.send(Down::Fault(frames::fault(v1::Reason::Superseded, false))).await;
        run.supersede(slot);
        self.fake.count_frame();
        StreamEnd(Some(frames::refusal(v1::Reason::Superseded, None)))
    }

    async fn abandon(&self, slot: u32) -> Result<(), StreamEnd> {
        let mut run = self.fake.run.lock().await;
        run.violation(Some(slot), "the client abandoned the episode");
        self.end_episode(&mut run, slot, v1::EndReason::Abandoned).await
    }

    async fn end_episode(
        &self,
        run: &mut TrialRun,
        slot: u32,
        reason: v1::EndReason,
    ) -> Result<(), StreamEnd> {
        // Closed first, so that the progress counts the episode.
        let Some(open) = run.close(slot) else { return Ok(()) };
        self.send(Down::EpisodeEnd(frames::end(run, &open, reason))).await;
        self.end_if_complete(run).await
    }

    /// Ends the run if a slot waits for its end and no other plays.
    async fn end_if_complete(&self, run: &mut TrialRun) -> Result<(), StreamEnd> {
        if run.has_waiting() && run.is_complete() { self.end_run(run).await } else { Ok(()) }
    }

    async fn end_run(&self, run: &mut TrialRun) -> Result<(), StreamEnd> {
        self.send(Down::RunEnd(frames::run_end(run))).await;
        run.finish();
        self.fake.count_frame();
        Err(StreamEnd(None))
    }
}

fn lost(run: &mut TrialRun) -> StreamEnd {
    run.lose_stream();
    StreamEnd(Some(Status::unavailable("the conformance kit closed the stream")))
}
