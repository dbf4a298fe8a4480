//! Integration tests of the web application: a real database and real requests, mostly without a network. This file has the
//! fixture: an arena with a public phase, played by two teams, and a hidden phase, played by one of them.

mod api;
mod golden;
mod live;
mod management;
mod pages;
mod replay;
mod site;

use avln_challenge::{MethodInfo, MethodType};
use avln_episode::{EndReason, Modality, Order, Rules, Sensors};
use avln_scoring::Metrics;
use avln_store::{
    EpisodeResult, GoalText, NewRun, NewToken, Phase, PhaseEpisode, Scene, SceneMap, Split, Store,
    TimeAccount, TokenScope, Visibility,
};
use avln_web::{Documents, LiveStatus, Management, ReplayRenderer, SignedLogs, Site};
use axum::{
    Router,
    body::Body,
    http::{HeaderMap, Request, StatusCode, header},
};
use http_body_util::BodyExt;
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::{Arc, LazyLock},
};
use tempfile::TempDir;
use tower::ServiceExt;

pub(crate) const RUDE_TEAM: &str = "<script>alert(1)</script>";
pub(crate) const FORMULA_TEAM: &str = "=1+1";
pub(crate) const RUDE_SENTENCE: &str = "a chair & a <b>table</b>";
pub(crate) const LOG_KEY: &str = "abcdef";
pub(crate) const TOKEN: &str = "the-token-of-the-rude-team";
pub(crate) const ORGANISER: &str = "the-token-of-the-organiser";

#[derive(Clone)]
pub(crate) struct Arena {
    pub(crate) folder: Arc<TempDir>,
    pub(crate) store: Store,
    router: Router,
}

/// A complete response.
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: String,
}

pub(crate) struct Follower {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    body: Body,
}

/// A received event.
#[derive(Debug)]
pub(crate) struct Event {
    pub(crate) id: String,
    pub(crate) name: String,
    pub(crate) data: Value,
}

impl Follower {
    /// Returns the next event; `None` after the end of the stream. Skips heartbeats.
    pub(crate) async fn next(&mut self) -> Option<Event> {
        loop {
            let frame = self.body.frame().await?.expect("a frame").into_data().expect("no trailers");
            let text = String::from_utf8(frame.to_vec()).expect("text");
            let field = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)).map(str::to_owned);
            if let (Some(id), Some(name), Some(data)) = (field("id: "), field("event: "), field("data: ")) {
                return Some(Event { id, name, data: serde_json::from_str(&data).expect("JSON") });
            }
        }
    }
}

impl Answer {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|error| panic!("{error} in {}", self.body))
    }

    pub(crate) fn header(&self, name: header::HeaderName) -> &str {
        self.headers.get(&name).map_or("", |value| value.to_str().expect("a header in ASCII"))
    }
}

impl Arena {
    /// Phase `open` with the runs `run_rude` (all goals found), `run_formula` (half of the goals found) and `run_begun` (one
    /// of two episodes played); phase `sealed` with `run_sealed`.
    pub(crate) async fn new() -> Self {
        Self::with_documents(documents()).await
    }

    /// As [`Arena::new`], with other documents.
    pub(crate) async fn with_documents(documents: Documents) -> Self {
        Self::open(|_| Site { documents, ..Site::default() }).await
    }

    /// As [`Arena::new`], with a renderer.
    pub(crate) async fn with_renderer(replay_renderer: Option<Arc<dyn ReplayRenderer>>) -> Self {
        Self::with_live_status(replay_renderer, None).await
    }

    /// As [`Arena::new`], with a renderer and a live status.
    pub(crate) async fn with_live_status(
        replay_renderer: Option<Arc<dyn ReplayRenderer>>,
        live_status: Option<Arc<dyn LiveStatus>>,
    ) -> Self {
        Self::open(|_| Site { replay_renderer, live_status, documents: documents(), ..Site::default() }).await
    }

    /// As [`Arena::new`], with sign-in and management actions.
    pub(crate) async fn with_management(management: impl FnOnce(Store) -> Arc<dyn Management>) -> Self {
        let site =
            |store| Site { management: Some(management(store)), documents: documents(), ..Site::default() };
        Self::open(site).await
    }

    /// As [`Arena::new`], with canonical addresses.
    pub(crate) async fn with_addresses(web_url: &str, grpc_url: Option<&str>) -> Self {
        let (web_url, grpc_url) = (Some(web_url.to_owned()), grpc_url.map(str::to_owned));
        Self::open(|_| Site { web_url, grpc_url, documents: documents(), ..Site::default() }).await
    }

    async fn open(site: impl FnOnce(Store) -> Site) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(&folder.path().join("arena.db")).await.expect("a new database");
        let logs = Some(SignedLogs { folder: folder.path().to_owned(), key: LOG_KEY.to_owned() });
        let site = Site { grpc_port: 50051, logs, ..site(store.clone()) };
        let router = avln_web::router(store.reader(), site);
        let arena = Self { folder: Arc::new(folder), store, router };
        arena.furnish().await;
        arena.play("run_rude", "open", RUDE_TEAM, "good walker", 2, 2).await;
        arena.play("run_formula", "open", FORMULA_TEAM, "@walker", 1, 2).await;
        arena.play("run_begun", "open", FORMULA_TEAM, "slow walker", 1, 1).await;
        arena.play("run_sealed", "sealed", RUDE_TEAM, "secret walker", 2, 2).await;
        arena
    }

    async fn furnish(&self) {
        let split = Split { name: "val".to_owned(), digest: "d".to_owned(), scenes: 1, episodes: 2 };
        self.store.upsert_split(&split).await.expect("a split");
        let polygons = vec![vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 4.25]]];
        let map = SceneMap { min: [0.0; 3], max: [4.0, 3.0, 4.25], polygons };
        let scene = Scene { name: "canary-scene".to_owned(), digest: "s".to_owned(), map };
        self.store.upsert_scene(&scene).await.expect("a scene");
        self.store.upsert_phase(&phase("open", Visibility::Public), 1).await.expect("a phase");
        self.store.upsert_phase(&phase("sealed", Visibility::Organiser), 2).await.expect("a phase");
        for team in [RUDE_TEAM, FORMULA_TEAM] {
            self.store.create_team(team, None, 1).await.expect("a team");
        }
        self.issue(TOKEN, TokenScope::Participant, Some(RUDE_TEAM)).await;
        self.issue(ORGANISER, TokenScope::Organiser, None).await;
    }

    pub(crate) async fn issue(&self, secret: &str, kind: TokenScope, team: Option<&str>) {
        let token = NewToken { secret, kind, name: "", team, expires_unix_ms: None };
        self.store.issue_token(&token, 1).await.expect("a token");
    }

    async fn play(&self, run: &str, phase: &str, team: &str, method: &str, found: u32, episodes: u32) {
        let digests = BTreeMap::from([("benchmark".to_owned(), "abc123".to_owned())]);
        let order = Order::Unordered;
        let method = MethodInfo {
            description: "Follows <walls>".to_owned(),
            code_url: "https://code.example/a?b=1&c=2".to_owned(),
            paper_url: "javascript:alert(1)".to_owned(),
            weights_licence: "MIT".to_owned(),
            method_type: (method != "@walker").then_some(MethodType::LearntPerception),
            ..MethodInfo::new(method, "1.0")
        };
        let new = NewRun {
            id: run,
            token: run,
            phase,
            team,
            method: &method,
            order,
            client_request_id: None,
            digests: &digests,
        };
        self.store.start_run(&new, 10).await.expect("a run");
        for index in 0..episodes {
            let handle = format!("{run}-{index}");
            let assigned = self.store.assign_next_episode(run, &handle, 20).await.expect("an open run");
            let episode = assigned.expect("an episode").episode;
            self.finish(run, &handle, &episode, found, EndReason::FinalSubmit).await;
        }
    }

    /// Starts a run of the rude team with one episode.
    pub(crate) async fn begin(&self, run: &str, phase: &str, digests: &BTreeMap<String, String>) {
        let new = NewRun {
            id: run,
            token: run,
            phase,
            team: RUDE_TEAM,
            method: &MethodInfo::new("beginner", "1.0"),
            order: Order::Unordered,
            client_request_id: None,
            digests,
        };
        self.store.start_run(&new, 10).await.expect("a run");
        let assigned = self.store.assign_next_episode(run, "begun", 20).await.expect("an open run");
        assert!(assigned.is_some());
    }

    /// Starts the next episode of a run and disconnects the agent.
    pub(crate) async fn lose(&self, run: &str) {
        let assigned = self.store.assign_next_episode(run, "lost", 20).await.expect("an open run");
        let episode = assigned.expect("an episode").episode;
        self.finish(run, "lost", &episode, 1, EndReason::Disconnected).await;
    }

    /// Stores an episode. Its hidden parts are JSON, because this crate cannot name their types.
    async fn finish(&self, run: &str, handle: &str, episode: &str, found: u32, end: EndReason) {
        let finished = EpisodeResult {
            run,
            handle,
            truth: &serde_json::from_value(truth(episode)).expect("a truth"),
            record: &serde_json::from_value(record(found, end)).expect("a record"),
            metrics: &metrics(found),
            time: &TimeAccount { simulation_s: 0.5, thinking_s: 1.5, ..TimeAccount::default() },
        };
        self.store.record_result(&finished, 30).await.expect("a result");
    }

    pub(crate) async fn ask(&self, request: Request<Body>) -> Answer {
        let response = self.router.clone().oneshot(request).await.expect("an answer");
        let (parts, body) = response.into_parts();
        let body = body.collect().await.expect("a body").to_bytes();
        let body = String::from_utf8_lossy(&body).into_owned();
        Answer { status: parts.status, headers: parts.headers, body }
    }

    pub(crate) async fn get(&self, address: &str) -> Answer {
        self.ask(Request::get(address).body(Body::empty()).expect("a request")).await
    }

    /// Returns a response with an unread body.
    pub(crate) async fn follow(&self, address: &str, headers: &[(&str, &str)]) -> Follower {
        let mut request = Request::get(address);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let request = request.body(Body::empty()).expect("a request");
        let response = self.router.clone().oneshot(request).await.expect("an answer");
        let (parts, body) = response.into_parts();
        Follower { status: parts.status, headers: parts.headers, body }
    }

    /// Returns the body size, and the headers.
    pub(crate) async fn measure(&self, request: Request<Body>) -> (usize, HeaderMap) {
        let (_, headers, body) = self.bytes(request).await;
        (body.len(), headers)
    }

    /// Returns status, headers and body.
    pub(crate) async fn bytes(&self, request: Request<Body>) -> (StatusCode, HeaderMap, Vec<u8>) {
        let response = self.router.clone().oneshot(request).await.expect("an answer");
        let (parts, body) = response.into_parts();
        (parts.status, parts.headers, body.collect().await.expect("a body").to_bytes().to_vec())
    }

    pub(crate) async fn get_as(&self, address: &str, token: &str) -> Answer {
        let request = Request::get(address).header(header::AUTHORIZATION, format!("Bearer {token}"));
        self.ask(request.body(Body::empty()).expect("a request")).await
    }
}

/// Root of the repository.
pub(crate) fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")
}

/// The repository's documents, read at run time: a changed document rebuilds no test.
pub(crate) fn documents() -> Documents {
    static DOCUMENTS: LazyLock<Documents> = LazyLock::new(read_documents);
    DOCUMENTS.clone()
}

fn read_documents() -> Documents {
    let read = |path: &str| fs::read_to_string(repository().join(path)).expect(path);
    let summary = read("docs/SUMMARY.md");
    let paths = listed(&summary);
    let texts: Vec<String> = paths.iter().map(|path| read(path)).collect();
    let files: Vec<_> = paths.iter().map(String::as_str).zip(texts.iter().map(String::as_str)).collect();
    Documents::new(&summary, &files)
}

/// Returns the repository paths in the table of contents.
pub(crate) fn listed(summary: &str) -> Vec<String> {
    let links = summary.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let path = |link: &str| link.strip_prefix("../").map_or_else(|| format!("docs/{link}"), str::to_owned);
    links.map(path).collect()
}

pub(crate) fn phase(id: &str, visibility: Visibility) -> Phase {
    let goals = vec![
        GoalText { modality: Modality::Category, text: Some("chair".to_owned()) },
        GoalText { modality: Modality::Description, text: Some(RUDE_SENTENCE.to_owned()) },
    ];
    let episode = |index| PhaseEpisode {
        episode: format!("canary-episode-{index}"),
        scene: "canary-scene".to_owned(),
        goals: goals.clone(),
    };
    Phase {
        title: format!("The {id} phase"),
        orders: vec![Order::Unordered, Order::Ordered],
        sensors: Sensors::all(256, 256),
        scores: visibility,
        replays: visibility,
        ..Phase::new(id, "val", Rules::paper(), (0..2).map(episode).collect())
    }
}

fn truth(episode: &str) -> Value {
    let target = |category: &str, modality: &str| {
        json!({
            "instance": 1, "category": category, "modality": modality,
            "bounds": { "min": [1.0, 0.0, 1.0], "max": [2.0, 1.0, 2.0] }, "source": [1.5, 0.5, 1.5],
            "floor_y_m": 0.0, "region": [[1.0, 0.0, 0.5]], "viewpoints": [], "start_distance_m": 1.0,
        })
    };
    json!({
        "episode": episode, "scene": "canary-scene", "seed": 7, "order": "unordered",
        "start": { "position": [0.5, 0.0, 2.0], "heading_rad": 0.0 },
        "targets": [target("chair", "category"), target("<i>table</i>", "description")],
        "reference_m": 1.0, "reference_path": [[0.5, 0.0, 2.0], [1.5, 0.0, 1.0]],
    })
}

fn record(found: u32, end: EndReason) -> Value {
    let pose = |z: f64| json!({ "position": [0.5, 0.0, z], "heading_rad": 0.0 });
    let step = |index: u32| {
        let action = if index < 4 { "MoveForward" } else { "Submit" };
        json!({
            "action": action, "pose": pose(2.0 - 0.25 * f64::from(index.min(3) + 1)), "collided": index == 2,
            "in_region": 0, "sounding": 0, "state_hash": 5,
        })
    };
    let submit =
        |goal: u32| json!({ "step": 5 + goal, "completed": (goal < found).then_some(goal), "skipped": null });
    json!({
        "rules": Rules::PAPER, "start": pose(2.0), "steps": (0..6).map(step).collect::<Vec<_>>(),
        "submits": (0..2).map(submit).collect::<Vec<_>>(), "in_region_at_start": [false, false],
        "final_distance_m": [0.5, null], "end": end,
    })
}

fn metrics(found: u32) -> Metrics {
    let isr = f64::from(found) / 2.0;
    let sr = if found == 2 { 1.0 } else { 0.0 };
    Metrics {
        goals: 2,
        found,
        sr,
        isr,
        osr: isr,
        osr_all: sr,
        spl: sr,
        soft_spl: isr,
        sna: sr,
        steps: 6,
        path_m: 1.0,
        reference_m: 1.0,
        collisions: 1,
        wrong_submits: 2 - found,
        wrong_instance_submits: 0,
        steps_to_goal: (0..2).map(|goal| (goal < found).then_some(5 + goal)).collect(),
        final_distance_m: vec![Some(0.5), None],
    }
}
