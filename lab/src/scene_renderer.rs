//! Scenes of which pictures are taken, and nothing else.

use avln_geom::RayMesh;
use avln_render::{ModelCache, ModelCacheEntry, Renderer};
use avln_scene::{Scene, digest::digest};
use avln_world::Cache;
use std::sync::Arc;

/// A scene that is ready to be drawn.
pub struct SceneRenderer {
    /// The scene, without textures: the renderer has them.
    pub scene: Arc<Scene>,
    /// Its triangles.
    pub rays: Arc<RayMesh>,
    /// Renderer of its pictures.
    pub renderer: Renderer,
}

impl SceneRenderer {
    /// Gets `scene` ready; what pictures are made from is looked for and kept in `cache`.
    pub fn new(mut scene: Scene, cache: Option<Arc<dyn Cache>>) -> Self {
        let place =
            cache.map(|cache| ModelCacheEntry { cache: cache as Arc<dyn ModelCache>, name: digest(&scene) });
        let textures = std::mem::take(&mut scene.textures);
        let scene = Arc::new(scene);
        let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
        let renderer = Renderer::with_cache(Arc::clone(&scene), textures, Arc::clone(&rays), place);
        Self { scene, rays, renderer }
    }
}
