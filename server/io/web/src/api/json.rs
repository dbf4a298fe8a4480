//! JSON responses, and run log downloads.

use super::SCHEMA_VERSION;
use crate::{
    error::{RequestError, Result},
    format::with_named_times,
    leaderboard::LeaderboardParams,
    request::{CompareQuery, NoParameters, PathOnly, RequestContext, RunsQuery, StrictQuery},
    server::Streaming,
};
use avln_store::{EpisodeLine, LeaderboardView, LogAccess, MissionsView, PhaseView, Quota, RunView};
use axum::{
    Extension, Json,
    body::Body,
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};
use serde::Serialize;
use serde_json::Value;
use std::{io, path::PathBuf};
use tokio::fs::File;
use tokio_util::io::ReaderStream;
use utoipa::ToSchema;

/// Run logs with their signature key.
#[derive(Clone, Debug)]
pub struct SignedLogs {
    /// Folder with a file per run.
    pub folder: PathBuf,
    /// The server's public key, hexadecimal.
    pub key: String,
}

type JsonResponse = Result<Json<Value>>;

/// Returns `body` with the schema version, and with times by RFC 3339.
fn respond(body: &impl Serialize) -> JsonResponse {
    let mut value = with_named_times(body)?;
    if let Value::Object(fields) = &mut value {
        fields.insert("schema_version".to_owned(), SCHEMA_VERSION.into());
    }
    Ok(Json(value))
}

#[derive(Serialize, ToSchema)]
pub(super) struct Status {
    name: &'static str,
    version: &'static str,
    state: &'static str,
    log_key: Option<String>,
}

pub(super) async fn status(
    context: RequestContext,
    Extension(logs): Extension<Option<SignedLogs>>,
    _: StrictQuery<NoParameters>,
) -> JsonResponse {
    context.reader.ping().await?;
    let version = env!("CARGO_PKG_VERSION");
    respond(&Status { name: "LH-AVLN Arena", version, state: "up", log_key: logs.map(|logs| logs.key) })
}

#[derive(Serialize, ToSchema)]
pub(super) struct Phases {
    phases: Vec<PhaseView>,
}

pub(super) async fn phases(context: RequestContext, _: StrictQuery<NoParameters>) -> JsonResponse {
    respond(&Phases { phases: context.reader.phases(&context.viewer, context.now_unix_ms).await? })
}

#[derive(Serialize, ToSchema)]
pub(super) struct Phase {
    phase: PhaseView,
}

pub(super) async fn phase(context: RequestContext, PathOnly(id): PathOnly<String>) -> JsonResponse {
    respond(&Phase { phase: context.phase(&id).await? })
}

#[derive(Serialize, ToSchema)]
pub(super) struct Missions {
    missions: MissionsView,
}

pub(super) async fn missions(context: RequestContext, PathOnly(id): PathOnly<String>) -> JsonResponse {
    respond(&Missions { missions: context.missions(&id).await? })
}

#[derive(Serialize, ToSchema)]
pub(super) struct Quotas {
    quotas: Vec<Quota>,
}

pub(super) async fn quota(context: RequestContext, _: StrictQuery<NoParameters>) -> JsonResponse {
    respond(&Quotas { quotas: context.reader.quotas(&context.viewer, context.now_unix_ms).await? })
}

pub(super) async fn leaderboard(
    context: RequestContext,
    Path(id): Path<String>,
    params: LeaderboardParams,
) -> JsonResponse {
    respond(&find_leaderboard(&context, &id, &params).await?)
}

#[derive(Serialize, ToSchema)]
pub(super) struct Leaderboards {
    boards: Vec<LeaderboardView>,
}

pub(super) async fn leaderboards(
    context: RequestContext,
    Path(id): Path<String>,
    params: LeaderboardParams,
) -> JsonResponse {
    respond(&Leaderboards { boards: find_leaderboards(&context, &id, &params).await? })
}

pub(super) async fn compare(
    context: RequestContext,
    StrictQuery(query): StrictQuery<CompareQuery>,
) -> JsonResponse {
    respond(&query.view(&context).await?)
}

pub(super) async fn runs(
    context: RequestContext,
    StrictQuery(query): StrictQuery<RunsQuery>,
) -> JsonResponse {
    respond(&query.list(&context.reader, &context.viewer).await?)
}

pub(super) async fn run(context: RequestContext, PathOnly(id): PathOnly<String>) -> JsonResponse {
    respond(&context.run(&id).await?)
}

#[derive(Serialize, ToSchema)]
pub(super) struct Episodes {
    run: String,
    episodes: Vec<EpisodeLine>,
}

pub(super) async fn episodes(context: RequestContext, PathOnly(id): PathOnly<String>) -> JsonResponse {
    let RunView { line, episodes, .. } = context.run(&id).await?;
    respond(&Episodes { run: line.run, episodes })
}

pub(super) async fn episode(
    context: RequestContext,
    PathOnly((run, ordinal)): PathOnly<(String, String)>,
) -> JsonResponse {
    respond(&context.episode(&run, &ordinal).await?)
}

pub(super) async fn log(
    context: RequestContext,
    PathOnly(run): PathOnly<String>,
    Extension(logs): Extension<Option<SignedLogs>>,
) -> Result<Response> {
    let unknown = || RequestError::unknown("log of run", run.clone());
    match context.reader.log_access(&context.viewer, &run).await? {
        LogAccess::None => return Err(unknown()),
        LogAccess::Later => {
            let message = format!("run '{run}' is still open; its log is signed when the run ends");
            return Err(RequestError::Invalid(message));
        }
        LogAccess::Now => {}
    }
    let SignedLogs { folder, .. } = logs.ok_or_else(unknown)?;
    // The store has found this run, so the id cannot be a path to another folder.
    let path = folder.join(format!("{run}.log"));
    let file = File::open(&path).await.map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => unknown(),
        _ => {
            tracing::error!(%error, run, "cannot read a run log");
            RequestError::Internal
        }
    })?;
    let headers = [
        (header::CONTENT_TYPE, "text/plain; charset=utf-8".to_owned()),
        (header::CACHE_CONTROL, "private, no-store".to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{run}.log\"")),
    ];
    Ok((headers, Extension(Streaming), Body::from_stream(ReaderStream::new(file))).into_response())
}

pub(super) async fn find_leaderboard(
    context: &RequestContext,
    id: &str,
    params: &LeaderboardParams,
) -> Result<LeaderboardView> {
    let phase = context.phase(id).await?;
    params.reject_columns()?;
    params.read(context, &phase, params.order(&phase)?).await
}

pub(super) async fn find_leaderboards(
    context: &RequestContext,
    id: &str,
    params: &LeaderboardParams,
) -> Result<Vec<LeaderboardView>> {
    if params.orders.is_some() {
        let message = "this address returns all orders; remove the parameter 'order'";
        return Err(RequestError::Invalid(message.to_owned()));
    }
    params.reject_columns()?;
    params.read_all(context, &context.phase(id).await?).await
}
