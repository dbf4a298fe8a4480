//! Setting of a simulated world: data folder, phases, teams and limits.

use avln_arena::{
    Arena, BENCHMARK_VERSION,
    clock::Clock,
    data::DataFolder,
    ids::new_token,
    servers::Limits,
    setup::{NewPhase, NewSplit, make_split, open_phase},
};
use avln_challenge::{QuotaLimits, TokenScope};
use avln_dataset::Seed;
use avln_episode::{Modality, TimeLimits};
use avln_geom::Rng;
use avln_store::{AuditNote, NewToken, Store};
use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::OnceLock,
    time::Duration,
};
use tempfile::TempDir;

pub(crate) const TEAMS: [&str; 3] = ["red", "green", "blue"];
/// Secret of all phases: handles of episodes are the same in every simulation.
const SECRET: &str = "5555555555555555555555555555555555555555555555555555555555555555";
/// A phase whose runs have a wall time, and one whose runs end with it.
pub(crate) const PHASES: [&str; 2] = ["timed", "dated"];
/// Episodes of a run.
pub(crate) const EPISODES: u32 = 3;
/// Most slots of a run.
pub(crate) const SLOTS: u32 = 3;
/// Most steps of an episode.
const STEPS: u32 = 250;
/// Wall clock at the start, in the last hours of a month: 2026-01-31T18:00:00Z.
pub(crate) const START_UNIX_MS: i64 = 1_769_882_400_000;

/// Phase settings drawn for a world.
#[derive(Clone, Debug)]
pub(crate) struct PhaseSetting {
    pub(crate) id: &'static str,
    pub(crate) quotas: QuotaLimits,
    pub(crate) time: TimeLimits,
    pub(crate) closes_unix_ms: Option<i64>,
}

/// Settings of a world.
#[derive(Clone, Debug)]
pub(crate) struct Setting {
    pub(crate) phases: [PhaseSetting; 2],
    pub(crate) limits: Limits,
}

impl Setting {
    pub(crate) fn draw(random: &mut Rng) -> Self {
        let timed = TimeLimits { run_s: *pick(random, &[120, 300, 900]), ..time_limits(random) };
        let dated = TimeLimits { run_s: 0, ..time_limits(random) };
        let closes = START_UNIX_MS + 1000 * *pick(random, &[600_i64, 3600, 40 * 86_400]);
        let phase = |id, time, closes_unix_ms, quotas| PhaseSetting { id, time, closes_unix_ms, quotas };
        Self {
            phases: [
                phase(PHASES[0], timed, None, quotas(random)),
                phase(PHASES[1], dated, Some(closes), quotas(random)),
            ],
            limits: limits(random),
        }
    }
}

/// Returns a random item of a list that is not empty.
pub(crate) fn pick<'a, T>(random: &mut Rng, items: &'a [T]) -> &'a T {
    &items[random.below(items.len())]
}

fn time_limits(random: &mut Rng) -> TimeLimits {
    TimeLimits {
        step_ms: *pick(random, &[0, 2000, 5000]),
        bank_ms: *pick(random, &[0, 10_000]),
        run_s: 0,
        disconnect_s: *pick(random, &[0, 10, 40]),
        disconnect_total_s: *pick(random, &[20, 120]),
    }
}

fn quotas(random: &mut Rng) -> QuotaLimits {
    let limit = |random: &mut Rng, most: usize| random.chance(0.5).then(|| 2 + random.below(most) as u32);
    QuotaLimits {
        day: limit(random, 6),
        month: limit(random, 12),
        total: limit(random, 30),
        concurrent: limit(random, 4),
        uncharged: limit(random, 8),
    }
}

fn limits(random: &mut Rng) -> Limits {
    Limits {
        // Simulations block the simulated runtime, so that their order is repeatable.
        max_simulations: 0,
        max_sessions: 3 + random.below(6),
        max_slots: 4 + random.below(6) as u32,
        max_watchers: 4,
        timeouts_in_a_row: 2 + random.below(6) as u32,
        unary_idle: Duration::from_secs(*pick(random, &[20, 120])),
        overdue_interval: Duration::from_secs(*pick(random, &[3, 10, 10])),
        ..Limits::default()
    }
}

/// A data folder, with the secret token of every team.
pub(crate) struct Place {
    pub(crate) folder: TempDir,
    pub(crate) tokens: [String; 3],
}

impl Place {
    /// Copies the prepared data folder, and applies the setting.
    pub(crate) async fn prepare(setting: &Setting) -> Self {
        let folder = temporary_folder();
        copy(prepared(), folder.path()).expect("a copy of the prepared data folder");
        let data = DataFolder::open(folder.path()).expect("the folder is writable");
        let store = data.store().await.expect("its database");
        apply(&store, setting).await;
        let mut tokens = [const { String::new() }; 3];
        for (token, team) in tokens.iter_mut().zip(TEAMS) {
            *token = new_token("account").expect("randomness");
            let kind = TokenScope::Participant;
            let new = NewToken { secret: token, kind, name: "", team: Some(team), expires_unix_ms: None };
            store.issue_token(&new, START_UNIX_MS).await.expect("a token");
        }
        store.close().await;
        Self { folder, tokens }
    }

    pub(crate) fn data(&self) -> DataFolder {
        DataFolder::open(self.folder.path()).expect("the folder is writable")
    }

    pub(crate) fn database(&self) -> PathBuf {
        self.folder.path().join("avln.db")
    }

    /// Opens the arena and its database.
    pub(crate) async fn open(&self, clock: Clock) -> (Arena, Store) {
        let data = self.data();
        let store = data.store().await.expect("its database");
        let arena = Arena::open_at(clock, &data, store.clone(), 64).await.expect("its phases");
        (arena, store)
    }
}

async fn apply(store: &Store, setting: &Setting) {
    for change in &setting.phases {
        let mut phase = store.phase(change.id).await.expect("a phase");
        phase.quotas = change.quotas;
        phase.time = change.time;
        phase.schedule.closes_unix_ms = change.closes_unix_ms;
        phase.rules.max_steps = STEPS;
        // Agents use the pose only: nothing is rendered or heard, not even in advance.
        (phase.sensors.rgb, phase.sensors.depth, phase.sensors.audio) = (false, false, false);
        phase.max_slots = SLOTS;
        let note = AuditNote::default();
        store.change_phases(&[phase], &[note], START_UNIX_MS).await.expect("a change");
    }
}

/// A folder in memory, if the system offers one.
fn temporary_folder() -> TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder")
}

/// Returns a data folder with houses, phases and teams, made once.
fn prepared() -> &'static Path {
    static MADE: OnceLock<TempDir> = OnceLock::new();
    let make = || {
        let folder = temporary_folder();
        let runtime = tokio::runtime::Runtime::new().expect("a runtime");
        runtime.block_on(make(folder.path()));
        folder
    };
    // On another thread, because the caller may run in a runtime.
    MADE.get_or_init(|| std::thread::scope(|scope| scope.spawn(make).join().expect("a data folder"))).path()
}

async fn make(folder: &Path) {
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("a new database");
    let split = NewSplit {
        name: "tiny".to_owned(),
        houses: 1,
        scenes: vec![],
        // Some of them have no picture as a goal, which would be rendered at every start.
        missions: 4 * EPISODES as usize,
        seed: Seed::Number(5),
        rules: "lh-avln-v1".to_owned(),
    };
    make_split(&data, &store, split, |_| ()).await.expect("missions in a house");
    for phase in PHASES {
        let mut phase = open_phase(&data, &store, &NewPhase::public(phase, "tiny")).await.expect("a phase");
        phase.episodes.retain(|episode| episode.goals.iter().all(|goal| goal.modality != Modality::Image));
        phase.episodes.truncate(EPISODES as usize);
        assert_eq!(phase.episodes.len(), EPISODES as usize, "missions without pictures");
        store.upsert_phase(&phase, START_UNIX_MS).await.expect("a change");
        let committed = store.commit_phase(&phase.id, SECRET, BENCHMARK_VERSION, START_UNIX_MS).await;
        assert!(committed.expect("a commitment"), "the episodes are new");
    }
    for team in TEAMS {
        store.create_team(team, None, START_UNIX_MS).await.expect("a team");
    }
    store.close().await;
    super::database::Database::open(&folder.join("avln.db")).await.prepare().await;
}

fn copy(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}
