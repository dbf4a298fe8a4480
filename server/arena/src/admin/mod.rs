//! The admin server: metrics, live status, announcements, drain. It has a separate listener on this machine
//! only.

mod ask;
mod metrics;

pub use ask::{Answer, ask};

use crate::{Arena, now_unix_ms};
use avln_grpc::{Control, SlotState};
use avln_store::{Reader, Viewer};
use axum::{
    Extension, Json, Router,
    extract::{DefaultBodyLimit, Request, State, rejection::JsonRejection},
    http::{StatusCode, header},
    middleware::{Next, from_fn_with_state},
    response::{IntoResponse, Response},
    routing::{get, post},
};
use serde::{Deserialize, Serialize};
use std::{sync::Arc, time::Duration};

/// Most bytes of a request: a reason or a notice.
const MAX_BODY_BYTES: usize = 16 << 10;
/// Most characters of a reason or a notice.
const MAX_TEXT_CHARS: usize = 500;
/// Most minutes that open episodes can be given.
const MAX_DRAIN_MINUTES: u32 = 24 * 60;

/// State of the admin server.
#[derive(Clone)]
pub struct Desk {
    /// Hosted phases and live runs.
    pub arena: Arc<Arena>,
    /// Read access to the store.
    pub reader: Reader,
}

impl Desk {
    fn control(&self) -> &Control {
        self.arena.control()
    }
}

/// Live status.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Status {
    /// Reason of a drain, if draining.
    pub draining: Option<String>,
    /// Announcement; may be empty.
    pub notice: String,
    /// Slots with an episode.
    pub slots: Vec<Slot>,
    /// Steps since the server started.
    pub steps: u64,
    /// Bytes of scenes that are ready.
    pub scene_bytes: usize,
    /// Hanging simulator threads; several of them block new runs.
    pub hanging: usize,
}

/// A slot with an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Slot {
    /// Id of the run.
    pub run: String,
    /// Number of the slot.
    pub slot: u32,
    /// Steps taken.
    pub step: u32,
}

/// A wish to stop.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drain {
    /// Why, for agents and people.
    pub reason: String,
    /// Grace period for open episodes.
    pub minutes: u32,
}

/// An announcement.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Notice {
    /// For agents and people; empty: none.
    pub text: String,
}

/// Routes of the admin server. All except `/metrics` require an organiser token.
pub fn router(desk: Desk) -> Router {
    let guarded = Router::new()
        .route("/v1/status", get(status))
        .route("/v1/drain", post(drain))
        .route("/v1/notice", post(notice))
        .layer(from_fn_with_state(desk.clone(), organisers_only));
    Router::new()
        .route("/metrics", get(metrics_text))
        .merge(guarded)
        .layer(DefaultBodyLimit::max(MAX_BODY_BYTES))
        .layer(Extension(()))
        .with_state(desk)
}

/// Why something was not done.
struct Refused(StatusCode, String);

impl IntoResponse for Refused {
    fn into_response(self) -> Response {
        (self.0, Json(serde_json::json!({ "error": self.1 }))).into_response()
    }
}

impl From<JsonRejection> for Refused {
    fn from(rejection: JsonRejection) -> Self {
        Self(rejection.status(), rejection.body_text())
    }
}

impl From<avln_store::StoreError> for Refused {
    fn from(error: avln_store::StoreError) -> Self {
        Self(StatusCode::INTERNAL_SERVER_ERROR, error.to_string())
    }
}

async fn organisers_only(
    State(desk): State<Desk>,
    request: Request,
    next: Next,
) -> Result<Response, Refused> {
    let value = request.headers().get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    let token = value.and_then(|value| value.strip_prefix("Bearer ")).map(str::to_owned);
    let viewer = match token {
        Some(token) => desk.reader.viewer(&token, now_unix_ms()).await?,
        None => None,
    };
    match viewer {
        Some(Viewer::Organiser) => Ok(next.run(request).await),
        _ => {
            let words = "only an organiser's token opens this door; send authorization: Bearer TOKEN";
            Err(Refused(StatusCode::UNAUTHORIZED, words.to_owned()))
        }
    }
}

async fn metrics_text(State(desk): State<Desk>) -> Result<Response, Refused> {
    let census = desk.reader.census().await?;
    let text = metrics::text(&desk.arena, &census);
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response())
}

async fn status(State(desk): State<Desk>) -> Json<Status> {
    Json(status_of(&desk.arena))
}

/// Returns the live status.
pub fn status_of(arena: &Arena) -> Status {
    let control = arena.control();
    let seen = control.snapshot();
    let slot = |SlotState { run, slot, step, .. }| Slot { run, slot, step };
    Status {
        draining: control.draining().map(|drain| drain.reason),
        notice: seen.notice,
        slots: seen.slots.into_iter().map(slot).collect(),
        steps: seen.steps,
        scene_bytes: arena.scene_bytes(),
        hanging: control.watchdog().hanging(),
    }
}

async fn drain(
    State(desk): State<Desk>,
    body: Result<Json<Drain>, JsonRejection>,
) -> Result<Json<Status>, Refused> {
    let Json(Drain { reason, minutes }) = body?;
    let reason = printable("reason", reason.trim())?;
    if reason.is_empty() || minutes > MAX_DRAIN_MINUTES {
        let words =
            format!("a drain has a reason and 0 to {MAX_DRAIN_MINUTES} minutes; got {minutes} minutes");
        return Err(Refused(StatusCode::UNPROCESSABLE_ENTITY, words));
    }
    let patience = Duration::from_secs(60 * u64::from(minutes));
    desk.arena
        .drain(&reason, patience)
        .await
        .map_err(|failure| Refused(StatusCode::INTERNAL_SERVER_ERROR, failure.to_string()))?;
    tracing::warn!(reason, minutes, "draining");
    Ok(Json(status_of(&desk.arena)))
}

async fn notice(
    State(desk): State<Desk>,
    body: Result<Json<Notice>, JsonRejection>,
) -> Result<Json<Status>, Refused> {
    let Json(Notice { text }) = body?;
    desk.control().announce(&printable("text", text.trim())?);
    Ok(Json(status_of(&desk.arena)))
}

fn printable(what: &str, text: &str) -> Result<String, Refused> {
    if text.chars().count() <= MAX_TEXT_CHARS && !text.chars().any(char::is_control) {
        return Ok(text.to_owned());
    }
    let words = format!("{what} has at most {MAX_TEXT_CHARS} characters on one line");
    Err(Refused(StatusCode::UNPROCESSABLE_ENTITY, words))
}
