//! Ground truth of missions, with distractor sources.

use super::{SplitFolder, scene_of};
use crate::Failure;
use avln_dataset::{EpisodeSpec, SceneMissions};
use avln_episode::{Order, Rules};
use avln_truth::EpisodeTruth;
use avln_world::SceneAssets;
use std::sync::Arc;

impl SplitFolder {
    /// Returns a mission's ground truth, with the distractor sources of `rules`.
    pub fn truth(
        &self,
        episode: &EpisodeSpec,
        order: Order,
        rules: &Rules,
        assets: &SceneAssets,
    ) -> Result<EpisodeTruth, Failure> {
        // The other missions of the scene are read only if they are needed.
        let count = rules.distractor_sources.count(episode.goals.len());
        let scene = if count > 0 { self.scene_of_mission(&episode.id)? } else { None };
        Ok(scene.map_or_else(|| episode.truth(order), |scene| scene.truth(episode, order, rules, assets)))
    }

    /// Rejects rules with more distractor sources than a mission's scene has other targets.
    pub fn check_distractors(&self, rules: &Rules) -> Result<(), Failure> {
        if rules.distractor_sources.count(1) == 0 {
            return Ok(());
        }
        for scene in self.scenes() {
            let missions = SceneMissions::new(self.episodes(scene)?);
            for episode in missions.episodes() {
                let needed = rules.distractor_sources.count(episode.goals.len());
                let found = missions.distractor_candidates(episode);
                if found < needed {
                    return Err(too_few(&rules.name, &episode.id, needed, found));
                }
            }
        }
        Ok(())
    }

    /// Returns all missions in a mission's scene; `None` if unknown.
    pub(super) fn scene_of_mission(&self, id: &str) -> Result<Option<Arc<SceneMissions>>, Failure> {
        let Some(&index) = scene_of(id).and_then(|scene| self.by_name.get(scene)) else { return Ok(None) };
        let (episodes, _) =
            self.cache.get(index, || self.episodes(&self.scenes[index]).map(SceneMissions::new))?;
        Ok(Some(episodes))
    }
}

fn too_few(rules: &str, episode: &str, needed: usize, found: usize) -> Failure {
    let message = format!(
        "rules '{rules}' need {needed} distractor sources in mission {episode}, but its scene has {found} other targets"
    );
    Failure::scene(message).hinted("make a split with more missions per scene, or use the rules lh-avln-v1")
}
