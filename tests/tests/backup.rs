//! A backup of a server that is being played on makes the same server elsewhere: the same board, the same logs, and a run
//! that goes on where it was.

use avln_client::{Action, Client, Observation, Order, Play, RunOptions};
use avln_tests::{
    PHASE, TestSetup,
    fault_proxy::FaultProxy,
    furnish, http,
    scripted_run::{NO_SENSORS, play_script},
    server::Server,
};
use serde_json::Value;
use std::{
    fs,
    net::SocketAddr,
    path::Path,
    process::Command,
    sync::atomic::{AtomicBool, AtomicU32, Ordering},
    time::Duration,
};
use tokio::task::JoinSet;

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
/// Steps after which the wanderer stops.
const STEPS: u32 = 120;
/// Slots of the run that goes on elsewhere.
const SLOTS: u32 = 3;

/// Calls the program over the data folder `data`; gives back what it said.
fn avln(data: &Path, arguments: &[&str]) -> (bool, String) {
    let output = Command::new(PROGRAM).arg("--data").arg(data).args(arguments).output().expect("it starts");
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.success(), text)
}

fn done(data: &Path, arguments: &[&str]) -> String {
    let (content, text) = avln(data, arguments);
    assert!(content, "{arguments:?}: {text}");
    text
}

/// Wanders by what it senses alone, so that it does the same however it was disturbed.
fn wander(seen: &Observation) -> Action {
    let place = seen.pose.position.map(f32::to_bits);
    let mixed = place.into_iter().chain([seen.pose.heading_rad.to_bits(), seen.step]);
    let draw =
        mixed.fold(0x9e37_79b9_u32, |hash, word| (hash ^ word).wrapping_mul(0x85eb_ca6b).rotate_left(13));
    match draw % 100 {
        _ if seen.step >= STEPS => Action::Stop,
        0..=20 => Action::TurnLeft,
        21..=30 => Action::TurnRight,
        _ => Action::MoveForward,
    }
}

/// Steps that were taken, and whether players wait before their next one.
struct Pace {
    steps: AtomicU32,
    held: AtomicBool,
    hold_at: u32,
    pause: Duration,
}

impl Pace {
    const fn new(hold_at: u32, pause: Duration) -> Self {
        Self { steps: AtomicU32::new(0), held: AtomicBool::new(false), hold_at, pause }
    }

    async fn step(&self) {
        tokio::time::sleep(self.pause).await;
        if self.steps.fetch_add(1, Ordering::AcqRel) + 1 == self.hold_at {
            self.held.store(true, Ordering::Release);
        }
        while self.held.load(Ordering::Acquire) {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }
}

async fn play_slot(mut play: Play, pace: &Pace) -> Play {
    while let Some(mut episode) = play.next_episode().await.expect("a slot that plays to the end") {
        while !episode.is_over() {
            let action = wander(episode.observation());
            pace.step().await;
            episode.step(action).await.expect("a legal step");
        }
    }
    play
}

/// Plays a whole run in several slots; gives back its id.
async fn play_run(url: String, token: String, method: &str, pace: &'static Pace) -> String {
    let arena = Client::connect(url, &token).await.expect("the door is open");
    let run = arena.start_run(RunOptions::new(PHASE, method).order(Order::Unordered)).await.expect("a run");
    let mut players = JoinSet::new();
    for play in arena.play_slots(&run, NO_SENSORS, SLOTS).await.expect("a stream") {
        players.spawn(play_slot(play, pace));
    }
    let mut last = None;
    while let Some(joined) = players.join_next().await {
        last = Some(joined.expect("no panic"));
    }
    assert!(last.expect("a slot").finish().await.expect("a summary").complete);
    run.id
}

/// What each episode of a run was worth, as the API tells it.
async fn worth(web: SocketAddr, run: &str) -> Vec<Value> {
    let body = http::get(web, &format!("/api/v1/runs/{run}")).await;
    let run: Value = serde_json::from_str(&body.body).expect("JSON");
    let episodes = run["episodes"].as_array().expect("episodes");
    episodes.iter().map(|line| serde_json::json!([line["ordinal"], line["end"], line["metrics"]])).collect()
}

async fn board(web: SocketAddr) -> String {
    http::get(web, &format!("/api/v1/phases/{PHASE}/leaderboard?order=unordered")).await.body
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_is_played_on_goes_on_elsewhere() {
    static CALM: Pace = Pace::new(u32::MAX, Duration::ZERO);
    static HELD: Pace = Pace::new(200, Duration::ZERO);
    // Long enough for the backup to be made meanwhile.
    static BUSY: Pace = Pace::new(u32::MAX, Duration::from_millis(10));
    let place = tempfile::tempdir().expect("a folder");
    let (old, new, file) =
        (place.path().join("old"), place.path().join("new"), place.path().join("backup.tar"));
    let token = furnish(&old, &TestSetup { houses: 1, missions: 8, ..TestSetup::default() }).await;
    let server = Server::start(PROGRAM, &old);
    let wire = FaultProxy::open(server.grpc).await;
    let over = play_script(&wire.url(), &token, "over before").await;
    let calm = play_run(wire.url(), token.clone(), "calm", &CALM).await;
    let (before, verified) = (board(server.web).await, check(&old, &over));

    // One run is held in the middle; another goes on at full speed while the backup is made.
    let held = tokio::spawn(play_run(wire.url(), token.clone(), "held", &HELD));
    while !HELD.held.load(Ordering::Acquire) {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    tokio::time::sleep(Duration::from_millis(300)).await;
    let busy = tokio::spawn(play_run(format!("http://{}", server.grpc), token.clone(), "busy", &BUSY));
    while BUSY.steps.load(Ordering::Acquire) < 60 {
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    let said = done(&old, &["data", "db", "backup", &file.display().to_string()]);
    assert!(!busy.is_finished(), "the run was over before the backup was");
    assert!(said.contains("4 runs (2 open)") && said.contains("4 run logs"), "{said}");
    let (content, said) = avln(&old, &["data", "db", "backup", &file.display().to_string()]);
    assert!(!content && said.contains("already exists"), "{said}");
    busy.abort();
    server.kill();

    let said = done(&new, &["data", "db", "restore", &file.display().to_string()]);
    assert!(said.contains("4 runs (2 open)"), "{said}");
    let (content, said) = avln(&new, &["data", "db", "restore", &file.display().to_string()]);
    assert!(!content && said.contains("new or empty folder"), "{said}");
    assert_eq!(check(&new, &over), verified, "the same log by the same key");
    let logs = fs::read_dir(new.join("runs")).expect("logs").map(|log| log.expect("a log").path());
    for log in logs {
        done(&new, &["run", "verify", &log.display().to_string()]);
    }
    let server = Server::start(PROGRAM, &new);
    assert_eq!(board(server.web).await, before);
    wire.redirect(server.grpc);
    wire.cut();
    HELD.held.store(false, Ordering::Release);
    let held = held.await.expect("no panic");
    assert_eq!(worth(server.web, &held).await, worth(server.web, &calm).await, "it went on where it was");
    check(&new, &held);
}

/// What `avln run verify` says of a run's log.
fn check(data: &Path, run: &str) -> String {
    let log = data.join("runs").join(format!("{run}.log"));
    done(data, &["run", "verify", &log.display().to_string()])
}
