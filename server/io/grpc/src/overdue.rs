//! Runs whose time is over: they end whoever plays them, and whether anybody does.

use crate::{
    door::Door,
    gate::Stop,
    refusal::{Failure, ask},
};
use tokio::time::{MissedTickBehavior, interval};
use tracing::Instrument;

/// Ends runs when their time is over, for ever.
pub(crate) async fn watch(door: Door) {
    let mut ticks = interval(door.limits.overdue_interval);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        let host = door.host.clone();
        match ask("look for runs whose time is over", async move { host.overdue().await }).await {
            Ok(runs) => end_all(&door, runs).await,
            Err(failure) => {
                tracing::error!(why = failure.message(), "runs whose time is over were not looked for")
            }
        }
    }
}

async fn end_all(door: &Door, runs: Vec<String>) {
    for run in runs {
        let span = tracing::error_span!("session", run);
        match expire(door, &run).instrument(span.clone()).await {
            // Its session may take a while to put its episodes away.
            Ok(()) => drop(tokio::spawn(stop(door.clone(), run).instrument(span))),
            Err(failure) => {
                let _entered = span.enter();
                tracing::error!(why = failure.message(), "a run whose time is over was not ended");
            }
        }
    }
}

/// First the store knows that the run is over, so that nothing begins in it any more.
async fn expire(door: &Door, run: &str) -> Result<(), Failure> {
    let (host, run) = (door.host.clone(), run.to_owned());
    ask("end a run whose time is over", async move { host.expire_run(&run).await }).await
}

async fn stop(door: Door, run: String) {
    door.gate.stop(&run, Stop::Expired).await;
    tracing::info!("the run's wall time is over");
}
