//! The hosted arena as a library: phases, episodes, run log, data folder, backup and management.
//!
//! [`Arena`] implements the `Host` of the gRPC server: it admits teams, starts episodes with a referee each, scores and
//! stores their records. [`servers`] serves it to agents, visitors and the operator.

pub mod admin;
mod ahead;
pub mod backup;
pub mod budget;
pub mod cache;
pub mod challenge;
pub mod data;
pub mod dataset;
mod episode;
mod failure;
pub mod heads;
mod heart;
mod host;
mod lookout;
pub mod office;
mod onlooker;
mod play;
mod refusals;
pub mod register;
mod replayer;
pub mod rescoring;
mod restore;
pub mod runlog;
mod scenes;
pub mod sealed;
pub mod secret;
pub mod servers;
pub mod setup;
pub mod sounds;
pub mod stages;
mod told;
mod warm;

pub use failure::{Failure, FailureKind};
pub use refusals::fault_count;
pub use replayer::Replayer;

use avln_grpc::Control;
use avln_referee::Referee;
use avln_store::{DowntimeCredit, Store};
use avln_web::{LiveStatus, ReplayRenderer, SignedLogs};
use budget::Budget;
use data::DataFolder;
use episode::{FaultInjection, Observer};
use heart::Heart;
use lookout::ControlStatus;
use onlooker::SceneRenderer;
use runlog::{RunLogs, SigningKey};
use scenes::SceneCache;
use stages::{Stage, Stages};
use std::{
    collections::BTreeSet,
    sync::{Arc, Mutex},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use tokio::sync::Semaphore;

/// Version of the benchmark: it changes whenever a score could change.
pub const BENCHMARK_VERSION: &str = "1.0.0";

/// Default memory for loaded scenes, MiB: tens of scans or two hundred houses.
pub const SCENE_MEMORY_MIB: u32 = 2048;

/// The host of all phases of a data folder.
pub struct Arena {
    store: Store,
    stages: Arc<Stages>,
    scenes: Arc<SceneCache>,
    /// Episodes in play by ticket.
    playing: Mutex<play::Playing>,
    /// Run logs.
    logs: Arc<RunLogs>,
    /// Signing key for logs of ended runs.
    key: Arc<SigningKey>,
    /// Limits prefetching to a single episode at a time, so that running episodes have priority.
    ahead: Arc<Semaphore>,
    control: Control,
    budget: Budget,
    heart: Heart,
    /// Renderer of replays for visitors.
    onlooker: Arc<SceneRenderer>,
    /// Episodes, by run and handle, that could neither be stored nor taken back.
    owed: Mutex<Owed>,
    faults: Option<FaultInjection>,
    observer: Option<Observer>,
}

type Owed = BTreeSet<(String, String)>;

impl Arena {
    /// Reads the phases of the data folder and their splits. Scenes stay ready in
    /// `scene_memory_mib` MiB; those that are being played stay even if they take more.
    ///
    /// # Errors
    /// When the database or a split cannot be read.
    pub async fn open(data: &DataFolder, store: Store, scene_memory_mib: u32) -> Result<Self, Failure> {
        let stages = Arc::new(Stages::open(data, &store).await?);
        let onlooker = Arc::new(SceneRenderer::new(store.clone(), stages.clone(), data.cache()));
        let budget_bytes = (scene_memory_mib as usize).saturating_mul(1 << 20);
        let scenes = Arc::new(SceneCache::new(budget_bytes, data.cache()));
        let logs = Arc::new(data.run_logs());
        keep_safe(&logs);
        let key = Arc::new(data.signing_key()?);
        let (playing, ahead) = (Mutex::default(), Arc::new(Semaphore::new(1)));
        let (control, budget, heart) = (Control::default(), Budget::default(), Heart::new());
        let made_up = store.credit_downtime(now_unix_ms()).await?;
        if made_up != DowntimeCredit::default() {
            let DowntimeCredit { away_ms, runs, phases } = made_up;
            tracing::info!(away_ms, runs, ?phases, "the server was down; open runs get the lost time back");
        }
        Ok(Self {
            store,
            stages,
            scenes,
            playing,
            logs,
            key,
            ahead,
            control,
            budget,
            heart,
            onlooker,
            owed: Mutex::default(),
            faults: None,
            observer: None,
        })
    }

    /// Sets the session budget.
    pub fn with_budget(self, budget: Budget) -> Self {
        Self { budget, ..self }
    }

    /// Injects faults, for tests: calls `disturb` on the simulator thread before every step with the number
    /// of steps taken.
    pub fn disturbed(self, disturb: impl Fn(u32) + Send + Sync + 'static) -> Self {
        Self { faults: Some(Arc::new(disturb)), ..self }
    }

    /// Adds an observer, for tests and tools: calls `watch` on the simulator thread before every observation
    /// with the episode handle and referee. The data stays in the process.
    pub fn watched(self, watch: impl Fn(&str, &Referee) + Send + Sync + 'static) -> Self {
        Self { observer: Some(Arc::new(watch)), ..self }
    }

    /// Stops new runs and gives open episodes `patience` to end. The next server extends deadlines by the
    /// downtime.
    ///
    /// # Errors
    /// If the database fails; the server then continues.
    pub async fn drain(&self, reason: &str, patience: Duration) -> Result<(), Failure> {
        self.store.record_drain(reason, now_unix_ms()).await?;
        self.control.drain(reason, patience);
        Ok(())
    }

    /// Control of live runs.
    pub fn control(&self) -> &Control {
        &self.control
    }

    /// Run logs and their signing key.
    pub fn signed_logs(&self) -> SignedLogs {
        SignedLogs { folder: self.logs.folder().to_owned(), key: self.key.public() }
    }

    /// Renderer of replays.
    pub fn onlooker(&self) -> Arc<dyn ReplayRenderer> {
        self.onlooker.clone()
    }

    /// Live status for visitors.
    pub fn lookout(&self) -> Arc<dyn LiveStatus> {
        Arc::new(ControlStatus(self.control.clone()))
    }

    /// The database, with the right to write.
    pub(crate) fn store(&self) -> &Store {
        &self.store
    }

    /// Bytes of scenes that are ready.
    pub fn scene_bytes(&self) -> usize {
        self.scenes.bytes()
    }

    /// Phase ids with the episode count of a run.
    ///
    /// # Errors
    /// If the phases are unreadable.
    pub async fn phases(&self) -> Result<Vec<(String, u32)>, Failure> {
        let stages = self.stages.now(&self.store).await?;
        Ok(stages.iter().map(|stage| (stage.phase.id.clone(), stage.phase.episodes_of_run())).collect())
    }
}

/// Longest delay of a log sync: steps lost in a power failure are repeated.
const SYNC_EVERY: Duration = Duration::from_secs(1);

/// Syncs run logs to disk periodically, as long as they are in use.
fn keep_safe(logs: &Arc<RunLogs>) {
    let logs = Arc::downgrade(logs);
    tokio::spawn(async move {
        let mut ticks = tokio::time::interval(SYNC_EVERY);
        loop {
            ticks.tick().await;
            let Some(logs) = logs.upgrade() else { return };
            if let Err(error) = tokio::task::spawn_blocking(move || logs.sync()).await {
                tracing::error!(%error, "cannot write run logs to the disk");
            }
        }
    });
}

/// The clock that results carry: milliseconds since 1970-01-01 UTC.
pub fn now_unix_ms() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}
