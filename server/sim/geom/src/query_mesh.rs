//! Mesh queries by parry: distances, upright bodies, and rays independent of `RayMesh`.

use crate::convert::{glam_from_point, glam_from_vector};
use crate::{Point3, Vector3};
use parry3d::math::Pose as ParryPose;
use parry3d::query::{PointQuery, Ray, RayCast, ShapeCastOptions, cast_shapes, distance, intersection_test};
use parry3d::shape::{Capsule as ParryCapsule, TriMesh};

/// Two-sided triangles for occasional queries. Triangles without area are left out.
pub struct QueryMesh {
    mesh: TriMesh,
    /// Caller's index per triangle.
    indices: Vec<u32>,
}

/// An upright capsule, the shape of a standing body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// Lowest point.
    pub base: Point3<f32>,
    /// Radius, metres.
    pub radius_m: f32,
    /// Height with both caps, metres; at least the diameter.
    pub height_m: f32,
}

impl Capsule {
    /// Returns the capsule without its lowest `lift_m`, with the same top.
    pub fn without_feet(&self, lift_m: f32) -> Self {
        let base = self.base + Vector3::y() * lift_m;
        Self { base, height_m: (self.height_m - lift_m).max(2.0 * self.radius_m), ..*self }
    }

    fn parry(&self) -> ParryCapsule {
        let end = |height_m: f32| glam_from_point(&(self.base + Vector3::y() * height_m));
        let high_m = (self.height_m - self.radius_m).max(self.radius_m);
        ParryCapsule::new(end(self.radius_m), end(high_m), self.radius_m)
    }
}

impl QueryMesh {
    /// Indexes the triangles with an area; `None` without any.
    ///
    /// # Panics
    /// If an index is outside `positions`.
    pub fn new(
        positions: &[Point3<f32>],
        triangles: impl IntoIterator<Item = (u32, [u32; 3])>,
    ) -> Option<Self> {
        let has_area = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| positions[corner as usize]);
            (b - a).cross(&(c - a)).norm_squared() > 0.0
        };
        let (mut vertices, mut indices, mut faces) = (Vec::new(), Vec::new(), Vec::new());
        for (index, corners) in triangles.into_iter().filter(|(_, corners)| has_area(corners)) {
            let first = vertices.len() as u32;
            vertices.extend(corners.map(|corner| glam_from_point(&positions[corner as usize])));
            faces.push([first, first + 1, first + 2]);
            indices.push(index);
        }
        let mesh = TriMesh::new(vertices, faces).ok()?;
        Some(Self { mesh, indices })
    }

    /// Returns the memory use in bytes.
    pub fn byte_count(&self) -> usize {
        size_of_val(self.mesh.vertices())
            + size_of_val(self.mesh.indices())
            + self.mesh.bvh().total_memory_size()
            + size_of_val(self.indices.as_slice())
    }

    /// Returns the Euclidean distance from `point` to the surface, metres.
    pub fn distance_m(&self, point: &Point3<f32>) -> f32 {
        self.mesh.distance_to_local_point(glam_from_point(point), true)
    }

    /// Returns the index of the first triangle within `max_distance` direction lengths, and its distance.
    pub fn cast(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_distance: f32,
    ) -> Option<(u32, f32)> {
        let ray = Ray::new(glam_from_point(origin), glam_from_vector(direction));
        let hit = self.mesh.cast_local_ray_and_get_normal(&ray, max_distance, false)?;
        Some((self.indices[hit.subshape as usize], hit.time_of_impact))
    }

    /// Returns true if the surface and the capsule share a point.
    pub fn intersects(&self, capsule: &Capsule) -> bool {
        // parry supports every pair of its convex shapes and meshes.
        intersection_test(&ParryPose::IDENTITY, &capsule.parry(), &ParryPose::IDENTITY, &self.mesh)
            .is_ok_and(|found| found.intersecting)
    }

    /// Returns the gap between the capsule and the surface, metres; 0 if they share a point.
    pub fn clearance_m(&self, capsule: &Capsule) -> f32 {
        distance(&ParryPose::IDENTITY, &capsule.parry(), &ParryPose::IDENTITY, &self.mesh)
            .map_or(0.0, |found| found.distance)
    }

    /// Returns the way of a capsule in a unit direction up to the first contact, metres; `None` beyond `reach_m`.
    pub fn cast_capsule(&self, capsule: &Capsule, direction: &Vector3<f32>, reach_m: f32) -> Option<f32> {
        let still = glam_from_vector(&Vector3::zeros());
        let options = ShapeCastOptions::with_max_time_of_impact(reach_m);
        let (body, motion) = (capsule.parry(), glam_from_vector(direction));
        let here = ParryPose::IDENTITY;
        let hit = cast_shapes(&here, motion, &body, &here, still, &self.mesh, options).ok()??;
        Some(hit.time_of_impact)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{RayMesh, Rng};

    /// A floor at height 0 and a wall in the plane x = 2, each of two triangles.
    fn corner() -> QueryMesh {
        let at = |x: f32, y: f32, z: f32| Point3::new(x, y, z);
        let floor = [at(-5.0, 0.0, -5.0), at(5.0, 0.0, -5.0), at(5.0, 0.0, 5.0), at(-5.0, 0.0, 5.0)];
        let wall = [at(2.0, 0.0, -5.0), at(2.0, 3.0, -5.0), at(2.0, 3.0, 5.0), at(2.0, 0.0, 5.0)];
        let positions = [floor, wall].concat();
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7], [0, 0, 1]];
        QueryMesh::new(&positions, (0..).zip(triangles)).expect("triangles with an area")
    }

    fn body(x: f32, y: f32) -> Capsule {
        Capsule { base: Point3::new(x, y, 0.0), radius_m: 0.25, height_m: 1.5 }
    }

    #[test]
    fn distances_lead_to_the_nearest_triangle() {
        let mesh = corner();
        let eye = Point3::new(1.0, 2.5, 0.5);
        assert!((mesh.distance_m(&eye) - 1.0).abs() < 1e-6);
        assert_eq!(mesh.distance_m(&Point3::new(0.0, 0.0, 0.0)), 0.0);
    }

    #[test]
    fn meshes_without_area_are_none() {
        let positions = [Point3::origin(), Point3::new(1.0, 0.0, 0.0)];
        assert!(QueryMesh::new(&positions, [(0, [0, 1, 1])]).is_none());
        assert!(QueryMesh::new(&positions, []).is_none());
    }

    #[test]
    fn capsules_meet_walls_and_floors() {
        let mesh = corner();
        assert!(!mesh.intersects(&body(1.0, 0.1)));
        let clearance_m = mesh.clearance_m(&body(1.0, 0.1));
        assert!((clearance_m - 0.1).abs() < 1e-3, "{clearance_m}");
        assert!(mesh.intersects(&body(1.9, 0.1)), "the wall");
        assert!(mesh.intersects(&body(1.0, -0.1)), "the floor");
        assert!(!mesh.intersects(&body(1.0, -0.1).without_feet(0.2)), "the feet are left out");
        assert_eq!(mesh.clearance_m(&body(1.9, 0.1)), 0.0);
    }

    #[test]
    fn falling_capsules_stop_on_the_floor() {
        let mesh = corner();
        let fall_m = mesh.cast_capsule(&body(0.0, 0.5), &-Vector3::y(), 2.0).expect("a floor");
        assert!((fall_m - 0.5).abs() < 1e-3, "{fall_m}");
        let walk_m = mesh.cast_capsule(&body(0.0, 0.5), &Vector3::x(), 9.0).expect("a wall");
        assert!((walk_m - 1.75).abs() < 1e-3, "{walk_m}");
        assert_eq!(mesh.cast_capsule(&body(0.0, 0.5), &-Vector3::y(), 0.4), None);
    }

    #[test]
    fn both_ray_casters_agree() {
        let mut rng = Rng::new(11);
        let mut point = || Point3::from(Vector3::from_fn(|_, _| rng.range(-3.0, 3.0)));
        let positions: Vec<_> = (0..300).map(|_| point()).collect();
        let triangles: Vec<[u32; 3]> = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let ours = RayMesh::new(&positions, &triangles);
        let theirs = QueryMesh::new(&positions, (0..).zip(triangles)).expect("triangles");
        for _ in 0..2000 {
            let (from, to) = (point(), point());
            let hit = ours.cast(&from, &(to - from), 2.0).map(|hit| (hit.triangle, hit.distance));
            let other = theirs.cast(&from, &(to - from), 2.0);
            let agree = match (hit, other) {
                (Some((a, near)), Some((b, far))) => a == b && (near - far).abs() < 1e-4,
                (None, None) => true,
                _ => false,
            };
            assert!(agree, "{from} to {to}: {hit:?}, {other:?}");
        }
    }
}
