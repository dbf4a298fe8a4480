//! The suite's split and server.

use super::results::{EpisodeKey, MissionFacts};
use super::{AgentVariant, SuiteOptions, hints::LiveEpisodes, track::feedback_name};
use crate::{dataset::build::Builder, internal};
use avln_arena::data::DataFolder;
use avln_arena::dataset::{DatasetFiles, SplitFolder};
use avln_arena::servers::RunningServers;
use avln_arena::setup::{self, admit};
use avln_arena::{Arena, BENCHMARK_VERSION, Failure, FailureKind, SCENE_MEMORY_MIB, now_unix_ms};
use avln_dataset::{EpisodeSpec, Recipe};
use avln_episode::{Order, Rules, Sounds};
use avln_store::{AuditNote, Phase, PhaseEpisode, Reference, Store};
use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const TEAM: &str = "baselines";

/// A suite's locked folder.
pub(super) struct SuiteFolder {
    folder: PathBuf,
    data: DataFolder,
    dataset: PathBuf,
    /// Key without agent, order and episode.
    pub(super) edition: EpisodeKey,
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
    pub(super) fn open(folder: &Path, plan: &SuiteOptions) -> Result<Self, Failure> {
        let lock = lock(folder)?;
        let data = DataFolder::open(&folder.join("data"))?;
        let recipe = plan.track.recipe(plan.size)?;
        let dataset = folder.join(format!("dataset-{}", recipe.name));
        let split = build_split(&dataset, &data, recipe, plan.size.split())?;
        let mut rules = plan.track.rules(setup::rules_of(TEAM, &split)?, plan.feedback)?;
        rules.sounds = if plan.size.practice { Sounds::Train } else { Sounds::Validation };
        let edition = EpisodeKey {
            agent: String::new(),
            order: String::new(),
            episode: String::new(),
            seed: plan.seed,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            benchmark: BENCHMARK_VERSION.to_owned(),
            split: split.digest().to_owned(),
            track: plan.track.label(plan.size.practice),
            rules: rules.name.clone(),
            feedback: feedback_name(rules.feedback).to_owned(),
            side_px: plan.side,
            split_seed: plan.size.split_seed,
        };
        let (folder, split) = (folder.to_owned(), Arc::new(split));
        Ok(Self { folder, data, dataset, edition, split, rules, _lock: lock })
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

    /// Returns an episode's key for this build, split and rules.
    pub(super) fn key(&self, agent: &str, order: Order, episode: &str) -> EpisodeKey {
        let (agent, order, episode) = (agent.to_owned(), order.as_str().to_owned(), episode.to_owned());
        EpisodeKey { agent, order, episode, ..self.edition.clone() }
    }

    /// Returns the facts of a mission in an order.
    pub(super) fn facts(&self, scene: &str, spec: &EpisodeSpec, order: Order) -> MissionFacts {
        let line = self.split.scenes().iter().find(|line| line.name == scene);
        let house = line.and_then(|line| line.facts).unwrap_or_default();
        let tour = match order {
            Order::Ordered => &spec.ordered,
            Order::Unordered => &spec.unordered,
        };
        MissionFacts { reference_steps: tour.steps, storeys: house.storeys, area_m2: house.area_m2 }
    }

    /// Starts a server with an empty database and one phase per batch.
    pub(super) async fn host(&self, batches: &[Batch]) -> Result<HostedSuite, Failure> {
        // Before the old database is deleted: `avln serve` may use it.
        let lock = self.data.lock()?;
        // Earlier episodes are in the results file: an old database would only contain unfinished runs.
        self.forget_runs()?;
        let name = self.data.link_split(&self.dataset, self.split.name())?;
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

/// Locks a suite's folder, which is created if it is missing.
pub(super) fn lock(folder: &Path) -> Result<File, Failure> {
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
    Ok(lock)
}

fn build_split(folder: &Path, data: &DataFolder, recipe: Recipe, name: &str) -> Result<SplitFolder, Failure> {
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
