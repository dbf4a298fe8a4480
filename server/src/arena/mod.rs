//! Where the agents' door meets the rules and the store.
//!
//! [`Arena`] implements the door's `Host`: it admits teams, hands out episodes with a referee each, scores what comes
//! back and stores it.

mod ahead;
pub mod data;
mod host;
mod play;
mod refusals;
pub mod register;
mod scenes;
pub mod secret;
mod warm;

use crate::{Failure, FailureKind, dataset::SplitFolder};
use avln_dataset::EpisodeSpec;
use avln_episode::{FeedbackRule, Rules};
use avln_referee::Audio;
use avln_store::{Phase, PhaseEpisode, PhaseState, Scene, Store};
use avln_world::SceneAssets;
use data::DataFolder;
use scenes::SceneCache;
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex},
    time::{SystemTime, UNIX_EPOCH},
};

use tokio::sync::Semaphore;

/// Version of the benchmark: it changes whenever a score could change.
pub const BENCHMARK_VERSION: &str = "1.0.0";

/// Memory for scenes that are ready, MiB, unless somebody says otherwise: some tens of scans or two hundred houses.
pub const SCENE_MEMORY_MIB: u32 = 2048;

/// What hosts the phases of a data folder.
pub struct Arena {
    store: Store,
    /// Phases by id, each with its missions.
    phases: BTreeMap<String, Arc<Stage>>,
    scenes: Arc<SceneCache>,
    /// What is being played, by ticket.
    playing: Mutex<play::Playing>,
    /// Who prepares an episode ahead of time: one after the other, so that the others can play.
    ahead: Arc<Semaphore>,
}

/// A phase, the missions that are played in it, the clips that they draw from, and who listens.
struct Stage {
    phase: Phase,
    split: SplitFolder,
    audio: Audio,
}

impl Arena {
    /// Reads the phases of the data folder and their splits, and takes up what a stopped server left. Scenes stay ready in
    /// `scene_memory_mib` MiB; those that are being played stay even if they take more.
    ///
    /// # Errors
    /// When the database or a split cannot be read.
    pub async fn open(data: &DataFolder, store: Store, scene_memory_mib: u32) -> Result<Self, Failure> {
        let reopened = store.reopen_interrupted(now_unix_ms()).await?;
        if reopened > 0 {
            tracing::info!(
                reopened,
                "episodes that were being played when the server stopped are pending again"
            );
        }
        let mut phases = BTreeMap::new();
        for phase in store.phases().await? {
            let stage = Stage::read(data, phase)?;
            phases.insert(stage.phase.id.clone(), Arc::new(stage));
        }
        let budget_bytes = (scene_memory_mib as usize).saturating_mul(1 << 20);
        let scenes = Arc::new(SceneCache::new(budget_bytes, data.cache()));
        Ok(Self { store, phases, scenes, playing: Mutex::default(), ahead: Arc::new(Semaphore::new(1)) })
    }

    /// Ids of the phases, and how many episodes each has.
    pub fn phases(&self) -> impl Iterator<Item = (&str, usize)> {
        self.phases.values().map(|stage| (stage.phase.id.as_str(), stage.phase.episodes.len()))
    }
}

impl Stage {
    fn read(data: &DataFolder, phase: Phase) -> Result<Self, Failure> {
        let split = data.missions(&phase.split)?;
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

    /// The mission called `id`. Reads the files of its scene when they are not at hand.
    fn episode(&self, id: &str) -> Result<EpisodeSpec, Failure> {
        let missing =
            || Failure::new(FailureKind::Scene, format!("no episode {id} in split '{}'", self.phase.split));
        self.split.episode(id)?.ok_or_else(missing)
    }

    /// The scene called `name`, ready for the phase's rules, and its map if it was made now.
    fn scene(&self, name: &str, scenes: &SceneCache) -> Result<(Arc<SceneAssets>, Option<Scene>), Failure> {
        let missing =
            || Failure::new(FailureKind::Scene, format!("no scene {name} in split '{}'", self.phase.split));
        let spec = self.split.scene(name).ok_or_else(missing)?;
        let (assets, made) = scenes.get(&spec, self.rules())?;
        let map = made.then(|| register::map_of(&assets));
        Ok((assets, map.map(|map| Scene { name: spec.name, digest: spec.digest, map })))
    }

    fn is_open(&self) -> bool {
        self.phase.state == PhaseState::Open
    }

    fn rules(&self) -> &Rules {
        &self.phase.rules
    }

    fn feedback(&self) -> FeedbackRule {
        self.phase.rules.feedback
    }
}

/// The clock that results carry: milliseconds since 1970-01-01 UTC.
pub fn now_unix_ms() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}
