//! Latency of pages over a full database: 1000 runs of 550 episodes, 200 requests per second.
//!
//! `cargo bench -p avln-web --bench leaderboards -- 20` measures each page for 20 seconds; the default is 10. Latency is
//! measured from the scheduled time, so a stalled server also counts for the waiting requests (no coordinated omission).

use avln_episode::{EndReason, Modality, Order, Rules};
use avln_scoring::{EpisodeScore, Metrics, summarise};
use avln_store::{GoalText, Phase, PhaseEpisode, Scene, SceneMap, Split, Store, Visibility};
use avln_web::Site;
use sqlx::{Connection, SqliteConnection};
use std::{
    io,
    net::SocketAddr,
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    runtime::Runtime,
    sync::Mutex,
    task::JoinSet,
    time::sleep_until,
};

/// Requests per second.
const RATE: u32 = 200;
/// Open connections.
const VISITORS: usize = 16;
/// Requests of a connection before the client reconnects, below the server's limit.
const REQUESTS_PER_CONNECTION: usize = 200;

/// Name of the database file.
const DATABASE: &str = "arena.db";
/// Phase id.
const PHASE: &str = "standard";
const RUNS: u32 = 1000;
const EPISODES: u32 = 550;
const SCENES: u32 = 25;
/// Teams, with two methods each.
const TEAMS: u32 = 25;
const SEED: u64 = 0x4156_4C4E;

fn main() {
    let seconds = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(10);
    Runtime::new().expect("a runtime").block_on(measure(seconds));
}

async fn measure(seconds: u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let begun = Instant::now();
    let filled = fill_database(folder.path()).await;
    println!(
        "{} runs of {} episodes, {} MB, made in {:.0} s",
        RUNS,
        EPISODES,
        filled.bytes / 1_000_000,
        begun.elapsed().as_secs_f64()
    );
    let store = Store::open(&folder.path().join(DATABASE)).await.expect("the database");
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
    let web = listener.local_addr().expect("its address");
    tokio::spawn(avln_web::serve(listener, store.reader(), Site::default(), std::future::pending()));
    println!("| page | first, ms | bytes | p50 ms | p99 ms | worst ms |\n|---|---:|---:|---:|---:|---:|");
    let leaderboard = format!("/leaderboard/{}", PHASE);
    let pages = [
        ("home", "/".to_owned()),
        ("both leaderboards", leaderboard.clone()),
        ("leaderboard", format!("{leaderboard}?order=ordered")),
        ("leaderboard by SPL", format!("{leaderboard}?order=ordered&sort=spl")),
        ("leaderboard, JSON", format!("/api/v1/phases/{}/leaderboard?order=ordered", PHASE)),
        ("run", format!("/runs/{}", filled.run)),
        ("runs", "/runs".to_owned()),
    ];
    for (name, path) in pages {
        report(name, web, &path, seconds).await;
    }
}

async fn report(name: &str, web: SocketAddr, path: &str, seconds: u32) {
    let mut first = Visitor::new(web);
    let begun = Instant::now();
    let bytes = first.get(path).await;
    let first_ms = begun.elapsed().as_secs_f64() * 1e3;
    let mut waited_ms = send_requests(web, path, RATE * seconds).await;
    waited_ms.sort_by(f64::total_cmp);
    let at = |share: f64| waited_ms[((waited_ms.len() - 1) as f64 * share) as usize];
    println!("| {name} | {first_ms:.0} | {bytes} | {:.1} | {:.1} | {:.1} |", at(0.5), at(0.99), at(1.0));
}

/// Sends `count` requests at [`RATE`], and returns the latencies, milliseconds.
async fn send_requests(web: SocketAddr, path: &str, count: u32) -> Vec<f64> {
    let idle: Arc<Mutex<Vec<Visitor>>> = Arc::default();
    idle.lock().await.extend((0..VISITORS).map(|_| Visitor::new(web)));
    let (begun, mut asked) = (Instant::now(), JoinSet::new());
    for number in 0..count {
        let due = begun + Duration::from_secs(1) * number / RATE;
        sleep_until(due.into()).await;
        let (idle, path) = (idle.clone(), path.to_owned());
        asked.spawn(async move {
            let free = idle.lock().await.pop();
            let mut visitor = free.unwrap_or_else(|| Visitor::new(web));
            visitor.get(&path).await;
            let waited_ms = due.elapsed().as_secs_f64() * 1e3;
            idle.lock().await.push(visitor);
            waited_ms
        });
    }
    asked.join_all().await
}

/// A client with a connection.
struct Visitor {
    web: SocketAddr,
    stream: Option<TcpStream>,
    answers: usize,
}

impl Visitor {
    fn new(web: SocketAddr) -> Self {
        Self { web, stream: None, answers: 0 }
    }

    /// Requests a page as a browser does, and returns the size of the response. Reconnects if the server has closed the connection.
    async fn get(&mut self, path: &str) -> usize {
        if self.answers == REQUESTS_PER_CONNECTION {
            *self = Self::new(self.web);
        }
        let is_old = self.stream.is_some();
        match self.try_get(path).await {
            Ok(bytes) => bytes,
            Err(_) if is_old => {
                *self = Self::new(self.web);
                self.try_get(path).await.expect("an answer")
            }
            Err(error) => panic!("{path}: {error}"),
        }
    }

    async fn try_get(&mut self, path: &str) -> io::Result<usize> {
        let web = self.web;
        let stream = match &mut self.stream {
            Some(stream) => stream,
            none => none.insert(TcpStream::connect(web).await?),
        };
        self.answers += 1;
        let request = format!("GET {path} HTTP/1.1\r\nHost: {web}\r\nAccept-Encoding: gzip\r\n\r\n");
        stream.write_all(request.as_bytes()).await?;
        read_answer(stream).await
    }
}

/// Reads a response up to the declared length or the final chunk.
async fn read_answer(stream: &mut TcpStream) -> io::Result<usize> {
    let (mut bytes, mut part) = (Vec::new(), [0; 16 << 10]);
    loop {
        let read = stream.read(&mut part).await?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes.extend_from_slice(&part[..read]);
        let Some(head) = bytes.windows(4).position(|end| end == b"\r\n\r\n") else { continue };
        let words = String::from_utf8_lossy(&bytes[..head]).to_lowercase();
        assert!(words.starts_with("http/1.1 200"), "{words}");
        let length =
            words.split("content-length: ").nth(1).and_then(|rest| rest.lines().next()?.parse().ok());
        let is_whole = match length {
            Some(length) => bytes.len() - head - 4 >= length,
            None => bytes.ends_with(b"0\r\n\r\n"),
        };
        if is_whole {
            return Ok(bytes.len());
        }
    }
}

/// The filled database.
struct FilledDatabase {
    /// Id of one of the runs.
    run: String,
    /// Database size.
    bytes: u64,
}

/// Creates a database with a phase: half of the runs are ordered, with ten runs per method and order.
async fn fill_database(folder: &Path) -> FilledDatabase {
    let path = folder.join(DATABASE);
    let known = Store::open(&path).await.expect("a database");
    add_phase(&known).await;
    for team in 0..TEAMS {
        known.create_team(&format!("team {team:02}"), None, 1).await.expect("a team");
    }
    known.close().await;
    let mut database =
        SqliteConnection::connect(&format!("sqlite:{}", path.display())).await.expect("its file");
    let mut tx = database.begin().await.expect("a transaction");
    for number in 0..RUNS {
        add_run(&mut tx, number).await;
    }
    tx.commit().await.expect("a database");
    sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)").execute(&mut database).await.expect("one file");
    database.close().await.expect("a closed database");
    FilledDatabase { run: run_id(0), bytes: path.metadata().expect("its file").len() }
}

fn run_id(number: u32) -> String {
    format!("run_{number:04}")
}

fn scene(episode: u32) -> String {
    format!("house-{:02}", episode % SCENES)
}

async fn add_phase(store: &Store) {
    let split = Split { name: "val".to_owned(), digest: "d".to_owned(), scenes: SCENES, episodes: EPISODES };
    store.upsert_split(&split).await.expect("a split");
    for number in 0..SCENES {
        let map = SceneMap { min: [0.0; 3], max: [12.0, 3.0, 9.0], polygons: vec![] };
        let scene = Scene { name: scene(number), digest: format!("{number}"), map };
        store.upsert_scene(&scene).await.expect("a scene");
    }
    let goal = |text: &str| GoalText { modality: Modality::Category, text: Some(text.to_owned()) };
    let goals = ["chair", "table", "lamp"].map(goal).to_vec();
    let episode = |number| PhaseEpisode {
        episode: format!("e{number:03}"),
        scene: scene(number),
        goals: goals.clone(),
    };
    let episodes = (0..EPISODES).map(episode).collect();
    let public = Visibility::Public;
    let phase =
        Phase { scores: public, replays: public, ..Phase::new(PHASE, "val", Rules::paper(), episodes) };
    store.upsert_phase(&phase, 2).await.expect("a phase");
}

async fn add_run(tx: &mut SqliteConnection, number: u32) {
    let (id, order) =
        (run_id(number), if number.is_multiple_of(2) { Order::Ordered } else { Order::Unordered });
    let (team, method) = ((number / 2) % TEAMS, (number / 2 / TEAMS) % 2);
    let skill = 0.1 + 0.03 * f64::from(team) + 0.05 * f64::from(method);
    let sensors = r#"{"rgb":true,"depth":true,"audio":true,"width":128,"height":128,"hfov_rad":1.57}"#;
    sqlx::query(
        "INSERT INTO runs (id, phase, team, method, version, mission_order, state, episodes, sensors, senses, digests, created_ms, \
         finished_ms) VALUES ($1, $2, $3, $4, '1.0', $5, 'completed', $6, $7, $7, '{}', $8, $9)",
    )
    .bind(&id)
    .bind(PHASE)
    .bind(format!("team {team:02}"))
    .bind(format!("method {method}"))
    .bind(order.as_str())
    .bind(EPISODES)
    .bind(sensors)
    .bind(1_790_000_000_000 + i64::from(number) * 1000)
    .bind(1_790_000_500_000 + i64::from(number) * 1000)
    .execute(&mut *tx)
    .await
    .expect("a run");
    let scores: Vec<_> = (0..EPISODES).map(|episode| score(number, episode, order, skill)).collect();
    for (ordinal, score) in scores.iter().enumerate() {
        add_episode(tx, &id, ordinal as u32, score).await;
    }
    let summary = serde_json::to_string(&summarise(&scores, SEED)).expect("JSON");
    let insert = "INSERT INTO run_summaries (run, scored, isr, summary) VALUES ($1, $2, $3, $4)";
    let isr: f64 = scores.iter().map(|score| score.metrics.isr).sum();
    sqlx::query(insert)
        .bind(&id)
        .bind(EPISODES)
        .bind(isr)
        .bind(summary)
        .execute(tx)
        .await
        .expect("a summary");
}

async fn add_episode(tx: &mut SqliteConnection, run: &str, ordinal: u32, score: &EpisodeScore) {
    let m = &score.metrics;
    let metrics = serde_json::to_string(m).expect("JSON");
    sqlx::query(
        "INSERT INTO episodes (run, ordinal, episode, scene, state, attempts, handle, end_reason, metrics, time_account, \
         started_ms, finished_ms) VALUES ($1, $2, $3, $4, 'terminated', 1, $1 || '-' || $2, $5, $6, \
         '{\"simulation_s\":1.5,\"encoding_s\":0.25,\"queue_s\":0.5,\"thinking_s\":4.25}', 1790000000000, 1790000000000)",
    )
    .bind(run)
    .bind(ordinal)
    .bind(&score.episode)
    .bind(&score.scene)
    .bind(if m.sr > 0.5 { EndReason::Stopped } else { EndReason::StepLimit }.as_str())
    .bind(metrics)
    .execute(tx)
    .await
    .expect("an episode");
}

/// Returns a pseudo-random score of a method of the given skill.
fn score(run: u32, episode: u32, order: Order, skill: f64) -> EpisodeScore {
    let goals = 2 + episode % 3;
    let luck = |salt| f64::from(mixed(run, episode, salt) % 1000) / 1000.0;
    let found = (0..goals).filter(|goal| luck(*goal) < skill).count() as u32;
    let (isr, ratio) = (f64::from(found) / f64::from(goals), 0.3 + 0.6 * luck(9));
    let sr = f64::from(u8::from(found == goals));
    let metrics = Metrics {
        goals,
        found,
        sr,
        isr,
        osr: isr,
        osr_all: sr,
        spl: sr * ratio,
        soft_spl: isr * ratio,
        sna: sr * ratio * 0.9,
        steps: 200 + mixed(run, episode, 10) % 800,
        path_m: 20.0 + 60.0 * luck(11),
        reference_m: 15.0 + f64::from(episode % 10),
        collisions: mixed(run, episode, 12) % 40,
        wrong_submits: mixed(run, episode, 13) % 3,
        steps_to_goal: (0..goals).map(|goal| (goal < found).then_some(90 * (goal + 1))).collect(),
        final_distance_m: vec![Some(3.5); goals as usize],
        ..Metrics::default()
    };
    EpisodeScore { episode: format!("e{episode:03}"), scene: scene(episode), order, metrics }
}

/// Hashes the arguments with the finaliser of MurmurHash3 (Appleby 2011).
fn mixed(run: u32, episode: u32, salt: u32) -> u32 {
    let mut hash =
        run.wrapping_mul(0x9E37_79B9) ^ episode.wrapping_mul(0x85EB_CA6B) ^ salt.wrapping_mul(0xC2B2_AE35);
    for factor in [0x85EB_CA6B_u32, 0xC2B2_AE35] {
        hash = (hash ^ (hash >> 15)).wrapping_mul(factor);
    }
    hash ^ (hash >> 16)
}
