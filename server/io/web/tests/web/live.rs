use crate::fixture::{Arena, TOKEN};
use avln_web::{LiveStatus, LiveSession, Site, LiveSlot};
use axum::http::{StatusCode, header};
use std::{
    sync::{Arc, Mutex},
    time::Duration,
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    sync::oneshot,
    time::timeout,
};

const EVENTS: &str = "/api/v1/runs/run_begun/events";

/// Knows of one slot in every run, as far as somebody says.
#[derive(Debug, Default)]
struct Tower(Mutex<u32>);

impl Tower {
    fn step(&self, step: u32) {
        *self.0.lock().expect("nobody broke") = step;
    }
}

impl LiveStatus for Tower {
    fn session(&self, _: &str) -> Option<LiveSession> {
        let step = *self.0.lock().expect("nobody broke");
        let since_unix_ms = 1000 * i64::from(step);
        let slot = LiveSlot { slot: 0, step, last_step_s: Some(0.5), mean_step_s: Some(0.25), since_unix_ms };
        Some(LiveSession { is_connected: true, slots: vec![slot] })
    }

    fn draining(&self) -> Option<String> {
        None
    }
}

async fn watched() -> (Arena, Arc<Tower>) {
    let tower = Arc::new(Tower::default());
    (Arena::watched_by(None, Some(tower.clone())).await, tower)
}

#[tokio::test]
async fn a_run_under_way_is_followed_event_by_event() {
    let (arena, tower) = watched().await;
    tower.step(7);
    let mut follower = arena.follow(EVENTS, &[("accept-encoding", "gzip")]).await;
    assert_eq!(
        (follower.status, &follower.headers[header::CACHE_CONTROL]),
        (StatusCode::OK, &"no-store".parse().expect("ASCII"))
    );
    assert!(!follower.headers.contains_key(header::CONTENT_ENCODING), "what is packed comes late");
    assert_eq!(follower.headers["x-accel-buffering"], "no", "a proxy in between hands it on");
    let first = follower.next().await.expect("how things stand");
    assert_eq!((first.name.as_str(), &first.data["state"]), ("run", &"running".into()));
    assert_eq!((&first.data["done"], &first.data["episodes"]), (&1.into(), &2.into()));
    assert_eq!((&first.data["slots"][0]["step"], &first.data["steps_per_s"]), (&7.into(), &4.0.into()));
    assert_eq!(first.data["words"]["pace"], "4.0 steps a second, the last step took 0.50 s");
    tower.step(8);
    let second = follower.next().await.expect("a change");
    assert_eq!(second.data["slots"][0]["step"], 8);
    assert_ne!(first.id, second.id);
    let mut known = arena.follow(EVENTS, &[("last-event-id", &second.id)]).await;
    assert!(timeout(Duration::from_millis(300), known.next()).await.is_err(), "nothing is told twice");
    arena.store.cancel_run("run_begun", 40).await.expect("a run");
    let last = follower.next().await.expect("the end");
    assert_eq!(last.data["state"], "cancelled");
    assert!(follower.next().await.is_none(), "nothing comes after the end");
    let again = arena.follow(EVENTS, &[("last-event-id", &last.id)]).await;
    assert_eq!(again.status, StatusCode::NO_CONTENT, "and nobody is to ask again");
}

#[tokio::test]
async fn all_runs_under_way_are_followed_and_others_are_not() {
    let (arena, tower) = watched().await;
    tower.step(3);
    let mut follower = arena.follow("/api/v1/runs/events", &[]).await;
    let told = follower.next().await.expect("how things stand");
    let ids: Vec<_> =
        told.data["runs"].as_array().expect("a list").iter().map(|run| run["run"].clone()).collect();
    assert_eq!((told.name.as_str(), ids), ("runs", vec!["run_begun".into()]));
    arena.store.cancel_run("run_begun", 40).await.expect("a run");
    let told = follower.next().await.expect("a change");
    assert_eq!(told.data["runs"], serde_json::json!([]));
}

#[tokio::test]
async fn a_hidden_phase_tells_its_team_counts_and_others_nothing() {
    let (arena, tower) = watched().await;
    tower.step(9);
    let digests = std::collections::BTreeMap::new();
    arena.begin("run_hidden", "sealed", &digests).await;
    let address = "/api/v1/runs/run_hidden/events";
    assert_eq!(arena.get(address).await.status, StatusCode::NOT_FOUND);
    assert!(!arena.get("/runs").await.body.contains("run_hidden"));
    let bearer = format!("Bearer {TOKEN}");
    for address in [address, "/api/v1/runs/events"] {
        let mut follower = arena.follow(address, &[("authorization", &bearer)]).await;
        let told = follower.next().await.expect("how things stand").data;
        let own = |run: &&serde_json::Value| run["run"] == "run_hidden";
        let run = told["runs"].as_array().map_or(Some(&told), |runs| runs.iter().find(own)).expect("the run");
        assert_eq!(
            (&run["run"], &run["playing"], &run["done"]),
            (&"run_hidden".into(), &1.into(), &0.into())
        );
        assert_eq!((&run["slots"], &run["steps_per_s"]), (&serde_json::json!([]), &serde_json::Value::Null));
        assert!(!told.to_string().contains("canary"), "{told}");
    }
    let page = arena.get_as("/runs/run_hidden", TOKEN).await.body;
    assert!(page.contains("0 of 2 done, 1 being played") && !page.contains("steps a second"), "{page}");
}

#[tokio::test]
async fn few_follow_at_a_time_and_the_others_are_told_why_not() {
    let (arena, _) = watched().await;
    let mut followers = Vec::new();
    for _ in 0..64 {
        let mut follower = arena.follow(EVENTS, &[]).await;
        assert!(follower.next().await.is_some());
        followers.push(follower);
    }
    let refused = arena.get(EVENTS).await;
    assert_eq!((refused.status, refused.header(header::RETRY_AFTER)), (StatusCode::TOO_MANY_REQUESTS, "5"));
    let detail = refused.json()["detail"].to_string();
    assert!(detail.contains("64 visitors follow runs already"), "{detail}");
    followers.pop();
    let mut follower = arena.follow(EVENTS, &[]).await;
    while follower.status != StatusCode::OK {
        tokio::task::yield_now().await;
        follower = arena.follow(EVENTS, &[]).await;
    }
    assert!(follower.next().await.is_some(), "a place is free again");
}

#[tokio::test]
async fn whoever_follows_is_let_go_when_the_door_closes() {
    let arena = Arena::new().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address");
    let (stop, stopped) = oneshot::channel::<()>();
    let served = tokio::spawn(avln_web::serve(listener, arena.store.reader(), Site::default(), async {
        let _ = stopped.await;
    }));
    let mut visitor = TcpStream::connect(address).await.expect("a connection");
    let request = format!("GET {EVENTS} HTTP/1.1\r\nHost: x\r\n\r\n");
    visitor.write_all(request.as_bytes()).await.expect("a request");
    let mut told = Vec::new();
    while !String::from_utf8_lossy(&told).contains("event: run") {
        assert_ne!(visitor.read_buf(&mut told).await.expect("an answer"), 0);
    }
    stop.send(()).expect("a door");
    let closed = timeout(Duration::from_secs(3), served).await.expect("the door waits for nobody");
    closed.expect("no panic").expect("no failure");
}

#[tokio::test]
async fn pages_tell_what_is_under_way_without_a_script() {
    let (arena, tower) = watched().await;
    tower.step(5);
    let list = arena.get("/runs").await.body;
    assert!(list.contains("1 run under way.") && list.contains("<tr data-run=\"run_begun\">"), "{list}");
    assert!(list.contains("data-live=\"episodes\">1 of 2 done</span>"), "{list}");
    let run = arena.get("/runs/run_begun").await.body;
    assert!(run.contains("data-events=\"/api/v1/runs/run_begun/events\""), "{run}");
    assert!(run.contains("data-live=\"pace\">4.0 steps a second"), "{run}");
    assert!(run.contains("data-live=\"waits\">slot 0 waits for its agent since 00:00:05 UTC"), "{run}");
    let over = arena.get("/runs/run_rude").await.body;
    assert!(!over.contains("data-events") && !over.contains("live.js"), "{over}");
    let blind = Arena::new().await.get("/runs/run_begun").await.body;
    assert!(blind.contains("the run waits for its agent to connect and ask for the next episode"), "{blind}");
}
