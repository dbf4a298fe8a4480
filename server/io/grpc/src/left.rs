//! Runs that their teams left by another door than the agents': nobody plays them any more.

use crate::{door::Door, gate::Stop};

/// Ends the sessions of such runs, for ever.
pub(crate) async fn watch(door: Door) {
    let Some(control) = door.host.control().cloned() else { return std::future::pending().await };
    loop {
        for run in control.left().await {
            let gate = door.gate.clone();
            // A session may take a while to put its episodes away.
            tokio::spawn(async move { gate.stop(&run, Stop::Left).await });
        }
    }
}
