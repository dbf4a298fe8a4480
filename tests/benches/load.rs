//! Load by eight processes with eight slots each: steps, fairness, errors and server memory.
//!
//! `cargo bench -p avln-tests --bench load -- 10` plays for ten minutes; the default is one. Memory on Linux only.

use avln_arena::{data::DataFolder, setup::admit};
use avln_client::{Action, Client, Order, Play, RunOptions, Sensors};
use avln_tests::{PHASE, Server, TestSetup, set_up};
use std::{
    net::SocketAddr,
    path::Path,
    process::{Child, Command, Stdio},
    sync::Arc,
    sync::atomic::{AtomicBool, AtomicU64, Ordering},
    thread::sleep,
    time::{Duration, Instant},
};
use tokio::{runtime::Runtime, task::JoinSet};

const PROCESSES: usize = 8;
const SLOTS: u32 = 8;
const SENSORS: Sensors =
    Sensors { rgb: true, depth: true, audio: true, width: 64, height: 64, hfov_rad: 1.57 };
/// Memory sampling interval.
const LOOK: Duration = Duration::from_secs(5);
/// Time for the clients' last steps.
const LAST_STEPS: Duration = Duration::from_secs(20);

fn main() {
    let words: Vec<_> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let runtime = Runtime::new().expect("a runtime");
    match words.as_slice() {
        [url, token, seconds] => {
            let length = Duration::from_secs(seconds.parse().expect("seconds"));
            runtime.block_on(play_for(url, token, length));
        }
        words => {
            let minutes: u64 = words.first().map_or(Ok(1), |word| word.parse()).expect("minutes");
            measure(&runtime, Duration::from_secs(60 * minutes));
        }
    }
}

fn measure(runtime: &Runtime, length: Duration) {
    let folder = tempfile::tempdir().expect("a folder");
    let tokens = runtime.block_on(tokens(folder.path()));
    let mut server = Server::start(env!("CARGO_BIN_EXE_avln_under_test"), folder.path());
    let players: Vec<_> = tokens.iter().map(|token| player(server.grpc, token, length)).collect();
    let resident = watch(&server, length);
    let output: Vec<_> = players.into_iter().map(outcome).collect();
    report(&output, length, server.is_running());
    report_memory(&resident);
}

/// A phase, and a team for each process.
async fn tokens(folder: &Path) -> Vec<String> {
    set_up(folder, &TestSetup { houses: 2, missions: 24, ..TestSetup::default() }).await;
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("its database");
    let mut tokens = Vec::new();
    for number in 0..PROCESSES {
        tokens.push(admit(&store, &format!("team {number}"), None).await.expect("a team"));
    }
    store.close().await;
    tokens
}

fn player(door: SocketAddr, token: &str, length: Duration) -> Child {
    let mut play = Command::new(std::env::current_exe().expect("this program"));
    play.args([&format!("http://{door}"), token, &length.as_secs().to_string()]);
    play.stdout(Stdio::piped()).spawn().expect("a player starts")
}

/// Resident server memory over time, MiB.
fn watch(server: &Server, length: Duration) -> Vec<u64> {
    let begun = Instant::now();
    let mut resident = Vec::new();
    while begun.elapsed() < length {
        sleep(LOOK);
        let status = std::fs::read_to_string(format!("/proc/{}/status", server.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
        resident.extend(kib.map(|kib| kib / 1024));
    }
    resident
}

/// A player's steps and episodes; `None` if it failed.
fn outcome(player: Child) -> Option<[u64; 2]> {
    let output = player.wait_with_output().expect("a player ends");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let (steps, episodes) = text.trim().split_once(' ')?;
    output.status.success().then_some([steps.parse().ok()?, episodes.parse().ok()?])
}

fn report(output: &[Option<[u64; 2]>], length: Duration, alive: bool) {
    let played: Vec<_> = output.iter().flatten().collect();
    let steps = played.iter().map(|[steps, _]| *steps);
    let (all, least, most) =
        (steps.clone().sum::<u64>(), steps.clone().min().unwrap_or(0), steps.max().unwrap_or(0));
    let episodes: u64 = played.iter().map(|[_, episodes]| episodes).sum();
    println!("{} of {PROCESSES} processes without an error, the server lives: {alive}", played.len());
    println!("{all} steps, {episodes} episodes, {:.0} steps/s", all as f64 / length.as_secs_f64());
    println!("steps of a process: {least} to {most}, {:.2} times", most as f64 / least.max(1) as f64);
}

fn report_memory(resident: &[u64]) {
    for (tenth, part) in resident.chunks(resident.len().div_ceil(10).max(1)).enumerate() {
        println!("tenth {}: {} MiB at most", tenth + 1, part.iter().max().unwrap_or(&0));
    }
}

/// Plays run after run until the time is over.
async fn play_for(url: &str, token: &str, length: Duration) {
    let client = Client::connect(url, token).await.expect("a connection");
    let (steps, episodes) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let over = Arc::new(AtomicBool::new(false));
    let bell = over.clone();
    tokio::spawn(async move {
        tokio::time::sleep(length).await;
        bell.store(true, Ordering::Relaxed);
    });
    let playing = async {
        while !over.load(Ordering::Relaxed) {
            play_run(&client, &over, [&steps, &episodes]).await;
        }
    };
    tokio::time::timeout(length + LAST_STEPS, playing).await.expect("no step takes that long");
    println!("{} {}", steps.load(Ordering::Relaxed), episodes.load(Ordering::Relaxed));
}

async fn play_run(client: &Client, over: &Arc<AtomicBool>, counts: [&Arc<AtomicU64>; 2]) {
    let options = RunOptions::new(PHASE, "load").order(Order::Unordered);
    let run = client.start_run(options).await.expect("a run");
    let mut players = JoinSet::new();
    for play in client.play_slots(&run, SENSORS, SLOTS).await.expect("a stream") {
        players.spawn(play_slot(play, over.clone(), counts.map(Arc::clone)));
    }
    let plays = players.join_all().await;
    drop(plays);
    if over.load(Ordering::Relaxed) {
        client.cancel_run(&run.id).await.expect("it can be cancelled");
    }
}

/// Returns the slot, so that the stream stays open until all slots have finished.
async fn play_slot(mut play: Play, over: Arc<AtomicBool>, [steps, episodes]: [Arc<AtomicU64>; 2]) -> Play {
    while let Some(mut episode) = play.next_episode().await.expect("an episode") {
        while !episode.is_over() {
            if over.load(Ordering::Relaxed) {
                return play;
            }
            let turn = episode.observation().step.wrapping_mul(0x9e37_79b9) >> 28;
            let action = if turn < 4 { Action::TurnLeft } else { Action::MoveForward };
            episode.step(action).await.expect("a step");
            steps.fetch_add(1, Ordering::Relaxed);
        }
        episodes.fetch_add(1, Ordering::Relaxed);
    }
    play
}
