//! Session reaper: endings, detached sessions, cancelled and expired runs, and runs interrupted by a server restart.

use crate::{
    attachment::{AttachmentEvent, Ending, StopReason},
    context::ServiceContext,
    host::Host,
    refusal::{Failure, call_host},
    registry::SessionGuard,
    session::Session,
};
use avln_challenge::RunState;
use avln_episode::EndReason;
use avln_proto::v1;
use std::sync::Arc;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, sleep_until};
use tracing::Instrument;

/// Ends an attachment. Returns the run's end if the run ends as well.
pub(crate) async fn end<H: Host>(
    context: &ServiceContext<H>,
    session: Arc<Session<H>>,
    guard: SessionGuard<Session<H>>,
    reason: StopReason,
) -> Result<Option<v1::RunEnd>, Failure> {
    match reason.ending() {
        Ending::Close(end) => session.close(end).await,
        Ending::KeepForRestart => session.leave().await,
        Ending::Detach => {
            detach(context, session, guard).await;
            return Ok(None);
        }
        Ending::HandOver => {
            hand_over(context, session, guard).await;
            return Ok(None);
        }
    }
    if !reason.finishes_run() {
        return Ok(None);
    }
    // With the guard alive: a connection that waits for the run enters after the end and learns that the run is over.
    context.finish_run(&guard.run).await.map(Some)
}

/// Lets a session wait for the client, or closes it if the run allows no time to reconnect.
async fn detach<H: Host>(
    context: &ServiceContext<H>,
    session: Arc<Session<H>>,
    guard: SessionGuard<Session<H>>,
) {
    let patience = session.detach().await;
    if patience.is_zero() {
        tracing::info!("connection lost; the run has no time left to reconnect");
        return session.close(EndReason::Disconnected).await;
    }
    tracing::info!(?patience, "connection lost; open episodes wait");
    spawn_wait(context.clone(), session, guard, Instant::now() + patience);
}

// Not async: the future of `wait` contains that of `end`, and with it this call.
fn spawn_wait<H: Host>(
    context: ServiceContext<H>,
    session: Arc<Session<H>>,
    guard: SessionGuard<Session<H>>,
    until: Instant,
) {
    guard.apply(AttachmentEvent::Detached { until });
    tokio::spawn(wait(context, session, guard, until).in_current_span());
}

async fn wait<H: Host>(
    context: ServiceContext<H>,
    session: Arc<Session<H>>,
    mut guard: SessionGuard<Session<H>>,
    until: Instant,
) {
    let reason = tokio::select! {
        // First: a client that resumes in the last moment gets the session.
        biased;
        reason = guard.stopped() => reason,
        () = sleep_until(until) => guard.ends(StopReason::AwayTooLong),
    };
    if let Err(failure) = end(&context, session, guard, reason).await {
        tracing::warn!(why = failure.message(), "run not finished");
    }
}

/// Passes a session to the connection that stopped it.
async fn hand_over<H: Host>(
    context: &ServiceContext<H>,
    session: Arc<Session<H>>,
    guard: SessionGuard<Session<H>>,
) {
    session.detach().await;
    let registry = context.registry.clone();
    let patience = context.limits.handover;
    let run = guard.run.clone();
    let number = guard.hand_over(session);
    tokio::spawn(async move {
        // That connection may have given up meanwhile. Without this task, the session would stay open for ever.
        sleep(patience).await;
        if let Some(session) = registry.take_unclaimed(&run, number) {
            session.close(EndReason::Disconnected).await;
        }
    });
}

/// Claims runs interrupted by a server restart, before any client is admitted.
pub(crate) async fn claim_interrupted<H: Host>(context: &ServiceContext<H>) -> Vec<SessionGuard<Session<H>>> {
    let host = context.host.clone();
    let runs = match call_host("look for interrupted runs", async move { host.interrupted().await }).await {
        Ok(runs) => runs,
        Err(failure) => {
            tracing::error!(why = failure.message(), "interrupted runs are not restored");
            return Vec::new();
        }
    };
    let mut guards = Vec::new();
    for run in runs {
        match context.registry.enter(&run, StopReason::Resumed).await {
            Ok((guard, _)) => guards.push(guard),
            Err(refused) => tracing::error!(run, %refused, "an interrupted run is not restored"),
        }
    }
    guards
}

/// Restores an interrupted run and waits for the client.
pub(crate) async fn restore<H: Host>(context: ServiceContext<H>, guard: SessionGuard<Session<H>>) {
    let span = tracing::error_span!("session", run = guard.run);
    if let Err(failure) = try_restore(&context, guard).instrument(span).await {
        tracing::error!(why = failure.message(), "an interrupted run could not be restored");
    }
}

async fn try_restore<H: Host>(
    context: &ServiceContext<H>,
    guard: SessionGuard<Session<H>>,
) -> Result<(), Failure> {
    let host = context.host.clone();
    let run = guard.run.clone();
    let interrupted = call_host("restore a run", async move { host.restore(&run).await }).await?;
    let episodes = interrupted.episodes.len();
    tracing::info!(episodes, "an interrupted run continues");
    // The run may have ended while the server was down.
    let reason = match interrupted.open.over {
        None => StopReason::ConnectionLost,
        Some(RunState::Expired) => StopReason::Expired,
        Some(_) => StopReason::Cancelled,
    };
    let session = context.session(interrupted);
    end(context, session, guard, reason).await.map(drop)
}

/// Ends sessions after a cancellation outside gRPC, on the web page or the command line. Never returns.
pub(crate) async fn end_cancelled_runs<H: Host>(context: ServiceContext<H>) {
    let Some(control) = context.host.control().cloned() else { return std::future::pending().await };
    loop {
        for run in control.cancelled_runs().await {
            let registry = context.registry.clone();
            // A task per run, because a session may need long to store its episodes.
            tokio::spawn(async move { registry.stop(&run, StopReason::Cancelled).await });
        }
    }
}

/// Ends expired runs, connected or not. Never returns.
pub(crate) async fn end_expired_runs<H: Host>(context: ServiceContext<H>) {
    let mut ticks = interval(context.limits.overdue_interval);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        let host = context.host.clone();
        let runs = match call_host("look for expired runs", async move { host.overdue().await }).await {
            Ok(runs) => runs,
            Err(failure) => {
                tracing::error!(why = failure.message(), "cannot look for expired runs");
                continue;
            }
        };
        for run in runs {
            let span = tracing::error_span!("session", run);
            expire(&context, run).instrument(span).await;
        }
    }
}

async fn expire<H: Host>(context: &ServiceContext<H>, run: String) {
    let host = context.host.clone();
    let id = run.clone();
    // The host first: from then on no episode begins in the run, so none can start while the session ends.
    if let Err(failure) = call_host("end an expired run", async move { host.expire_run(&id).await }).await {
        tracing::error!(why = failure.message(), "an expired run was not ended");
        return;
    }
    let registry = context.registry.clone();
    let stop = async move {
        registry.stop(&run, StopReason::Expired).await;
        tracing::info!("the run's wall time has passed");
    };
    tokio::spawn(stop.in_current_span());
}
