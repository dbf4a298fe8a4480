//! A building's immutable data: scene, navigation mesh, render model, acoustics.

use avln_acoustics::{
    Acoustics, BuildingCache, Clip, ClipLevels, Emitter, Head, LevelMeter, Settings, SoundCache, Source,
};
use avln_geom::{Point3, QueryMesh, RayMesh, Rng, Vector3, angle};
use avln_navmesh::{Body, NavMesh, NavMeshError};
use avln_render::{Camera, CameraImage, Detail, ModelCache, ModelCacheEntry, Renderer};
use avln_scene::{InstanceId, Mesh, Scene};
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// Sampled points per instance.
const POINTS: usize = 64;
// A hit this close to the sampled point counts as the point, metres.
const TOLERANCE_M: f32 = 0.01;

/// A sound source.
#[derive(Clone, Debug, PartialEq)]
pub struct SoundSource {
    /// Position, world frame.
    pub position: Point3<f32>,
    /// Repeated clip.
    pub clip: Clip,
    /// Clip position at the episode start, samples.
    pub offset_samples: usize,
}

/// A building's immutable data, shared by all episodes.
pub struct SceneAssets {
    /// Building without textures; the renderer has them.
    pub scene: Arc<Scene>,
    /// Walkable floor.
    pub navmesh: NavMesh,
    rays: Arc<RayMesh>,
    renderer: Renderer,
    /// Built on first use.
    acoustics: OnceLock<Acoustics>,
    /// The same building for levels without signals; built on first use.
    levels: OnceLock<Acoustics>,
    cached: Option<Cached>,
    surfaces: BTreeMap<InstanceId, InstanceSurface>,
}

/// An instance's surface.
struct InstanceSurface {
    /// Sampled evenly over the area.
    points: Vec<Point3<f32>>,
    /// Built on first use; `None` without area.
    mesh: OnceLock<Option<QueryMesh>>,
}

impl InstanceSurface {
    fn byte_count(&self) -> usize {
        let mesh = self.mesh.get().and_then(Option::as_ref);
        size_of_val(self.points.as_slice()) + mesh.map_or(0, QueryMesh::byte_count)
    }
}

/// A persistent cache for render models and sound sources.
pub trait Cache: ModelCache + SoundCache {}

impl<T: ModelCache + SoundCache> Cache for T {}

/// An entry in a cache.
#[derive(Clone)]
pub struct Cached {
    /// Cache.
    pub cache: Arc<dyn Cache>,
    /// Entry name, unique by scene content.
    pub name: String,
}

/// A ray's first hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Struck {
    /// Distance, metres.
    pub distance_m: f32,
    /// Instance; [`InstanceId::NONE`] for the building itself.
    pub instance: InstanceId,
}

/// An unusable building.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// No walkable floor.
    #[error("cannot prepare scene `{scene}`: {source}")]
    NavMesh {
        /// Scene name.
        scene: String,
        /// Reason.
        source: NavMeshError,
    },
    /// A mesh list with a wrong length.
    #[error("cannot prepare scene `{scene}`: its mesh has {defect}; re-import the file")]
    Malformed {
        /// Scene name.
        scene: String,
        /// List with actual and required length.
        defect: String,
    },
}

impl SceneAssets {
    /// Prepares navmesh, rendering and acoustics.
    ///
    /// # Errors
    /// If the mesh is invalid or not walkable.
    pub fn prepare(scene: Scene, body: &Body) -> Result<SceneAssets, PrepareError> {
        Self::prepare_cached(scene, body, None)
    }

    /// Prepares a scene, with a cache for expensive results.
    ///
    /// # Errors
    /// If the mesh is invalid or not walkable.
    #[tracing::instrument(level = "debug", name = "prepare_scene", skip_all, fields(scene = scene.name))]
    pub fn prepare_cached(
        mut scene: Scene,
        body: &Body,
        cached: Option<Cached>,
    ) -> Result<SceneAssets, PrepareError> {
        check_lists(&scene)?;
        // The navmesh validates corners and indices; all other parts rely on this.
        let navmesh = tracing::debug_span!("navmesh").in_scope(|| NavMesh::build(&scene, body));
        let navmesh =
            navmesh.map_err(|source| PrepareError::NavMesh { scene: scene.name.clone(), source })?;
        let textures = std::mem::take(&mut scene.textures);
        let scene = Arc::new(scene);
        let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
        let place = cached.clone().map(|Cached { cache, name }| ModelCacheEntry { cache, name });
        let renderer = Renderer::with_cache(Arc::clone(&scene), textures, Arc::clone(&rays), place);
        let surfaces = surfaces(&scene);
        Ok(Self {
            scene,
            navmesh,
            rays,
            renderer,
            acoustics: OnceLock::new(),
            levels: OnceLock::new(),
            cached,
            surfaces,
        })
    }

    /// Returns the countable memory, bytes: mesh, rays, navmesh, instance surfaces, acoustics, and render data
    /// including mapped files. It grows with the first image, new sound sources and distances to meshes. Names, regions and
    /// images in progress are not counted.
    pub fn resident_bytes(&self) -> usize {
        mesh_bytes(&self.scene.mesh)
            + self.rays.byte_count()
            + self.navmesh.byte_count()
            + self.surfaces.values().map(InstanceSurface::byte_count).sum::<usize>()
            + self.acoustics.get().map_or(0, Acoustics::resident_bytes)
            + self.levels.get().map_or(0, Acoustics::sources_bytes)
            + self.renderer.resident_bytes()
    }

    /// Renders an image.
    pub fn render(&self, camera: &Camera) -> CameraImage {
        self.renderer.render(camera)
    }

    /// Renders an image with this detail; the first image below [`Detail::Exact`] simplifies the building.
    pub fn render_at(&self, camera: &Camera, detail: Detail) -> CameraImage {
        self.renderer.render_at(camera, detail)
    }

    /// Returns the first surface within `reach_m` in a unit direction.
    pub fn cast(&self, origin: &Point3<f32>, direction: &Vector3<f32>, reach_m: f32) -> Option<Struck> {
        let hit = self.rays.cast(origin, direction, reach_m)?;
        let instance = self.scene.mesh.instance_of[hit.triangle as usize];
        Some(Struck { distance_m: hit.distance, instance })
    }

    /// Returns true if a sampled surface point of `instance` is visible from `eye` at some heading, within
    /// `half_vfov_rad` above or below the horizon. False for instances without surface.
    pub fn sees(&self, eye: &Point3<f32>, instance: InstanceId, half_vfov_rad: f32) -> bool {
        self.visible_points(eye, instance, half_vfov_rad).next().is_some()
    }

    /// Returns the sampled surface points of `instance` that are visible as in [`Self::sees`].
    pub fn visible_points<'a>(
        &'a self,
        eye: &'a Point3<f32>,
        instance: InstanceId,
        half_vfov_rad: f32,
    ) -> impl Iterator<Item = &'a Point3<f32>> {
        let (sin, cos) = angle::sin_cos(half_vfov_rad.clamp(0.0, std::f32::consts::FRAC_PI_2));
        let points = self.surfaces.get(&instance).map_or(&[][..], |surface| surface.points.as_slice());
        points.iter().filter(move |&point| {
            let offset = point - eye;
            let across_m = (offset.x * offset.x + offset.z * offset.z).sqrt();
            if offset.y.abs() * cos > across_m * sin {
                return false;
            }
            let distance_m = offset.norm();
            let reach = 1.0 + TOLERANCE_M / distance_m.max(TOLERANCE_M);
            distance_m == 0.0
                || self
                    .rays
                    .cast(eye, &offset, reach)
                    .is_some_and(|hit| self.scene.mesh.instance_of[hit.triangle as usize] == instance)
        })
    }

    /// Returns the Euclidean distance from `eye` to the nearest triangle of `instance`, metres; infinite for instances
    /// without surface.
    pub fn distance_to_mesh_m(&self, eye: &Point3<f32>, instance: InstanceId) -> f32 {
        let Some(surface) = self.surfaces.get(&instance) else { return f32::INFINITY };
        let mesh = surface.mesh.get_or_init(|| instance_mesh(&self.scene.mesh, instance));
        mesh.as_ref().map_or(f32::INFINITY, |mesh| mesh.distance_m(eye))
    }

    /// Computes or loads the data for the first image.
    pub fn prepare_pictures(&self) {
        self.renderer.model();
    }

    /// Computes or loads a source's acoustics (world frame, metres).
    pub fn prepare_sound(&self, position: &Point3<f32>) {
        self.source(position).prepare();
    }

    /// Returns a meter for the levels of sound sources, each with the levels of its clip. Its sources are prepared
    /// apart from audible ones, in a fraction of the time.
    pub fn level_meter(
        &self,
        sources: Vec<(SoundSource, Arc<ClipLevels>)>,
        head: &Head,
        samples_per_step: usize,
    ) -> LevelMeter {
        let acoustics = self.levels.get_or_init(|| self.acoustics().for_levels());
        let emitter = |(SoundSource { position, clip, offset_samples }, levels)| {
            let source = acoustics.source(&position).with_head(head);
            (Emitter { source, clip, offset_samples }, levels)
        };
        LevelMeter::new(sources.into_iter().map(emitter).collect(), samples_per_step)
    }

    /// Returns the shared sound source.
    pub(crate) fn source(&self, position: &Point3<f32>) -> Source {
        self.acoustics().source(position)
    }

    fn acoustics(&self) -> &Acoustics {
        let listen = || {
            let surfaces = avln_acoustics::Surfaces::by_material(&self.scene);
            let cached = self.cached.clone();
            let place = cached.map(|Cached { cache, name }| BuildingCache { cache, name });
            let _span = tracing::debug_span!("acoustics", scene = self.scene.name).entered();
            Acoustics::new(&self.scene, Arc::clone(&self.rays), surfaces, Settings::default())
                .with_cache(place)
        };
        self.acoustics.get_or_init(listen)
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
    for (list, found, expected) in lists {
        if found != expected {
            let defect = format!("{found} entries in `{list}` where {expected} belong");
            return Err(PrepareError::Malformed { scene: scene.name.clone(), defect });
        }
    }
    Ok(())
}

fn instance_mesh(mesh: &Mesh, instance: InstanceId) -> Option<QueryMesh> {
    let all = (0..).zip(&mesh.triangles).zip(&mesh.instance_of);
    let own = all.filter(|(_, of)| **of == instance).map(|((index, triangle), _)| (index, *triangle));
    QueryMesh::new(&mesh.positions, own)
}

fn surfaces(scene: &Scene) -> BTreeMap<InstanceId, InstanceSurface> {
    let mut triangles = BTreeMap::<InstanceId, Vec<_>>::new();
    for (triangle, &id) in scene.mesh.instance_of.iter().enumerate() {
        if id != InstanceId::NONE {
            triangles.entry(id).or_default().push(scene.corners(triangle));
        }
    }
    let surface = |triangles: &[[Point3<f32>; 3]], id: InstanceId| InstanceSurface {
        points: spread(triangles, u64::from(id.0)),
        mesh: OnceLock::new(),
    };
    triangles.iter().map(|(&id, triangles)| (id, surface(triangles, id))).collect()
}

/// Returns [`POINTS`] points, one per equal area share; none without area.
fn spread(triangles: &[[Point3<f32>; 3]], seed: u64) -> Vec<Point3<f32>> {
    let mut rng = Rng::new(seed);
    let area = |[a, b, c]: &[Point3<f32>; 3]| f64::from((b - a).cross(&(c - a)).norm());
    let total: f64 = triangles.iter().map(area).sum();
    let mut points = Vec::new();
    let mut passed = 0.0;
    for triangle in triangles {
        passed += area(triangle);
        while points.len() < POINTS && passed > total * (points.len() as f64 + 0.5) / POINTS as f64 {
            points.push(inside(triangle, &mut rng));
        }
    }
    points
}

/// Returns a random point, uniform over the area.
fn inside([a, b, c]: &[Point3<f32>; 3], rng: &mut Rng) -> Point3<f32> {
    let (u, v) = (rng.range(0.0, 1.0), rng.range(0.0, 1.0));
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    let offset: Vector3<f32> = (b - a) * u + (c - a) * v;
    a + offset
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
    fn resident_bytes_grow_with_the_first_image() {
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
        assets.prepare_sound(&eye);
        assert!(assets.resident_bytes() > seen);
    }

    #[test]
    fn mesh_distances_are_at_least_box_distances() {
        let assets =
            SceneAssets::prepare(avln_houses::house("measured", 1, &HouseOptions::small()), &Body::default())
                .expect("a house");
        let before = assets.resident_bytes();
        let eye = Point3::new(0.3, 1.0, 0.2);
        for object in &assets.scene.objects {
            let mesh_m = assets.distance_to_mesh_m(&eye, object.id);
            let is_own = |triangle: &usize| assets.scene.mesh.instance_of[*triangle] == object.id;
            let corners = (0..assets.scene.mesh.triangles.len()).filter(is_own);
            let corners = corners.flat_map(|triangle| assets.scene.corners(triangle));
            let corner_m = corners.map(|corner| (corner - eye).norm()).fold(f32::INFINITY, f32::min);
            assert!(mesh_m >= object.bounds.distance_m(&eye) - 1e-4, "{}", object.category);
            assert!(mesh_m <= corner_m + 1e-4, "{}: {mesh_m}, {corner_m}", object.category);
        }
        assert!(assets.distance_to_mesh_m(&eye, InstanceId(InstanceId::MAX)).is_infinite());
        assert!(assets.resident_bytes() > before, "the meshes are kept");
    }

    #[test]
    fn invalid_scenes_are_refused_by_name() {
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
            Ok(_) => panic!("an invalid scene was prepared"),
            Err(error) => error.to_string(),
        };
        assert!(refusal(&scene).contains("`ruin` has no triangles"));
        scene.mesh.uvs.push(Point2::origin());
        assert!(refusal(&scene).contains("1 entries in `uvs` where 0 belong"));
    }

    #[test]
    fn surface_points_are_distributed_by_area() {
        let triangle = |size: f32, x: f32| {
            [Point3::new(x, 0.0, 0.0), Point3::new(x + size, 0.0, 0.0), Point3::new(x, size, 0.0)]
        };
        // Areas in a ratio of 9 to 1.
        let points = spread(&[triangle(3.0, 0.0), triangle(1.0, 10.0)], 1);
        assert_eq!(points.len(), POINTS);
        let on_small = points.iter().filter(|point| point.x >= 10.0).count();
        assert!((5..=8).contains(&on_small), "{on_small} of {POINTS} points on a tenth of the area");
        assert!(points.iter().all(|p| p.y >= 0.0 && (p.x % 10.0) + p.y <= 3.0 + 1e-5));
        assert!(spread(&[[Point3::origin(); 3]], 1).is_empty(), "a point has no area");
    }
}
