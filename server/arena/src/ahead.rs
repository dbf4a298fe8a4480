//! Prefetching: prepares the next episode of a run during the present one.

use super::{Arena, Stage, scenes::SceneCache};
use crate::{Failure, FailureKind};
use avln_referee::source_positions;
use avln_store::Scene;
use std::sync::Arc;

impl Arena {
    /// Prepares the next episode of `run` in the background, in request order.
    pub(super) fn look_ahead(&self, run: &str, stage: &Arc<Stage>) {
        let (run, stage, store) = (run.to_owned(), stage.clone(), self.store.clone());
        let (scenes, turns) = (self.scenes.clone(), self.ahead.clone());
        let (watchdog, limit) = (self.control().watchdog().clone(), self.budget.preparation);
        tokio::spawn(async move {
            let Ok(_turn) = turns.acquire_owned().await else { return };
            let next = store.next_pending(&run).await;
            let get_ready = move || next?.map_or(Ok(None), |episode| get_ready(&stage, &scenes, &episode));
            let done = watchdog.run(limit, get_ready);
            let stored = match done.await {
                Ok(Ok(Some(map))) => store.upsert_scene(&map).await.map_err(Failure::from),
                Ok(Ok(None)) => Ok(()),
                Ok(Err(error)) => Err(error),
                Err(error) => Err(Failure::new(FailureKind::Internal, error)),
            };
            if let Err(error) = stored {
                tracing::warn!(run, %error, "cannot prepare the next episode in advance; it is prepared on request");
            }
        });
    }
}

/// Prepares the expensive parts of an episode; returns the scene map if the scene was created for it.
fn get_ready(stage: &Stage, scenes: &SceneCache, episode: &str) -> Result<Option<Scene>, Failure> {
    let spec = stage.episode(episode)?;
    let (assets, map) = stage.scene(&spec.scene, scenes)?;
    let sensors = &stage.phase.sensors;
    if sensors.rgb || sensors.depth {
        assets.prepare_pictures();
    }
    if sensors.audio {
        stage.audio.head.prepare();
        let targets: Vec<_> = spec.goals.iter().map(|goal| goal.target.clone()).collect();
        source_positions(stage.rules(), &targets).iter().for_each(|position| assets.prepare_sound(position));
    }
    Ok(map)
}
