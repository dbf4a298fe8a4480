//! Admin server and client: metrics, live status, announcements, drain.

use crate::{Arena, Failure, fault_count, now_unix_ms};
use avln_grpc::{Control, Histogram, SlotState, Snapshot};
use avln_store::{Census, Reader, Viewer};
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
use std::{
    fmt::{Display, Write},
    sync::Arc,
    time::Duration,
};
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

impl AdminState {
    fn control(&self) -> &Control {
        self.arena.control()
    }
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
        .route("/metrics", get(metrics_text))
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

impl From<avln_store::StoreError> for AdminError {
    fn from(error: avln_store::StoreError) -> Self {
        Self(StatusCode::INTERNAL_SERVER_ERROR, error.to_string())
    }
}

async fn organisers_only(
    State(state): State<AdminState>,
    request: axum::extract::Request,
    next: Next,
) -> Result<Response, AdminError> {
    let value = request.headers().get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    let token = value.and_then(|value| value.strip_prefix("Bearer ")).map(str::to_owned);
    let viewer = match token {
        Some(token) => state.reader.viewer(&token, now_unix_ms()).await?,
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

async fn metrics_text(State(state): State<AdminState>) -> Result<Response, AdminError> {
    let census = state.reader.census().await?;
    let text = metrics_page(&state.arena, &census);
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response())
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
    state
        .arena
        .drain(&reason, patience)
        .await
        .map_err(|failure| AdminError(StatusCode::INTERNAL_SERVER_ERROR, failure.to_string()))?;
    tracing::warn!(reason, minutes, "draining");
    Ok(Json(status_of(&state.arena)))
}

async fn notice(
    State(state): State<AdminState>,
    body: Result<Json<Notice>, JsonRejection>,
) -> Result<Json<Status>, AdminError> {
    let Json(Notice { text }) = body?;
    state.control().announce(&printable("text", text.trim())?);
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
            .hinted("--server is the address after --admin in `avln serve`, by default http://127.0.0.1:50052; from another machine use: ssh -L 50052:127.0.0.1:50052 HOST")
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
        Ok::<_, Box<dyn std::error::Error + Send + Sync>>(AdminReply { status, body })
    });
    match reply.await {
        Ok(reply) => reply.map_err(|error| failed(&error)),
        Err(_) => Err(failed(&"no reply within ten seconds")),
    }
}

/// Writes all metrics in the Prometheus text format 0.0.4.
fn metrics_page(arena: &Arena, census: &Census) -> String {
    let snapshot = arena.control().snapshot();
    let mut page = MetricsPage::default();
    page.family("avln_info", "gauge", "Version of the server.");
    page.line("avln_info", &format!("version=\"{}\"", env!("CARGO_PKG_VERSION")), 1);
    page.single(
        "avln_draining",
        "gauge",
        "1 if the server is draining.",
        u8::from(arena.control().draining().is_some()),
    );
    add_stored(&mut page, census);
    add_live(&mut page, &snapshot);
    page.single("avln_scene_bytes", "gauge", "Memory of prepared scenes.", arena.scene_bytes());
    let watchdog = arena.control().watchdog();
    page.single("avln_hanging", "gauge", "Abandoned threads that still simulate.", watchdog.hanging());
    page.single(
        "avln_given_up_total",
        "counter",
        "Abandoned simulations since the server start.",
        watchdog.given_up(),
    );
    page.single(
        "avln_faults_total",
        "counter",
        "Server faults, such as database failures, since the server start.",
        fault_count(),
    );
    page.0
}

fn add_stored(page: &mut MetricsPage, census: &Census) {
    page.family("avln_runs", "gauge", "Runs in the database by state.");
    for (state, count) in &census.runs {
        page.line("avln_runs", &format!("state=\"{state}\""), count);
    }
    page.family("avln_episodes", "gauge", "Episodes in the database by state and end reason.");
    for (state, end, count) in &census.episodes {
        page.line(
            "avln_episodes",
            &format!("state=\"{state}\",end=\"{}\"", end.as_deref().unwrap_or("")),
            count,
        );
    }
}

fn add_live(page: &mut MetricsPage, snapshot: &Snapshot) {
    let mut runs: Vec<&str> = snapshot.slots.iter().map(|slot| slot.run.as_str()).collect();
    runs.dedup();
    page.single("avln_sessions", "gauge", "Runs with an open episode.", runs.len());
    page.single("avln_open_episodes", "gauge", "Slots with an episode.", snapshot.slots.len());
    page.single("avln_steps_total", "counter", "Steps since the server start.", snapshot.steps);
    page.family(
        "avln_episodes_ended_total",
        "counter",
        "Ended episodes since the server start, by end reason.",
    );
    for (end, count) in &snapshot.ends {
        page.line("avln_episodes_ended_total", &format!("end=\"{end}\""), count);
    }
    page.family("avln_step_seconds", "histogram", "Step time by part.");
    for (part, histogram) in &snapshot.parts {
        page.histogram("avln_step_seconds", part, histogram);
    }
}

#[derive(Default)]
struct MetricsPage(String);

impl MetricsPage {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        // Writing to a string cannot fail.
        let _ = write!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}\n");
    }

    /// Adds a metric with a single value.
    fn single(&mut self, name: &str, kind: &str, help: &str, value: impl Display) {
        self.family(name, kind, help);
        self.line(name, "", value);
    }

    fn line(&mut self, name: &str, labels: &str, value: impl Display) {
        let _ = match labels {
            "" => writeln!(self.0, "{name} {value}"),
            labels => writeln!(self.0, "{name}{{{labels}}} {value}"),
        };
    }

    fn histogram(&mut self, name: &str, part: &str, histogram: &Histogram) {
        let limits = Histogram::LIMITS_S.map(|limit| limit.to_string());
        let limits = limits.iter().map(String::as_str).chain(["+Inf"]);
        let mut sum = 0;
        for (limit, count) in limits.zip(histogram.counts) {
            sum += count;
            self.line(&format!("{name}_bucket"), &format!("part=\"{part}\",le=\"{limit}\""), sum);
        }
        self.line(&format!("{name}_sum"), &format!("part=\"{part}\""), histogram.sum_s);
        self.line(&format!("{name}_count"), &format!("part=\"{part}\""), sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_are_cumulative() {
        let mut histogram = Histogram::default();
        (histogram.counts[0], histogram.counts[3], histogram.counts[15]) = (1, 2, 4);
        histogram.sum_s = 250.5;
        let mut page = MetricsPage::default();
        page.histogram("t", "queue", &histogram);
        assert!(page.0.starts_with("t_bucket{part=\"queue\",le=\"0.0001\"} 1\n"), "{}", page.0);
        assert!(page.0.contains("t_bucket{part=\"queue\",le=\"0.001\"} 3\n"), "{}", page.0);
        assert!(page.0.contains("t_bucket{part=\"queue\",le=\"60\"} 3\n"), "{}", page.0);
        assert!(
            page.0.ends_with("le=\"+Inf\"} 7\nt_sum{part=\"queue\"} 250.5\nt_count{part=\"queue\"} 7\n"),
            "{}",
            page.0
        );
    }
}
