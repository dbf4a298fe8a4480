//! Steps per second in a procedural house, in process and over gRPC on loopback, and the time by part: `cargo
//! bench -p avln-lab --bench steps`.
//!
//! Processor time is summed over all threads in this process: over gRPC that includes server and client. The
//! simulator's parts are differences between walks with and without a sense; the other parts are measured by
//! thread.

use avln_arena::data::DataFolder;
use avln_arena::servers::{Addresses, RunningServers, Servers};
use avln_arena::setup::{NewPhase, NewSplit, admit, make_split, open_phase};
use avln_arena::{Arena, SCENE_MEMORY_MIB};
use avln_client::{Client, RunOptions};
use avln_dataset::Seed;
use avln_episode::{Action, Order, Rules, Sensors};
use avln_geom::Rng;
use avln_referee::{Audio, Referee};
use avln_world::SceneAssets;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tokio::runtime::{Builder, Runtime};

/// Steps per walk.
const STEPS: usize = 480;
/// Steps before the measurement.
const WARM_UP: usize = 20;
/// Measurements per median.
const REPEATS: usize = 3;
/// Least measured time in process: a step without senses takes microseconds.
const LEAST: Duration = Duration::from_millis(300);
const PHASE: &str = "bench";
/// Name prefix of simulator threads.
const SIMULATOR: &str = "avln-simulat";

/// The agent's senses.
struct Senses {
    name: &'static str,
    /// Image side, pixels; `None` without images.
    side: Option<u32>,
    audio: bool,
}

const SENSES: [Senses; 4] = [
    Senses { name: "RGB-D 256 x 256, audio", side: Some(256), audio: true },
    Senses { name: "RGB-D 128 x 128, audio", side: Some(128), audio: true },
    Senses { name: "audio", side: None, audio: true },
    Senses { name: "blind and deaf", side: None, audio: false },
];
const ALL: usize = 0;
const AUDIO: usize = 2;
const NONE: usize = 3;

/// Cost per step, microseconds.
#[derive(Clone, Copy)]
struct Cost {
    wall_us: f64,
    cpu_us: f64,
    /// Processor time in simulator threads and in the client's thread.
    simulator_us: f64,
    client_us: f64,
}

fn main() {
    let folder = TempDir::new().expect("a folder for temporary files");
    let server = runtime();
    let token = server.block_on(furnish(folder.path()));
    let servers = server.block_on(open_servers(folder.path()));
    let local = LocalEpisode::open(folder.path());
    let client_runtime = Builder::new_current_thread().enable_all().build().expect("a runtime of one thread");
    let client = client_runtime
        .block_on(Client::connect(format!("http://{}", servers.grpc), token))
        .expect("the gRPC server");
    let measure = |senses: &Senses| {
        let inside = (0..REPEATS).map(|_| local.walk(senses));
        let outside = (0..REPEATS).map(|_| client_runtime.block_on(walk_by_grpc(&client, senses)));
        [median(inside.collect()), median(outside.collect())]
    };
    let costs = SENSES.each_ref().map(measure);
    print_rates(&costs);
    print_parts(&costs);
    drop((client, client_runtime));
    server.block_on(servers.close()).expect("closed servers");
}

fn runtime() -> Runtime {
    Builder::new_multi_thread().worker_threads(2).enable_all().build().expect("a runtime")
}

/// Returns the same walk for every measurement, with every second step forward.
fn walk() -> impl Iterator<Item = Action> {
    let mut rng = Rng::new(3);
    let choices = [Action::MoveForward, Action::MoveForward, Action::TurnLeft, Action::TurnRight];
    (0..STEPS).map(move |_| choices[rng.below(choices.len())])
}

/// The episode without a server.
struct LocalEpisode {
    assets: Arc<SceneAssets>,
    split: avln_dataset::Split,
}

impl LocalEpisode {
    fn open(folder: &Path) -> Self {
        let split = DataFolder::open(folder).and_then(|data| data.split(PHASE)).expect("the split");
        let begun = Instant::now();
        let assets = split.scenes[0].open(&Rules::paper()).expect("the house");
        let (triangles, rooms) = (assets.scene.mesh.triangles.len(), assets.scene.regions.len());
        let ready_ms = 1e3 * begun.elapsed().as_secs_f64();
        println!("{}: {triangles} triangles, {rooms} rooms, ready in {ready_ms:.0} ms", assets.scene.name);
        let local = Self { assets: Arc::new(assets), split };
        for occasion in ["first", "second"] {
            let begun = Instant::now();
            black_box(local.referee(&SENSES[ALL]).start());
            println!("episode begins, {occasion}: {:.0} ms", 1e3 * begun.elapsed().as_secs_f64());
        }
        local
    }

    fn referee(&self, senses: &Senses) -> Referee {
        let (spec, order) = (&self.split.episodes[0], Order::Unordered);
        let rules = Rules { max_steps: u32::MAX, ..Rules::paper() };
        let (pictures, side) = (senses.side.is_some(), senses.side.unwrap_or(Sensors::MIN_SIDE));
        let sensors =
            Sensors { rgb: pictures, depth: pictures, audio: senses.audio, ..Sensors::all(side, side) };
        let mission = spec.mission(&self.assets, &rules, order);
        let (assets, truth) = (self.assets.clone(), spec.truth(order));
        Referee::new(assets, mission, truth, rules, sensors, &Audio::default()).expect("an episode")
    }

    fn walk(&self, senses: &Senses) -> Cost {
        let mut referee = self.referee(senses);
        let mut step = |action| drop(black_box(referee.step(action).expect("an open episode")));
        walk().take(WARM_UP).for_each(&mut step);
        let meter = Meter::start();
        let mut steps = 0;
        while steps == 0 || meter.begun.elapsed() < LEAST {
            walk().for_each(&mut step);
            steps += STEPS;
        }
        meter.cost(steps)
    }
}

/// Walks over gRPC.
async fn walk_by_grpc(client: &Client, senses: &Senses) -> Cost {
    let run = client.start_run(RunOptions::new(PHASE, "bench")).await.expect("a run");
    let (pictures, side) = (senses.side.is_some(), senses.side.unwrap_or(Sensors::MIN_SIDE));
    let sensors = avln_client::Sensors {
        rgb: pictures,
        depth: pictures,
        audio: senses.audio,
        ..avln_client::Sensors::square(side)
    };
    let mut play = client.play(&run, sensors).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    for action in walk().take(WARM_UP) {
        episode.step(on_the_wire(action)).await.expect("a step");
    }
    let meter = Meter::start();
    for action in walk() {
        black_box(episode.step(on_the_wire(action)).await.expect("a step"));
    }
    let cost = meter.cost(STEPS);
    play.finish().await.expect("a finished run");
    cost
}

fn on_the_wire(action: Action) -> avln_client::Action {
    match action {
        Action::MoveForward => avln_client::Action::MoveForward,
        Action::TurnLeft => avln_client::Action::TurnLeft,
        Action::TurnRight => avln_client::Action::TurnRight,
        Action::Submit => avln_client::Action::Submit,
        Action::Stop => avln_client::Action::Stop,
    }
}

fn print_rates(costs: &[[Cost; 2]]) {
    println!("\n{:24} {:>32} {:>32}", "", "in process", "over gRPC");
    let head = format!("{:>14} {:>8} {:>8}", "steps/s a core", "cpu us", "wall us");
    println!("{:24} {head} {head}", "senses");
    for (senses, [inside, outside]) in SENSES.iter().zip(costs) {
        let cells = |Cost { wall_us, cpu_us, .. }: &Cost| {
            format!("{:>14.0} {cpu_us:>8.1} {wall_us:>8.1}", 1e6 / cpu_us)
        };
        println!("{:24} {} {}", senses.name, cells(inside), cells(outside));
    }
}

/// Prints the parts of a step with all senses at 256 x 256 over gRPC; their sum is the whole by construction.
fn print_parts(costs: &[[Cost; 2]]) {
    let inside = |senses: usize| costs[senses][0].cpu_us;
    let Cost { cpu_us, simulator_us, client_us, .. } = costs[ALL][1];
    let parts = [
        ("motion and referee", inside(NONE)),
        ("audio", inside(AUDIO) - inside(NONE)),
        ("pictures", inside(ALL) - inside(AUDIO)),
        ("cold caches after a pause", simulator_us - inside(ALL)),
        ("server: messages, HTTP/2, sockets", cpu_us - simulator_us - client_us),
        ("client: sockets, HTTP/2, messages", client_us),
    ];
    println!("\n{:40} {:>8} {:>8}", "part of a step, 256 x 256 over gRPC", "cpu us", "share");
    for (name, part_us) in parts {
        println!("{name:40} {part_us:>8.1} {:>7.1}%", 100.0 * part_us / cpu_us);
    }
}

/// Returns the median by kind of time.
fn median(costs: Vec<Cost>) -> Cost {
    let middle = |value: fn(&Cost) -> f64| {
        let mut values: Vec<f64> = costs.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    Cost {
        wall_us: middle(|cost| cost.wall_us),
        cpu_us: middle(|cost| cost.cpu_us),
        simulator_us: middle(|cost| cost.simulator_us),
        client_us: middle(|cost| cost.client_us),
    }
}

/// Wall time and processor time since the start.
struct Meter {
    begun: Instant,
    threads_ns: BTreeMap<String, u64>,
}

impl Meter {
    fn start() -> Self {
        Self { threads_ns: threads_ns(), begun: Instant::now() }
    }

    /// Returns the cost per step; without thread statistics, processor time is wall time.
    fn cost(&self, steps: usize) -> Cost {
        let wall_us = 1e6 * self.begun.elapsed().as_secs_f64() / steps as f64;
        let now = threads_ns();
        let spent_us = |of: &dyn Fn(&str) -> bool| {
            let before = |thread: &String| self.threads_ns.get(thread).copied().unwrap_or(0);
            let threads = now.iter().filter(|(thread, _)| of(thread));
            let spent_ns: u64 = threads.map(|(thread, ns)| ns.saturating_sub(before(thread))).sum();
            spent_ns as f64 / 1e3 / steps as f64
        };
        let cpu_us = spent_us(&|_| true);
        Cost {
            wall_us,
            cpu_us: if cpu_us > 0.0 { cpu_us } else { wall_us },
            simulator_us: spent_us(&|thread| name_of(thread).starts_with(SIMULATOR)),
            client_us: spent_us(&|thread| thread == std::process::id().to_string()),
        }
    }
}

/// Returns a thread's name, up to 15 bytes; empty on other systems than Linux.
fn name_of(thread: &str) -> String {
    std::fs::read_to_string(format!("/proc/self/task/{thread}/comm")).unwrap_or_default()
}

/// Returns the processor time by thread, nanoseconds; empty on other systems than Linux.
fn threads_ns() -> BTreeMap<String, u64> {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let spent = tasks.filter_map(|task| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        let ns = text.split_whitespace().next()?.parse().ok()?;
        Some((task.file_name().to_string_lossy().into_owned(), ns))
    });
    spent.collect()
}

/// Creates a data folder with house, mission, phase and team; returns the team's token.
async fn furnish(folder: &Path) -> String {
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("a new database");
    let make = NewSplit {
        name: PHASE.to_owned(),
        houses: 1,
        scenes: vec![],
        missions: 1,
        seed: Seed::Number(5),
        rules: Rules::PAPER.to_owned(),
    };
    make_split(&data, &store, make, |_| ()).await.expect("a house with a mission");
    let open = NewPhase { max_slots: 1, max_side: 256, ..NewPhase::public(PHASE, PHASE) };
    open_phase(&data, &store, &open).await.expect("a phase");
    let token = admit(&store, "bench team", None).await.expect("a team");
    store.close().await;
    token
}

async fn open_servers(folder: &Path) -> RunningServers {
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("its database");
    let arena = Arena::open(&data, store.clone(), SCENE_MEMORY_MIB).await.expect("its phase");
    let servers = Servers::bind(&Addresses::LOCAL).await.expect("free ports");
    servers.open(Arc::new(arena), store.reader()).expect("running servers")
}
