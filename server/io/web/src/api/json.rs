//! JSON responses, and run log downloads.

use super::SCHEMA_VERSION;
use crate::{
    error::RequestError,
    format,
    leaderboard::LeaderboardParams,
    middleware::Streaming,
    request::{self, CompareQuery, NoParameters, RequestContext, RunsQuery, StrictQuery},
};
use avln_episode::Order;
use avln_store::{EpisodeView, LeaderboardView, LogAccess, MissionsView, PhaseView, RunView};
use axum::{
    Extension, Json,
    body::Body,
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};
use serde::Serialize;
use serde_json::{Value, json};
use std::{io, path::PathBuf};
use tokio::fs::File;
use tokio_util::io::ReaderStream;

/// Run logs with their signature key.
#[derive(Clone, Debug)]
pub struct SignedLogs {
    /// Folder with a file per run.
    pub folder: PathBuf,
    /// The server's public key, hexadecimal.
    pub key: String,
}

type JsonResponse = Result<Json<Value>, RequestError>;

pub(super) async fn status(
    context: RequestContext,
    Extension(logs): Extension<Option<SignedLogs>>,
    _: StrictQuery<NoParameters>,
) -> JsonResponse {
    context.reader.ping().await?;
    let log_key = logs.map(|logs| logs.key);
    let version = env!("CARGO_PKG_VERSION");
    respond(&json!({ "name": "LH-AVLN Arena", "version": version, "state": "up", "log_key": log_key }))
}

pub(super) async fn phases(context: RequestContext, _: StrictQuery<NoParameters>) -> JsonResponse {
    respond(&json!({ "phases": context.reader.phases(&context.viewer, context.now_unix_ms).await? }))
}

pub(super) async fn phase(
    context: RequestContext,
    Path(id): Path<String>,
    _: StrictQuery<NoParameters>,
) -> JsonResponse {
    respond(&json!({ "phase": find_phase(&context, &id).await? }))
}

pub(super) async fn missions(
    context: RequestContext,
    Path(id): Path<String>,
    _: StrictQuery<NoParameters>,
) -> JsonResponse {
    respond(&json!({ "missions": find_missions(&context, &id).await? }))
}

pub(super) async fn quota(context: RequestContext, _: StrictQuery<NoParameters>) -> JsonResponse {
    respond(&json!({ "quotas": context.reader.quotas(&context.viewer, context.now_unix_ms).await? }))
}

pub(super) async fn leaderboard(
    context: RequestContext,
    Path(id): Path<String>,
    params: LeaderboardParams,
) -> JsonResponse {
    let phase = find_phase(&context, &id).await?;
    let order = params.order(&phase)?;
    respond(&find_leaderboard(&context, &phase, &params, order).await?)
}

pub(super) async fn leaderboards(
    context: RequestContext,
    Path(id): Path<String>,
    params: LeaderboardParams,
) -> JsonResponse {
    respond(&json!({ "boards": find_leaderboards(&context, &id, &params).await? }))
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

pub(super) async fn run(
    context: RequestContext,
    Path(id): Path<String>,
    _: StrictQuery<NoParameters>,
) -> JsonResponse {
    respond(&find_run(&context, &id).await?)
}

pub(super) async fn episodes(
    context: RequestContext,
    Path(id): Path<String>,
    _: StrictQuery<NoParameters>,
) -> JsonResponse {
    let RunView { line, episodes, .. } = find_run(&context, &id).await?;
    respond(&json!({ "run": line.run, "episodes": episodes }))
}

pub(super) async fn episode(
    context: RequestContext,
    Path((run, place)): Path<(String, String)>,
    _: StrictQuery<NoParameters>,
) -> JsonResponse {
    respond(&find_episode(&context, &run, &place).await?)
}

pub(super) async fn log(
    context: RequestContext,
    Path(run): Path<String>,
    Extension(logs): Extension<Option<SignedLogs>>,
    _: StrictQuery<NoParameters>,
) -> Result<Response, RequestError> {
    let unknown = || RequestError::Unknown { what: "log of run", name: run.clone() };
    match context.reader.log_access(&context.viewer, &run).await? {
        LogAccess::None => return Err(unknown()),
        LogAccess::Later => {
            let message = format!("run '{run}' is still open; its log is signed when the run ends");
            return Err(RequestError::Invalid(message));
        }
        LogAccess::Now => {}
    }
    let SignedLogs { folder, .. } = logs.ok_or_else(unknown)?;
    // The store knows this run, so its id is not a path to another folder.
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

pub(super) async fn find_episode(
    context: &RequestContext,
    run: &str,
    place: &str,
) -> Result<EpisodeView, RequestError> {
    let view = context.reader.episode(&context.viewer, run, request::ordinal(place)?).await?;
    view.ok_or_else(|| RequestError::Unknown { what: "episode", name: format!("{place} of run {run}") })
}

pub(super) async fn find_run(context: &RequestContext, id: &str) -> Result<RunView, RequestError> {
    let view = context.reader.run(&context.viewer, id).await?;
    view.ok_or_else(|| RequestError::Unknown { what: "run", name: id.to_owned() })
}

pub(super) async fn find_phase(context: &RequestContext, id: &str) -> Result<PhaseView, RequestError> {
    let view = context.reader.phase(&context.viewer, id, context.now_unix_ms).await?;
    view.ok_or_else(|| RequestError::Unknown { what: "phase", name: id.to_owned() })
}

pub(super) async fn find_missions(
    context: &RequestContext,
    phase: &str,
) -> Result<MissionsView, RequestError> {
    let view = context.reader.missions(&context.viewer, phase).await?;
    view.ok_or_else(|| RequestError::Unknown {
        what: "public list of missions of phase",
        name: phase.to_owned(),
    })
}

pub(super) async fn find_leaderboard(
    context: &RequestContext,
    phase: &PhaseView,
    params: &LeaderboardParams,
    order: Order,
) -> Result<LeaderboardView, RequestError> {
    if !params.columns.is_empty() {
        let message = "the API returns all columns; remove the parameter 'column'";
        return Err(RequestError::Invalid(message.to_owned()));
    }
    let query = params.query(phase, order, context.now_unix_ms);
    let view = context.reader.leaderboard(&context.viewer, &query).await?;
    view.ok_or_else(|| RequestError::Unknown { what: "phase", name: phase.id.clone() })
}

pub(super) async fn find_leaderboards(
    context: &RequestContext,
    id: &str,
    params: &LeaderboardParams,
) -> Result<Vec<LeaderboardView>, RequestError> {
    if params.orders.is_some() {
        let message = "this address returns all orders; remove the parameter 'order'";
        return Err(RequestError::Invalid(message.to_owned()));
    }
    let phase = find_phase(context, id).await?;
    let mut leaderboards = Vec::new();
    for &order in &phase.orders {
        leaderboards.push(find_leaderboard(context, &phase, params, order).await?);
    }
    Ok(leaderboards)
}

/// Returns `body` with the schema version, and with times by RFC 3339.
fn respond(body: &impl Serialize) -> JsonResponse {
    let mut value = serde_json::to_value(body)?;
    name_moments(&mut value);
    if let Value::Object(fields) = &mut value {
        fields.insert("schema_version".to_owned(), SCHEMA_VERSION.into());
    }
    Ok(Json(value))
}

/// Replaces every field `x_unix_ms` by `x_at` with a time by RFC 3339.
fn name_moments(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(name_moments),
        Value::Object(fields) => {
            for (mut name, mut value) in std::mem::take(fields) {
                name_moments(&mut value);
                if let Some(stem) = name.strip_suffix("_unix_ms") {
                    value = value.as_i64().map_or(Value::Null, |ms| format::rfc3339(ms).into());
                    name = format!("{stem}_at");
                }
                fields.insert(name, value);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_rfc_3339_at_every_depth() {
        let mut value = json!({ "finished_unix_ms": null, "runs": [{ "created_unix_ms": 1000, "n": 2 }] });
        name_moments(&mut value);
        let expected =
            json!({ "finished_at": null, "runs": [{ "created_at": "1970-01-01T00:00:01Z", "n": 2 }] });
        assert_eq!(value, expected);
    }
}
