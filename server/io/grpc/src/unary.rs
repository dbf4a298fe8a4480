//! Unary calls: a session with a single slot, found by the run token.

use crate::{
    attachment::StopReason,
    context::ServiceContext,
    host::Host,
    lifecycle::{self, admit, check},
    refusal::{Failure, ServerFault},
    registry::{SessionGuard, UnaryClient},
    session::{Session, SlotReply, SlotRequest},
};
use avln_proto::v1::{self, Reason, end_request, end_response, reset_response::Outcome};
use std::{sync::Arc, time::Duration};
use tokio::{
    sync::watch,
    time::{Instant, sleep_until},
};
use tracing::Instrument;

/// Slot that unary calls play.
const SLOT: u32 = 0;

/// Handles Reset: Hello and Ready in a single call.
pub(crate) async fn reset<H: Host>(
    context: &ServiceContext<H>,
    token: &str,
    request: v1::ResetRequest,
) -> Result<v1::ResetResponse, Failure> {
    context.registry.check_open()?;
    let hello = request.hello.unwrap_or_default();
    check_slot(request.ready.unwrap_or_default().slot)?;
    let client = match context.registry.unary_client(token) {
        Some(client) => {
            let (_, agreement) = check(context, token, &hello).await?;
            client.session.check_sensors(&agreement.sensors)?;
            client
        }
        None => open(context, token, &hello).await?,
    };
    let request = if hello.resume { SlotRequest::Resume } else { SlotRequest::Ready };
    let outcome = match send(context, &client, request).await? {
        SlotReply::Start(start) => Outcome::EpisodeStart(*start),
        _ => Outcome::RunEnd(leave(context, &client.welcome.run).await?),
    };
    Ok(v1::ResetResponse { welcome: Some(client.welcome.clone()), outcome: Some(outcome) })
}

/// Handles Step.
pub(crate) async fn step<H: Host>(
    context: &ServiceContext<H>,
    token: &str,
    request: v1::StepRequest,
) -> Result<v1::StepResponse, Failure> {
    let act = request.act.ok_or_else(|| Failure::new(Reason::BadRequest, "Step needs an Act"))?;
    check_slot(act.slot)?;
    let client = find(context, token).await?;
    match send(context, &client, SlotRequest::Act(act)).await? {
        SlotReply::Step(response) => Ok(*response),
        other => Err(unexpected(&other)),
    }
}

/// Handles End: Abandon or Goodbye.
pub(crate) async fn end<H: Host>(
    context: &ServiceContext<H>,
    token: &str,
    request: v1::EndRequest,
) -> Result<v1::EndResponse, Failure> {
    let frame = match request.frame {
        Some(end_request::Frame::Abandon(abandon)) => {
            check_slot(abandon.slot)?;
            let client = find(context, token).await?;
            match send(context, &client, SlotRequest::Abandon(abandon)).await? {
                SlotReply::Ended(end) => end_response::Frame::EpisodeEnd(*end),
                other => return Err(unexpected(&other)),
            }
        }
        Some(end_request::Frame::Goodbye(goodbye)) if !goodbye.pause => {
            let open = context.open_run(token).await?;
            end_response::Frame::RunEnd(leave(context, &open.run).await?)
        }
        Some(end_request::Frame::Goodbye(_)) => {
            return Err(Failure::new(
                Reason::Unsupported,
                "unary calls do not support pause; send Goodbye without it",
            ));
        }
        None => return Err(Failure::new(Reason::BadRequest, "End needs an Abandon or a Goodbye")),
    };
    Ok(v1::EndResponse { frame: Some(frame) })
}

/// Opens or resumes a session for unary calls.
async fn open<H: Host>(
    context: &ServiceContext<H>,
    token: &str,
    hello: &v1::Hello,
) -> Result<Arc<UnaryClient<Session<H>>>, Failure> {
    let admission = admit(context, token, hello, 1).await?;
    let session = admission.session;
    session.attach_unary().await;
    let last_call = watch::Sender::new(Instant::now());
    let client = Arc::new(UnaryClient { session, welcome: admission.welcome, last_call });
    admission.guard.attach_unary(token, client.clone());
    let span = tracing::error_span!("session", run = admission.open.run);
    tokio::spawn(supervise(context.clone(), client.clone(), admission.guard).instrument(span));
    Ok(client)
}

/// Waits for a session's end and carries it out.
async fn supervise<H: Host>(
    context: ServiceContext<H>,
    client: Arc<UnaryClient<Session<H>>>,
    mut guard: SessionGuard<Session<H>>,
) {
    let reason = tokio::select! {
        biased;
        reason = guard.stopped() => reason,
        reason = client.session.over() => reason,
        () = idle(&client, context.limits.unary_idle) => StopReason::Idle,
    };
    let reason = guard.ends(reason);
    if let Err(failure) = lifecycle::end(&context, client.session.clone(), guard, reason).await {
        tracing::warn!(why = failure.message(), "run not finished");
    }
}

/// Waits until no call has come for `limit`.
async fn idle<H: Host>(client: &UnaryClient<Session<H>>, limit: Duration) {
    loop {
        let end = *client.last_call.borrow() + limit;
        if end <= Instant::now() {
            return;
        }
        sleep_until(end).await;
    }
}

/// Sends a request to the slot and waits for the reply.
async fn send<H: Host>(
    context: &ServiceContext<H>,
    client: &UnaryClient<Session<H>>,
    request: SlotRequest,
) -> Result<SlotReply, Failure> {
    // Before and after, so that a long step does not count as idle time.
    client.last_call.send_replace(Instant::now());
    let reply = client.session.call(SLOT, request).await;
    client.last_call.send_replace(Instant::now());
    // After a server stop, the caller must learn of the stop and not of the session's end.
    reply.map_err(|failure| context.registry.check_open().err().map_or(failure, Failure::from))
}

fn check_slot(slot: u32) -> Result<(), Failure> {
    if slot == SLOT {
        return Ok(());
    }
    let message = format!("slot {slot} does not exist: unary calls play slot {SLOT}; use Play for more");
    Err(Failure::new(Reason::SlotUnknown, message))
}

fn unexpected(reply: &SlotReply) -> Failure {
    ServerFault::log("answer a unary call", format!("{reply:?}")).into()
}

/// Returns the token's client.
async fn find<H: Host>(
    context: &ServiceContext<H>,
    token: &str,
) -> Result<Arc<UnaryClient<Session<H>>>, Failure> {
    if let Some(client) = context.registry.unary_client(token) {
        return Ok(client);
    }
    context.registry.check_open()?;
    // The host is asked only for the reason: a bad token or a finished run is a better answer than a missing episode.
    let run = context.open_run(token).await?.run;
    let message =
        format!("run {run} has no open episode here; call Reset first, with resume in its Hello to continue");
    Err(Failure::new(Reason::EpisodeUnknown, message))
}

/// Ends the run's session and then the run.
async fn leave<H: Host>(context: &ServiceContext<H>, run: &str) -> Result<v1::RunEnd, Failure> {
    context.registry.stop(run, StopReason::Cancelled).await;
    context.finish_run(run).await
}
