//! Makes splits known to the database: what pages and runs need of them.

use super::data::DataFolder;
use crate::{Failure, FailureKind};
use avln_dataset::{CueSpec, EpisodeSpec, Split};
use avln_episode::{Modality, Rules};
use avln_store::{GoalText, PhaseEpisode, Scene, SceneMap, Store};
use avln_world::SceneAssets;

/// Stores a split and the maps of its scenes.
///
/// # Errors
/// When the database refuses.
pub async fn register_split(
    data: &DataFolder,
    store: &Store,
    split: &Split,
    maps: &[SceneMap],
) -> Result<(), Failure> {
    for (scene, map) in split.scenes.iter().zip(maps) {
        let row = Scene { name: scene.name.clone(), digest: scene.digest.clone(), map: map.clone() };
        store.upsert_scene(&row).await?;
    }
    let row = avln_store::Split {
        name: split.name.clone(),
        digest: data.split_digest(&split.name)?,
        scenes: split.scenes.len() as u32,
        episodes: split.episodes.len() as u32,
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
pub fn phase_episodes(split: &Split) -> Vec<PhaseEpisode> {
    let episode = |spec: &EpisodeSpec| PhaseEpisode {
        episode: spec.id.clone(),
        scene: spec.scene.clone(),
        goals: spec.goals.iter().map(|goal| goal_text(&goal.cue, &goal.target.category)).collect(),
    };
    split.episodes.iter().map(episode).collect()
}

fn goal_text(cue: &CueSpec, category: &str) -> GoalText {
    let text = match cue {
        CueSpec::Category => Some(category.to_owned()),
        CueSpec::Description(sentence) => Some(sentence.clone()),
        CueSpec::Image(_) => None,
    };
    debug_assert_eq!(text.is_none(), cue.modality() == Modality::Image);
    GoalText { modality: cue.modality(), text }
}

/// The rule set that a split was made for.
///
/// # Errors
/// When this version does not know it.
pub fn rules_of(split: &Split) -> Result<Rules, Failure> {
    Rules::named(&split.rules).map_err(|error| {
        Failure::new(FailureKind::Scene, format!("split '{}': {error}", split.name))
            .hinted("make the split again with: avln split make NAME --rules RULES")
    })
}
