//! The split of the baseline suite, and its server.

use super::{live_episodes::LiveEpisodes, results::EpisodeKey};
use crate::dataset::build::Builder;
use avln_arena::{Arena, BENCHMARK_VERSION, Failure, FailureKind, SCENE_MEMORY_MIB, data::DataFolder, dataset::{DatasetFiles, SplitFolder}, now_unix_ms, servers::RunningServers, setup::{admit, self}};
use avln_dataset::{Recipe, SceneChoice};
use avln_episode::{Order, Rules, Sounds};
use avln_store::{AuditNote, Phase, PhaseEpisode, Reference, Store};
use std::{
    fs::{self, File, TryLockError},
    path::{Path, PathBuf},
    sync::Arc,
};

const RECIPE: &str = include_str!("recipe.json");
const TEAM: &str = "ladder";

/// Size and pool of the split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SuiteSize {
    /// Houses.
    pub houses: u32,
    /// Missions per house.
    pub missions: usize,
    /// Uses houses of the training pool, to tune agents.
    pub practice: bool,
}

impl Default for SuiteSize {
    /// 200 missions in 25 houses of the validation pool.
    fn default() -> Self {
        Self { houses: 25, missions: 8, practice: false }
    }
}

impl SuiteSize {
    /// Name of the split in the recipe.
    fn split(self) -> &'static str {
        if self.practice { "train" } else { "val" }
    }
}

/// The locked folder of a suite.
pub(super) struct SuiteFolder {
    folder: PathBuf,
    data: DataFolder,
    size: SuiteSize,
    pub(super) split: Arc<SplitFolder>,
    pub(super) rules: Rules,
    _lock: File,
}

/// A running server for the suite.
pub(super) struct HostedSuite {
    pub(super) store: Store,
    pub(super) servers: RunningServers,
    pub(super) token: String,
    pub(super) live: Arc<LiveEpisodes>,
}

/// The missions of an agent in one order, hosted as a phase.
pub(super) struct Batch {
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
                let message = format!("another ladder is played in {}", folder.display());
                Failure::new(FailureKind::Data, message)
                    .hinted("wait for it, or use another folder with --out")
            }
            TryLockError::Error(error) => cannot(error),
        })?;
        let data = DataFolder::open(&folder.join("data"))?;
        let split = build_split(&folder.join("dataset"), &data, size)?;
        let mut rules = setup::rules_of("ladder", &split)?;
        rules.sounds = if size.practice { Sounds::Train } else { Sounds::Validation };
        Ok(Self { folder: folder.to_owned(), data, size, split: Arc::new(split), rules, _lock: lock })
    }

    pub(super) fn results(&self) -> PathBuf {
        results_path(&self.folder)
    }

    /// Returns all missions: the first one of every house, then the second one, and so on.
    pub(super) fn episodes(&self) -> Result<Vec<PhaseEpisode>, Failure> {
        let mut episodes = setup::phase_episodes(&self.split)?;
        let number =
            |episode: &PhaseEpisode| episode.episode.rsplit_once('-').map(|(_, number)| number.to_owned());
        episodes.sort_by_key(|episode| (number(episode), episode.scene.clone()));
        Ok(episodes)
    }

    /// Returns the key of an episode for this build and split.
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

    /// Starts a server with one phase per batch and an empty database; earlier episodes are in the results file.
    pub(super) async fn host(&self, batches: &[Batch]) -> Result<HostedSuite, Failure> {
        self.forget_runs()?;
        let name = self.data.link_split(&self.folder.join("dataset"), self.size.split())?;
        let store = self.data.store().await?;
        setup::register_split(&store, &name, &self.split, &[]).await?;
        let phase =
            |batch: &Batch| Phase::new(&batch.phase, &name, self.rules.clone(), batch.episodes.clone());
        let phases: Vec<_> = batches.iter().map(phase).collect();
        let notes = vec![AuditNote::default(); phases.len()];
        store.change_phases(&phases, &notes, now_unix_ms()).await?;
        let token = admit(&store, TEAM, Some(Reference::Baseline)).await?;
        let live = Arc::new(LiveEpisodes::default());
        let watching = live.clone();
        let arena = Arena::open(&self.data, store.clone(), SCENE_MEMORY_MIB).await?;
        let arena = arena.with_observer(move |handle, referee| watching.note(handle, referee));
        let servers = RunningServers::local_for(arena, &store).await?;
        Ok(HostedSuite { store, servers, token, live })
    }

    fn forget_runs(&self) -> Result<(), Failure> {
        let root = self.data.root();
        let files = ["avln.db", "avln.db-wal", "avln.db-shm"].map(|name| root.join(name));
        let removed = files.iter().map(fs::remove_file).chain([fs::remove_dir_all(root.join("runs"))]);
        let failed =
            removed.filter_map(Result::err).find(|error| error.kind() != std::io::ErrorKind::NotFound);
        failed.map_or(Ok(()), |error| {
            Err(Failure::new(FailureKind::Data, format!("cannot clear {}: {error}", root.display())))
        })
    }
}

/// Path of the results file.
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
    let mut told = 0;
    builder.run(None, Some(&data.cache()), |progress| {
        if progress.done > told {
            told = progress.done;
            eprintln!("missions: {} of {}", progress.done, progress.missions);
        }
    })?;
    SplitFolder::open(folder, name)
}
