//! Step latency of a remote agent while a sealed agent on the server's machine exhausts processor, memory and server.
//!
//! `cargo bench -p avln-tests --bench sealed`, on an idle machine. Fails if an attack more than doubles the 95th percentile.

use avln_arena::{data::DataFolder, setup::admit};
use avln_client::{Action, Client, ConnectOptions, Order, Play, RunOptions, Sensors};
use avln_tests::{PHASE, Server, TestSetup, set_up};
use std::{
    env,
    hint::black_box,
    io::{BufRead, BufReader},
    net::SocketAddr,
    path::Path,
    process::{Child, Command, ExitCode, Stdio},
    sync::Arc,
    thread,
    time::{Duration, Instant},
};
use tokio::{
    runtime::{Builder, Runtime},
    task::JoinSet,
};

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
/// Attacks, also names of their teams.
const ATTACKS: [&str; 3] = ["busy", "memory", "flood"];
/// Largest permitted quotient of 95th percentiles.
const LIMIT: f64 = 2.0;

const SENSORS: Sensors =
    Sensors { rgb: true, depth: true, audio: true, width: 64, height: 64, hfov_rad: 1.57 };
const WARM_UP: usize = 100;
/// Steps and time of a measurement, at least.
const STEPS: usize = 1000;
const LENGTH: Duration = Duration::from_secs(20);
/// Time for an attack to take effect.
const LEAD: Duration = Duration::from_secs(3);
/// Length of an attack, seconds.
const WALL_S: &str = "60";

/// Processes, and threads in one of them, that compute.
const SPINNERS: usize = 16;
/// Processes that fill memory up to the limit.
const FILLERS: usize = 4;
const MEMORY_MIB: &str = "1024";
const BLOCK_BYTES: usize = 32 << 20;
const PAGE_BYTES: usize = 4096;
/// Connections without a run, and calls in progress on each.
const CONNECTIONS: usize = 8;
const CALLS: usize = 16;

fn main() -> ExitCode {
    let words: Vec<_> = env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["play", url, token] => runtime().block_on(play(url, token)),
        ["attack", kind] => attack(kind),
        _ if cfg!(target_os = "linux") => return measure(),
        _ => println!("skipped: sealed runs need Linux"),
    }
    ExitCode::SUCCESS
}

/// A runtime as in agents with a single slot.
fn runtime() -> Runtime {
    Builder::new_current_thread().enable_all().build().expect("a runtime")
}

#[derive(Clone, Copy)]
struct Latency {
    steps: usize,
    p50_ms: f64,
    p95_ms: f64,
}

fn measure() -> ExitCode {
    let folder = tempfile::tempdir().expect("a folder");
    let token = runtime().block_on(prepare(folder.path()));
    let server = Server::start(PROGRAM, folder.path());
    println!("{:>8} {:>8} {:>8} {:>8} {:>8}", "attack", "steps", "p50 ms", "p95 ms", "ratio");
    let alone = player(server.grpc, &token);
    print("none", alone, alone);
    let mut is_within = true;
    for kind in ATTACKS {
        let sealed = begin(kind, folder.path(), server.grpc);
        let attacked = player(server.grpc, &token);
        end(kind, sealed);
        print(kind, attacked, alone);
        is_within &= attacked.p95_ms <= LIMIT * alone.p95_ms;
    }
    if is_within { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn print(attack: &str, latency: Latency, alone: Latency) {
    let Latency { steps, p50_ms, p95_ms } = latency;
    println!("{attack:>8} {steps:>8} {p50_ms:>8.2} {p95_ms:>8.2} {:>8.2}", p95_ms / alone.p95_ms);
}

/// A phase, a team for the remote agent, and one for each attack. Returns the former's token.
async fn prepare(folder: &Path) -> String {
    let token = set_up(folder, &TestSetup { houses: 2, missions: 48, ..TestSetup::default() }).await;
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("its database");
    for kind in ATTACKS {
        admit(&store, kind, None).await.expect("a team");
    }
    store.close().await;
    token
}

/// Runs the remote agent.
fn player(door: SocketAddr, token: &str) -> Latency {
    let mut play = Command::new(env::current_exe().expect("this program"));
    play.args(["play", &format!("http://{door}"), token]).stderr(Stdio::inherit());
    let output = play.output().expect("a player ends");
    assert!(output.status.success(), "the player failed: {}", output.status);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let [steps, p50_ms, p95_ms] = text.split_whitespace().collect::<Vec<_>>()[..] else {
        panic!("no latencies: {text}");
    };
    let ms = |text: &str| text.parse::<f64>().expect("milliseconds");
    Latency { steps: steps.parse().expect("steps"), p50_ms: ms(p50_ms), p95_ms: ms(p95_ms) }
}

/// Starts a sealed run, and waits until its attack takes effect.
fn begin(kind: &str, folder: &Path, door: SocketAddr) -> Child {
    let agent = env::current_exe().expect("this program");
    let mut sealed = Command::new(PROGRAM);
    sealed.args(["challenge", "sealed", "run", "--phase", PHASE, "--team", kind, "--method", kind]);
    sealed.args(["--server", &door.to_string(), "--wall-s", WALL_S, "--memory-mib", MEMORY_MIB, "--read"]);
    sealed.arg(agent.parent().expect("its folder")).arg("--").arg(&agent).args(["attack", kind]);
    sealed.env("AVLN_DATA", folder).env_remove("AVLN_SERVER").env_remove("AVLN_TOKEN");
    let mut sealed = sealed.stdout(Stdio::piped()).spawn().expect("a sealed run");
    let mut lines = BufReader::new(sealed.stdout.take().expect("its output")).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.starts_with("run ")), "no sealed run: {:?}", sealed.wait());
    // A closed pipe would end the command.
    thread::spawn(move || lines.for_each(drop));
    thread::sleep(LEAD);
    sealed
}

/// Waits for the end of an attack, which must have lasted until now.
fn end(kind: &str, mut sealed: Child) {
    let early = sealed.try_wait().expect("a state");
    assert!(early.is_none(), "the attack '{kind}' ended before the measurement: {early:?}");
    sealed.wait().expect("the sealed run ends");
}

/// Plays in lock-step and prints the steps, and the median and 95th percentile of their latency in milliseconds.
async fn play(url: &str, token: &str) {
    let client = Client::connect(url, token).await.expect("a connection");
    let options = RunOptions::new(PHASE, "remote").order(Order::Unordered);
    let run = client.start_run(options).await.expect("a run");
    let mut play = client.play(&run, SENSORS).await.expect("a stream");
    let mut latencies = latencies(&mut play).await.split_off(WARM_UP);
    drop(play);
    client.cancel_run(&run.id).await.expect("it can be cancelled");
    assert!(latencies.len() >= STEPS, "{} steps", latencies.len());
    latencies.sort_unstable();
    let at = |percent: usize| latencies[latencies.len() * percent / 100].as_secs_f64() * 1000.0;
    println!("{} {} {}", latencies.len(), at(50), at(95));
}

async fn latencies(play: &mut Play) -> Vec<Duration> {
    let begun = Instant::now();
    let mut latencies = Vec::new();
    while let Some(mut episode) = play.next_episode().await.expect("an episode") {
        while !episode.is_over() {
            let turn = episode.observation().step.wrapping_mul(0x9e37_79b9) >> 28;
            let action = if turn < 4 { Action::TurnLeft } else { Action::MoveForward };
            let sent = Instant::now();
            episode.step(action).await.expect("a step");
            latencies.push(sent.elapsed());
            if latencies.len() >= WARM_UP + STEPS && begun.elapsed() >= LENGTH {
                return latencies;
            }
        }
    }
    latencies
}

/// Attacks until the sandbox ends this process.
fn attack(kind: &str) {
    match kind {
        "busy" => {
            let _processes = start("spin", SPINNERS);
            (1..SPINNERS).for_each(|_| drop(thread::spawn(spin)));
            spin();
        }
        "memory" => {
            let _processes = start("fill", FILLERS - 1);
            fill();
        }
        "flood" => Runtime::new().expect("a runtime").block_on(flood()),
        "spin" => spin(),
        "fill" => fill(),
        kind => panic!("no attack '{kind}'"),
    }
}

/// Starts processes with another attack.
fn start(attack: &str, count: usize) -> Vec<Child> {
    let program = env::current_exe().expect("this program");
    let process = |_| Command::new(&program).args(["attack", attack]).spawn().expect("a process");
    (0..count).map(process).collect()
}

fn spin() {
    let mut turns = 0_u64;
    loop {
        turns = black_box(turns.wrapping_add(1));
    }
}

/// Takes memory until the kernel refuses, writes to all of it, returns it, and begins again.
fn fill() {
    loop {
        let mut blocks = Vec::new();
        while let Some(block) = block() {
            blocks.push(block);
        }
        for block in &mut blocks {
            block.iter_mut().step_by(PAGE_BYTES).for_each(|byte| *byte = byte.wrapping_add(1));
        }
        drop(black_box(blocks));
    }
}

fn block() -> Option<Vec<u8>> {
    let mut block = Vec::new();
    block.try_reserve_exact(BLOCK_BYTES).ok()?;
    block.resize(BLOCK_BYTES, 1);
    Some(block)
}

/// Plays all slots with the largest images, and calls the server on further connections.
async fn flood() {
    let [server, token] =
        ["AVLN_SERVER", "AVLN_TOKEN"].map(|name| env::var(name).expect("set by the sandbox"));
    let options = RunOptions::new(PHASE, "flood");
    let begun = Client::begin(&server, token, &ConnectOptions::default(), options).await;
    let (client, run) = begun.expect("its run");
    let mut tasks = JoinSet::new();
    for play in client.play_slots(&run, Sensors::square(256), 64).await.expect("a stream") {
        tasks.spawn(turn(play));
    }
    for _ in 0..CONNECTIONS {
        tasks.spawn(call(server.clone()));
    }
    tasks.join_all().await;
}

async fn turn(mut play: Play) {
    while let Ok(Some(mut episode)) = play.next_episode().await {
        while !episode.is_over() && episode.step(Action::TurnLeft).await.is_ok() {}
    }
}

/// Requests server information without a pause.
async fn call(server: String) {
    let Ok(client) = Client::connect(&server, "").await else { return };
    let client = Arc::new(client);
    let mut calls = JoinSet::new();
    for _ in 0..CALLS {
        let client = client.clone();
        calls.spawn(async move { while client.server_info().await.is_ok() {} });
    }
    calls.join_all().await;
}
