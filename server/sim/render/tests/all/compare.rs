//! Depth and instances compared with double-precision rays, pixel by pixel, from more than a thousand
//! positions. The rays are slow and independent from the renderer.
//!
//! A pixel is right if depth agrees within 1 mm or 0.1 % and the instance belongs to a surface there. All
//! others must be on a silhouette, where rays 0.02 pixels aside hit a different surface.

use crate::scenes::{camera, direction, painted, procedural, renderer, shared, tumbled};
use avln_geom::{Aabb, Point3, RayMesh, Rng, Vector3, Visitor, angle};
use avln_render::{Camera, CameraImage, Renderer};
use avln_scene::{InstanceId, Scene};
use std::sync::Arc;

/// Relative depth tolerance.
const RIGHT: f64 = 1e-3;
/// Silhouette test offset, pixels.
const BESIDE_PX: f64 = 0.02;
/// Relative corner rounding in single precision.
const ROUNDING: f64 = 4e-7;
/// Permitted silhouette share.
const SILHOUETTES: f64 = 0.002;
/// Permitted share of wrong pixels.
const WRONG: f64 = 0.0;

/// A scene's comparison result.
#[derive(Debug, Default)]
struct Tally {
    pixels: usize,
    /// Different, on a silhouette.
    silhouette: usize,
    wrong: Vec<String>,
}

struct Oracle<'a> {
    scene: &'a Scene,
    tree: &'a RayMesh,
}

impl Oracle<'_> {
    fn met(&self, camera: &Camera, at: [f64; 2]) -> Vec<Met> {
        let (origin, direction) = ray(camera, at);
        Trace::through(self.scene, self.tree, origin, direction)
    }

    /// Depth tolerance at `met`: larger at grazing incidence on a near surface.
    fn tolerance_m(met: &Met) -> f64 {
        (RIGHT * met.depth_m).max(1e-3) + met.depth_m * ROUNDING * met.extent_m / met.plane_m.max(1e-9)
    }

    fn is_right(&self, met: &[Met], (depth_m, seen): (f64, InstanceId)) -> bool {
        let shown = |first: &Met| {
            let tolerance_m = Self::tolerance_m(first);
            let there = |other: &&Met| other.depth_m <= first.depth_m + tolerance_m;
            (depth_m - first.depth_m).abs() <= tolerance_m
                && met.iter().filter(there).any(|met| instance(self.scene, met) == seen)
        };
        let too_near = met.iter().filter(|met| met.depth_m < NEAR_M);
        let nothing = nearest(met).is_none() && depth_m == 0.0 && seen == InstanceId::NONE;
        nothing || too_near.chain(nearest(met).as_ref()).any(shown)
    }

    /// Returns true if a ray next to the pixel hits a different instance or leaves the hit's plane.
    fn is_silhouette(&self, camera: &Camera, [x, y]: [f64; 2]) -> bool {
        let middle = nearest(&self.met(camera, [x, y]));
        let beside = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
        beside.map(|[i, j]| [x + i * BESIDE_PX, y + j * BESIDE_PX]).into_iter().any(|at| {
            match (middle, nearest(&self.met(camera, at))) {
                (None, None) => false,
                (Some(middle), Some(met)) => {
                    let on_plane_m = plane_depth_m(self.scene, middle.triangle, ray(camera, at));
                    instance(self.scene, &met) != instance(self.scene, &middle)
                        || (met.depth_m - on_plane_m).abs() > Self::tolerance_m(&met)
                }
                _ => true,
            }
        })
    }

    fn compare(&self, camera: &Camera, frame: &CameraImage, tally: &mut Tally) {
        for pixel in 0..frame.depth.len() {
            let (column, row) = (pixel % camera.width as usize, pixel / camera.width as usize);
            let at = [column as f64 + 0.5, row as f64 + 0.5];
            let met = self.met(camera, at);
            tally.pixels += 1;
            let shown = (f64::from(frame.depth[pixel]), frame.instances[pixel]);
            if self.is_right(&met, shown) {
                continue;
            }
            if self.is_silhouette(camera, at) {
                tally.silhouette += 1;
            } else {
                let nearest = nearest(&met);
                tally.wrong.push(format!("{column},{row} of {camera:?}: {shown:?} is not {nearest:?}"));
            }
        }
    }
}

/// Compares all images on two threads.
pub(crate) fn check(scene: Scene, cameras: impl FnOnce(&Scene, &RayMesh) -> Vec<Camera>) {
    let scene = Arc::new(scene);
    let (renderer, tree) = renderer(&scene);
    let cameras = cameras(&scene, &tree);
    let oracle = Oracle { scene: &scene, tree: &tree };
    let work = |cameras: &[Camera], renderer: &Renderer| {
        let mut tally = Tally::default();
        cameras.iter().for_each(|camera| oracle.compare(camera, &renderer.render(camera), &mut tally));
        tally
    };
    let (first, second) = cameras.split_at(cameras.len() / 2);
    let tallies = std::thread::scope(|scope| {
        let other = scope.spawn(|| work(second, &renderer));
        [work(first, &renderer), other.join().expect("no panic")]
    });
    let sum = |of: fn(&Tally) -> usize| tallies.iter().map(of).sum::<usize>();
    let (pixels, silhouette) = (sum(|tally| tally.pixels), sum(|tally| tally.silhouette));
    let wrong: Vec<&String> = tallies.iter().flat_map(|tally| &tally.wrong).collect();
    let counts = format!(
        "{}: of {pixels} pixels {silhouette} differ on silhouettes, {} are wrong",
        scene.name,
        wrong.len()
    );
    println!("{counts}");
    assert!(wrong.len() as f64 <= WRONG * pixels as f64, "{counts}: {:#?}", &wrong[..wrong.len().min(5)]);
    assert!(silhouette as f64 <= SILHOUETTES * pixels as f64, "{counts}");
}

/// A random pose in a room, or anywhere without rooms.
fn inside(scene: &Scene, rng: &mut Rng) -> Camera {
    let room = match rng.choose(&scene.regions) {
        Some(region) => region.bounds,
        None => scene.bounds().expect("triangles"),
    };
    let eye = Point3::from(std::array::from_fn(|axis| rng.range(room.min[axis], room.max[axis])));
    camera(eye, tumbled(rng))
}

/// A pose near a furniture centre; the centre itself is often on a surface.
fn in_furniture(scene: &Scene, rng: &mut Rng) -> Camera {
    match rng.choose(&scene.objects) {
        Some(object) => camera(object.bounds.center() + direction(rng) * 0.01, tumbled(rng)),
        None => inside(scene, rng),
    }
}

/// A millimetre in front of a surface.
fn touching(scene: &Scene, tree: &RayMesh, rng: &mut Rng) -> Camera {
    const GAP_M: f32 = 1e-3;
    let from = inside(scene, rng);
    let towards = direction(rng);
    let eye = match tree.cast(&from.eye, &towards, 100.0) {
        Some(hit) => from.eye + towards * (hit.distance - GAP_M).max(0.0),
        None => from.eye,
    };
    Camera { eye, ..from }
}

/// From outside and above.
fn outside(scene: &Scene, rng: &mut Rng) -> Camera {
    let bounds = scene.bounds().expect("triangles");
    let away = direction(rng) * bounds.size().norm();
    camera(bounds.center() + away, tumbled(rng))
}

/// `count` cameras per kind, with random lenses and sizes.
fn all_kinds(scene: &Scene, tree: &RayMesh, count: usize) -> Vec<Camera> {
    let mut rng = Rng::new(scene.mesh.triangles.len() as u64);
    let mut four = |_| {
        let hfov_rad = rng.range(0.3, 2.4);
        let (width, height) = (33 + rng.below(32) as u32, 25 + rng.below(24) as u32);
        let cameras = [
            inside(scene, &mut rng),
            in_furniture(scene, &mut rng),
            touching(scene, tree, &mut rng),
            outside(scene, &mut rng),
        ];
        cameras.map(|camera| Camera { hfov_rad, width, height, ..camera })
    };
    (0..count).flat_map(&mut four).collect()
}

#[test]
fn procedural_houses_agree_with_rays() {
    for (seed, has_lamps) in [(1, true), (2, false), (11, true), (40, false)] {
        let scene = procedural(seed);
        let scene = if has_lamps { scene } else { painted(scene) };
        check(scene, |scene, tree| all_kinds(scene, tree, 63));
    }
}

#[test]
fn scanned_and_modelled_scenes_agree_with_rays() {
    for path in [
        "aws_small_house/combined/small_house.glb",
        "webxr/home-theater/home-theater.gltf",
        "playcanvas/vr-gallery.glb",
        "resonance/CubeRoom.obj",
        "habitat_sim/scenes/stage_floor1.glb",
    ] {
        if let Some(scene) = shared(path) {
            check(scene, |scene, tree| all_kinds(scene, tree, 15));
        }
    }
}

#[test]
fn comparison_detects_a_tenth_of_a_pixel() {
    let scene = Arc::new(painted(procedural(2)));
    let (renderer, tree) = renderer(&scene);
    let oracle = Oracle { scene: &scene, tree: &tree };
    let camera = inside(&scene, &mut Rng::new(8));
    let pixel_rad = camera.hfov_rad / camera.width as f32;
    let off = angle::about_up(0.1 * pixel_rad) * camera.world_from_camera;
    let mut tally = Tally::default();
    oracle.compare(&camera, &renderer.render(&camera), &mut tally);
    assert_eq!((tally.wrong.len(), tally.pixels), (0, 48 * 36));
    oracle.compare(&camera, &renderer.render(&Camera { world_from_camera: off, ..camera }), &mut tally);
    assert!(tally.wrong.len() > 80, "{} of {} pixels are wrong", tally.wrong.len(), tally.pixels / 2);
}

/// Boxes are grown by this against rounding, metres.
const MARGIN_M: f64 = 1e-4;

/// Near plane with tolerance, metres: closer surfaces may or may not be visible.
const NEAR_M: f64 = 1.05e-3;

/// A ray hit.
#[derive(Clone, Copy, Debug)]
struct Met {
    /// Distance in direction lengths: planar depth for unit view directions.
    depth_m: f64,
    triangle: u32,
    /// From the ray's origin to the triangle's plane, metres.
    plane_m: f64,
    /// From the ray's origin to the triangle's farthest corner, metres.
    extent_m: f64,
}

/// A ray traversal with all hits.
struct Trace<'a> {
    scene: &'a Scene,
    origin: [f64; 3],
    direction: [f64; 3],
    nearest: f64,
    met: Vec<Met>,
}

impl Trace<'_> {
    /// All candidate hits, unordered; `tree` contains the scene triangles.
    fn through(scene: &Scene, tree: &RayMesh, origin: [f64; 3], direction: [f64; 3]) -> Vec<Met> {
        let mut trace = Trace { scene, origin, direction, nearest: f64::INFINITY, met: Vec::new() };
        tree.visit(&mut trace);
        trace.met
    }

    /// All hits by testing every triangle.
    fn by_force(scene: &Scene, origin: [f64; 3], direction: [f64; 3]) -> Vec<Met> {
        let mut trace = Trace { scene, origin, direction, nearest: f64::INFINITY, met: Vec::new() };
        (0..scene.mesh.triangles.len() as u32).for_each(|index| trace.triangle(index));
        trace.met
    }

    /// Entry distance into a box; infinite for a miss.
    fn entry(&self, bounds: &Aabb) -> f64 {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let (low, high) =
                (f64::from(bounds.min[axis]) - MARGIN_M, f64::from(bounds.max[axis]) + MARGIN_M);
            let inverse = 1.0 / self.direction[axis];
            let (a, b) = ((low - self.origin[axis]) * inverse, (high - self.origin[axis]) * inverse);
            // A ray on the box border yields NaN; min and max ignore it.
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        if enter <= leave { enter } else { f64::INFINITY }
    }
}

impl Visitor for Trace<'_> {
    fn distance(&self, bounds: &Aabb) -> f32 {
        self.entry(bounds) as f32
    }

    fn enters(&mut self, bounds: &Aabb) -> bool {
        let entry = self.entry(bounds);
        entry.is_finite() && entry <= self.nearest * 1.01 + 0.01
    }

    fn triangle(&mut self, index: u32) {
        let corners = corners(self.scene, index);
        if let Some((depth_m, plane_m)) = crossing(corners, self.origin, self.direction) {
            let offsets = corners.map(|corner| minus(corner, self.origin));
            let extent_m = offsets.map(|offset| dot(offset, offset).sqrt()).into_iter().fold(0.0, f64::max);
            self.nearest = if depth_m < NEAR_M { self.nearest } else { self.nearest.min(depth_m) };
            self.met.push(Met { depth_m, triangle: index, plane_m, extent_m });
        }
    }
}

/// Triangle intersection, and the plane's distance (Möller and Trumbore 1997).
fn crossing([a, b, c]: [[f64; 3]; 3], origin: [f64; 3], direction: [f64; 3]) -> Option<(f64, f64)> {
    let (along, across, offset) = (minus(b, a), minus(c, a), minus(origin, a));
    let p = cross(direction, across);
    let determinant = dot(along, p);
    if determinant == 0.0 {
        return None;
    }
    let q = cross(offset, along);
    let (u, v) = (dot(offset, p) / determinant, dot(direction, q) / determinant);
    let depth_m = dot(across, q) / determinant;
    let normal = cross(along, across);
    let plane_m = (dot(offset, normal) / dot(normal, normal).sqrt()).abs();
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && depth_m > 0.0).then_some((depth_m, plane_m))
}

/// Intersection with a triangle's plane.
fn plane_depth_m(scene: &Scene, triangle: u32, (origin, direction): ([f64; 3], [f64; 3])) -> f64 {
    let [a, b, c] = corners(scene, triangle);
    let normal = cross(minus(b, a), minus(c, a));
    dot(minus(a, origin), normal) / dot(direction, normal)
}

fn corners(scene: &Scene, triangle: u32) -> [[f64; 3]; 3] {
    scene.corners(triangle as usize).map(|corner| <[f32; 3]>::from(corner.coords).map(f64::from))
}

/// Pinhole and direction through an image point, in pixels from left and top.
fn ray(camera: &Camera, [x, y]: [f64; 2]) -> ([f64; 3], [f64; 3]) {
    let double = |v: Vector3<f32>| <[f32; 3]>::from(v).map(f64::from);
    let axis = |v: Vector3<f32>| double(camera.world_from_camera * v);
    let (right, up, back) = (axis(Vector3::x()), axis(Vector3::y()), axis(Vector3::z()));
    let half = [0.5 * f64::from(camera.width), 0.5 * f64::from(camera.height)];
    let slope = (0.5 * f64::from(camera.hfov_rad)).tan() / half[0];
    let (i, j) = ((x - half[0]) * slope, (half[1] - y) * slope);
    let direction = std::array::from_fn(|k| i * right[k] + j * up[k] - back[k]);
    (double(camera.eye.coords), direction)
}

/// The nearest certain hit.
fn nearest(met: &[Met]) -> Option<Met> {
    let certain = met.iter().copied().filter(|met| met.depth_m >= NEAR_M);
    certain.min_by(|a, b| a.depth_m.total_cmp(&b.depth_m))
}

fn instance(scene: &Scene, met: &Met) -> InstanceId {
    scene.mesh.instance_of[met.triangle as usize]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[test]
fn ray_tree_agrees_with_brute_force() {
    let scene = crate::scenes::procedural(2);
    let tree = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
    let mut rng = avln_geom::Rng::new(3);
    let bounds = scene.bounds().expect("a house");
    let mut met = 0;
    for _ in 0..150 {
        let origin = std::array::from_fn(|k| f64::from(rng.range(bounds.min[k], bounds.max[k])));
        let direction = std::array::from_fn(|_| f64::from(rng.range(-1.0, 1.0)));
        let (quick, slow) =
            (Trace::through(&scene, &tree, origin, direction), Trace::by_force(&scene, origin, direction));
        let depth = |met: &[Met]| nearest(met).map(|met| met.depth_m);
        assert_eq!(depth(&quick), depth(&slow));
        met += usize::from(!slow.is_empty());
    }
    assert!(met > 100, "{met} of 150 rays have a hit");
}
