//! Prepared scenes, shared by episodes, and their prefetching.

use crate::{Arena, Failure, lru::LruCache, phases::HostedPhase};
use avln_dataset::{DatasetError, SceneSpec};
use avln_episode::Rules;
use avln_referee::source_positions;
use avln_store::Scene;
use avln_world::{Cache, SceneAssets};
use std::sync::Arc;

/// Prepared scenes by digest and rules.
pub(crate) struct SceneCache {
    memory: LruCache<(String, String), SceneAssets>,
    disk: Arc<dyn Cache>,
}

impl SceneCache {
    /// Creates a cache with `budget_bytes` of memory; `disk` stores render data.
    pub(crate) fn new(budget_bytes: usize, disk: Arc<dyn Cache>) -> Self {
        Self { memory: LruCache::new(budget_bytes, SceneAssets::resident_bytes), disk }
    }

    /// Returns the total size of the scenes, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.memory.bytes()
    }

    /// Returns a scene, prepared for the rules' body, and true if it was prepared now, with much processor time.
    ///
    /// # Errors
    /// If the scene is unreadable or changed, or no body can move in it.
    pub(crate) fn get(
        &self,
        scene: &SceneSpec,
        rules: &Rules,
    ) -> Result<(Arc<SceneAssets>, bool), DatasetError> {
        let key = (scene.digest.clone(), rules.name.clone());
        self.memory.get(key, || scene.open_with(rules, Some(&self.disk)))
    }
}

impl Arena {
    /// Prepares the next episode of `run` in the background.
    pub(crate) fn prefetch(&self, run: &str, phase: &Arc<HostedPhase>) {
        let (run, phase, store) = (run.to_owned(), phase.clone(), self.store.clone());
        let (scenes, turns) = (self.scenes.clone(), self.prefetching.clone());
        let (watchdog, limit) = (self.control().watchdog().clone(), self.budget.preparation);
        tokio::spawn(async move {
            // One episode at a time, in request order: running episodes have priority on the processors.
            let Ok(_turn) = turns.acquire_owned().await else { return };
            let next = store.next_pending(&run).await;
            let work = move || next?.map_or(Ok(None), |episode| prepare(&phase, &scenes, &episode));
            let stored = match watchdog.run(limit, work).await {
                Ok(Ok(Some(map))) => store.upsert_scene(&map).await.map_err(Failure::from),
                Ok(Ok(None)) => Ok(()),
                Ok(Err(error)) => Err(error),
                Err(error) => Err(Failure::internal(error)),
            };
            if let Err(error) = stored {
                tracing::warn!(run, %error, "cannot prepare the next episode in advance; it is prepared on request");
            }
        });
    }
}

/// Prepares the expensive parts of an episode; returns the map of a newly prepared scene.
fn prepare(phase: &HostedPhase, scenes: &SceneCache, episode: &str) -> Result<Option<Scene>, Failure> {
    let spec = phase.episode(episode)?;
    let (assets, map) = phase.scene(&spec.scene, scenes)?;
    let sensors = &phase.settings.sensors;
    if sensors.rgb || sensors.depth {
        assets.prepare_pictures();
    }
    if sensors.audio {
        phase.audio.head.prepare();
        let targets: Vec<_> = spec.goals.iter().map(|goal| goal.target.clone()).collect();
        for position in &source_positions(phase.rules(), &targets) {
            assets.prepare_sound(position);
        }
    }
    Ok(map)
}
