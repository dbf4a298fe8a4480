use super::{data::DataFolder, play::make_referee, scenes::SceneCache, stages::Stage};
use crate::{Failure, FailureKind, runlog::EpisodeHistory};
use avln_episode::{Order, Sensors};
use avln_scoring::{Metrics, score};
use std::collections::BTreeMap;

/// Memory for scenes while runs are checked, bytes.
const SCENE_BYTES: usize = 1 << 30;

/// Plays the episodes of a phase again, without senses, which change nothing of what happens.
pub struct Replayer {
    stage: Stage,
    scenes: SceneCache,
    order: Order,
}

impl Replayer {
    /// For runs of this order in the phase called `phase` of a data folder.
    ///
    /// # Errors
    /// When there is no such phase, or its split cannot be read.
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

    /// Compares what was in force when a run was played with what is now.
    ///
    /// # Errors
    /// When something that decides scores differs: names it.
    pub fn check_digests(&self, then: &BTreeMap<String, String>) -> Result<(), Failure> {
        let now = self.stage.digests();
        let differs = |name: &&str| then.get(*name) != now.get(*name);
        let Some(name) = ["benchmark", "split", "config"].into_iter().find(differs) else { return Ok(()) };
        let told = |digests: &BTreeMap<String, String>| digests.get(name).cloned().unwrap_or_default();
        let message = format!("the run was played with {name} '{}'; here it is '{}'", told(then), told(&now));
        Err(Failure::new(FailureKind::Run, message)
            .hinted("check it with the data folder and the version of the server that hosted it"))
    }

    /// Plays an episode again; what it was worth, if it is over and counts.
    ///
    /// # Errors
    /// When an action leads elsewhere than it did.
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
