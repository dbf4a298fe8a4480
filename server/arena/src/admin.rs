//! Admin server and client: live status, announcements, drain, and metrics for Prometheus in the text format 0.0.4.

use crate::{Arena, Failure, fault_count};
use avln_grpc::{Histogram, SlotState, Snapshot};
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
use prometheus_client::{
    collector::Collector,
    encoding::{
        DescriptorEncoder, EncodeCounterValue, EncodeGaugeValue, NoLabelSet,
        prometheus_text::{self, CONTENT_TYPE},
    },
    metrics::{MetricType, exemplar::Exemplar},
    registry::Registry,
};
use serde::{Deserialize, Serialize};
use std::{
    error::Error,
    fmt::{self, Display},
    iter::successors,
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

/// Values of a scrape. Metrics name no team, method, run or scene.
#[derive(Debug)]
struct Scrape {
    census: Census,
    snapshot: Snapshot,
    is_draining: bool,
    scene_bytes: usize,
    hanging: usize,
    given_up: u64,
    faults: u64,
}

fn metrics_text(arena: &Arena, census: Census) -> Result<String, fmt::Error> {
    let (control, watchdog) = (arena.control(), arena.control().watchdog());
    let scrape = Scrape {
        census,
        snapshot: control.snapshot(),
        is_draining: control.draining().is_some(),
        scene_bytes: arena.scene_bytes(),
        hanging: watchdog.hanging(),
        given_up: watchdog.given_up(),
        faults: fault_count(),
    };
    text_of(scrape)
}

fn text_of(scrape: Scrape) -> Result<String, fmt::Error> {
    let mut registry = Registry::default();
    registry.register_collector(Box::new(scrape));
    let mut text = String::new();
    prometheus_text::encode(&mut text, &registry)?;
    Ok(text)
}

impl Collector for Scrape {
    fn encode(&self, mut encoder: DescriptorEncoder) -> fmt::Result {
        let version = [("version", env!("CARGO_PKG_VERSION"))];
        encoder
            .encode_descriptor("avln", "Server version.", None, MetricType::Info)?
            .encode_info(&version)?;
        gauge(&mut encoder, "avln_draining", "1 if the server is draining.", &u32::from(self.is_draining))?;
        self.encode_stored(&mut encoder)?;
        self.encode_live(&mut encoder)?;
        gauge(&mut encoder, "avln_scene_bytes", "Memory of prepared scenes.", &self.scene_bytes)?;
        gauge(&mut encoder, "avln_hanging", "Abandoned threads that still simulate.", &self.hanging)?;
        let given_up = "Abandoned simulations since the server start.";
        counter(&mut encoder, "avln_given_up", given_up, &self.given_up)?;
        let faults = "Server faults, such as database failures, since the server start.";
        counter(&mut encoder, "avln_faults", faults, &self.faults)
    }
}

impl Scrape {
    fn encode_stored(&self, encoder: &mut DescriptorEncoder) -> fmt::Result {
        let help = "Runs in the database by state.";
        let mut runs = encoder.encode_descriptor("avln_runs", help, None, MetricType::Gauge)?;
        for (state, count) in &self.census.runs {
            runs.encode_family(&[("state", state.as_str())])?.encode_gauge(count)?;
        }
        let help = "Episodes in the database by state and end reason.";
        let mut episodes = encoder.encode_descriptor("avln_episodes", help, None, MetricType::Gauge)?;
        for (state, end, count) in &self.census.episodes {
            let labels = [("state", state.as_str()), ("end", end.as_deref().unwrap_or(""))];
            episodes.encode_family(&labels)?.encode_gauge(count)?;
        }
        Ok(())
    }

    fn encode_live(&self, encoder: &mut DescriptorEncoder) -> fmt::Result {
        let Snapshot { slots, steps, parts, ends, .. } = &self.snapshot;
        let mut runs: Vec<&str> = slots.iter().map(|slot| slot.run.as_str()).collect();
        runs.dedup();
        gauge(encoder, "avln_sessions", "Runs with an open episode.", &runs.len())?;
        gauge(encoder, "avln_open_episodes", "Slots with an episode.", &slots.len())?;
        counter(encoder, "avln_steps", "Steps since the server start.", steps)?;
        let help = "Ended episodes since the server start, by end reason.";
        let mut ended = encoder.encode_descriptor("avln_episodes_ended", help, None, MetricType::Counter)?;
        for (end, count) in ends {
            ended.encode_family(&[("end", *end)])?.encode_counter(count, NO_EXEMPLAR)?;
        }
        let help = "Step time by part.";
        let mut times = encoder.encode_descriptor("avln_step_seconds", help, None, MetricType::Histogram)?;
        for (part, histogram) in parts {
            let buckets: Vec<(f64, u64)> = Histogram::LIMITS_S.into_iter().zip(histogram.counts).collect();
            times.encode_family(&[("part", *part)])?.encode_histogram::<NoLabelSet>(
                histogram.sum_s,
                histogram.counts.iter().sum(),
                &buckets,
                None,
            )?;
        }
        Ok(())
    }
}

const NO_EXEMPLAR: Option<&Exemplar<NoLabelSet, f64>> = None;

fn gauge(
    encoder: &mut DescriptorEncoder,
    name: &str,
    help: &str,
    value: &impl EncodeGaugeValue,
) -> fmt::Result {
    encoder.encode_descriptor(name, help, None, MetricType::Gauge)?.encode_gauge(value)
}

/// Encodes a counter; the format appends `_total` to the name.
fn counter(
    encoder: &mut DescriptorEncoder,
    name: &str,
    help: &str,
    value: &impl EncodeCounterValue,
) -> fmt::Result {
    encoder.encode_descriptor(name, help, None, MetricType::Counter)?.encode_counter(value, NO_EXEMPLAR)
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

    #[test]
    fn buckets_are_cumulative() {
        let mut histogram = Histogram::default();
        (histogram.counts[0], histogram.counts[3], histogram.counts[15]) = (1, 2, 4);
        histogram.sum_s = 250.5;
        let snapshot = Snapshot { parts: vec![("queue", histogram)], ..Snapshot::default() };
        let census = Census { runs: vec![("a\"b".to_owned(), 7)], episodes: vec![] };
        let text = text_of(Scrape {
            census,
            snapshot,
            is_draining: true,
            scene_bytes: 5,
            hanging: 0,
            given_up: 3,
            faults: 0,
        });
        let text = text.expect("metrics");
        for line in [
            "avln_step_seconds_bucket{part=\"queue\",le=\"0.0001\"} 1",
            "avln_step_seconds_bucket{part=\"queue\",le=\"0.001\"} 3",
            "avln_step_seconds_bucket{part=\"queue\",le=\"60\"} 3",
            "avln_step_seconds_bucket{part=\"queue\",le=\"+Inf\"} 7",
            "avln_step_seconds_sum{part=\"queue\"} 250.5",
            "avln_step_seconds_count{part=\"queue\"} 7",
            "avln_runs{state=\"a\\\"b\"} 7",
            "avln_draining 1",
            "avln_given_up_total 3",
        ] {
            assert!(text.lines().any(|written| written == line), "{line} is missing in {text}");
        }
        assert!(text.contains("avln_info{version="), "{text}");
        let end = "le=\"+Inf\"} 7\navln_step_seconds_sum{part=\"queue\"} 250.5\navln_step_seconds_count{part=\"queue\"} 7\n";
        assert!(text.contains(end), "the last bucket precedes sum and count: {text}");
        assert_eq!(text.matches("le=\"+Inf\"").count(), 1, "{text}");
    }
}
