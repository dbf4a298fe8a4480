//! Visitors of pages, and connections that end at every stage.

use crate::{
    agents::{SENSORS, action, open_silently},
    fleet::PROCESSES,
    tally::Tally,
};
use avln_client::{Client, Error, RunOptions};
use avln_tests::PHASE;
use std::{
    fmt::Display,
    net::SocketAddr,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    task::JoinSet,
    time::{sleep, timeout},
};

const VIEW_INTERVAL: Duration = Duration::from_millis(200);
const CHURN_INTERVAL: Duration = Duration::from_secs(1);
/// Limit of a complete answer.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time for which live updates and unfinished connections stay open.
const STAY: Duration = Duration::from_secs(3);
/// Distinct pictures, few enough for the cache to be full after the warm-up.
const PICTURES: usize = 24;
/// Episodes of a run.
const EPISODES: usize = 24;
const HTTP2: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";
const TLS: &[u8] = b"\x16\x03\x01\x00\xf4\x01\x00\x00\xf0\x03\x03";

/// Addresses of the server.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places {
    pub(crate) grpc: SocketAddr,
    pub(crate) web: SocketAddr,
    pub(crate) admin: SocketAddr,
}

const PAGES: &[&str] = &[
    "/",
    "/leaderboard",
    "/leaderboard/trial",
    "/embed/trial",
    "/phases/trial",
    "/runs",
    "/docs",
    "/docs/scoring",
    "/readyz",
    "/assets/app.css",
    "/api/v1/status",
    "/api/v1/phases",
    "/api/v1/phases/trial",
    "/api/v1/phases/trial/missions",
    "/api/v1/phases/trial/leaderboards",
    "/api/v1/phases/trial/leaderboard.csv",
    "/api/v1/runs",
    "/api/v1/runs.csv",
    "/api/v1/runs/events",
    "/api/v1/openapi.json",
    "/metrics",
];

/// Pages of an open run.
fn pages_of_open_run(run: &str) -> Vec<String> {
    vec![format!("/runs/{run}"), format!("/api/v1/runs/{run}"), format!("/api/v1/runs/{run}/events")]
}

/// Pages of the oldest and the newest completed run.
fn pages_of_completed_runs(first: &str, last: &str, turn: usize) -> Vec<String> {
    let ordinal = turn % EPISODES;
    let replay = format!("runs/{last}/episodes/{ordinal}");
    let step = turn % PICTURES;
    vec![
        format!("/runs/{last}"),
        format!("/runs/{last}/badge.svg"),
        format!("/api/v1/runs/{last}"),
        format!("/api/v1/runs/{last}/log"),
        format!("/api/v1/runs/{last}/episodes.csv"),
        format!("/{replay}"),
        format!("/{replay}/ears/0-20.wav"),
        format!("/api/v1/{replay}"),
        format!("/api/v1/{replay}/steps.csv"),
        format!("/runs/{first}/episodes/0/eyes/{step}.png"),
        format!("/compare?first={first}&second={last}"),
    ]
}

fn page(tally: &Tally, turn: usize) -> String {
    let mut pages: Vec<String> = PAGES.iter().map(|page| (*page).to_owned()).collect();
    if let Some([run, _]) = tally.current(turn % PROCESSES) {
        pages.extend(pages_of_open_run(&run));
    }
    if let [first, .., last] = tally.completed().as_slice() {
        pages.extend(pages_of_completed_runs(first, last, turn));
    }
    pages.swap_remove(turn % pages.len())
}

/// Views five pages per second.
pub(crate) async fn view_pages(places: Places, tally: Arc<Tally>, until: Instant) {
    let mut views = JoinSet::new();
    for turn in 0.. {
        if Instant::now() >= until {
            break;
        }
        let page = page(&tally, turn);
        let tally = tally.clone();
        views.spawn(async move {
            tally.views.add(1);
            match view(places, &page).await {
                Ok(200) => {}
                Ok(status) => tally.error(&format!("{page}: status {status}")),
                Err(error) => tally.error(&format!("{page}: {error}")),
            }
        });
        while views.try_join_next().is_some() {}
        sleep(VIEW_INTERVAL).await;
    }
    views.join_all().await;
}

/// Returns the status of a page.
async fn view(places: Places, page: &str) -> Result<u16, String> {
    let address = if page == "/metrics" { places.admin } else { places.web };
    let is_endless = page.ends_with("/events");
    let mut answer = Vec::new();
    let limit = if is_endless { STAY } else { PATIENCE };
    match timeout(limit, fetch(address, page, &mut answer)).await {
        Ok(answered) => answered.map_err(text)?,
        Err(_) if is_endless => {}
        Err(_) => return Err(format!("no complete answer in {} s", PATIENCE.as_secs())),
    }
    let head = String::from_utf8_lossy(&answer);
    let status = head.split(' ').nth(1).and_then(|code| code.parse().ok());
    status.ok_or_else(|| format!("no status in {} bytes", answer.len()))
}

async fn fetch(address: SocketAddr, page: &str, answer: &mut Vec<u8>) -> std::io::Result<()> {
    let mut stream = TcpStream::connect(address).await?;
    let request = format!("GET {page} HTTP/1.0\r\nHost: {address}\r\n\r\n");
    stream.write_all(request.as_bytes()).await?;
    stream.read_to_end(answer).await.map(drop)
}

fn text(error: impl Display) -> String {
    error.to_string()
}

/// Opens a few connections per second. The last of the `teams` plays no other runs.
pub(crate) async fn churn(places: Places, teams: Vec<String>, tally: Arc<Tally>, until: Instant) {
    let mut connections = JoinSet::new();
    for turn in 0_usize.. {
        if Instant::now() >= until {
            break;
        }
        connections.spawn(report("TCP", tally.clone(), send_and_leave(places.grpc, b"")));
        let preface = if turn.is_multiple_of(2) { HTTP2 } else { TLS };
        connections.spawn(report("preface", tally.clone(), send_and_leave(places.grpc, preface)));
        connections.spawn(report("bad token", tally.clone(), show_bad_token(places.grpc)));
        let process = turn % PROCESSES;
        if let Some([run, _]) = tally.current(process) {
            let watch = watch_and_leave(places.grpc, teams[process].clone(), run);
            connections.spawn(report("watch", tally.clone(), watch));
        }
        if turn % 10 == 5 {
            let play = play_and_leave(places.grpc, teams[PROCESSES].clone());
            connections.spawn(report("stream", tally.clone(), play));
        }
        while connections.try_join_next().is_some() {}
        sleep(CHURN_INTERVAL).await;
    }
    connections.join_all().await;
}

async fn report(
    name: &'static str,
    tally: Arc<Tally>,
    connection: impl Future<Output = Result<(), String>> + Send,
) {
    tally.connections.add(1);
    if let Err(error) = connection.await {
        tally.error(&format!("{name}: {error}"));
    }
}

async fn send_and_leave(address: SocketAddr, bytes: &[u8]) -> Result<(), String> {
    let mut stream = TcpStream::connect(address).await.map_err(text)?;
    stream.write_all(bytes).await.map_err(text)?;
    // The server may close first.
    let mut answer = [0; 1024];
    let _ = timeout(STAY, stream.read(&mut answer)).await;
    Ok(())
}

async fn show_bad_token(grpc: SocketAddr) -> Result<(), String> {
    match Client::connect(format!("http://{grpc}"), "avln_wrong").await {
        Err(Error::Token { .. }) => Ok(()),
        Err(error) => Err(text(error)),
        Ok(_) => Err("it is accepted".to_owned()),
    }
}

async fn watch_and_leave(grpc: SocketAddr, token: String, run: String) -> Result<(), String> {
    let client = Client::connect(format!("http://{grpc}"), token).await.map_err(text)?;
    let mut watch = client.watch(&run).await.map_err(text)?;
    watch.next().await.map(drop).map_err(text)
}

/// Starts a run, leaves one stream before Hello and another within an episode, and cancels the run.
async fn play_and_leave(grpc: SocketAddr, token: String) -> Result<(), String> {
    let url = format!("http://{grpc}");
    let client = Client::connect(&url, token).await.map_err(text)?;
    let run = client.start_run(RunOptions::new(PHASE, "guest")).await.map_err(text)?;
    open_silently(&url, &run.token, CHURN_INTERVAL).await.map_err(text)?;
    let mut play = client.play(&run, SENSORS).await.map_err(text)?;
    if let Some(mut episode) = play.next_episode().await.map_err(text)? {
        let action = action(episode.id(), 0);
        episode.step(action).await.map_err(text)?;
    }
    drop(play);
    client.cancel_run(&run.id).await.map(drop).map_err(text)
}
