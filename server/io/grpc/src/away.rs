//! Sessions that nobody listens to: their connection is lost, or the server has just begun again.

use crate::{
    door::Door,
    gate::{Pass, Stop},
    refusal::{Failure, ask},
    session::Session,
};
use avln_episode::EndReason;
use std::{sync::Arc, time::Duration};
use tokio::time::sleep;
use tracing::Instrument;

/// A session that waits for its agent to come back.
pub(crate) struct Away {
    session: Arc<Session>,
    pass: Pass,
}

impl Away {
    /// Nobody listens to the session any more: it waits in the background, or ends where connections may not be lost.
    pub(crate) async fn begin(session: Arc<Session>, pass: Pass) {
        let patience = session.detach().await;
        if patience.is_zero() {
            tracing::info!("connection lost, and no time to come back is left");
            return session.close(EndReason::Disconnected).await;
        }
        tracing::info!(?patience, "connection lost; open episodes wait");
        tokio::spawn(Self { session, pass }.wait(patience).in_current_span());
    }

    async fn wait(mut self, patience: Duration) {
        let stop = tokio::select! {
            stop = self.pass.stopped() => Some(stop),
            () = sleep(patience) => None,
        };
        match stop {
            Some(Stop::Resumed) => self.pass.hand_over(self.session),
            Some(Stop::Draining) => self.session.leave().await,
            Some(Stop::Expired) => self.session.close(EndReason::TimeBudget).await,
            Some(Stop::Left) => self.session.close(EndReason::Abandoned).await,
            Some(Stop::Superseded) | None => self.session.close(EndReason::Disconnected).await,
        }
    }
}

/// Runs that the server was stopped in, taken before anybody is let in.
pub(crate) async fn take_interrupted(door: &Door) -> Vec<Pass> {
    let host = door.host.clone();
    let runs = match ask("look for interrupted runs", async move { host.interrupted().await }).await {
        Ok(runs) => runs,
        Err(failure) => {
            tracing::error!(why = failure.message(), "interrupted runs are not taken up again");
            return Vec::new();
        }
    };
    let mut passes = Vec::new();
    for run in runs {
        match door.gate.enter(&run, Stop::Resumed).await {
            Ok((pass, _)) => passes.push(pass),
            Err(refused) => tracing::error!(run, %refused, "an interrupted run is not taken up again"),
        }
    }
    passes
}

/// Brings the episodes of a run back to where they were, and waits for its agent.
pub(crate) async fn restore(door: Door, pass: Pass) {
    let span = tracing::error_span!("session", run = pass.run);
    if let Err(failure) = try_restore(&door, pass).instrument(span).await {
        tracing::error!(why = failure.message(), "an interrupted run could not be taken up again");
    }
}

async fn try_restore(door: &Door, pass: Pass) -> Result<(), Failure> {
    let (host, run) = (door.host.clone(), pass.run.clone());
    let interrupted = ask("restore a run", async move { host.restore(&run).await }).await?;
    let episodes = interrupted.episodes.len();
    tracing::info!(episodes, "an interrupted run goes on");
    let over = interrupted.open.over.clone();
    let session = door.session_again(interrupted);
    match over.as_deref() {
        None => Away::begin(session, pass).await,
        Some("expired") => session.close(EndReason::TimeBudget).await,
        Some(_) => session.close(EndReason::Abandoned).await,
    }
    Ok(())
}
