//! Sealed runs, started by the organiser.

use crate::{
    Failure,
    data::DataFolder,
    ids, now_unix_ms,
    phases::{PhaseCatalog, find_phase},
};
use avln_challenge::MethodInfo;
use avln_episode::Order;
use avln_store::{NewRun, Run, Store};

/// A run id and a token.
#[derive(Clone, Debug)]
pub struct IssuedRun {
    /// Run id.
    pub run: String,
    /// Token for this run only.
    pub token: String,
}

impl IssuedRun {
    pub(crate) fn random() -> Result<Self, getrandom::Error> {
        Ok(Self { run: format!("run_{}", ids::random_hex()?), token: ids::new_token("run")? })
    }
}

/// The organiser's request for a sealed run.
#[derive(Clone, Copy, Debug)]
pub struct SealedRunRequest<'a> {
    /// Phase id.
    pub phase: &'a str,
    /// Team.
    pub team: &'a str,
    /// Method name on leaderboards.
    pub method: &'a str,
    /// Method version; may be empty.
    pub version: &'a str,
    /// Goal order.
    pub order: Order,
}

/// Starts a run and records the enforced and the missing restrictions; `missing` may be empty.
pub async fn start_sealed_run(
    data: &DataFolder,
    store: &Store,
    request: &SealedRunRequest<'_>,
    enforced: String,
    missing: String,
) -> Result<IssuedRun, Failure> {
    let phases = PhaseCatalog::open(data, store, Some(request.phase)).await?.now(store).await?;
    let Some(phase) = find_phase(&phases, request.phase) else {
        let known = store.phases().await?;
        return Err(unknown(request.phase, known.iter().map(|phase| phase.id.as_str()).collect()));
    };
    let mut digests = phase.digests();
    digests.insert(Run::SEALED.to_owned(), enforced);
    if !missing.is_empty() {
        digests.insert(Run::UNSEALED.to_owned(), missing);
    }
    let issued = IssuedRun::random().map_err(Failure::internal)?;
    let new = NewRun {
        id: &issued.run,
        token: &issued.token,
        phase: request.phase,
        team: request.team,
        method: &MethodInfo::new(request.method, request.version),
        order: request.order,
        client_request_id: None,
        digests: &digests,
    };
    store.start_run(&new, now_unix_ms()).await?;
    Ok(issued)
}

fn unknown(phase: &str, known: Vec<&str>) -> Failure {
    let message = format!("there is no phase '{}'", phase.escape_debug());
    let hint = match known.join(", ") {
        none if none.is_empty() => "make one with: avln challenge phase open ID --split NAME".to_owned(),
        known => format!("the data folder has: {known}"),
    };
    Failure::data(message).hinted(hint)
}
