//! Runs that the organiser starts for a team, to play them sealed.

use super::{
    data::DataFolder,
    now_unix_ms, secret,
    stages::{Stage, Stages},
};
use crate::{Failure, FailureKind};
use avln_challenge::MethodInfo;
use avln_episode::Order;
use avln_store::{NewRun, Run, Store};

/// The run that is wanted.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a> {
    /// Id of the phase.
    pub phase: &'a str,
    /// Team of the run.
    pub team: &'a str,
    /// Name of the method on the board.
    pub method: &'a str,
    /// Version of the method, may be empty.
    pub version: &'a str,
    /// Order of the goals.
    pub order: Order,
}

/// A run with its token.
#[derive(Clone, Debug)]
pub struct Ticket {
    /// Id of the run.
    pub run: String,
    /// Token for this run only.
    pub token: String,
}

/// Starts a run with a record of enforced and missing restrictions; `missing` may be empty.
///
/// # Errors
/// If the phase is not hosted or not open, the team is not allowed, its quota is used up, or the database
/// fails.
pub async fn start(
    data: &DataFolder,
    store: &Store,
    wanted: &Wanted<'_>,
    enforced: String,
    missing: String,
) -> Result<Ticket, Failure> {
    let stages = Stages::open(data, store).await?.now(store).await?;
    let Some(stage) = stages.iter().find(|stage| stage.phase.id == wanted.phase) else {
        return Err(unknown(wanted.phase, stages.iter().map(|stage| stage.phase.id.as_str()).collect()));
    };
    let mut digests = Stage::digests(stage);
    digests.insert(Run::SEALED.to_owned(), enforced);
    if !missing.is_empty() {
        digests.insert(Run::UNSEALED.to_owned(), missing);
    }
    let random = |error| Failure::new(FailureKind::Internal, error);
    let run = format!("run_{}", secret::random_hex().map_err(random)?);
    let token = secret::new_token("run").map_err(random)?;
    let method = MethodInfo::new(wanted.method, wanted.version);
    let new = NewRun {
        id: &run,
        token: &token,
        phase: wanted.phase,
        team: wanted.team,
        method: &method,
        order: wanted.order,
        client_request_id: None,
        digests: &digests,
    };
    store.start_run(&new, now_unix_ms()).await?;
    Ok(Ticket { run, token })
}

fn unknown(phase: &str, known: Vec<&str>) -> Failure {
    let message = format!("there is no phase '{}' to play in", phase.escape_debug());
    let hint = match known.join(", ") {
        none if none.is_empty() => "make one with: avln challenge phase open ID --split NAME".to_owned(),
        known => format!("the data folder has: {known}"),
    };
    Failure::new(FailureKind::Data, message).hinted(hint)
}
