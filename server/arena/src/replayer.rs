use super::{data::DataFolder, play::make_referee, scenes::SceneCache, stages::Stage};
use crate::{Failure, FailureKind, runlog::EpisodeHistory};
use avln_episode::{Order, Sensors};
use avln_scoring::{Metrics, score};
use std::collections::BTreeMap;

/// Memory for scenes while runs are checked, bytes.
const SCENE_BYTES: usize = 1 << 30;

/// Replays episodes of a phase without sensors, which do not affect the outcome.
pub struct Replayer {
    stage: Stage,
    scenes: SceneCache,
    order: Order,
}

impl Replayer {
    /// Opens a phase with an order for replay.
    ///
    /// # Errors
    /// If the phase is unknown, or its split is unreadable.
    pub async fn open(data: &DataFolder, phase: &str, order: Order) -> Result<Self, Failure> {
        let store = data.store().await?;
        let phase = store.phase(phase).await?;
        store.close().await;
        Ok(Self {
            stage: Stage::read(data, phase, &[])?,
            scenes: SceneCache::new(SCENE_BYTES, data.cache()),
            order,
        })
    }

    /// Compares the digests of a run with the present ones.
    ///
    /// # Errors
    /// If a digest that affects scores differs; names it.
    pub fn check_digests(&self, then: &BTreeMap<String, String>) -> Result<(), Failure> {
        let now = self.stage.digests();
        let differs = |name: &&str| then.get(*name) != now.get(*name);
        let Some(name) = ["benchmark", "split", "config"].into_iter().find(differs) else { return Ok(()) };
        let told = |digests: &BTreeMap<String, String>| digests.get(name).cloned().unwrap_or_default();
        let message = format!("the run was played with {name} '{}'; here it is '{}'", told(then), told(&now));
        Err(Failure::new(FailureKind::Run, message)
            .hinted("check it with the data folder and the version of the server that hosted it"))
    }

    /// Replays an episode; returns its metrics if it ended and counts.
    ///
    /// # Errors
    /// If a state differs from the log.
    pub fn replay(&self, history: &EpisodeHistory) -> Result<Option<Metrics>, String> {
        let blind = Sensors { rgb: false, depth: false, audio: false, ..Sensors::all(64, 64) };
        let referee = make_referee(&self.stage, &self.scenes, &history.episode, self.order, blind);
        let mut referee = referee.map_err(|refusal| refusal.message)?.referee;
        referee.replay(&history.taken).map_err(|error| error.to_string())?;
        let Some((end, _)) = history.ended else { return Ok(None) };
        referee.truncate(end);
        let (truth, record) = referee.into_record();
        Ok((record.end == end).then(|| score(&truth, &record, self.stage.rules())))
    }
}
