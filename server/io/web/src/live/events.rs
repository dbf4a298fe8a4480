//! Server-Sent Events for open runs. Every event holds the complete state, so a lost event does no harm.

use super::{LiveRunJson, LiveRunView, LiveStatus, MAX_RUNS};
use crate::{
    error::RequestError,
    middleware::Streaming,
    request::{NoParameters, RequestContext, StrictQuery, now_unix_ms},
    server::MAX_CONNECTIONS,
};
use axum::{
    Extension,
    extract::Path,
    http::{HeaderMap, HeaderName, StatusCode, header},
    response::{
        IntoResponse, Response,
        sse::{Event, KeepAlive, Sse},
    },
};
use serde::Serialize;
use std::{convert::Infallible, sync::Arc, time::Duration};
use tokio::{
    sync::{OwnedSemaphorePermit, Semaphore, mpsc, watch},
    time::{Instant, sleep},
};
use tokio_stream::wrappers::ReceiverStream;

/// Subscriber limit: a quarter of all connections, so that pages remain available.
const MAX_SUBSCRIBERS: usize = MAX_CONNECTIONS / 4;
/// Shortest time between two events.
const INTERVAL: Duration = Duration::from_secs(1);
/// Interval between comments that keep an idle connection open.
const HEARTBEAT: Duration = Duration::from_secs(15);
/// Stream lifetime, shorter than that of a connection. The browser then reconnects, which repeats the token check.
const STREAM_LIFETIME: Duration = Duration::from_secs(50);
/// Delay before a browser reconnects.
const RECONNECT_DELAY: Duration = Duration::from_secs(2);
const LAST_EVENT_ID: HeaderName = HeaderName::from_static("last-event-id");
/// Header that makes nginx forward events without buffering.
const UNBUFFERED: HeaderName = HeaderName::from_static("x-accel-buffering");

/// Live runs with a subscriber limit.
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

    /// Returns a run; `None` if the viewer may not see it.
    pub(crate) async fn run(
        &self,
        context: &RequestContext,
        id: &str,
    ) -> Result<Option<LiveRunView>, RequestError> {
        let run = context.reader.live_run(&context.viewer, id).await?;
        Ok(run.map(|run| LiveRunView::new(run, self.live_status.as_deref(), now_unix_ms())))
    }

    /// Returns all open runs that the viewer may see.
    pub(crate) async fn runs(&self, context: &RequestContext) -> Result<Vec<LiveRunView>, RequestError> {
        let runs = context.reader.live_runs(&context.viewer, MAX_RUNS).await?;
        let view = |run| LiveRunView::new(run, self.live_status.as_deref(), now_unix_ms());
        Ok(runs.into_iter().map(view).collect())
    }
}

/// Streams a run's state.
pub(crate) async fn run(
    context: RequestContext,
    Path(id): Path<String>,
    Extension(feed): Extension<Arc<LiveFeed>>,
    headers: HeaderMap,
    _: StrictQuery<NoParameters>,
) -> Result<Response, RequestError> {
    subscribe(Subscription { feed, context, run: Some(id) }, &headers).await
}

/// Streams the state of all open runs.
pub(crate) async fn runs(
    context: RequestContext,
    Extension(feed): Extension<Arc<LiveFeed>>,
    headers: HeaderMap,
    _: StrictQuery<NoParameters>,
) -> Result<Response, RequestError> {
    subscribe(Subscription { feed, context, run: None }, &headers).await
}

struct Subscription {
    feed: Arc<LiveFeed>,
    context: RequestContext,
    /// Run id; `None` for all open runs.
    run: Option<String>,
}

/// All open runs for programs.
#[derive(Serialize)]
pub(crate) struct LiveRunsJson {
    runs: Vec<LiveRunJson>,
}

struct Snapshot {
    /// Data hash.
    id: String,
    data: String,
    /// True if the run has ended.
    is_last: bool,
}

impl Subscription {
    /// Returns the current state; `None` for an unknown run.
    async fn read(&self) -> Result<Option<Snapshot>, RequestError> {
        let (data, is_last) = match &self.run {
            Some(id) => match self.feed.run(&self.context, id).await? {
                Some(live) => (serde_json::to_string(&live.json())?, !live.run.line.state.is_open()),
                None => return Ok(None),
            },
            None => {
                let runs = self.feed.runs(&self.context).await?.iter().map(LiveRunView::json).collect();
                (serde_json::to_string(&LiveRunsJson { runs })?, false)
            }
        };
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

/// Completes when the server shuts down.
async fn shut_down(closed: Option<watch::Receiver<()>>) {
    match closed {
        // The sender never sends: this completes when the sender is dropped.
        Some(mut closed) => drop(closed.changed().await),
        None => std::future::pending().await,
    }
}

async fn subscribe(subscription: Subscription, headers: &HeaderMap) -> Result<Response, RequestError> {
    let unknown =
        || RequestError::Unknown { what: "run", name: subscription.run.clone().unwrap_or_default() };
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
    headers.insert(header::CACHE_CONTROL, header::HeaderValue::from_static("no-store"));
    headers.insert(UNBUFFERED, header::HeaderValue::from_static("no"));
    Ok(response)
}
