//! Looking into the scenes of phases for those who watch replays. It has scenes of its own, so that visitors take none from agents.

use super::{
    scenes::SceneCache,
    stages::{Stage, Stages},
};
use avln_geom::{Vector3, angle};
use avln_render::Camera;
use avln_store::Store;
use avln_web::{Blind, Glance, Looking, Onlooker, Seen};
use std::{fmt, sync::Arc};

/// Memory for scenes that were looked into, bytes; the last one stays even if it takes more.
const SCENE_BYTES: usize = 512 << 20;

/// Who looks for visitors.
pub(super) struct SceneOnlooker {
    store: Store,
    stages: Arc<Stages>,
    scenes: Arc<SceneCache>,
}

impl SceneOnlooker {
    pub(super) fn new(store: Store, stages: Arc<Stages>, cache: Arc<dyn avln_world::Cache>) -> Self {
        Self { store, stages, scenes: Arc::new(SceneCache::new(SCENE_BYTES, cache)) }
    }
}

impl fmt::Debug for SceneOnlooker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SceneOnlooker")
    }
}

impl Onlooker for SceneOnlooker {
    fn look(&self, glance: Glance) -> Looking {
        let (store, stages, scenes) = (self.store.clone(), self.stages.clone(), self.scenes.clone());
        Box::pin(async move {
            let blind = |error: &dyn fmt::Display| Blind(error.to_string());
            let all = stages.now(&store).await.map_err(|failure| blind(&failure))?;
            let stage = all.iter().find(|stage| stage.phase.id == glance.phase).cloned();
            let stage = stage.ok_or_else(|| Blind(format!("phase '{}' is not hosted", glance.phase)))?;
            let looked = tokio::task::spawn_blocking(move || look(&stage, &scenes, &glance)).await;
            looked.map_err(|error| blind(&error))?
        })
    }
}

fn look(stage: &Stage, scenes: &SceneCache, glance: &Glance) -> Result<Seen, Blind> {
    let (assets, _) = stage.scene(&glance.scene, scenes).map_err(|failure| Blind(failure.to_string()))?;
    let rules = stage.rules();
    let camera = Camera {
        eye: glance.pose.position + Vector3::y() * rules.camera_height_m,
        world_from_camera: angle::about_up(glance.pose.heading_rad),
        width: glance.width,
        height: glance.height,
        hfov_rad: glance.hfov_rad,
        depth_max_m: rules.depth_max_m,
    };
    let frame = assets.render(&camera);
    Ok(Seen { rgb: frame.rgb, depth_m: frame.depth, depth_max_m: rules.depth_max_m })
}
