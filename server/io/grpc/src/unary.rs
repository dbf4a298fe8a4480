//! The unary mirror: the same session as a stream's, with one slot, found again by the run of the token.

use crate::{
    away::Away,
    door::{Door, Terms},
    gate::{Pass, Stop},
    refusal::{Failure, ServerFault},
    session::{Answer, Order, Over, Session},
};
use avln_episode::EndReason;
use avln_proto::v1::{self, Reason, end_request, end_response, reset_response::Outcome};
use std::{sync::Arc, time::Duration};
use tokio::{
    sync::watch,
    time::{Instant, sleep_until},
};
use tracing::Instrument;

/// The slot that unary calls play.
const SLOT: u32 = 0;

/// Where unary calls find the session of their run.
pub(crate) struct Desk {
    session: Arc<Session>,
    welcome: v1::Welcome,
    last_call: watch::Sender<Instant>,
}

impl Desk {
    async fn ask(&self, door: &Door, order: Order) -> Result<Answer, Failure> {
        self.last_call.send_replace(Instant::now());
        let answer = self.session.ask(SLOT, order).await;
        self.last_call.send_replace(Instant::now());
        // What fails while the server stops fails because it stops.
        answer.map_err(|failure| door.gate.check_open().err().map_or(failure, Failure::from))
    }

    /// Watches over the session until it is over, then puts it away.
    async fn keep(self: Arc<Self>, door: Door, mut pass: Pass) {
        let reason = tokio::select! {
            stop = pass.stopped() => match stop {
                Stop::Superseded => EndReason::Disconnected,
                Stop::Left => EndReason::Abandoned,
                Stop::Expired => EndReason::TimeBudget,
                Stop::Draining => return self.session.leave().await,
                Stop::Resumed => {
                    self.session.detach().await;
                    return pass.hand_over(self.session.clone());
                }
            },
            over = self.session.over() => match over {
                Over::NothingLeft => EndReason::Abandoned,
                Over::AgentHangs => EndReason::TimeBudget,
            },
            () = self.idle(door.limits.unary_idle) => EndReason::Disconnected,
        };
        self.session.close(reason).await;
        if reason == EndReason::TimeBudget
            && let Err(failure) = door.finish_run(&pass.run).await
        {
            tracing::warn!(why = failure.message(), "run not finished");
        }
    }

    /// Waits until no call has come for `limit`.
    async fn idle(&self, limit: Duration) {
        loop {
            let end = *self.last_call.borrow() + limit;
            if end <= Instant::now() {
                return;
            }
            sleep_until(end).await;
        }
    }
}

impl std::fmt::Debug for Desk {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Desk").field("run", &self.welcome.run).finish_non_exhaustive()
    }
}

/// Hello and Ready.
pub(crate) async fn reset(
    door: &Door,
    token: &str,
    request: v1::ResetRequest,
) -> Result<v1::ResetResponse, Failure> {
    door.gate.check_open()?;
    let hello = request.hello.unwrap_or_default();
    let slot = request.ready.unwrap_or_default().slot;
    only_slot(slot)?;
    let open = door.open_run(token).await?;
    let terms = Terms { slots: 1, ..door.terms(&hello, &open)? };
    let desk = match door.gate.desk(token) {
        Some(desk) => desk,
        None => open_desk(door, token, &hello).await?,
    };
    desk.session.check_sensors(&terms.sensors)?;
    let welcome = Some(desk.welcome.clone());
    let order = if hello.resume { Order::GoOn } else { Order::Ready };
    let outcome = match desk.ask(door, order).await? {
        Answer::Start(start) => Outcome::EpisodeStart(*start),
        _ => Outcome::RunEnd(leave(door, &open.run).await?),
    };
    Ok(v1::ResetResponse { welcome, outcome: Some(outcome) })
}

/// Act.
pub(crate) async fn step(
    door: &Door,
    token: &str,
    request: v1::StepRequest,
) -> Result<v1::StepResponse, Failure> {
    let act = request.act.ok_or_else(|| Failure::new(Reason::BadRequest, "Step needs an Act"))?;
    only_slot(act.slot)?;
    match found(door, token).await?.ask(door, Order::Act(act)).await? {
        Answer::Step(response) => Ok(*response),
        other => Err(out_of_turn(&other)),
    }
}

/// Abandon or Goodbye.
pub(crate) async fn end(
    door: &Door,
    token: &str,
    request: v1::EndRequest,
) -> Result<v1::EndResponse, Failure> {
    let frame = match request.frame {
        Some(end_request::Frame::Abandon(abandon)) => {
            only_slot(abandon.slot)?;
            match found(door, token).await?.ask(door, Order::Abandon(abandon)).await? {
                Answer::Ended(end) => end_response::Frame::EpisodeEnd(*end),
                other => return Err(out_of_turn(&other)),
            }
        }
        Some(end_request::Frame::Goodbye(goodbye)) if !goodbye.pause => {
            let open = door.open_run(token).await?;
            end_response::Frame::RunEnd(leave(door, &open.run).await?)
        }
        Some(end_request::Frame::Goodbye(_)) => {
            return Err(Failure::new(Reason::Unsupported, "pause is not offered; say Goodbye without it"));
        }
        None => return Err(Failure::new(Reason::BadRequest, "End needs an Abandon or a Goodbye")),
    };
    Ok(v1::EndResponse { frame: Some(frame) })
}

/// Opens a desk on the run: on its session where `hello` resumes, else on a new one.
async fn open_desk(door: &Door, token: &str, hello: &v1::Hello) -> Result<Arc<Desk>, Failure> {
    let run = door.open_run(token).await?.run;
    let how = if hello.resume { Stop::Resumed } else { Stop::Superseded };
    let (pass, kept) = door.gate.enter(&run, how).await?;
    // A session that was superseded has just stored its episodes: ask again how far the run is.
    let open = door.open_run(token).await?;
    let terms = Terms { slots: 1, ..door.terms(hello, &open)? };
    let session = match kept {
        Some(session) if hello.resume => session,
        Some(session) => {
            session.close(EndReason::Disconnected).await;
            door.session(&open, &terms.sensors)
        }
        None => door.session(&open, &terms.sensors),
    };
    if let Err(refused) = session.check_sensors(&terms.sensors) {
        Away::begin(session, pass).await;
        return Err(refused.into());
    }
    session.answer_calls().await;
    pass.take_slots(&open.team, 1, 1);
    let welcome = door.welcome(&open, &terms, &session, session.positions().await);
    let last_call = watch::Sender::new(Instant::now());
    let desk = Arc::new(Desk { session, welcome, last_call });
    pass.open_desk(token, desk.clone());
    let span = tracing::error_span!("session", run = open.run);
    tokio::spawn(desk.clone().keep(door.clone(), pass).instrument(span));
    Ok(desk)
}

fn only_slot(slot: u32) -> Result<(), Failure> {
    if slot == SLOT {
        return Ok(());
    }
    let message = format!("slot {slot} does not exist: unary calls play slot {SLOT}; use Play for more");
    Err(Failure::new(Reason::SlotUnknown, message))
}

fn out_of_turn(answer: &Answer) -> Failure {
    ServerFault::log("answer a unary call", format!("{answer:?}")).into()
}

/// The session that the token opened. The host is asked only where there is none: its answer says why.
async fn found(door: &Door, token: &str) -> Result<Arc<Desk>, Failure> {
    if let Some(desk) = door.gate.desk(token) {
        return Ok(desk);
    }
    door.gate.check_open()?;
    let run = door.open_run(token).await?.run;
    let message =
        format!("run {run} has no open episode here; begin with Reset, whose Hello says resume to go on");
    Err(Failure::new(Reason::EpisodeUnknown, message))
}

/// Ends the run's session, whatever kind it is, and the run with it.
async fn leave(door: &Door, run: &str) -> Result<v1::RunEnd, Failure> {
    door.gate.stop(run, Stop::Left).await;
    door.finish_run(run).await
}
