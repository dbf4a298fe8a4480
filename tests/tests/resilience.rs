//! No run is lost: connection losses at any step and server kills at any moment change no bit of a score,
//! lose no episode and count none twice.

use avln_client::{Action, Client, Episode, Error, Observation, Order, Play, Run, RunOptions};
use avln_tests::{
    PHASE, Server, TestServer, TestSetup, clients::NO_SENSORS, http, proxies::FaultProxy, set_up,
};
use serde_json::Value;
use std::{
    net::SocketAddr,
    path::Path,
    process::Command,
    sync::atomic::{AtomicU32, Ordering},
    time::Duration,
};
use tokio::task::JoinSet;

/// Steps after which the wanderer stops.
const STEPS: u32 = 800;

/// Chooses actions from the observation only, so interruptions do not change them.
fn wander(seen: &Observation) -> Action {
    let place = seen.pose.position().map(f32::to_bits);
    let mixed = place.into_iter().chain([seen.pose.heading_rad().to_bits(), seen.step]);
    let draw =
        mixed.fold(0x9e37_79b9_u32, |hash, word| (hash ^ word).wrapping_mul(0x85eb_ca6b).rotate_left(13));
    match draw % 1000 {
        _ if seen.step >= STEPS => Action::Stop,
        0 => Action::Submit,
        1..=200 => Action::TurnLeft,
        201..=300 => Action::TurnRight,
        _ => Action::MoveForward,
    }
}

async fn play_slot(mut play: Play, steps: &AtomicU32) -> Result<Play, Error> {
    while let Some(mut episode) = play.next_episode().await? {
        wander_on(&mut episode, steps).await?;
    }
    Ok(play)
}

async fn wander_on(episode: &mut Episode<'_>, steps: &AtomicU32) -> Result<(), Error> {
    while !episode.is_over() {
        let action = wander(episode.observation());
        episode.step(action).await?;
        steps.fetch_add(1, Ordering::Relaxed);
    }
    Ok(())
}

/// Plays a run in several slots; returns the id.
async fn play_run(url: String, token: String, slots: u32, steps: &'static AtomicU32) -> String {
    let client = Client::connect(url, &token).await.expect("a connection");
    let run =
        client.start_run(RunOptions::new(PHASE, "wanderer").order(Order::Unordered)).await.expect("a run");
    play_on(&client, &run, slots, steps).await;
    run.id
}

async fn play_on(client: &Client, run: &Run, slots: u32, steps: &'static AtomicU32) {
    let mut players = JoinSet::new();
    for play in client.play_slots(run, NO_SENSORS, slots).await.expect("a stream") {
        players.spawn(play_slot(play, steps));
    }
    let mut last = None;
    while let Some(joined) = players.join_next().await {
        last = Some(joined.expect("no panic").expect("a slot that plays to the end"));
    }
    let summary = last.expect("a slot").finish().await.expect("a summary");
    assert!(summary.complete, "{summary:?}");
}

/// Episode results from the API, by ordinal.
async fn worth(web: SocketAddr, run: &str) -> Vec<Value> {
    let body = http::get(web, &format!("/api/v1/runs/{run}")).await;
    let run: Value = serde_json::from_str(&body.body).expect("JSON");
    let episodes = run["episodes"].as_array().expect("episodes");
    episodes.iter().map(|line| serde_json::json!([line["ordinal"], line["end"], line["metrics"]])).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn hundreds_of_lost_connections_change_nothing() {
    static STEPS_TAKEN: AtomicU32 = AtomicU32::new(0);
    let server = TestServer::open(&TestSetup { houses: 1, missions: 4, ..TestSetup::default() }).await;
    let calm = play_run(server.agents_url(), server.token.clone(), 4, &STEPS_TAKEN).await;
    let steps = STEPS_TAKEN.swap(0, Ordering::Relaxed);

    let proxy = FaultProxy::open(server.servers.grpc).await;
    let playing = tokio::spawn(play_run(proxy.url(), server.token.clone(), 4, &STEPS_TAKEN));
    let (mut snips, mut draw, mut due) = (0, 7_u32, 1);
    while !playing.is_finished() {
        draw = draw.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        if STEPS_TAKEN.load(Ordering::Relaxed) >= due {
            proxy.cut();
            snips += 1;
            due = STEPS_TAKEN.load(Ordering::Relaxed) + 1;
        }
        tokio::time::sleep(Duration::from_micros(u64::from(draw >> 21))).await;
    }
    let stormy = playing.await.expect("no panic");
    println!("{steps} steps in peace; {snips} connections lost");
    assert!(snips >= 300, "only {snips} connections were lost in {steps} steps");
    assert_eq!(worth(server.servers.web, &stormy).await, worth(server.servers.web, &calm).await);
}

/// Runs `avln run verify` on a log; returns success and output.
fn verify(folder: &Path, log: &Path) -> (bool, String) {
    let mut verify = Command::new(PROGRAM);
    let output =
        verify.arg("--data").arg(folder).args(["run", "verify"]).arg(log).output().expect("the program runs");
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.success(), text)
}

/// The log shows the whole run, and that it is unchanged.
fn check_log(folder: &Path, run: &str, episodes: usize) {
    let log = folder.join("runs").join(format!("{run}.log"));
    let (content, text) = verify(folder, &log);
    assert!(content && text.contains(&format!("episodes   {episodes} played again")), "{text}");
    let written = std::fs::read_to_string(&log).expect("the log");
    let forged = folder.join("forged.log");
    std::fs::write(&forged, written.replacen("\"sr\":0", "\"sr\":1", 1)).expect("a copy");
    let (content, text) = verify(folder, &forged);
    assert!(!content && text.contains("its hash does not match"), "{text}");
}

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");

#[tokio::test(flavor = "multi_thread")]
async fn thirty_deaths_of_the_server_change_nothing() {
    static STEPS_TAKEN: AtomicU32 = AtomicU32::new(0);
    let folder = tempfile::tempdir().expect("a folder");
    let token = set_up(folder.path(), &TestSetup { houses: 1, missions: 20, ..TestSetup::default() }).await;
    let mut server = Server::start(PROGRAM, folder.path());
    let proxy = FaultProxy::open(server.grpc).await;
    let calm = play_run(proxy.url(), token.clone(), 16, &STEPS_TAKEN).await;
    let steps = STEPS_TAKEN.swap(0, Ordering::Relaxed);

    let playing = tokio::spawn(play_run(proxy.url(), token, 16, &STEPS_TAKEN));
    let (mut deaths, mut draw) = (0, 3_u32);
    while !playing.is_finished() && deaths < 30 {
        draw = draw.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let due = STEPS_TAKEN.load(Ordering::Relaxed) + 1 + draw % (steps / 90).max(1);
        while STEPS_TAKEN.load(Ordering::Relaxed) < due && !playing.is_finished() {
            tokio::time::sleep(Duration::from_micros(300)).await;
        }
        server.kill();
        proxy.cut();
        server = Server::start(PROGRAM, folder.path());
        proxy.redirect(server.grpc);
        deaths += 1;
    }
    let stormy = playing.await.expect("no panic");
    println!("{steps} steps in peace; the server died {deaths} times");
    assert_eq!(deaths, 30, "the run was over after {deaths} deaths");
    assert_eq!(worth(server.web, &stormy).await, worth(server.web, &calm).await);
    check_log(folder.path(), &calm, 20);
    check_log(folder.path(), &stormy, 20);
}
