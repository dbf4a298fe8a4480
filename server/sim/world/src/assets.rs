use crate::sight::Surfaces;
use avln_acoustics::{Acoustics, BuildingCache, Settings, SoundCache, Source};
use avln_geom::{Point3, RayMesh, Vector3};
use avln_navmesh::{Body, NavMesh, NavMeshError};
use avln_render::{Camera, CameraImage, ModelCache, ModelCacheEntry, Renderer};
use avln_scene::{InstanceId, Mesh, Scene};
use std::sync::{Arc, OnceLock};

/// Immutable data shared by all episodes in a building.
pub struct SceneAssets {
    /// The building, without textures: the renderer has them.
    pub scene: Arc<Scene>,
    /// Walkable floor.
    pub navmesh: NavMesh,
    rays: Arc<RayMesh>,
    renderer: Renderer,
    /// Built on first use.
    acoustics: OnceLock<Acoustics>,
    cached: Option<Cached>,
    surfaces: Surfaces,
}

/// A persistent cache of render models and sound sources.
pub trait Cache: ModelCache + SoundCache {}

impl<T: ModelCache + SoundCache> Cache for T {}

/// A scene's name in a cache.
#[derive(Clone)]
pub struct Cached {
    /// The cache.
    pub cache: Arc<dyn Cache>,
    /// A name that only scenes with the same content have.
    pub name: String,
}

/// The first hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Struck {
    /// Distance, metres.
    pub distance_m: f32,
    /// Of which instance the surface is; [`InstanceId::NONE`] for the building itself.
    pub instance: InstanceId,
}

/// Why a building cannot be lived in.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// No walkable floor.
    #[error("cannot prepare scene `{scene}`: {source}")]
    NavMesh {
        /// Name of the scene.
        scene: String,
        /// Error of the navmesh.
        source: NavMeshError,
    },
    /// A mesh list has the wrong length.
    #[error(
        "cannot prepare scene `{scene}`: its mesh has {found} entries in `{list}` where {expected} belong; \
         import the file again"
    )]
    Malformed {
        /// Name of the scene.
        scene: String,
        /// The list.
        list: &'static str,
        /// Actual length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
}

impl SceneAssets {
    /// Prepares `scene` for a body: navmesh, rendering, acoustics.
    ///
    /// # Errors
    /// If the mesh is invalid or not walkable.
    pub fn prepare(scene: Scene, body: &Body) -> Result<SceneAssets, PrepareError> {
        Self::prepare_cached(scene, body, None)
    }

    /// Like [`SceneAssets::prepare`], with a cache for expensive results.
    ///
    /// # Errors
    /// If the mesh is invalid or not walkable.
    pub fn prepare_cached(
        mut scene: Scene,
        body: &Body,
        cached: Option<Cached>,
    ) -> Result<SceneAssets, PrepareError> {
        check_lists(&scene)?;
        // The navmesh validates corners and indices, which all other parts rely on.
        let navmesh = NavMesh::build(&scene, body)
            .map_err(|source| PrepareError::NavMesh { scene: scene.name.clone(), source })?;
        let textures = std::mem::take(&mut scene.textures);
        let scene = Arc::new(scene);
        let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
        let place = cached
            .clone()
            .map(|Cached { cache, name }| ModelCacheEntry { cache: cache as Arc<dyn ModelCache>, name });
        let renderer = Renderer::with_cache(Arc::clone(&scene), textures, Arc::clone(&rays), place);
        let surfaces = Surfaces::new(&scene);
        Ok(Self { scene, navmesh, rays, renderer, acoustics: OnceLock::new(), cached, surfaces })
    }

    /// Memory in bytes as far as it can be counted: mesh, rays, navmesh, surface points, acoustics, and
    /// render data including mapped files. It grows with the first image and with every new sound source.
    /// Names, regions and images in progress are not counted.
    pub fn resident_bytes(&self) -> usize {
        mesh_bytes(&self.scene.mesh)
            + self.rays.byte_count()
            + self.navmesh.byte_count()
            + self.surfaces.byte_count()
            + self.acoustics.get().map_or(0, Acoustics::resident_bytes)
            + self.renderer.resident_bytes()
    }

    /// Renders a camera image.
    pub fn render(&self, camera: &Camera) -> CameraImage {
        self.renderer.render(camera)
    }

    /// Returns the first surface in the unit direction `direction` from `origin` within `reach_m`.
    pub fn cast(&self, origin: &Point3<f32>, direction: &Vector3<f32>, reach_m: f32) -> Option<Struck> {
        let hit = self.rays.cast(origin, direction, reach_m)?;
        let instance = self.scene.mesh.instance_of[hit.triangle as usize];
        Some(Struck { distance_m: hit.distance, instance })
    }

    /// Returns true if a sampled surface point of `instance` is visible from `eye` at some heading, at most
    /// `half_vfov_rad` above or below the horizon. False for instances without surface.
    pub fn sees(&self, eye: &Point3<f32>, instance: InstanceId, half_vfov_rad: f32) -> bool {
        let is_of_instance = |triangle: u32| self.scene.mesh.instance_of[triangle as usize] == instance;
        self.surfaces.any_visible(&self.rays, eye, instance, half_vfov_rad, is_of_instance)
    }

    /// Computes or loads the data for the first image.
    pub fn prepare_pictures(&self) {
        self.renderer.model();
    }

    /// Computes or loads the acoustics of a source at `position` (world frame, metres).
    pub fn prepare_sound(&self, position: &Point3<f32>) {
        self.source(position);
    }

    /// The shared sound source at `position`.
    pub(crate) fn source(&self, position: &Point3<f32>) -> Source {
        let listen = || {
            let surfaces = avln_acoustics::Surfaces::by_material(&self.scene);
            let place = self.cached.clone();
            let place = place
                .map(|Cached { cache, name }| BuildingCache { cache: cache as Arc<dyn SoundCache>, name });
            Acoustics::new(&self.scene, Arc::clone(&self.rays), surfaces, Settings::default())
                .with_cache(place)
        };
        self.acoustics.get_or_init(listen).source(position)
    }
}

fn mesh_bytes(mesh: &Mesh) -> usize {
    size_of_val(mesh.positions.as_slice())
        + size_of_val(mesh.uvs.as_slice())
        + size_of_val(mesh.colors.as_slice())
        + size_of_val(mesh.triangles.as_slice())
        + size_of_val(mesh.material_of.as_slice())
        + size_of_val(mesh.instance_of.as_slice())
}

fn check_lists(scene: &Scene) -> Result<(), PrepareError> {
    let mesh = &scene.mesh;
    let (corners, triangles) = (mesh.positions.len(), mesh.triangles.len());
    let lists = [
        ("uvs", mesh.uvs.len(), corners),
        ("colors", mesh.colors.len(), corners),
        ("material_of", mesh.material_of.len(), triangles),
        ("instance_of", mesh.instance_of.len(), triangles),
    ];
    match lists.into_iter().find(|(_, found, expected)| found != expected) {
        Some((list, found, expected)) => {
            Err(PrepareError::Malformed { scene: scene.name.clone(), list, found, expected })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Point2;
    use avln_houses::HouseOptions;
    use avln_scene::Lighting;

    #[test]
    fn assets_are_shared_between_threads() {
        fn shared<T: Send + Sync>() {}
        fn moved<T: Send>() {}
        shared::<SceneAssets>();
        moved::<crate::World>();
    }

    #[test]
    fn bytes_are_counted_and_grow_with_the_first_picture() {
        let house = avln_houses::house("counted", 1, &HouseOptions::small());
        let textures: usize = house.textures.iter().map(|texture| texture.pixels.len()).sum();
        let mesh = mesh_bytes(&house.mesh);
        let assets = SceneAssets::prepare(house, &Body::default()).expect("a house");
        assert!(assets.scene.textures.is_empty());
        let before = assets.resident_bytes();
        assert!(before > 2 * mesh + textures, "{before} bytes, {mesh} of the mesh, {textures} of textures");
        let eye = Point3::new(0.0, 1.5, 0.0);
        let world_from_camera = avln_geom::angle::about_up(0.0);
        assets.render(&Camera {
            eye,
            world_from_camera,
            width: 8,
            height: 8,
            hfov_rad: 1.5,
            depth_max_m: 9.0,
        });
        let seen = assets.resident_bytes();
        assert_eq!(seen, before - textures + assets.renderer.model().byte_count());
        assets.source(&eye);
        assert!(assets.resident_bytes() > seen);
    }

    #[test]
    fn broken_scenes_are_refused_with_their_name() {
        let mut scene = Scene {
            name: "ruin".into(),
            mesh: Mesh::default(),
            materials: Vec::new(),
            textures: Vec::new(),
            regions: Vec::new(),
            objects: Vec::new(),
            lighting: Lighting::Painted,
        };
        let refusal = |scene: &Scene| match SceneAssets::prepare(scene.clone(), &Body::default()) {
            Ok(_) => panic!("a ruin was prepared"),
            Err(error) => error.to_string(),
        };
        assert!(refusal(&scene).contains("`ruin` has no triangles"));
        scene.mesh.uvs.push(Point2::origin());
        assert!(refusal(&scene).contains("1 entries in `uvs` where 0 belong"));
    }
}
