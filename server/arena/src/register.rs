//! Registration of splits in the database for pages and runs.

use crate::{Failure, FailureKind, dataset::SplitFolder};
use avln_dataset::{PublicGoal, PublicMission};
use avln_episode::{Modality, Rules};
use avln_store::{GoalText, PhaseEpisode, Scene, SceneMap, Store};
use avln_world::SceneAssets;

/// Stores a split and its scenes; missing maps are added when a scene is first played.
///
/// # Errors
/// If the database fails.
pub async fn register_split(
    store: &Store,
    name: &str,
    split: &SplitFolder,
    maps: &[SceneMap],
) -> Result<(), Failure> {
    for (index, scene) in split.scenes().iter().enumerate() {
        let map = maps.get(index).cloned().unwrap_or_default();
        let row = Scene { name: scene.name.clone(), digest: scene.digest.clone(), map };
        store.upsert_scene(&row).await?;
    }
    let row = avln_store::Split {
        name: name.to_owned(),
        digest: split.digest().to_owned(),
        scenes: split.scenes().len() as u32,
        episodes: split.mission_count() as u32,
    };
    Ok(store.upsert_split(&row).await?)
}

/// The floor plan that pages draw.
pub fn map_of(assets: &SceneAssets) -> SceneMap {
    let bounds = assets.scene.bounds();
    let corner = |point: avln_geom::Point3<f32>| [point.x, point.y, point.z];
    let polygons = assets.navmesh.polygons();
    SceneMap {
        min: bounds.map_or([0.0; 3], |b| corner(b.min)),
        max: bounds.map_or([0.0; 3], |b| corner(b.max)),
        polygons: polygons.into_iter().map(|polygon| polygon.into_iter().map(corner).collect()).collect(),
    }
}

/// The episodes of a split as a phase lists them.
///
/// # Errors
/// When a file of the split cannot be used.
pub fn phase_episodes(split: &SplitFolder) -> Result<Vec<PhaseEpisode>, Failure> {
    let mut episodes = Vec::with_capacity(split.mission_count());
    for scene in split.scenes() {
        let episode = |mission: PublicMission| PhaseEpisode {
            episode: mission.id,
            scene: scene.name.clone(),
            goals: mission.goals.into_iter().map(goal_text).collect(),
        };
        episodes.extend(split.public(scene)?.into_iter().map(episode));
    }
    Ok(episodes)
}

fn goal_text(goal: PublicGoal) -> GoalText {
    match goal {
        PublicGoal::Category(label) => GoalText { modality: Modality::Category, text: Some(label) },
        PublicGoal::Description(sentence) => {
            GoalText { modality: Modality::Description, text: Some(sentence) }
        }
        PublicGoal::Image => GoalText { modality: Modality::Image, text: None },
    }
}

/// The rule set that a split was made for.
///
/// # Errors
/// When this version does not know it.
pub fn rules_of(name: &str, split: &SplitFolder) -> Result<Rules, Failure> {
    Rules::named(split.rules()).map_err(|error| {
        Failure::new(FailureKind::Scene, format!("split '{name}': {error}"))
            .hinted("make the split again with: avln data split make NAME --rules RULES")
    })
}
