//! The suite's split and server.

use super::{AgentVariant, hints::LiveEpisodes, results::EpisodeKey};
use crate::{dataset::build::Builder, internal};
use avln_arena::data::DataFolder;
use avln_arena::dataset::{DatasetFiles, SplitFolder};
use avln_arena::servers::RunningServers;
use avln_arena::setup::{self, admit};
use avln_arena::{Arena, BENCHMARK_VERSION, Failure, FailureKind, SCENE_MEMORY_MIB, now_unix_ms};
use avln_dataset::{EpisodeSpec, Recipe, SceneChoice};
use avln_episode::{Order, Rules, Sounds};
use avln_store::{AuditNote, Phase, PhaseEpisode, Reference, Store};
use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const RECIPE: &str = include_str!("recipe.json");
const TEAM: &str = "baselines";

/// The split's size and pool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SuiteSize {
    /// Houses.
    pub houses: u32,
    /// Missions per house.
    pub missions: usize,
    /// `true` for houses from the training pool, to tune agents.
    pub practice: bool,
}

impl Default for SuiteSize {
    /// Returns 200 missions in 25 houses from the validation pool.
    fn default() -> Self {
        Self { houses: 25, missions: 8, practice: false }
    }
}

impl SuiteSize {
    /// Returns the split's name in the recipe.
    fn split(self) -> &'static str {
        if self.practice { "train" } else { "val" }
    }
}

/// A suite's locked folder.
pub(super) struct SuiteFolder {
    folder: PathBuf,
    data: DataFolder,
    size: SuiteSize,
    pub(super) split: Arc<SplitFolder>,
    pub(super) rules: Rules,
    _lock: File,
}

pub(super) struct HostedSuite {
    pub(super) store: Store,
    pub(super) servers: RunningServers,
    pub(super) token: String,
    pub(super) live: Arc<LiveEpisodes>,
}

/// An agent's missions in one order, hosted as a phase.
pub(super) struct Batch {
    pub(super) variant: AgentVariant,
    pub(super) order: Order,
    pub(super) phase: String,
    pub(super) episodes: Vec<PhaseEpisode>,
}

impl SuiteFolder {
    /// Locks the folder and builds the split if it is missing.
    pub(super) fn open(folder: &Path, size: SuiteSize) -> Result<Self, Failure> {
        let cannot = |error: std::io::Error| {
            Failure::new(FailureKind::Data, format!("cannot use {}: {error}", folder.display()))
        };
        fs::create_dir_all(folder).map_err(cannot)?;
        let lock = File::create(folder.join("lock")).map_err(cannot)?;
        lock.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => {
                let message = format!("another baseline suite is running in {}", folder.display());
                Failure::new(FailureKind::Data, message)
                    .hinted("wait until it ends, or choose another folder with --out")
            }
            TryLockError::Error(error) => cannot(error),
        })?;
        let data = DataFolder::open(&folder.join("data"))?;
        let split = build_split(&folder.join("dataset"), &data, size)?;
        let mut rules = setup::rules_of(TEAM, &split)?;
        rules.sounds = if size.practice { Sounds::Train } else { Sounds::Validation };
        Ok(Self { folder: folder.to_owned(), data, size, split: Arc::new(split), rules, _lock: lock })
    }

    pub(super) fn results(&self) -> PathBuf {
        results_path(&self.folder)
    }

    /// Returns all missions: every house's first, then every house's second, and so on.
    pub(super) fn episodes(&self) -> Result<Vec<PhaseEpisode>, Failure> {
        let mut episodes = setup::phase_episodes(&self.split)?;
        let number =
            |episode: &PhaseEpisode| episode.episode.rsplit_once('-').map(|(_, number)| number.to_owned());
        episodes.sort_by_key(|episode| (number(episode), episode.scene.clone()));
        Ok(episodes)
    }

    /// Returns an episode's key for this build and split.
    pub(super) fn key(&self, agent: &str, order: Order, episode: &str, seed: u64) -> EpisodeKey {
        EpisodeKey {
            agent: agent.to_owned(),
            order: order.as_str().to_owned(),
            episode: episode.to_owned(),
            seed,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            benchmark: BENCHMARK_VERSION.to_owned(),
            split: self.split.digest().to_owned(),
        }
    }

    /// Starts a server with an empty database and one phase per batch.
    pub(super) async fn host(&self, batches: &[Batch]) -> Result<HostedSuite, Failure> {
        // Before the old database is deleted: `avln serve` may use it.
        let lock = self.data.lock()?;
        // Earlier episodes are in the results file: an old database would only contain unfinished runs.
        self.forget_runs()?;
        let name = self.data.link_split(&self.folder.join("dataset"), self.size.split())?;
        let store = self.data.store().await?;
        setup::register_split(&store, &name, &self.split, &[]).await?;
        let mut phases = Vec::with_capacity(batches.len());
        for Batch { phase, episodes, .. } in batches {
            phases.push(Phase::new(phase, &name, self.rules.clone(), episodes.clone()));
        }
        let notes = vec![AuditNote::default(); phases.len()];
        store.change_phases(&phases, &notes, now_unix_ms()).await?;
        let token = admit(&store, TEAM, Some(Reference::Baseline)).await?;
        let arena = Arena::open_locked(lock, &self.data, store.clone(), SCENE_MEMORY_MIB).await?;
        let (servers, live) = serve(arena, &store).await?;
        Ok(HostedSuite { store, servers, token, live })
    }

    fn forget_runs(&self) -> Result<(), Failure> {
        let root = self.data.root();
        let files = ["avln.db", "avln.db-wal", "avln.db-shm"].map(|name| root.join(name));
        let removed = files.iter().map(fs::remove_file).chain([fs::remove_dir_all(root.join("runs"))]);
        let mut failed = removed.filter_map(Result::err).filter(|error| error.kind() != ErrorKind::NotFound);
        failed.next().map_or(Ok(()), |error| {
            Err(Failure::new(FailureKind::Data, format!("cannot clear {}: {error}", root.display())))
        })
    }
}

/// Serves an arena locally and reports every episode's state to the returned table.
pub(super) async fn serve(
    arena: Arena,
    store: &Store,
) -> Result<(RunningServers, Arc<LiveEpisodes>), Failure> {
    let live = Arc::new(LiveEpisodes::default());
    let watching = live.clone();
    let arena = arena.with_observer(move |handle, referee| watching.note(handle, referee));
    Ok((RunningServers::local_for(arena, store).await?, live))
}

/// Returns the mission behind a run's episode handle.
pub(super) async fn mission_of(
    store: &Store,
    split: &SplitFolder,
    run: &str,
    handle: &str,
) -> Result<EpisodeSpec, Failure> {
    let open = store.running_episodes().await?;
    let open = open.into_iter().find(|open| open.run == run && open.handle == handle);
    let spec = open.map(|open| split.episode(&open.episode)).transpose()?.flatten();
    spec.ok_or_else(|| internal(format!("the split has no episode for handle {handle}")))
}

pub(super) fn client_order(order: Order) -> avln_client::Order {
    match order {
        Order::Ordered => avln_client::Order::Ordered,
        Order::Unordered => avln_client::Order::Unordered,
    }
}

pub(super) fn results_path(folder: &Path) -> PathBuf {
    folder.join("results.jsonl")
}

fn build_split(folder: &Path, data: &DataFolder, size: SuiteSize) -> Result<SplitFolder, Failure> {
    let mut recipe = Recipe::from_json(RECIPE)?;
    let name = size.split();
    recipe.splits.retain(|split| split.name == name);
    for split in &mut recipe.splits {
        split.missions_per_scene = size.missions;
        if let SceneChoice::Houses { count, .. } = &mut split.scenes {
            *count = size.houses;
        }
    }
    let builder = Builder::open(DatasetFiles::at(folder), recipe)?;
    let mut reported = 0;
    builder.run(None, Some(&data.cache()), |progress| {
        if progress.done > reported {
            reported = progress.done;
            eprintln!("missions: {} of {}", progress.done, progress.missions);
        }
    })?;
    SplitFolder::open(folder, name)
}
