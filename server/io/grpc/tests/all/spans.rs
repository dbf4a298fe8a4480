//! Spans of a run, captured by a subscriber of the process.
//!
//! A subscriber of one thread would miss spans: tracing asks the thread that reaches a span first whether the span is wanted, and
//! applies the answer to all threads. With one server per thread, the thread of a span's creation names the test.

use crate::common::{Agent, Plan, Quirk, RUN, RUN_TOKEN, TestServer};
use avln_proto::v1::{self, play_request::Frame as Up};
use std::{
    collections::BTreeMap,
    fmt::Debug,
    sync::{LazyLock, Mutex},
    thread::{self, ThreadId},
};
use tracing::{
    Subscriber,
    field::{Field, Visit},
    span::{Attributes, Id, Record},
};
use tracing_subscriber::{
    layer::{Context, Layer, SubscriberExt},
    registry::LookupSpan,
    util::SubscriberInitExt,
};

const FORWARD: i32 = 1;
const SUBMIT: i32 = 4;
const STOP: i32 = 5;

/// A span with its ancestors, outermost first.
#[derive(Clone, Debug)]
struct SeenSpan {
    id: Id,
    thread: ThreadId,
    path: Vec<&'static str>,
    fields: BTreeMap<&'static str, String>,
}

impl SeenSpan {
    fn field(&self, name: &str) -> &str {
        self.fields.get(name).map_or("", String::as_str)
    }
}

impl Visit for SeenSpan {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        self.fields.insert(field.name(), format!("{value:?}"));
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.fields.insert(field.name(), value.to_owned());
    }
}

/// A layer that records the spans of this crate, oldest first.
#[derive(Default)]
struct Recorder(Mutex<Vec<SeenSpan>>);

static RECORDER: LazyLock<&Recorder> = LazyLock::new(|| {
    let recorder: &Recorder = Box::leak(Box::default());
    tracing_subscriber::registry().with(recorder).init();
    recorder
});

impl Recorder {
    /// Returns the spans named `name` that this thread created.
    fn spans(&self, name: &str) -> Vec<SeenSpan> {
        let mut spans = self.0.lock().unwrap().clone();
        spans.retain(|span| span.thread == thread::current().id() && span.path.last() == Some(&name));
        spans.sort_by_key(|span| span.field("step").parse::<u32>().unwrap_or_default());
        spans
    }

    fn only(&self, name: &str) -> SeenSpan {
        let spans = self.spans(name);
        assert_eq!(spans.len(), 1, "{spans:?}");
        spans[0].clone()
    }
}

impl<S: Subscriber + for<'l> LookupSpan<'l>> Layer<S> for &'static Recorder {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        if !attributes.metadata().target().starts_with("avln_grpc") {
            return;
        }
        let path = context.span_scope(id).unwrap().from_root().map(|span| span.name()).collect();
        let mut seen =
            SeenSpan { id: id.clone(), thread: thread::current().id(), path, fields: BTreeMap::new() };
        attributes.record(&mut seen);
        self.0.lock().unwrap().push(seen);
    }

    fn on_record(&self, id: &Id, values: &Record<'_>, _: Context<'_, S>) {
        // The registry gives a closed span's id away again: the last span is meant.
        if let Some(seen) = self.0.lock().unwrap().iter_mut().rev().find(|seen| seen.id == *id) {
            values.record(seen);
        }
    }
}

#[tokio::test]
async fn steps_nest_in_episode_session_and_run() {
    let recorder = *RECORDER;
    let server = TestServer::open(Plan::plain(1)).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    for (step, action) in [(1, FORWARD), (2, STOP)] {
        agent.act(0, &start.episode, step, action).await;
        agent.observation().await;
    }
    agent.episode_end().await;
    agent.send(Up::Ready(v1::Ready { slot: 0 })).await;
    agent.run_end().await;

    let (run, session) = (recorder.only("run"), recorder.only("session"));
    assert_eq!((&run.path[..], run.field("run")), (&["run"][..], RUN));
    assert_eq!(run.field("outcome"), "completed");
    assert_eq!((&session.path[..], session.field("outcome")), (&["run", "session"][..], "nothing_left"));
    let episodes = recorder.spans("episode");
    let played = episodes.iter().find(|episode| episode.field("episode") == start.episode).unwrap();
    assert_eq!(played.path, ["run", "session", "episode"]);
    assert_eq!((played.field("slot"), played.field("ordinal"), played.field("steps")), ("0", "1", "2"));
    assert_eq!(played.field("outcome"), "stopped");
    let steps = recorder.spans("step");
    assert_eq!(steps.len(), 2);
    for (step, outcome) in steps.iter().zip(["continues", "stopped"]) {
        assert_eq!(step.path, ["run", "session", "episode", "step"]);
        assert_eq!(step.field("outcome"), outcome);
        for part in ["thinking_ms", "queue_ms", "simulation_ms", "encoding_ms"] {
            assert!(step.field(part).parse::<f64>().unwrap() >= 0.0, "{step:?}");
        }
    }
    for span in [&run, &session, played].into_iter().chain(&steps) {
        assert!(span.field("duration_ms").parse::<f64>().unwrap() > 0.0, "{span:?}");
        assert!(span.fields.values().all(|value| !value.contains(RUN_TOKEN)), "{span:?}");
    }
}

#[tokio::test]
async fn failed_steps_have_an_outcome() {
    let recorder = *RECORDER;
    let server = TestServer::open(Plan::odd(vec![Quirk::Fragile])).await;
    let mut agent = Agent::enter(&server, 1).await;
    let start = agent.ready(0).await;
    agent.act(0, &start.episode, 1, SUBMIT).await;
    agent.fault().await;
    agent.episode_end().await;
    let (step, episode) = (recorder.only("step"), recorder.only("episode"));
    assert_eq!((step.field("action"), step.field("outcome")), ("Submit", "server_fault"));
    assert_eq!((episode.field("steps"), episode.field("outcome")), ("0", "server_fault"));
}
