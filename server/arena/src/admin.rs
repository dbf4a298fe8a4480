//! Admin server and client: metrics, live status, announcements, drain.

use crate::{
    Arena, Failure,
    metrics::{CONTENT_TYPE, metrics_text},
};
use avln_grpc::SlotState;
use avln_store::{Reader, Viewer};
use axum::{
    Json, Router,
    body::Bytes,
    extract::{DefaultBodyLimit, State, rejection::JsonRejection},
    http::{Method, Request, StatusCode, Uri, header},
    middleware::{Next, from_fn_with_state},
    response::{IntoResponse, Response},
    routing::{get, post},
};
use http_body_util::{BodyExt, Full, Limited};
use hyper_util::{client::legacy::Client, rt::TokioExecutor};
use serde::{Deserialize, Serialize};
use std::{error::Error, fmt::Display, iter::successors, sync::Arc, time::Duration};
use tokio::time::timeout;

/// Largest request, bytes.
const MAX_BODY_BYTES: usize = 16 << 10;
/// Largest reason or notice, characters.
const MAX_TEXT_CHARS: usize = 500;
/// Longest drain, minutes.
const MAX_DRAIN_MINUTES: u32 = 24 * 60;

/// Admin server state.
#[derive(Clone)]
pub struct AdminState {
    /// Arena.
    pub arena: Arc<Arena>,
    /// Reader for tokens and counts.
    pub reader: Reader,
}

/// Live status.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Status {
    /// Reason for the drain, if draining.
    pub draining: Option<String>,
    /// Announcement; may be empty.
    pub notice: String,
    /// Slots in play.
    pub slots: Vec<Slot>,
    /// Steps since the server start.
    pub steps: u64,
    /// Total size, bytes.
    pub scene_bytes: usize,
    /// Hanging simulator threads; several block new runs.
    pub hanging: usize,
}

/// A slot in play.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Slot {
    /// Run id.
    pub run: String,
    /// Slot number.
    pub slot: u32,
    /// Steps taken.
    pub step: u32,
}

/// A drain request.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drain {
    /// Reason, for agents and visitors.
    pub reason: String,
    /// Time for open episodes.
    pub minutes: u32,
}

/// An announcement.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Notice {
    /// Text for agents and visitors; an empty text removes the announcement.
    pub text: String,
}

/// Returns the routes. All except `/metrics` require an organiser token.
pub fn router(state: AdminState) -> Router {
    let guarded = Router::new()
        .route("/v1/status", get(status))
        .route("/v1/drain", post(drain))
        .route("/v1/notice", post(notice))
        .layer(from_fn_with_state(state.clone(), organisers_only));
    Router::new()
        // Without a token: metrics name no team, method, run or scene, and health checks need them.
        .route("/metrics", get(metrics))
        .merge(guarded)
        .layer(DefaultBodyLimit::max(MAX_BODY_BYTES))
        .with_state(state)
}

/// A refusal with HTTP status.
struct AdminError(StatusCode, String);

impl IntoResponse for AdminError {
    fn into_response(self) -> Response {
        (self.0, Json(serde_json::json!({ "error": self.1 }))).into_response()
    }
}

impl From<JsonRejection> for AdminError {
    fn from(rejection: JsonRejection) -> Self {
        Self(rejection.status(), rejection.body_text())
    }
}

fn internal(error: impl Display) -> AdminError {
    AdminError(StatusCode::INTERNAL_SERVER_ERROR, error.to_string())
}

async fn organisers_only(
    State(state): State<AdminState>,
    request: axum::extract::Request,
    next: Next,
) -> Result<Response, AdminError> {
    let value = request.headers().get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    let token = value.and_then(|value| value.strip_prefix("Bearer ")).map(str::to_owned);
    let viewer = match token {
        Some(token) => {
            state.reader.viewer(&token, state.arena.clock.now_unix_ms()).await.map_err(internal)?
        }
        None => None,
    };
    match viewer {
        Some(Viewer::Organiser) => Ok(next.run(request).await),
        _ => {
            let words = "an organiser token is needed; send authorization: Bearer TOKEN";
            Err(AdminError(StatusCode::UNAUTHORIZED, words.to_owned()))
        }
    }
}

async fn metrics(State(state): State<AdminState>) -> Result<Response, AdminError> {
    let census = state.reader.census().await.map_err(internal)?;
    let text = metrics_text(&state.arena, census).map_err(internal)?;
    Ok(([(header::CONTENT_TYPE, CONTENT_TYPE)], text).into_response())
}

async fn status(State(state): State<AdminState>) -> Json<Status> {
    Json(status_of(&state.arena))
}

/// Returns the live status.
pub fn status_of(arena: &Arena) -> Status {
    let control = arena.control();
    let snapshot = control.snapshot();
    let slot = |SlotState { run, slot, step, .. }| Slot { run, slot, step };
    Status {
        draining: control.draining().map(|drain| drain.reason),
        notice: snapshot.notice,
        slots: snapshot.slots.into_iter().map(slot).collect(),
        steps: snapshot.steps,
        scene_bytes: arena.scene_bytes(),
        hanging: control.watchdog().hanging(),
    }
}

async fn drain(
    State(state): State<AdminState>,
    body: Result<Json<Drain>, JsonRejection>,
) -> Result<Json<Status>, AdminError> {
    let Json(Drain { reason, minutes }) = body?;
    let reason = printable("reason", reason.trim())?;
    if reason.is_empty() || minutes > MAX_DRAIN_MINUTES {
        let words = format!("a drain needs a reason and 0 to {MAX_DRAIN_MINUTES} minutes, but has {minutes}");
        return Err(AdminError(StatusCode::UNPROCESSABLE_ENTITY, words));
    }
    let patience = Duration::from_secs(60 * u64::from(minutes));
    state.arena.drain(&reason, patience).await.map_err(internal)?;
    tracing::warn!(reason, minutes, "draining");
    Ok(Json(status_of(&state.arena)))
}

async fn notice(
    State(state): State<AdminState>,
    body: Result<Json<Notice>, JsonRejection>,
) -> Result<Json<Status>, AdminError> {
    let Json(Notice { text }) = body?;
    state.arena.control().announce(&printable("text", text.trim())?);
    Ok(Json(status_of(&state.arena)))
}

fn printable(what: &str, text: &str) -> Result<String, AdminError> {
    if text.chars().count() <= MAX_TEXT_CHARS && !text.chars().any(char::is_control) {
        return Ok(text.to_owned());
    }
    let words = format!("{what} has at most {MAX_TEXT_CHARS} characters on one line");
    Err(AdminError(StatusCode::UNPROCESSABLE_ENTITY, words))
}

const REPLY_TIMEOUT: Duration = Duration::from_secs(10);
/// Largest reply, bytes.
const MAX_REPLY_BYTES: usize = 4 << 20;

/// A reply from the admin server.
pub struct AdminReply {
    /// HTTP status.
    pub status: StatusCode,
    /// Body.
    pub body: Bytes,
}

/// Requests `path` from the admin server at `server`, such as `http://127.0.0.1:50052`, with an optional `body`.
pub async fn ask(
    server: &str,
    path: &str,
    token: &str,
    body: Option<Vec<u8>>,
) -> Result<AdminReply, Failure> {
    let failed = |error: &dyn Display| {
        Failure::run(format!("{server}{path}: {error}"))
            .hinted("--admin is the address after --admin in `avln serve`, by default 127.0.0.1:50052; from another machine use: ssh -L 50052:127.0.0.1:50052 HOST")
    };
    let address: Uri = server.parse().map_err(|error| failed(&format!("the address is invalid: {error}")))?;
    let (Some("http"), Some(authority)) = (address.scheme_str(), address.authority()) else {
        return Err(failed(&"the address is not like http://127.0.0.1:50052"));
    };
    let request = Request::builder()
        .method(if body.is_some() { Method::POST } else { Method::GET })
        .uri(format!("http://{authority}{path}"))
        .header(header::AUTHORIZATION, format!("Bearer {token}"))
        .header(header::CONTENT_TYPE, "application/json")
        .body(Full::new(Bytes::from(body.unwrap_or_default())))
        .map_err(|error| failed(&error))?;
    let reply = timeout(REPLY_TIMEOUT, async {
        let response = Client::builder(TokioExecutor::new()).build_http().request(request).await?;
        let status = response.status();
        let body = Limited::new(response.into_body(), MAX_REPLY_BYTES).collect().await?.to_bytes();
        Ok::<_, Box<dyn Error + Send + Sync>>(AdminReply { status, body })
    });
    match reply.await {
        Ok(reply) => reply.map_err(|error| failed(&with_causes(&*error))),
        Err(_) => Err(failed(&"no reply within ten seconds")),
    }
}

/// Returns the messages of an error and its causes: hyper's own message only names the failed phase.
fn with_causes(error: &dyn Error) -> String {
    let chain = successors(Some(error), |error: &&dyn Error| Error::source(*error));
    chain.map(ToString::to_string).collect::<Vec<_>>().join(": ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    #[tokio::test]
    async fn unreachable_server_is_reported_with_cause() {
        let free = TcpListener::bind("127.0.0.1:0").expect("a free port").local_addr().expect("an address");
        let failure =
            ask(&format!("http://{free}"), "/v1/status", "", None).await.err().expect("nothing listens");
        assert!(failure.to_string().contains("refused"), "{failure}");
    }
}
