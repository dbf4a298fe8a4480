//! Poses of the body, as isometries.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Position and heading of the body. Right-handed, Y up; heading 0 looks to -Z, positive is a left turn.
///
/// ```
/// use avln_client::{Pose, nalgebra::Point3};
///
/// // A wall 2 m ahead of a body that has turned left by a quarter.
/// let pose = Pose::new([1.0, 0.0, 0.0], std::f32::consts::FRAC_PI_2);
/// let wall = pose.isometry() * Point3::new(0.0, 1.0, -2.0);
/// assert!((wall - Point3::new(-1.0, 1.0, 0.0)).norm() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    isometry: Isometry3<f32>,
    // Kept beside the rotation, because an angle from a quaternion differs from the sent one in the last bits.
    heading_rad: f32,
}

impl Pose {
    /// Creates a pose from a position (x right, y up, z back, metres) and a heading about +Y.
    pub fn new(position: [f32; 3], heading_rad: f32) -> Self {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), heading_rad);
        Self { isometry: Isometry3::from_parts(Translation3::from(position), turn), heading_rad }
    }

    /// Returns the base of the body, metres: x right, y up, z back.
    pub fn position(&self) -> [f32; 3] {
        self.isometry.translation.vector.into()
    }

    /// Returns the heading about +Y, radians, -π to π.
    pub fn heading_rad(&self) -> f32 {
        self.heading_rad
    }

    /// Returns the transform from the body's frame (-Z ahead) to the frame of poses.
    pub fn isometry(&self) -> &Isometry3<f32> {
        &self.isometry
    }
}

impl From<Pose> for Isometry3<f32> {
    /// Returns [`Pose::isometry`].
    fn from(pose: Pose) -> Self {
        pose.isometry
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn positions_and_headings_keep_their_bits() {
        let pose = Pose::new([0.1, -2.3, 1e-7], -1.000_000_1);
        assert_eq!(pose.position().map(f32::to_bits), [0.1_f32, -2.3, 1e-7].map(f32::to_bits));
        assert_eq!(pose.heading_rad().to_bits(), (-1.000_000_1_f32).to_bits());
        assert_eq!(Pose::default(), Pose::new([0.0; 3], 0.0));
    }

    #[test]
    fn isometries_map_ahead_to_the_heading() {
        let pose = Pose::new([3.0, 0.5, -1.0], 2.0);
        let ahead = Isometry3::from(pose) * Point3::new(0.0, 0.0, -1.0);
        let (sin, cos) = 2.0_f32.sin_cos();
        assert!((ahead - Point3::new(3.0 - sin, 0.5, -1.0 - cos)).norm() < 1e-6);
    }
}
