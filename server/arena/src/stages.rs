//! Hosted phases, reloaded after changes by the organiser.

use super::{BENCHMARK_VERSION, data::DataFolder, now_unix_ms, register, scenes::SceneCache, secret};
use crate::{Failure, FailureKind, dataset::SplitFolder};
use avln_dataset::{EpisodeSpec, SceneSource};
use avln_episode::Rules;
use avln_referee::Audio;
use avln_store::{Phase, PhaseEpisode, Scene, Store};
use avln_world::SceneAssets;
use std::sync::Arc;
use tokio::sync::Mutex;

/// A phase with its missions, clips and head model.
pub(super) struct Stage {
    pub(super) phase: Phase,
    pub(super) split: Arc<SplitFolder>,
    pub(super) audio: Audio,
}

/// All phases in the organiser's order.
pub(super) type StageList = Arc<Vec<Arc<Stage>>>;

/// The phases as they were read last, and the organiser's change after which that was.
pub(super) struct Stages {
    data: DataFolder,
    read: Mutex<(i64, StageList)>,
}

impl Stages {
    /// Reads all phases of the data folder.
    pub(super) async fn open(data: &DataFolder, store: &Store) -> Result<Self, Failure> {
        let change = store.newest_audit_id().await?;
        let mut stages = Vec::new();
        for phase in store.phases().await? {
            commit(store, &phase.id).await?;
            stages.push(Arc::new(Stage::read(data, phase, &[])?));
        }
        Ok(Self { data: data.clone(), read: Mutex::new((change, Arc::new(stages))) })
    }

    /// The present phases. A phase whose change cannot be hosted stays as before.
    pub(super) async fn now(&self, store: &Store) -> Result<StageList, Failure> {
        let mut read = self.read.lock().await;
        let change = store.newest_audit_id().await?;
        if change != read.0 {
            *read = (change, self.read_again(store, &read.1).await?);
        }
        Ok(read.1.clone())
    }

    async fn read_again(&self, store: &Store, before: &StageList) -> Result<StageList, Failure> {
        let phases = store.phases().await?;
        for phase in &phases {
            commit(store, &phase.id).await?;
        }
        let (data, before) = (self.data.clone(), before.clone());
        let read = move || phases.into_iter().filter_map(|phase| reread(&data, phase, &before)).collect();
        let stages = tokio::task::spawn_blocking(read).await;
        stages.map(Arc::new).map_err(|error| Failure::new(FailureKind::Internal, error))
    }
}

fn reread(data: &DataFolder, phase: Phase, before: &[Arc<Stage>]) -> Option<Arc<Stage>> {
    let kept = before.iter().find(|stage| stage.phase.id == phase.id);
    if let Some(kept) = kept.filter(|kept| kept.phase == phase) {
        return Some(kept.clone());
    }
    let id = phase.id.clone();
    match Stage::read(data, phase, before) {
        Ok(stage) => Some(Arc::new(stage)),
        Err(failure) => {
            tracing::error!(phase = id, %failure, "cannot host a changed phase; the previous version stays");
            kept.cloned()
        }
    }
}

/// Commits a phase to its episodes, scorer and a secret, unless already committed.
///
/// # Errors
/// Without a random source, or if the database fails.
pub async fn commit(store: &Store, phase: &str) -> Result<(), Failure> {
    let random = || secret::random_hex().map_err(|error| Failure::new(FailureKind::Internal, error));
    let new_secret = random()? + &random()?;
    store.commit_phase(phase, &new_secret, BENCHMARK_VERSION, now_unix_ms()).await?;
    Ok(())
}

impl Stage {
    /// Reads a phase; open splits are reused from `before`.
    pub(super) fn read(data: &DataFolder, phase: Phase, before: &[Arc<Self>]) -> Result<Self, Failure> {
        let open = before.iter().find(|stage| stage.phase.split == phase.split);
        let split = match open {
            Some(stage) => stage.split.clone(),
            None => Arc::new(data.missions(&phase.split)?),
        };
        let unknown = |episode: &&PhaseEpisode| !split.may_hold(&episode.scene, &episode.episode);
        if let Some(missing) = phase.episodes.iter().find(unknown) {
            let message = format!(
                "phase '{}' plays episode {}, split '{}' has none",
                phase.id, missing.episode, phase.split
            );
            return Err(
                Failure::new(FailureKind::Scene, message).hinted("restore the split's files from a backup")
            );
        }
        let audio = data.audio(&phase.rules)?;
        Ok(Self { phase, split, audio })
    }

    /// The mission `id`, read from the files of its scene if not cached.
    pub(super) fn episode(&self, id: &str) -> Result<EpisodeSpec, Failure> {
        let missing =
            || Failure::new(FailureKind::Scene, format!("no episode {id} in split '{}'", self.phase.split));
        self.split.episode(id)?.ok_or_else(missing)
    }

    /// Size of the scene file of an episode, bytes; 0 if missing or not accessible.
    pub(super) fn scene_file_bytes(&self, episode: &str) -> Result<u64, Failure> {
        let scene = self.episode(episode)?.scene;
        let source = self.split.scene(&scene).map(|spec| spec.source);
        let Some(SceneSource::File { path }) = source else { return Ok(0) };
        Ok(std::fs::metadata(path).map_or(0, |file| file.len()))
    }

    /// The scene `name`, ready for the rules of the phase, and its map if newly created.
    pub(super) fn scene(
        &self,
        name: &str,
        scenes: &SceneCache,
    ) -> Result<(Arc<SceneAssets>, Option<Scene>), Failure> {
        let missing =
            || Failure::new(FailureKind::Scene, format!("no scene {name} in split '{}'", self.phase.split));
        let spec = self.split.scene(name).ok_or_else(missing)?;
        let (assets, made) = scenes.get(&spec, self.rules())?;
        let map = made.then(|| register::map_of(&assets));
        Ok((assets, map.map(|map| Scene { name: spec.name, digest: spec.digest, map })))
    }

    pub(super) fn rules(&self) -> &Rules {
        &self.phase.rules
    }
}
