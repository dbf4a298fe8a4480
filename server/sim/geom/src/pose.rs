//! Poses: position and heading, and conversion between frames.

use crate::angle;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

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
