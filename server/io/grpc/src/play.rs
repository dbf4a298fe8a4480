//! The stream: one run, many slots, from Hello to Goodbye.

use crate::{
    away::Away,
    control::{Control, Drain},
    door::{Door, Terms},
    gate::{Pass, Stop},
    host::OpenRun,
    limits::Limits,
    outbound::Outbound,
    pulse::{Pulse, Remaining},
    refusal::{About, Failure, Refusal},
    session::{Order, Over, Session},
    wire,
};
use avln_episode::EndReason;
use avln_proto::v1::{self, Reason, play_request, play_response::Frame};
use std::sync::Arc;
use tokio::time::{Instant, interval_at, timeout};
use tonic::{Status, Streaming};
use tracing::Instrument;

/// Why the reading of a stream stopped.
enum Ending {
    /// The agent is no longer there, or no longer makes sense.
    Lost(Failure),
    Goodbye,
    /// The agent will be back.
    Pause,
    Over(Over),
    Stopped(Stop),
}

/// One Play stream.
pub(crate) struct Stage {
    pub(crate) door: Door,
    pub(crate) token: String,
    pub(crate) inbound: Streaming<v1::PlayRequest>,
    pub(crate) out: Outbound,
}

impl Stage {
    /// Plays the run until one side ends it. Every way out puts the open episodes away first.
    pub(crate) async fn run(mut self) {
        if let Err(failure) = self.play().await {
            self.out.fail(failure).await;
        }
    }

    async fn play(&mut self) -> Result<(), Failure> {
        let hello = self.hello().await?;
        let open = match self.admit(&hello).await {
            Ok((open, _)) => open,
            Err(why) => return self.turn_away(&hello, why).await,
        };
        let how = if hello.resume { Stop::Resumed } else { Stop::Superseded };
        let (pass, kept) = self.door.gate.enter(&open.run, how).await?;
        match (self.admit(&hello).await, kept) {
            (Err(why), kept) => {
                if let Some(session) = kept {
                    Away::begin(session, pass).await;
                }
                self.turn_away(&hello, why).await
            }
            (Ok((open, terms)), Some(session)) if hello.resume => {
                if let Err(refused) = session.check_sensors(&terms.sensors) {
                    Away::begin(session, pass).await;
                    return Err(refused.into());
                }
                self.perform(&open, &terms, session, pass, &hello.known).await
            }
            (Ok((open, terms)), kept) => {
                if let Some(session) = kept {
                    // It was on its way to somebody who resumes, whom this stream came before.
                    session.close(EndReason::Disconnected).await;
                }
                let session = self.door.session(&open, &terms.sensors);
                self.perform(&open, &terms, session, pass, &hello.known).await
            }
        }
    }

    /// How far the run is, now that whoever played it has stored its episodes, and what the agent is granted.
    async fn admit(&self, hello: &v1::Hello) -> Result<(OpenRun, Terms), Failure> {
        let open = self.door.open_run(&self.token).await?;
        let terms = self.door.terms(hello, &open)?;
        Ok((open, terms))
    }

    /// Somebody who comes back to a run that is over is told how it ended; anybody else is refused.
    async fn turn_away(&self, hello: &v1::Hello, why: Failure) -> Result<(), Failure> {
        if !hello.resume || why.reason() != Reason::RunOver {
            return Err(why);
        }
        let run = self.door.any_run(&self.token).await?.run;
        self.farewell(&run, &hello.known).await
    }

    /// Plays the session until the stream ends.
    async fn perform(
        &mut self,
        open: &OpenRun,
        terms: &Terms,
        session: Arc<Session>,
        mut pass: Pass,
        known: &[v1::SlotPosition],
    ) -> Result<(), Failure> {
        let span = tracing::error_span!("session", run = open.run);
        async {
            let resumed = session.positions().await;
            let held = resumed.iter().map(|held| held.slot + 1).max().unwrap_or(0).min(terms.slots);
            let slots = pass.take_slots(&open.team, terms.slots, held);
            let welcome = self.door.welcome(open, &Terms { slots, ..terms.clone() }, &session, resumed);
            let ending = match self.out.send(Frame::Welcome(welcome)).await {
                Ok(_) => {
                    session.attach(&self.out, slots, known).await;
                    self.conduct(&session, &mut pass, Remaining::of(open)).await
                }
                Err(_) => Ending::Lost(gone()),
            };
            self.finish(session, pass, ending).await
        }
        .instrument(span)
        .await
    }

    async fn hello(&mut self) -> Result<v1::Hello, Failure> {
        let limit = self.door.limits.hello;
        let first = timeout(limit, self.inbound.message()).await.map_err(|_| {
            let message = format!("no Hello within {limit:?} of opening the stream; send it first");
            Failure::new(Reason::TooSlow, message)
        })?;
        match first.map_err(broken)?.and_then(|request| request.frame) {
            Some(play_request::Frame::Hello(hello)) => Ok(hello),
            _ => Err(Failure::new(Reason::BadRequest, "the first frame of a stream must be Hello")),
        }
    }

    /// Reads frames and hands them to the slots.
    async fn conduct(&mut self, session: &Session, pass: &mut Pass, left: Remaining) -> Ending {
        let out = self.out.clone();
        let mut gone_away = std::pin::pin!(out.gone());
        let mut over = std::pin::pin!(session.over());
        let host = self.door.host.clone();
        let mut drain = std::pin::pin!(drain_begins(host.control()));
        let (mut told, mut warned) = (false, false);
        let mut pulse = Pulse::default();
        // Before any observation, so that the wire is known before the first clock runs.
        pulse.beat(&out, &left).await;
        let every = self.door.limits.ping_interval;
        let mut pings = interval_at(Instant::now() + every, every);
        loop {
            tokio::select! {
                biased;
                stop = pass.stopped() => return Ending::Stopped(stop),
                () = &mut gone_away => return Ending::Lost(gone()),
                over = &mut over => return Ending::Over(over),
                drain = &mut drain, if !told => {
                    told = true;
                    let _ = out.send(Frame::Notice(ending_notice(&drain))).await;
                }
                () = left.runs_low(), if !warned => {
                    warned = true;
                    let _ = out.send(Frame::Notice(left.notice())).await;
                }
                request = self.inbound.message() => match request {
                    Ok(Some(v1::PlayRequest { frame: Some(play_request::Frame::Pong(pong)) })) => {
                        pulse.answered(pong.nonce, &out, self.door.limits.wire);
                    }
                    Ok(Some(request)) => if let Some(ending) = self.receive(session, request).await {
                        return ending;
                    },
                    Ok(None) => return Ending::Lost(no_goodbye()),
                    Err(status) => return Ending::Lost(broken(status)),
                },
                _ = pings.tick() => pulse.beat(&out, &left).await,
            }
        }
    }

    async fn receive(&self, session: &Session, request: v1::PlayRequest) -> Option<Ending> {
        use play_request::Frame as Request;
        let (slot, order) = match request.frame {
            Some(Request::Ready(ready)) => (ready.slot, Order::Ready),
            Some(Request::Act(act)) => (act.slot, Order::Act(act)),
            Some(Request::Abandon(abandon)) => (abandon.slot, Order::Abandon(abandon)),
            Some(Request::Pong(_)) => return None,
            Some(Request::Goodbye(goodbye)) if !goodbye.pause => return Some(Ending::Goodbye),
            Some(Request::Goodbye(_)) => return Some(Ending::Pause),
            Some(Request::Hello(_)) => {
                return self
                    .refuse(Reason::BadRequest, "Hello was said already; send Ready, Act or Goodbye")
                    .await;
            }
            None => return self.refuse(Reason::Unsupported, "the frame is empty or not known here").await,
        };
        if let Err(failure) = session.order(slot, order.clone()) {
            self.fault(&failure, order.about(slot)).await;
        }
        None
    }

    async fn refuse(&self, reason: Reason, message: &str) -> Option<Ending> {
        self.fault(&Failure::new(reason, message), About::default()).await;
        None
    }

    /// Tells of a refused frame; the stream goes on. One that cannot be told is noticed as gone.
    async fn fault(&self, failure: &Failure, about: About<'_>) {
        let _ = self.out.send(Frame::Fault(failure.frame(about, true))).await;
    }

    /// Puts open episodes away or keeps them for a while, then says how the stream ends.
    async fn finish(&self, session: Arc<Session>, pass: Pass, ending: Ending) -> Result<(), Failure> {
        match ending {
            Ending::Lost(why) => {
                self.out.cut();
                Away::begin(session, pass).await;
                Err(why)
            }
            Ending::Pause => {
                Away::begin(session, pass).await;
                Ok(())
            }
            Ending::Goodbye | Ending::Over(Over::NothingLeft) => {
                session.close(EndReason::Abandoned).await;
                self.run_end(&pass.run).await
            }
            Ending::Over(Over::AgentHangs) => {
                let failure = hangs(&self.door.limits);
                let frame = Frame::Fault(failure.frame(About::default(), false));
                let _ = self.out.send(frame).await;
                session.close(EndReason::TimeBudget).await;
                self.run_end(&pass.run).await
            }
            Ending::Stopped(stop) => self.stopped(session, pass, stop).await,
        }
    }

    /// Tells somebody who comes back to a run that is over how it ended, and the episodes that he still holds.
    async fn farewell(&self, run: &str, known: &[v1::SlotPosition]) -> Result<(), Failure> {
        for position in known.iter().take(Limits::MAX_SLOTS as usize) {
            if let Some(end) = self.door.stored_end(run, position).await? {
                let _ = self.out.send(Frame::EpisodeEnd(end)).await;
            }
        }
        self.run_end(run).await
    }

    async fn run_end(&self, run: &str) -> Result<(), Failure> {
        let run_end = self.door.finish_run(run).await?;
        let _ = self.out.send(Frame::RunEnd(run_end)).await;
        Ok(())
    }

    async fn stopped(&self, session: Arc<Session>, pass: Pass, stop: Stop) -> Result<(), Failure> {
        self.out.cut();
        let why = match stop {
            Stop::Superseded => {
                session.close(EndReason::Disconnected).await;
                let message = "another stream took this run over; open episodes were put away";
                Refusal::new(Reason::Superseded, message)
            }
            Stop::Resumed => {
                session.detach().await;
                pass.hand_over(session);
                let message = "another stream goes on with this run; two cannot play it at once";
                Refusal::new(Reason::Superseded, message)
            }
            Stop::Expired => {
                let _ = self.out.send(Frame::Notice(expired_notice())).await;
                session.close(EndReason::TimeBudget).await;
                return self.run_end(&pass.run).await;
            }
            Stop::Left => {
                session.close(EndReason::Abandoned).await;
                Refusal::new(Reason::RunOver, "the run was ended by its own team")
            }
            Stop::Draining => {
                let _ = self.out.send(Frame::Notice(draining_notice())).await;
                session.leave().await;
                let message =
                    "the server stops; connect again with resume when it is back, and open episodes go on";
                Refusal::new(Reason::Draining, message).retry_after(5)
            }
        };
        let failure = Failure::from(why);
        let _ = self.out.send(Frame::Fault(failure.frame(About::default(), false))).await;
        Err(failure)
    }
}

/// What ends a run whose agent does not answer any more.
pub(crate) fn hangs(limits: &Limits) -> Failure {
    let message =
        format!("{} episodes in a row ran out of time; the run ends here", limits.timeouts_in_a_row);
    Failure::new(Reason::TooSlow, message)
}

async fn drain_begins(control: Option<&Control>) -> Drain {
    match control {
        Some(control) => control.drain_begins().await,
        None => std::future::pending().await,
    }
}

/// Tells that nothing new begins, and when what is open is cut.
fn ending_notice(drain: &Drain) -> v1::Notice {
    let left = drain.until.saturating_duration_since(Instant::now());
    v1::Notice {
        kind: v1::NoticeKind::Draining.into(),
        message: format!(
            "the server is about to stop ({}); finish open episodes, no others begin",
            drain.reason
        ),
        effective_unix_ms: wire::unix_ms() + i64::try_from(left.as_millis()).unwrap_or(i64::MAX / 2),
    }
}

fn expired_notice() -> v1::Notice {
    v1::Notice {
        kind: v1::NoticeKind::BudgetLow.into(),
        message: "the run's wall time is over: open episodes end, and the run with them".to_owned(),
        effective_unix_ms: wire::unix_ms(),
    }
}

fn draining_notice() -> v1::Notice {
    v1::Notice {
        kind: v1::NoticeKind::Draining.into(),
        message: "the server stops now; open episodes go on when it is back".to_owned(),
        effective_unix_ms: 0,
    }
}

fn gone() -> Failure {
    Failure::new(Reason::TooSlow, "a frame was left unread for too long; read the stream while thinking")
}

fn no_goodbye() -> Failure {
    let message = "the stream ended without Goodbye: open episodes wait for a Hello with resume, for a while";
    Failure::new(Reason::BadRequest, message)
}

/// The transport or the decoder refused what came; its words are about the bytes, not about the server.
fn broken(status: Status) -> Failure {
    Failure::new(Reason::BadRequest, format!("the stream broke: {}", Limits::shorten(status.message())))
}
