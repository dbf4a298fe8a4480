//! A database of the size of a busy year.

use avln_episode::{EndReason, Modality, Order, Rules};
use avln_scoring::{EpisodeScore, Metrics, summarise};
use avln_store::{GoalText, Phase, PhaseEpisode, Scene, SceneMap, Split, Store, Visibility};
use sqlx::{Connection, SqliteConnection};
use std::path::Path;

/// Name of the database file.
pub(crate) const DATABASE: &str = "arena.db";
/// Phase id.
pub(crate) const PHASE: &str = "standard";
pub(crate) const RUNS: u32 = 1000;
pub(crate) const EPISODES: u32 = 550;
const SCENES: u32 = 25;
/// Teams, with two methods each.
const TEAMS: u32 = 25;
const SEED: u64 = 0x4156_4C4E;

/// The filled database.
pub(crate) struct Filled {
    /// Id of one of the runs.
    pub(crate) run: String,
    /// Database size.
    pub(crate) bytes: u64,
}

/// Creates a database with a phase and its runs: half of them ordered, and ten runs per method and order.
pub(crate) async fn fill(folder: &Path) -> Filled {
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
    Filled { run: run_id(0), bytes: path.metadata().expect("its file").len() }
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
