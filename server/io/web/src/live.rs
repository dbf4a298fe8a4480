//! Live state of open runs, from the database and the running arena, and Server-Sent Events.

use crate::{
    error::{RequestError, Result},
    format::{self, NOTHING, with_named_times},
    request::{NoParameters, PathOnly, RequestContext, StrictQuery, now_unix_ms},
    server::{MAX_CONNECTIONS, Streaming},
};
use avln_store::{LiveRun, RunState};
use axum::{
    Extension,
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header},
    response::{
        IntoResponse, Response,
        sse::{Event, KeepAlive, Sse},
    },
};
use serde::Serialize;
use std::{convert::Infallible, fmt, sync::Arc, time::Duration};
use tokio::{
    sync::{OwnedSemaphorePermit, Semaphore, mpsc, watch},
    time::{Instant, sleep},
};
use tokio_stream::wrappers::ReceiverStream;
use utoipa::ToSchema;

pub(crate) const MAX_RUNS: u32 = 50;
// Wait for an agent after which the page names the slot, milliseconds.
const LONG_WAIT_MS: i64 = 10_000;
// Subscriber limit: a quarter of all connections, so that pages remain available.
const MAX_SUBSCRIBERS: usize = MAX_CONNECTIONS / 4;
const INTERVAL: Duration = Duration::from_secs(1);
// Comments at this interval keep an idle connection open.
const HEARTBEAT: Duration = Duration::from_secs(15);
// Shorter than a connection's lifetime. The browser then reconnects, which repeats the token check.
const STREAM_LIFETIME: Duration = Duration::from_secs(50);
const RECONNECT_DELAY: Duration = Duration::from_secs(2);
const LAST_EVENT_ID: HeaderName = HeaderName::from_static("last-event-id");
// Makes nginx forward events without buffering.
const UNBUFFERED: HeaderName = HeaderName::from_static("x-accel-buffering");

/// An open run's session.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LiveSession {
    /// True if the agent is connected.
    pub is_connected: bool,
    /// Slots with an open episode.
    pub slots: Vec<LiveSlot>,
}

/// A slot with an open episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct LiveSlot {
    /// Slot number.
    pub slot: u32,
    /// Steps taken.
    pub step: u32,
    /// Last step's duration from observation to observation, seconds.
    pub last_step_s: Option<f64>,
    /// Mean step duration, seconds.
    pub mean_step_s: Option<f64>,
    /// Time of the last observation, milliseconds since 1970-01-01 UTC.
    pub since_unix_ms: i64,
}

/// Live state, implemented by a running arena.
pub trait LiveStatus: fmt::Debug + Send + Sync {
    /// Returns the run session; `None` if it has none.
    fn session(&self, run: &str) -> Option<LiveSession>;
    /// Returns the reason if the server is draining.
    fn draining(&self) -> Option<String>;
    /// Returns the organiser's announcement for all pages; empty if there is none.
    fn announcement(&self) -> String;
}

#[derive(Debug)]
pub(crate) struct LiveRunView {
    pub(crate) run: LiveRun,
    /// The session, without slots if the viewer may not see steps.
    session: Option<LiveSession>,
    draining: Option<String>,
    now_unix_ms: i64,
}

#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct LiveRunJson {
    run: String,
    state: RunState,
    episodes: u32,
    done: u32,
    playing: u32,
    connected: Option<bool>,
    steps_per_s: Option<f64>,
    slots: Vec<LiveSlot>,
    created_unix_ms: i64,
    finished_unix_ms: Option<i64>,
    words: LiveText,
}

#[derive(Debug, PartialEq, Eq, Serialize, ToSchema)]
pub(crate) struct LiveText {
    pub(crate) state: String,
    pub(crate) episodes: String,
    pub(crate) pace: String,
    /// The waiting side and the reason.
    pub(crate) waits: String,
}

impl LiveRunView {
    /// Adds the session, without hidden steps.
    pub(crate) fn new(run: LiveRun, live_status: Option<&dyn LiveStatus>, now_unix_ms: i64) -> Self {
        let mut session = live_status.and_then(|status| status.session(&run.line.run));
        if let Some(session) = session.as_mut().filter(|_| !run.steps_visible) {
            session.slots.clear();
        }
        Self { session, draining: live_status.and_then(LiveStatus::draining), now_unix_ms, run }
    }

    fn steps_per_s(&self) -> Option<f64> {
        let means = self.slots().iter().filter_map(|slot| slot.mean_step_s);
        let rates: Vec<f64> = means.filter(|mean| *mean > 0.0).map(|mean| 1.0 / mean).collect();
        (!rates.is_empty()).then(|| rates.iter().sum())
    }

    fn slots(&self) -> &[LiveSlot] {
        self.session.as_ref().map_or(&[], |session| &session.slots)
    }

    pub(crate) fn json(&self) -> LiveRunJson {
        let LiveRun { line, playing, .. } = &self.run;
        LiveRunJson {
            run: line.run.clone(),
            state: line.state,
            episodes: line.episodes,
            done: line.done,
            playing: *playing,
            connected: self.session.as_ref().map(|session| session.is_connected),
            steps_per_s: self.steps_per_s(),
            slots: self.slots().to_vec(),
            created_unix_ms: line.created_unix_ms,
            finished_unix_ms: line.finished_unix_ms,
            words: self.text(),
        }
    }

    pub(crate) fn text(&self) -> LiveText {
        LiveText {
            state: format::run_state(&self.run.line.state).to_owned(),
            episodes: self.episodes(),
            pace: self.pace(),
            waits: self.waits(),
        }
    }

    fn episodes(&self) -> String {
        let line = &self.run.line;
        let playing = match self.run.playing {
            0 => String::new(),
            playing => format!(", {playing} in progress"),
        };
        format!("{} of {} done{playing}", line.done, line.episodes)
    }

    fn pace(&self) -> String {
        let Some(rate) = self.steps_per_s() else { return NOTHING.to_owned() };
        let newest = self.slots().iter().max_by_key(|slot| slot.since_unix_ms);
        let last = newest.and_then(|slot| slot.last_step_s);
        let last = last.map_or_else(String::new, |last| format!(", last step {last:.2} s"));
        format!("{rate:.1} steps per second{last}")
    }

    fn waits(&self) -> String {
        if !self.run.line.state.is_open() {
            return "none: the run has ended".to_owned();
        }
        if let Some(reason) = self.draining.as_ref().filter(|_| self.run.playing == 0) {
            return format!("the run waits for a restart of the server: {reason}");
        }
        let Some(session) = &self.session else { return self.waits_without_session().to_owned() };
        if !session.is_connected {
            return "the run waits for its agent to reconnect: the connection is lost".to_owned();
        }
        let is_slow = |slot: &&LiveSlot| self.now_unix_ms - slot.since_unix_ms >= LONG_WAIT_MS;
        if let Some(slot) = session.slots.iter().filter(is_slow).min_by_key(|slot| slot.since_unix_ms) {
            let since = format::rfc3339(slot.since_unix_ms);
            let clock = since.get(11..19).unwrap_or_default();
            return format!("slot {} has waited for its agent since {clock} UTC", slot.slot);
        }
        match self.run.playing {
            0 => "the server waits for the agent to request an episode".to_owned(),
            _ => "none: episodes are in progress".to_owned(),
        }
    }

    fn waits_without_session(&self) -> &'static str {
        match (self.run.line.state, self.run.playing) {
            (RunState::Created, _) => "the run waits for its agent to connect",
            (_, 0) => "the run waits for its agent to connect and request the next episode",
            _ => "open episodes wait for their agent to reconnect",
        }
    }
}

#[derive(Debug)]
pub(crate) struct LiveFeed {
    live_status: Option<Arc<dyn LiveStatus>>,
    permits: Arc<Semaphore>,
    /// Changes when the server shuts down; `None` for a router without a server.
    closed: Option<watch::Receiver<()>>,
}

impl LiveFeed {
    pub(crate) fn new(live_status: Option<Arc<dyn LiveStatus>>, closed: Option<watch::Receiver<()>>) -> Self {
        Self { live_status, permits: Arc::new(Semaphore::new(MAX_SUBSCRIBERS)), closed }
    }

    pub(crate) async fn run(&self, context: &RequestContext, id: &str) -> Result<Option<LiveRunView>> {
        let run = context.reader.live_run(&context.viewer, id).await?;
        Ok(run.map(|run| LiveRunView::new(run, self.live_status.as_deref(), now_unix_ms())))
    }

    pub(crate) async fn runs(&self, context: &RequestContext) -> Result<Vec<LiveRunView>> {
        let runs = context.reader.live_runs(&context.viewer, MAX_RUNS).await?;
        let view = |run| LiveRunView::new(run, self.live_status.as_deref(), now_unix_ms());
        Ok(runs.into_iter().map(view).collect())
    }
}

pub(crate) async fn run(
    context: RequestContext,
    PathOnly(id): PathOnly<String>,
    Extension(feed): Extension<Arc<LiveFeed>>,
    headers: HeaderMap,
) -> Result<Response> {
    subscribe(Subscription { feed, context, run: Some(id) }, &headers).await
}

pub(crate) async fn runs(
    context: RequestContext,
    Extension(feed): Extension<Arc<LiveFeed>>,
    headers: HeaderMap,
    _: StrictQuery<NoParameters>,
) -> Result<Response> {
    subscribe(Subscription { feed, context, run: None }, &headers).await
}

struct Subscription {
    feed: Arc<LiveFeed>,
    context: RequestContext,
    /// Run id; `None` for all open runs.
    run: Option<String>,
}

#[derive(Serialize, ToSchema)]
pub(crate) struct LiveRunsJson {
    runs: Vec<LiveRunJson>,
}

struct Snapshot {
    id: String,
    data: String,
    is_last: bool,
}

impl Subscription {
    /// Returns the current state; `None` for an unknown run.
    async fn read(&self) -> Result<Option<Snapshot>> {
        let (data, is_last) = match &self.run {
            Some(id) => match self.feed.run(&self.context, id).await? {
                Some(live) => (with_named_times(&live.json())?, !live.run.line.state.is_open()),
                None => return Ok(None),
            },
            None => {
                let runs = self.feed.runs(&self.context).await?.iter().map(LiveRunView::json).collect();
                (with_named_times(&LiveRunsJson { runs })?, false)
            }
        };
        let data = data.to_string();
        let id = blake3::hash(data.as_bytes()).to_hex()[..16].to_owned();
        Ok(Some(Snapshot { id, data, is_last }))
    }

    fn event(&self, snapshot: &Snapshot) -> Event {
        let name = if self.run.is_some() { "run" } else { "runs" };
        Event::default().event(name).id(&snapshot.id).retry(RECONNECT_DELAY).data(&snapshot.data)
    }

    /// Sends changes until the run ends, the client disconnects, or the stream's lifetime is over.
    async fn send_changes(
        self,
        mut snapshot: Snapshot,
        mut sent: String,
        sender: mpsc::Sender<Result<Event, Infallible>>,
        _permit: OwnedSemaphorePermit,
    ) {
        let end = Instant::now() + STREAM_LIFETIME;
        loop {
            if snapshot.id != sent {
                let event = self.event(&snapshot);
                sent.clone_from(&snapshot.id);
                if sender.send(Ok(event)).await.is_err() {
                    return;
                }
            }
            if snapshot.is_last || Instant::now() >= end {
                return;
            }
            tokio::select! {
                () = sleep(INTERVAL) => {}
                () = sender.closed() => return,
                () = shut_down(self.feed.closed.clone()) => return,
            }
            snapshot = match self.read().await {
                Ok(Some(snapshot)) => snapshot,
                Ok(None) | Err(_) => return,
            };
        }
    }
}

async fn shut_down(closed: Option<watch::Receiver<()>>) {
    match closed {
        // The sender never sends: this completes when the sender is dropped.
        Some(mut closed) => drop(closed.changed().await),
        None => std::future::pending().await,
    }
}

async fn subscribe(subscription: Subscription, headers: &HeaderMap) -> Result<Response> {
    let unknown = || RequestError::unknown("run", subscription.run.clone().unwrap_or_default());
    let snapshot = subscription.read().await?.ok_or_else(unknown)?;
    let sent = headers.get(LAST_EVENT_ID).and_then(|id| id.to_str().ok()).unwrap_or_default().to_owned();
    if snapshot.is_last && sent == snapshot.id {
        // By the specification, browsers do not reconnect after a 204.
        return Ok((StatusCode::NO_CONTENT, [(header::CACHE_CONTROL, "no-store")]).into_response());
    }
    let permits = subscription.feed.permits.clone();
    let permit =
        permits.try_acquire_owned().map_err(|_| RequestError::Followed { limit: MAX_SUBSCRIBERS })?;
    let (sender, events) = mpsc::channel(1);
    tokio::spawn(subscription.send_changes(snapshot, sent, sender, permit));
    let events = Sse::new(ReceiverStream::new(events)).keep_alive(KeepAlive::new().interval(HEARTBEAT));
    let mut response = (Extension(Streaming), events).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(UNBUFFERED, HeaderValue::from_static("no"));
    Ok(response)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Order;
    use avln_store::RunLine;

    const NOW_MS: i64 = 100_000;

    #[derive(Clone, Debug, Default)]
    struct FakeStatus {
        session: Option<LiveSession>,
        draining: Option<String>,
    }

    impl LiveStatus for FakeStatus {
        fn session(&self, _: &str) -> Option<LiveSession> {
            self.session.clone()
        }
        fn draining(&self) -> Option<String> {
            self.draining.clone()
        }
        fn announcement(&self) -> String {
            String::new()
        }
    }

    fn run(state: RunState, playing: u32, steps_visible: bool) -> LiveRun {
        let line = RunLine {
            run: "run_a".to_owned(),
            phase: "open".to_owned(),
            team: "t".to_owned(),
            reference: None,
            verified: false,
            disqualified: None,
            method: "m".to_owned(),
            version: "1".to_owned(),
            method_type: None,
            order: Order::Ordered,
            state,
            episodes: 9,
            done: 3,
            isr: None,
            created_unix_ms: 1,
            finished_unix_ms: None,
        };
        LiveRun { line, playing, steps_visible }
    }

    fn text(run: LiveRun, status: &FakeStatus) -> LiveText {
        LiveRunView::new(run, Some(status), NOW_MS).text()
    }

    fn connected(slots: Vec<LiveSlot>) -> FakeStatus {
        FakeStatus { session: Some(LiveSession { is_connected: true, slots }), draining: None }
    }

    fn slot(slot: u32, since_unix_ms: i64) -> LiveSlot {
        LiveSlot { slot, step: 5, last_step_s: Some(0.25), mean_step_s: Some(0.5), since_unix_ms }
    }

    #[test]
    fn waiting_sides_are_named() {
        let waits = |state, playing, status: &FakeStatus| text(run(state, playing, true), status).waits;
        let none = FakeStatus::default();
        assert_eq!(waits(RunState::Created, 0, &none), "the run waits for its agent to connect");
        assert!(waits(RunState::Running, 0, &none).ends_with("connect and request the next episode"));
        assert_eq!(waits(RunState::Running, 1, &none), "open episodes wait for their agent to reconnect");
        assert_eq!(waits(RunState::Completed, 0, &none), "none: the run has ended");
        let lost = FakeStatus { session: Some(LiveSession::default()), draining: None };
        assert!(waits(RunState::Running, 1, &lost).ends_with("the connection is lost"));
        assert!(waits(RunState::Running, 0, &connected(vec![])).contains("to request an episode"));
        let fast = connected(vec![slot(0, NOW_MS - 1000)]);
        assert_eq!(waits(RunState::Running, 1, &fast), "none: episodes are in progress");
        let slow = connected(vec![slot(0, NOW_MS - 1000), slot(1, NOW_MS - 40_000)]);
        assert_eq!(waits(RunState::Running, 2, &slow), "slot 1 has waited for its agent since 00:01:00 UTC");
        let stopping = FakeStatus { session: None, draining: Some("new disks".to_owned()) };
        assert!(waits(RunState::Running, 0, &stopping).ends_with("restart of the server: new disks"));
    }

    #[test]
    fn hidden_steps_leave_only_counts() {
        let status = connected(vec![slot(0, NOW_MS), slot(1, 5)]);
        let shown = text(run(RunState::Running, 2, true), &status);
        assert_eq!(shown.episodes, "3 of 9 done, 2 in progress");
        assert_eq!(shown.pace, "4.0 steps per second, last step 0.25 s");
        let hidden = LiveRunView::new(run(RunState::Running, 2, false), Some(&status), NOW_MS);
        let text = hidden.text();
        assert_eq!((text.episodes, text.pace.as_str()), (shown.episodes, NOTHING));
        assert_eq!(text.waits, "none: episodes are in progress");
        let json = serde_json::to_value(hidden.json()).expect("JSON");
        assert_eq!(
            (&json["slots"], &json["steps_per_s"]),
            (&serde_json::json!([]), &serde_json::Value::Null)
        );
    }
}
