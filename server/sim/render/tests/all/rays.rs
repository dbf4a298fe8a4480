//! Single rays in double precision, slow and independent from the renderer.

use avln_geom::{Aabb, RayMesh, Vector3, Visitor};
use avln_render::Camera;
use avln_scene::{InstanceId, Scene};

/// Boxes are grown by this against rounding, metres.
const MARGIN_M: f64 = 1e-4;

/// Near plane with tolerance, metres: closer surfaces may or may not be visible.
pub(crate) const NEAR_M: f64 = 1.05e-3;

/// A ray hit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Met {
    /// Distance in direction lengths: planar depth for unit view directions.
    pub(crate) depth_m: f64,
    pub(crate) triangle: u32,
    /// From the ray's origin to the triangle's plane, metres.
    pub(crate) plane_m: f64,
    /// From the ray's origin to the triangle's farthest corner, metres.
    pub(crate) extent_m: f64,
}

/// A ray traversal with all hits.
pub(crate) struct Trace<'a> {
    scene: &'a Scene,
    origin: [f64; 3],
    direction: [f64; 3],
    nearest: f64,
    met: Vec<Met>,
}

impl Trace<'_> {
    /// All candidate hits, unordered; `tree` contains the scene triangles.
    pub(crate) fn through(scene: &Scene, tree: &RayMesh, origin: [f64; 3], direction: [f64; 3]) -> Vec<Met> {
        let mut trace = Trace { scene, origin, direction, nearest: f64::INFINITY, met: Vec::new() };
        tree.visit(&mut trace);
        trace.met
    }

    /// All hits by testing every triangle.
    pub(crate) fn by_force(scene: &Scene, origin: [f64; 3], direction: [f64; 3]) -> Vec<Met> {
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
pub(crate) fn plane_depth_m(scene: &Scene, triangle: u32, (origin, direction): ([f64; 3], [f64; 3])) -> f64 {
    let [a, b, c] = corners(scene, triangle);
    let normal = cross(minus(b, a), minus(c, a));
    dot(minus(a, origin), normal) / dot(direction, normal)
}

fn corners(scene: &Scene, triangle: u32) -> [[f64; 3]; 3] {
    scene.corners(triangle as usize).map(|corner| <[f32; 3]>::from(corner.coords).map(f64::from))
}

/// Pinhole and direction through an image point, in pixels from left and top.
pub(crate) fn ray(camera: &Camera, [x, y]: [f64; 2]) -> ([f64; 3], [f64; 3]) {
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
pub(crate) fn nearest(met: &[Met]) -> Option<Met> {
    let certain = met.iter().copied().filter(|met| met.depth_m >= NEAR_M);
    certain.min_by(|a, b| a.depth_m.total_cmp(&b.depth_m))
}

pub(crate) fn instance(scene: &Scene, met: &Met) -> InstanceId {
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
