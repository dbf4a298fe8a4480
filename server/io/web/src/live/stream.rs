//! Server-Sent Events of runs under way. Each event tells everything, so one that was missed is missed by nobody.

use super::{Live, Lookout, MAX_RUNS};
use crate::{
    api::name_moments,
    door::MAX_CONNECTIONS,
    guard::Streamed,
    trouble::Trouble,
    visit::{Asked, Nothing, Visit, now_unix_ms},
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
use serde_json::{Value, json};
use std::{convert::Infallible, sync::Arc, time::Duration};
use tokio::{
    sync::{OwnedSemaphorePermit, Semaphore, mpsc, watch},
    time::{Instant, sleep},
};
use tokio_stream::wrappers::ReceiverStream;

/// Visitors who follow runs at a time: a quarter of those that the door lets in, so that it answers pages whoever follows what.
const MAX_LISTENERS: usize = MAX_CONNECTIONS / 4;
/// Time between two events at least.
const EVERY: Duration = Duration::from_secs(1);
/// After so long without an event a visitor is told that the server is there.
const HEARTBEAT: Duration = Duration::from_secs(15);
/// After this a visitor is to come again, before the door asks it to; whether its token is still valid is looked up then.
const LIFE: Duration = Duration::from_secs(50);
/// When to come again.
const RETRY: Duration = Duration::from_secs(2);
/// What a visitor says that it was told last.
const LAST_EVENT_ID: HeaderName = HeaderName::from_static("last-event-id");
/// What tells nginx to hand events on as they come.
const UNBUFFERED: HeaderName = HeaderName::from_static("x-accel-buffering");

/// Who knows what is played, and how many follow it.
#[derive(Debug)]
pub(crate) struct Hub {
    lookout: Option<Arc<dyn Lookout>>,
    places: Arc<Semaphore>,
    /// Ends when the door closes; `None` where it never does.
    closed: Option<watch::Receiver<()>>,
}

impl Hub {
    pub(crate) fn new(lookout: Option<Arc<dyn Lookout>>, closed: Option<watch::Receiver<()>>) -> Self {
        Self { lookout, places: Arc::new(Semaphore::new(MAX_LISTENERS)), closed }
    }

    /// A run under way; `None` when there is none that the visitor may know of.
    pub(crate) async fn run(&self, visit: &Visit, id: &str) -> Result<Option<Live>, Trouble> {
        let run = visit.reader.live_run(&visit.viewer, id).await?;
        Ok(run.map(|run| Live::new(run, self.lookout.as_deref(), now_unix_ms())))
    }

    /// All runs under way that the visitor may know of.
    pub(crate) async fn runs(&self, visit: &Visit) -> Result<Vec<Live>, Trouble> {
        let runs = visit.reader.live_runs(&visit.viewer, MAX_RUNS).await?;
        Ok(runs.into_iter().map(|run| Live::new(run, self.lookout.as_deref(), now_unix_ms())).collect())
    }
}

/// How a run goes on.
pub(crate) async fn run(
    visit: Visit,
    Path(id): Path<String>,
    Extension(hub): Extension<Arc<Hub>>,
    headers: HeaderMap,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    follow(Watch { hub, visit, run: Some(id) }, &headers).await
}

/// How all runs go on that are under way.
pub(crate) async fn runs(
    visit: Visit,
    Extension(hub): Extension<Arc<Hub>>,
    headers: HeaderMap,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    follow(Watch { hub, visit, run: None }, &headers).await
}

/// What a visitor follows.
struct Watch {
    hub: Arc<Hub>,
    visit: Visit,
    /// The run; `None` for all that are under way.
    run: Option<String>,
}

/// How things stand.
struct Told {
    /// Tells this from how they stood before.
    id: String,
    data: String,
    is_over: bool,
}

impl Watch {
    /// How things stand now; `None` when there is no such run.
    async fn look(&self) -> Result<Option<Told>, Trouble> {
        let (mut data, is_over) = match &self.run {
            Some(id) => match self.hub.run(&self.visit, id).await? {
                Some(live) => (live.json(), !live.run.line.state.is_open()),
                None => return Ok(None),
            },
            None => {
                let runs: Vec<Value> = self.hub.runs(&self.visit).await?.iter().map(Live::json).collect();
                (json!({ "runs": runs }), false)
            }
        };
        name_moments(&mut data);
        let data = data.to_string();
        let id = blake3::hash(data.as_bytes()).to_hex()[..16].to_owned();
        Ok(Some(Told { id, data, is_over }))
    }

    fn event(&self, told: &Told) -> Event {
        let name = if self.run.is_some() { "run" } else { "runs" };
        Event::default().event(name).id(&told.id).retry(RETRY).data(&told.data)
    }

    /// Tells what changes until the run is over, the visitor has gone, or it is time to come again.
    async fn pour(
        self,
        mut told: Told,
        mut known: String,
        sender: mpsc::Sender<Result<Event, Infallible>>,
        _place: OwnedSemaphorePermit,
    ) {
        let end = Instant::now() + LIFE;
        loop {
            if told.id != known {
                let event = self.event(&told);
                known.clone_from(&told.id);
                if sender.send(Ok(event)).await.is_err() {
                    return;
                }
            }
            if told.is_over || Instant::now() >= end {
                return;
            }
            tokio::select! {
                () = sleep(EVERY) => {}
                () = sender.closed() => return,
                () = closed(self.hub.closed.clone()) => return,
            }
            told = match self.look().await {
                Ok(Some(told)) => told,
                Ok(None) | Err(_) => return,
            };
        }
    }
}

/// Ends when the door closes.
async fn closed(closed: Option<watch::Receiver<()>>) {
    match closed {
        // The sender never sends: this ends when it is dropped.
        Some(mut closed) => drop(closed.changed().await),
        None => std::future::pending().await,
    }
}

async fn follow(watch: Watch, headers: &HeaderMap) -> Result<Response, Trouble> {
    let unknown = || Trouble::Unknown { what: "run", name: watch.run.clone().unwrap_or_default() };
    let told = watch.look().await?.ok_or_else(unknown)?;
    let known = headers.get(LAST_EVENT_ID).and_then(|id| id.to_str().ok()).unwrap_or_default().to_owned();
    if told.is_over && known == told.id {
        // Nothing is to come: whoever gets this does not come again.
        return Ok((StatusCode::NO_CONTENT, [(header::CACHE_CONTROL, "no-store")]).into_response());
    }
    let places = watch.hub.places.clone();
    let place = places.try_acquire_owned().map_err(|_| Trouble::Followed { limit: MAX_LISTENERS })?;
    let (sender, events) = mpsc::channel(1);
    tokio::spawn(watch.pour(told, known, sender, place));
    let events = Sse::new(ReceiverStream::new(events)).keep_alive(KeepAlive::new().interval(HEARTBEAT));
    let mut response = (Extension(Streamed), events).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, header::HeaderValue::from_static("no-store"));
    headers.insert(UNBUFFERED, header::HeaderValue::from_static("no"));
    Ok(response)
}
