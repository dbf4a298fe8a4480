//! Frames, poses, angles, boxes, rays, mesh queries and the seeded random generator.
//!
//! World frame (Habitat's): right-handed, Y up, metres, radians. A body with heading 0 faces -Z;
//! a positive rotation about +Y is a left turn. Quaternions are written `x, y, z, w`.
//!
//! Start reading at [`Pose`], [`Aabb`] and [`RayMesh`]. [`QueryMesh`] has the queries without a hot loop: distances, bodies, and a
//! second opinion on rays.
//!
//! This crate never reads a clock, the environment or a file or iterates in hash order.

mod aabb;
pub mod angle;
mod query_mesh;
mod ray_mesh;
mod rng;

pub use aabb::Aabb;
use nalgebra::Translation3;
pub use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector2, Vector3};
pub use query_mesh::{Capsule, QueryMesh};
pub use ray_mesh::{Hit, RayMesh, Visitor};
pub use rng::{Rng, SplitMix64};
use serde::{Deserialize, Serialize};

/// Conversions between nalgebra points and the vectors of parry and rerecast (glam).
pub mod convert {
    use super::{Point3, Vector3};
    pub use parry3d::math::Vec3 as GlamVec3;

    /// Converts a point for parry.
    pub fn glam_from_point(point: &Point3<f32>) -> GlamVec3 {
        GlamVec3::new(point.x, point.y, point.z)
    }

    /// Converts a direction for parry.
    pub fn glam_from_vector(vector: &Vector3<f32>) -> GlamVec3 {
        GlamVec3::new(vector.x, vector.y, vector.z)
    }

    /// Converts a point from parry.
    pub fn point_from_glam(point: GlamVec3) -> Point3<f32> {
        Point3::new(point.x, point.y, point.z)
    }
}

/// Position and heading of a body, in the world frame unless named otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Base (feet), metres.
    pub position: Point3<f32>,
    /// Rotation about +Y, radians in (-pi, pi]; 0 faces -Z, left is positive.
    pub heading_rad: f32,
}

impl Pose {
    /// Creates a pose with the heading normalised to (-pi, pi].
    pub fn new(position: Point3<f32>, heading_rad: f32) -> Self {
        Self { position, heading_rad: angle::wrap(heading_rad) }
    }

    /// Returns the horizontal unit vector ahead.
    pub fn forward(&self) -> Vector3<f32> {
        let (sin, cos) = angle::sin_cos(self.heading_rad);
        Vector3::new(-sin, 0.0, -cos)
    }

    /// Returns the horizontal unit vector to the right.
    pub fn right(&self) -> Vector3<f32> {
        let (sin, cos) = angle::sin_cos(self.heading_rad);
        Vector3::new(cos, 0.0, -sin)
    }

    /// Returns the rotation as a quaternion.
    pub fn rotation(&self) -> UnitQuaternion<f32> {
        angle::about_up(self.heading_rad)
    }

    /// Returns the transform from the agent's frame to the world.
    pub fn world_from_agent(&self) -> Isometry3<f32> {
        Isometry3::from_parts(Translation3::from(self.position), self.rotation())
    }

    /// Returns this pose in the frame of `start`.
    pub fn relative_to(&self, start: &Pose) -> Pose {
        let offset = self.position - start.position;
        let along = |axis: Vector3<f32>| offset.dot(&axis);
        let position = Point3::new(along(start.right()), offset.y, -along(start.forward()));
        Pose::new(position, self.heading_rad - start.heading_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::FRAC_PI_2;

    #[test]
    fn left_turn_from_minus_z_faces_minus_x() {
        let pose = Pose::new(Point3::origin(), FRAC_PI_2);
        assert!((pose.forward() - Vector3::new(-1.0, 0.0, 0.0)).norm() < 1e-6);
        let rotated = pose.rotation() * Vector3::new(0.0, 0.0, -1.0);
        assert!((rotated - pose.forward()).norm() < 1e-6);
    }

    #[test]
    fn relative_poses_lead_back_to_the_world() {
        let start = Pose::new(Point3::new(3.0, 1.0, -2.0), 0.7);
        let pose = Pose::new(Point3::new(-1.0, 1.5, 4.0), -2.0);
        let relative = pose.relative_to(&start);
        let heading_rad = angle::wrap(start.heading_rad + relative.heading_rad);
        assert!((heading_rad - pose.heading_rad).abs() < 1e-5);
        let isometry = start.world_from_agent() * relative.position;
        assert!((isometry - pose.position).norm() < 1e-5);
    }

    #[test]
    fn ahead_is_minus_z_relative_to_the_start() {
        let start = Pose::new(Point3::new(5.0, 0.0, 5.0), 1.2);
        let ahead = Pose::new(start.position + start.forward(), start.heading_rad);
        assert!((ahead.relative_to(&start).position - Point3::new(0.0, 0.0, -1.0)).norm() < 1e-6);
    }
}
