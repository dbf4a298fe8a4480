//! The hosted arena as a library: phases, episodes, run log, data folder, backup and management.
//!
//! [`Arena`] implements the `Host` of the gRPC server: it admits teams, starts episodes with a referee each, scores and
//! stores their records. [`servers`] serves it to agents, visitors and the operator.

pub mod actions;
pub mod admin;
pub mod audio;
pub mod backup;
pub mod budget;
pub mod cache;
pub mod challenge;
pub mod clock;
pub mod data;
pub mod dataset;
mod episodes;
mod failure;
mod host;
pub mod ids;
mod lru;
mod management;
mod phases;
pub mod replays;
mod restore;
pub mod runlog;
pub mod servers;
pub mod setup;

pub use failure::{Failure, FailureKind, fault_count};
pub use phases::seed_to_publish;

use avln_grpc::Control;
use avln_referee::Referee;
use avln_store::{DowntimeCredit, Store};
use budget::{Budget, TeamTurns};
use clock::{Clock, Heartbeat};
use data::DataFolder;
use episodes::{FaultInjection, Observer, OpenEpisodes, ReturnCause};
use ids::RunIds;
use jiff::Timestamp;
use phases::{PhaseCatalog, SceneCache};
use replays::SceneRenderer;
use runlog::{RunLogs, SigningKey};
use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io,
    path::Path,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};
use tokio::task::spawn_blocking;

/// Benchmark version; a possible change in scores needs a new one.
pub const BENCHMARK_VERSION: &str = "2.0.0";

/// Default memory for prepared scenes, MiB: tens of scans or two hundred houses.
pub const SCENE_MEMORY_MIB: u32 = 2048;

/// The host of a data folder's phases.
pub struct Arena {
    store: Store,
    phases: Arc<PhaseCatalog>,
    scenes: Arc<SceneCache>,
    open_episodes: Mutex<OpenEpisodes>,
    logs: Arc<RunLogs>,
    key: Arc<SigningKey>,
    /// Preparation of requested episodes.
    preparing: TeamTurns,
    /// Preparation in advance, an episode at a time.
    prefetching: Arc<TeamTurns>,
    control: Control,
    /// Public address of the web server, for links to runs.
    web_url: String,
    /// Keeps other servers away from the data folder.
    _lock: File,
    budget: Budget,
    clock: Clock,
    heartbeat: Heartbeat,
    replay_renderer: Arc<SceneRenderer>,
    /// Episodes, by run and handle, that could neither be stored nor returned.
    pending_returns: Mutex<PendingReturns>,
    run_ids: RunIds,
    faults: Option<FaultInjection>,
    observer: Option<Observer>,
}

/// The prepared scenes of an arena. Clones share them.
#[derive(Clone)]
pub struct PreparedScenes(Arc<SceneCache>);

type PendingReturns = BTreeMap<(String, String), ReturnCause>;

impl Arena {
    /// Locks the data folder and reads phases and splits; fails if another server uses the folder. Prepared scenes use
    /// `scene_memory_mib` MiB; scenes in use may exceed it.
    pub async fn open(data: &DataFolder, store: Store, scene_memory_mib: u32) -> Result<Self, Failure> {
        Self::open_locked(data.lock()?, data, store, scene_memory_mib).await
    }

    /// Reads phases and splits, as [`Arena::open`] does, with the lock of [`DataFolder::lock`]. A program locks the folder before
    /// it opens the database or changes anything, so that a second server is refused without a trace.
    pub async fn open_locked(
        lock: File,
        data: &DataFolder,
        store: Store,
        scene_memory_mib: u32,
    ) -> Result<Self, Failure> {
        let phases = PhaseCatalog::open(data, &store, None).await?;
        Self::host(lock, data, store, phases, scene_memory_mib, Clock::default()).await
    }

    /// Opens the data folder, as [`Arena::open`] does, by another clock than the system's, for simulations.
    pub async fn open_at(
        clock: Clock,
        data: &DataFolder,
        store: Store,
        scene_memory_mib: u32,
    ) -> Result<Self, Failure> {
        let phases = PhaseCatalog::open(data, &store, None).await?;
        Self::host(data.lock()?, data, store, phases, scene_memory_mib, clock).await
    }

    /// Hosts only the phase `id`, with the lock of [`DataFolder::lock`]. Splits of other phases may be sealed or missing, and runs
    /// of other phases wait for a server with all phases.
    pub async fn open_phase(lock: File, data: &DataFolder, store: Store, id: &str) -> Result<Self, Failure> {
        let phases = PhaseCatalog::open(data, &store, Some(id)).await?;
        Self::host(lock, data, store, phases, SCENE_MEMORY_MIB, Clock::default()).await
    }

    async fn host(
        lock: File,
        data: &DataFolder,
        store: Store,
        phases: PhaseCatalog,
        scene_memory_mib: u32,
        clock: Clock,
    ) -> Result<Self, Failure> {
        let phases = Arc::new(phases);
        let scene_bytes = (scene_memory_mib as usize).saturating_mul(1 << 20);
        let logs = Arc::new(data.run_logs().with_epoch(data.count_start(&lock)?));
        sync_periodically(&logs);
        // Before the credit: without a key no server runs, and the downtime continues.
        let key = Arc::new(data.signing_key()?);
        let credit = store.credit_downtime(clock.now_unix_ms()).await?;
        if credit != DowntimeCredit::default() {
            let DowntimeCredit { away_ms, runs, phases } = credit;
            tracing::info!(away_ms, runs, ?phases, "deadlines of open runs are extended by the downtime");
        }
        Ok(Self {
            scenes: Arc::new(SceneCache::new(scene_bytes, data.cache())),
            open_episodes: Mutex::default(),
            logs,
            key,
            preparing: TeamTurns::half_of_cores(),
            prefetching: Arc::new(TeamTurns::single()),
            control: Control::default(),
            web_url: String::new(),
            _lock: lock,
            budget: Budget::default(),
            heartbeat: Heartbeat::new(&clock),
            clock,
            replay_renderer: Arc::new(SceneRenderer::new(store.clone(), phases.clone(), data.cache())),
            pending_returns: Mutex::default(),
            run_ids: RunIds::default(),
            faults: None,
            observer: None,
            store,
            phases,
        })
    }

    /// Returns the prepared scenes, for [`Arena::with_scenes`].
    pub fn scenes(&self) -> PreparedScenes {
        PreparedScenes(self.scenes.clone())
    }

    /// Uses the prepared scenes of another arena, for simulations that restart often.
    pub fn with_scenes(self, PreparedScenes(scenes): PreparedScenes) -> Self {
        Self { scenes, ..self }
    }

    /// Sets the session budget.
    pub fn with_budget(self, budget: Budget) -> Self {
        Self { budget, ..self }
    }

    /// Sets the public address of the web server, such as `https://arena.example`; without it, links to runs are paths.
    pub fn with_web_url(self, web_url: String) -> Self {
        Self { web_url, ..self }
    }

    /// Sets the clock, for tests that change it.
    pub fn with_clock(self, clock: Clock) -> Self {
        Self { heartbeat: Heartbeat::new(&clock), clock, ..self }
    }

    /// Takes the ids of new runs from `next`, which must be unique, for simulations.
    pub fn with_run_ids(self, next: impl Fn() -> String + Send + Sync + 'static) -> Self {
        Self { run_ids: RunIds(Some(Arc::new(next))), ..self }
    }

    /// Injects faults, for tests: calls `inject` on the simulator thread before a step, with the step count.
    pub fn with_fault_injection(self, inject: impl Fn(u32) + Send + Sync + 'static) -> Self {
        Self { faults: Some(Arc::new(inject)), ..self }
    }

    /// Adds an observer, for tests and tools: called on the simulator thread before every observation.
    pub fn with_observer(self, watch: impl Fn(&str, &Referee) + Send + Sync + 'static) -> Self {
        Self { observer: Some(Arc::new(watch)), ..self }
    }

    /// Stops new runs and allows open episodes `patience` to end. The next server extends deadlines by the downtime.
    pub async fn drain(&self, reason: &str, patience: Duration) -> Result<(), Failure> {
        // Deadlines follow a change of the clock first: the downtime counts from this time.
        let time = self.settled_time().await.map_err(Failure::internal)?;
        self.store.record_drain(reason, time.unix_ms()).await?;
        drop(time);
        self.control.drain(reason, patience);
        Ok(())
    }

    /// Returns the control for live runs.
    pub fn control(&self) -> &Control {
        &self.control
    }

    /// Returns the prepared scenes' total size, bytes.
    pub fn scene_bytes(&self) -> usize {
        self.scenes.bytes()
    }

    /// Returns phase ids with episode counts per run.
    pub async fn phases(&self) -> Result<Vec<(String, u32)>, Failure> {
        let phases = self.phases.now(&self.store).await?;
        Ok(phases.iter().map(|phase| (phase.settings.id.clone(), phase.settings.episodes_of_run())).collect())
    }
}

/// Log sync interval: after a power failure, agents repeat the steps since the last sync.
const SYNC_INTERVAL: Duration = Duration::from_secs(1);

/// Syncs run logs to disk until they are dropped.
fn sync_periodically(logs: &Arc<RunLogs>) {
    let logs = Arc::downgrade(logs);
    tokio::spawn(async move {
        let mut ticks = tokio::time::interval(SYNC_INTERVAL);
        loop {
            ticks.tick().await;
            let Some(logs) = logs.upgrade() else { return };
            if let Err(error) = spawn_blocking(move || logs.sync()).await {
                tracing::error!(%error, "cannot sync run logs to disk");
            }
        }
    });
}

/// Returns the present time, milliseconds since 1970-01-01 UTC.
pub fn now_unix_ms() -> i64 {
    Timestamp::now().as_millisecond()
}

/// Returns options for a file that, if created, is accessible by its owner only.
pub(crate) fn private_file() -> OpenOptions {
    let mut options = OpenOptions::new();
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

/// Syncs the names in a folder, if supported.
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

/// Locks a mutex, also after a panic of another holder.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs blocking work on another thread.
pub async fn run_blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, Failure> + Send + 'static,
) -> Result<T, Failure> {
    spawn_blocking(work).await.map_err(Failure::internal)?
}
