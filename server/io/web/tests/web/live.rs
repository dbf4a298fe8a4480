use crate::{Arena, TOKEN};
use avln_web::{LiveSession, LiveSlot, LiveStatus, Site};
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

/// A live status with one slot in every run, at a settable step, and a settable announcement.
#[derive(Debug, Default)]
struct FakeStatus {
    step: Mutex<u32>,
    announcement: Mutex<String>,
}

impl FakeStatus {
    fn step(&self, step: u32) {
        *self.step.lock().expect("no panic") = step;
    }

    fn announce(&self, text: &str) {
        text.clone_into(&mut self.announcement.lock().expect("no panic"));
    }
}

impl LiveStatus for FakeStatus {
    fn session(&self, _: &str) -> Option<LiveSession> {
        let step = *self.step.lock().expect("no panic");
        let since_unix_ms = 1000 * i64::from(step);
        let slot = LiveSlot { slot: 0, step, last_step_s: Some(0.5), mean_step_s: Some(0.25), since_unix_ms };
        Some(LiveSession { is_connected: true, slots: vec![slot] })
    }

    fn draining(&self) -> Option<String> {
        None
    }

    fn announcement(&self) -> String {
        self.announcement.lock().expect("no panic").clone()
    }
}

async fn watched() -> (Arena, Arc<FakeStatus>) {
    let status = Arc::new(FakeStatus::default());
    (Arena::with_live_status(None, Some(status.clone())).await, status)
}

#[tokio::test]
async fn runs_are_followed_event_by_event() {
    let (arena, status) = watched().await;
    status.step(7);
    let mut follower = arena.follow(EVENTS, &[("accept-encoding", "gzip")]).await;
    assert_eq!(
        (follower.status, &follower.headers[header::CACHE_CONTROL]),
        (StatusCode::OK, &"no-store".parse().expect("ASCII"))
    );
    assert!(!follower.headers.contains_key(header::CONTENT_ENCODING), "compression would delay events");
    assert_eq!(follower.headers["x-accel-buffering"], "no", "proxies must not buffer");
    let first = follower.next().await.expect("the current state");
    assert_eq!((first.name.as_str(), &first.data["state"]), ("run", &"running".into()));
    assert_eq!((&first.data["done"], &first.data["episodes"]), (&1.into(), &2.into()));
    assert_eq!((&first.data["slots"][0]["step"], &first.data["steps_per_s"]), (&7.into(), &4.0.into()));
    assert_eq!(first.data["words"]["pace"], "4.0 steps per second, last step 0.50 s");
    status.step(8);
    let second = follower.next().await.expect("a change");
    assert_eq!(second.data["slots"][0]["step"], 8);
    assert_ne!(first.id, second.id);
    let mut known = arena.follow(EVENTS, &[("last-event-id", &second.id)]).await;
    assert!(timeout(Duration::from_millis(300), known.next()).await.is_err(), "no repetition");
    arena.store.cancel_run("run_begun", 40).await.expect("a run");
    let last = follower.next().await.expect("the end");
    assert_eq!(last.data["state"], "cancelled");
    assert!(follower.next().await.is_none(), "no event after the end");
    let again = arena.follow(EVENTS, &[("last-event-id", &last.id)]).await;
    assert_eq!(again.status, StatusCode::NO_CONTENT, "browsers must not reconnect");
}

#[tokio::test]
async fn only_open_runs_are_followed() {
    let (arena, status) = watched().await;
    status.step(3);
    let mut follower = arena.follow("/api/v1/runs/events", &[]).await;
    let told = follower.next().await.expect("the current state");
    let ids: Vec<_> =
        told.data["runs"].as_array().expect("a list").iter().map(|run| run["run"].clone()).collect();
    assert_eq!((told.name.as_str(), ids), ("runs", vec!["run_begun".into()]));
    arena.store.cancel_run("run_begun", 40).await.expect("a run");
    let told = follower.next().await.expect("a change");
    assert_eq!(told.data["runs"], serde_json::json!([]));
}

#[tokio::test]
async fn hidden_phases_show_only_counts_to_their_team() {
    let (arena, status) = watched().await;
    status.step(9);
    let digests = std::collections::BTreeMap::new();
    arena.begin("run_hidden", "sealed", &digests).await;
    let address = "/api/v1/runs/run_hidden/events";
    assert_eq!(arena.get(address).await.status, StatusCode::NOT_FOUND);
    assert!(!arena.get("/runs").await.body.contains("run_hidden"));
    let bearer = format!("Bearer {TOKEN}");
    for address in [address, "/api/v1/runs/events"] {
        let mut follower = arena.follow(address, &[("authorization", &bearer)]).await;
        let told = follower.next().await.expect("the current state").data;
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
    assert!(page.contains("0 of 2 done, 1 in progress") && !page.contains("steps per second"), "{page}");
}

#[tokio::test]
async fn subscribers_are_limited() {
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
    assert!(detail.contains("64 visitors are following runs"), "{detail}");
    followers.pop();
    let mut follower = arena.follow(EVENTS, &[]).await;
    while follower.status != StatusCode::OK {
        tokio::task::yield_now().await;
        follower = arena.follow(EVENTS, &[]).await;
    }
    assert!(follower.next().await.is_some(), "a permit is free again");
}

#[tokio::test]
async fn streams_end_when_the_server_closes() {
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
    stop.send(()).expect("a server");
    let closed = timeout(Duration::from_secs(3), served).await.expect("no wait");
    closed.expect("no panic").expect("no failure");
}

#[tokio::test]
async fn progress_needs_no_script() {
    let (arena, status) = watched().await;
    status.step(5);
    let list = arena.get("/runs").await.body;
    assert!(list.contains("1 open run.") && list.contains("<tr data-run=\"run_begun\">"), "{list}");
    assert!(list.contains("data-live=\"episodes\">1 of 2 done</span>"), "{list}");
    let run = arena.get("/runs/run_begun").await.body;
    assert!(run.contains("data-events=\"/api/v1/runs/run_begun/events\""), "{run}");
    assert!(run.contains("data-live=\"pace\">4.0 steps per second"), "{run}");
    assert!(run.contains("data-live=\"waits\">slot 0 has waited for its agent since 00:00:05 UTC"), "{run}");
    let ended = arena.get("/runs/run_rude").await.body;
    assert!(!ended.contains("data-events") && !ended.contains("live.js"), "{ended}");
    let plain = Arena::new().await.get("/runs/run_begun").await.body;
    assert!(plain.contains("the run waits for its agent to connect and request the next episode"), "{plain}");
}

#[tokio::test]
async fn the_server_answers_and_closes() {
    let arena = Arena::new().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address");
    let (stop, stopped) = oneshot::channel::<()>();
    let served =
        tokio::spawn(avln_web::serve(listener, arena.store.reader(), avln_web::Site::default(), async {
            let _ = stopped.await;
        }));
    let mut visitor = TcpStream::connect(address).await.expect("a connection");
    visitor
        .write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
        .await
        .expect("a request");
    let mut answer = String::new();
    visitor.read_to_string(&mut answer).await.expect("an answer");
    assert!(answer.starts_with("HTTP/1.1 200 OK") && answer.ends_with("alive\n"), "{answer}");

    let mut idle = TcpStream::connect(address).await.expect("a connection");
    idle.write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n").await.expect("a request");
    let mut first = [0; 15];
    idle.read_exact(&mut first).await.expect("an answer");
    stop.send(()).expect("a server");
    served.await.expect("no panic").expect("no failure");
    let mut rest = Vec::new();
    idle.read_to_end(&mut rest).await.expect("the connection closes");
    assert!(TcpStream::connect(address).await.is_err(), "no new connections");
}

#[tokio::test]
async fn announcements_belong_to_their_server() {
    let (arena, status) = watched().await;
    let other = Arena::new().await;
    status.announce("Maintenance at <noon>");
    for address in ["/", "/runs", "/nowhere"] {
        let page = arena.get(address).await.body;
        assert!(page.contains("role=\"status\">Maintenance at &#60;noon&#62;</p>"), "{address}: {page}");
        assert!(!other.get(address).await.body.contains("Maintenance"), "{address}");
    }
    status.announce("See https://e.org/?a=1&b=2.");
    let page = arena.get("/").await.body;
    let link = "<a rel=\"nofollow noopener\" href=\"https://e.org/?a=1&#38;b=2\">https://e.org/?a=1&#38;b=2</a>.</p>";
    assert!(page.contains(&format!("role=\"status\">See {link}")), "{page}");
    status.announce("");
    assert!(!arena.get("/").await.body.contains("https://e.org"));
}
