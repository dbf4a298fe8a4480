//! Play stream: one run, several slots, from Hello to Goodbye.

use crate::{
    attachment::{AttachmentEvent, StopReason},
    context::{Admission, RunGuard, ServiceContext},
    control::{Drain, unix_ms},
    host::Host,
    limits::Limits,
    outbound::{Outbound, PingTimer, RunDeadline},
    refusal::{Failure, FaultSubject, Refusal, Result},
    session::{Session, SlotRequest, stored_end},
};
use avln_proto::API_MINOR;
use avln_proto::v1::{self, Reason, play_request, play_response::Frame};
use std::{pin::pin, sync::Arc};
use tokio::time::{Instant, interval_at, timeout};
use tonic::{Status, Streaming};
use tracing::Instrument;

pub(crate) struct PlayStream<H: Host> {
    pub(crate) context: Arc<ServiceContext<H>>,
    pub(crate) token: String,
    pub(crate) inbound: Streaming<v1::PlayRequest>,
    pub(crate) out: Outbound,
}

impl<H: Host> PlayStream<H> {
    /// Runs the stream until either side ends it. Open episodes are stored, kept or handed over before it returns.
    pub(crate) async fn run(mut self) {
        if let Err(failure) = self.play().await {
            self.out.fail(failure).await;
        }
    }

    async fn play(&mut self) -> Result<()> {
        let hello = self.hello().await?;
        match self.context.admit(&self.token, &hello, Limits::MAX_SLOTS).await {
            Ok(admission) => {
                let span = admission.session.span();
                self.attach(admission, &hello.known).instrument(span).await
            }
            Err(over) if hello.resume && over.reason == Reason::RunOver => {
                let run = self.context.any_run(&self.token).await?.run;
                self.report_results(&run, &hello.known).await
            }
            Err(refused) => Err(refused),
        }
    }

    async fn hello(&mut self) -> Result<v1::Hello> {
        let limit = self.context.limits.hello;
        let first = timeout(limit, self.inbound.message()).await.map_err(|_| {
            let message = format!("no Hello within {limit:?} of opening the stream; send it first");
            Failure::new(Reason::TooSlow, message)
        })?;
        match first.map_err(broken)?.and_then(|request| request.frame) {
            Some(play_request::Frame::Hello(hello)) => Ok(hello),
            _ => Err(Failure::new(Reason::BadRequest, "the first frame of a stream must be Hello")),
        }
    }

    async fn attach(&mut self, admission: Admission<H>, known: &[v1::SlotPosition]) -> Result<()> {
        let Admission { open, session, mut guard, welcome } = admission;
        let slots = welcome.slots;
        let end = match self.out.send(Frame::Welcome(welcome)).await {
            Ok(_) => {
                guard.apply(AttachmentEvent::StreamAttached);
                session.attach_stream(&self.out, slots, known).await;
                let deadline = RunDeadline::of(&open, self.context.host.now_unix_ms());
                self.read(&session, &mut guard, deadline).await
            }
            Err(_) => Err(unread()),
        };
        self.finish(session, guard, end).await
    }

    /// Exchanges frames until the attachment ends. A lost connection is an error.
    async fn read(
        &mut self,
        session: &Session<H>,
        guard: &mut RunGuard<H>,
        deadline: RunDeadline,
    ) -> Result<StopReason> {
        let out = self.out.clone();
        tokio::select! {
            // In this order: a stop takes precedence over everything. Also while a frame waits for a client that does not read:
            // otherwise, this client would delay a server stop, a cancellation and the next connection of the run.
            biased;
            reason = guard.stopped() => Ok(reason),
            () = out.gone() => Err(unread()),
            ended = self.exchange(session, deadline) => ended,
        }
    }

    /// Reads frames and passes them to the slots.
    async fn exchange(&mut self, session: &Session<H>, deadline: RunDeadline) -> Result<StopReason> {
        let out = self.out.clone();
        let mut over = pin!(session.over());
        let host = self.context.host.clone();
        let mut drain = pin!(async {
            match host.control() {
                Some(control) => control.drain_begins().await,
                None => std::future::pending().await,
            }
        });
        let mut announced = false;
        let mut warned = false;
        let mut pings = PingTimer::default();
        // Before any observation, so that the round-trip time is known when the first clock starts.
        pings.tick(&out, &deadline).await;
        let every = self.context.limits.ping_interval;
        let mut ticks = interval_at(Instant::now() + every, every);
        loop {
            tokio::select! {
                // In this order: a flood of requests delays neither the end of the run nor notices.
                biased;
                reason = &mut over => return Ok(reason),
                drain = &mut drain, if !announced => {
                    announced = true;
                    let _ = out.send(drain_notice(&drain)).await;
                }
                () = deadline.runs_low(), if !warned => {
                    warned = true;
                    let _ = out.send(Frame::Notice(deadline.notice())).await;
                }
                request = self.inbound.message() => match request {
                    Ok(Some(v1::PlayRequest { frame: Some(play_request::Frame::Pong(pong)) })) => {
                        pings.answered(pong.nonce, &out, self.context.limits.wire);
                    }
                    Ok(Some(request)) => if let Some(reason) = self.receive(session, request).await {
                        return Ok(reason);
                    },
                    Ok(None) => return Err(no_goodbye()),
                    Err(status) => return Err(broken(status)),
                },
                _ = ticks.tick() => pings.tick(&out, &deadline).await,
            }
        }
    }

    /// Handles a frame. Returns a reason if the client ends the stream.
    async fn receive(&self, session: &Session<H>, request: v1::PlayRequest) -> Option<StopReason> {
        use play_request::Frame as Request;
        let (slot, request) = match request.frame {
            Some(Request::Ready(ready)) => (ready.slot, SlotRequest::Ready),
            Some(Request::Act(act)) => (act.slot, SlotRequest::Act(act)),
            Some(Request::Abandon(abandon)) => (abandon.slot, SlotRequest::Abandon(abandon)),
            Some(Request::Pong(_)) => return None,
            Some(Request::Goodbye(goodbye)) if goodbye.pause => return Some(StopReason::Paused),
            Some(Request::Goodbye(_)) => return Some(StopReason::Goodbye),
            Some(Request::Hello(_)) => {
                return self.refuse(Reason::BadRequest, "second Hello; send Ready, Act or Goodbye").await;
            }
            None => return self.refuse(Reason::Unsupported, &unknown_frame()).await,
        };
        if let Err(failure) = session.send(slot, request.clone()) {
            self.fault(&failure, request.subject(slot)).await;
        }
        None
    }

    async fn refuse(&self, reason: Reason, message: &str) -> Option<StopReason> {
        self.fault(&Failure::new(reason, message), FaultSubject::default()).await;
        None
    }

    /// Reports a refused frame; the stream continues. A client that does not read it is noticed by `Outbound::gone`.
    async fn fault(&self, failure: &Failure, subject: FaultSubject<'_>) {
        let _ = self.out.send(Frame::Fault(failure.frame(subject, true))).await;
    }

    /// Ends the attachment and reports the end to the client.
    async fn finish(
        &self,
        session: Arc<Session<H>>,
        guard: RunGuard<H>,
        end: Result<StopReason>,
    ) -> Result<()> {
        let (reason, lost) = match end {
            Ok(reason) => (reason, None),
            Err(lost) => (StopReason::ConnectionLost, Some(lost)),
        };
        let reason = guard.ends(reason);
        if reason.cuts_stream() {
            self.out.cut();
        }
        // Before the episodes end, so that the client learns the reason first.
        let last = match reason {
            StopReason::Expired => {
                let message = "the run's wall time is over: open episodes and the run end";
                Some(notice(v1::NoticeKind::BudgetLow, message, unix_ms()))
            }
            StopReason::Draining => {
                let message = "the server stops now; open episodes continue when it is back";
                // Not DRAINING: no episode may finish any more.
                Some(notice(v1::NoticeKind::Unspecified, message, 0))
            }
            StopReason::AgentHangs => {
                let timeouts = self.context.limits.timeouts_in_a_row;
                let message = format!("{timeouts} episodes in a row ran out of time; the run ends here");
                let failure = Failure::new(Reason::TooSlow, message);
                Some(Frame::Fault(failure.frame(FaultSubject::default(), false)))
            }
            _ => None,
        };
        if let Some(last) = last {
            let _ = self.out.send(last).await;
        }
        let stop_wanted = guard.stop_wanted();
        let cut = async {
            stop_wanted.await;
            // From now on others wait for the end: a client that does not read must not delay it.
            self.out.cut();
            std::future::pending().await
        };
        let run_end = tokio::select! {
            biased;
            ended = self.context.end(session, guard, reason) => ended?,
            () = cut => None,
        };
        if let Some(run_end) = run_end {
            let _ = self.out.send(Frame::RunEnd(run_end)).await;
            return Ok(());
        }
        match (refusal_of(reason), lost) {
            (Some(refusal), _) => {
                let failure = Failure::from(refusal);
                let _ = self.out.send(Frame::Fault(failure.frame(FaultSubject::default(), false))).await;
                Err(failure)
            }
            (None, Some(lost)) => Err(lost),
            (None, None) => Ok(()),
        }
    }

    /// Reports to a client that resumes a finished run how the run and the client's last episodes ended.
    async fn report_results(&self, run: &str, known: &[v1::SlotPosition]) -> Result<()> {
        let run_end = self.context.finish_run(run, false).await?;
        for position in known.iter().take(Limits::MAX_SLOTS as usize) {
            if let Some(end) = stored_end(&self.context.host, run, position).await? {
                let end = v1::EpisodeEnd { progress: run_end.progress, ..end };
                let _ = self.out.send(Frame::EpisodeEnd(end)).await;
            }
        }
        let _ = self.out.send(Frame::RunEnd(run_end)).await;
        Ok(())
    }
}

/// Returns the refusal after a stop by another party.
fn refusal_of(reason: StopReason) -> Option<Refusal> {
    match reason {
        StopReason::Superseded => {
            let message = "another stream took this run over; open episodes were ended and stored";
            Some(Refusal::new(Reason::Superseded, message))
        }
        StopReason::Resumed => {
            let message = "another stream resumed this run; two cannot play it at once";
            Some(Refusal::new(Reason::Superseded, message))
        }
        StopReason::Cancelled => Some(Refusal::new(Reason::RunOver, "the run was ended by its own team")),
        StopReason::Draining => {
            let message =
                "the server stops; connect again with resume when it is back, and open episodes continue";
            Some(Refusal::new(Reason::Draining, message).retry_after(5))
        }
        _ => None,
    }
}

fn notice(kind: v1::NoticeKind, message: impl Into<String>, effective_unix_ms: i64) -> Frame {
    Frame::Notice(v1::Notice { kind: kind.into(), message: message.into(), effective_unix_ms })
}

fn drain_notice(drain: &Drain) -> Frame {
    let message =
        format!("the server is about to stop ({}); finish open episodes, no others begin", drain.reason);
    let remaining = drain.until.saturating_duration_since(Instant::now());
    let cut_unix_ms = unix_ms() + i64::try_from(remaining.as_millis()).unwrap_or(i64::MAX / 2);
    notice(v1::NoticeKind::Draining, message, cut_unix_ms)
}

fn unknown_frame() -> String {
    format!(
        "the frame is empty or of a newer avln.v1; this server knows minor {API_MINOR}: Hello, Ready, Act, Abandon, Pong, Goodbye"
    )
}

fn unread() -> Failure {
    Failure::new(Reason::TooSlow, "a frame was left unread for too long; read the stream while thinking")
}

fn no_goodbye() -> Failure {
    let message = "the stream ended without Goodbye: open episodes wait for a Hello with resume, for a while";
    Failure::new(Reason::BadRequest, message)
}

fn broken(status: Status) -> Failure {
    // Safe to repeat: transport and decoder describe the received bytes, never the server.
    Failure::new(Reason::BadRequest, format!("the stream broke: {}", Limits::shorten(status.message())))
}
