//! Points and poses on the floor plan, and the pinhole camera.

use avln_client::{DepthImage, Pose, TaskSpec};

/// A point on the floor plan, metres: `x` right and `z` back in the frame of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FloorPoint {
    /// Metres.
    pub x: f32,
    /// Metres.
    pub z: f32,
}

impl FloorPoint {
    /// Creates a point.
    pub fn new(x: f32, z: f32) -> Self {
        Self { x, z }
    }

    /// Returns the distance to another point, metres.
    pub fn distance_m(self, other: Self) -> f32 {
        let (dx, dz) = (self.x - other.x, self.z - other.z);
        (dx * dx + dz * dz).sqrt()
    }

    /// Returns the point at `share` (0 to 1) of the way to `other`.
    pub fn toward(self, other: Self, share: f32) -> Self {
        Self { x: self.x + (other.x - self.x) * share, z: self.z + (other.z - self.z) * share }
    }
}

/// A pose on the floor plan.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pose2d {
    /// Body position.
    pub place: FloorPoint,
    sin: f32,
    cos: f32,
}

impl Pose2d {
    /// Projects a pose onto the floor plan.
    pub fn new(pose: &Pose) -> Self {
        // libm, as everywhere in the agents: the platform's functions differ in the last bit between systems, and
        // calibration compares actions bit for bit (docs/decisions/0019).
        let (sin, cos) = libm::sincosf(pose.heading_rad);
        let [x, _, z] = pose.position;
        Self { place: FloorPoint { x, z }, sin, cos }
    }

    /// Returns the point `ahead_m` in front and `right_m` to the right.
    pub fn offset(&self, ahead_m: f32, right_m: f32) -> FloorPoint {
        FloorPoint {
            x: self.place.x - self.sin * ahead_m + self.cos * right_m,
            z: self.place.z - self.cos * ahead_m - self.sin * right_m,
        }
    }

    /// Returns the rotation from this pose to `other`, radians, -π to π, positive to the left.
    pub fn turn_rad(&self, other: &Self) -> f32 {
        let (sin, cos) =
            (other.sin * self.cos - other.cos * self.sin, other.cos * self.cos + other.sin * self.sin);
        libm::atan2f(sin, cos)
    }

    /// Returns true if both poses have nearly the same view.
    pub fn sees_like(&self, other: &Self) -> bool {
        const MOVED_M: f32 = 0.45;
        const TURNED_RAD: f32 = 0.8;
        self.place.distance_m(other.place) < MOVED_M && self.turn_rad(other).abs() < TURNED_RAD
    }

    /// Returns the direction of a point from straight ahead, radians, -π to π, positive to the left.
    pub fn bearing_rad(&self, place: FloorPoint) -> f32 {
        let (dx, dz) = (place.x - self.place.x, place.z - self.place.z);
        let ahead = -self.sin * dx - self.cos * dz;
        let left = -self.cos * dx + self.sin * dz;
        libm::atan2f(left, ahead)
    }
}

/// A run's pinhole camera.
#[derive(Clone, Copy, Debug)]
pub struct PinholeCamera {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    focal_px: f32,
    camera_height_m: f32,
    depth_max_m: f32,
}

/// A surface point in a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfacePoint {
    /// Position on the floor plan.
    pub place: FloorPoint,
    /// Height above the body's base, metres.
    pub height_m: f32,
    /// Distance on the floor plan from the camera, metres.
    pub range_m: f32,
}

impl PinholeCamera {
    /// Creates a task's camera.
    pub fn new(task: &TaskSpec) -> Self {
        let focal_px = 0.5 * task.width as f32 / libm::tanf(0.5 * task.hfov_rad);
        Self {
            width: task.width as usize,
            height: task.height as usize,
            focal_px,
            camera_height_m: task.camera_height_m,
            depth_max_m: task.depth_max_m,
        }
    }

    /// Returns the point at `range_m` on the floor plan in a column's viewing direction.
    pub fn along(&self, pose: &Pose2d, column: usize, range_m: f32) -> FloorPoint {
        let tan = self.tan_right(column);
        let ahead_m = range_m / (1.0 + tan * tan).sqrt();
        pose.offset(ahead_m, tan * ahead_m)
    }

    /// Returns the surface point in a pixel; `None` without a hit or for an image of another size.
    pub fn seen(&self, pose: &Pose2d, depth: &DepthImage, column: usize, row: usize) -> Option<SurfacePoint> {
        let depth_m = *depth.metres.get(row * self.width + column)?;
        if !(depth_m > 0.0 && depth_m <= self.depth_max_m) {
            return None;
        }
        let right_m = self.tan_right(column) * depth_m;
        let up_m = (0.5 * self.height as f32 - row as f32 - 0.5) / self.focal_px * depth_m;
        Some(SurfacePoint {
            place: pose.offset(depth_m, right_m),
            height_m: self.camera_height_m + up_m,
            range_m: (depth_m * depth_m + right_m * right_m).sqrt(),
        })
    }

    fn tan_right(&self, column: usize) -> f32 {
        (column as f32 + 0.5 - 0.5 * self.width as f32) / self.focal_px
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::FRAC_PI_2;

    fn pose(x: f32, z: f32, heading_rad: f32) -> Pose2d {
        Pose2d::new(&Pose { position: [x, 0.5, z], heading_rad })
    }

    #[test]
    fn pixels_are_lifted_to_points() {
        let view = PinholeCamera::new(&TaskSpec { width: 4, height: 4, ..TaskSpec::default() });
        let depth = DepthImage { width: 4, height: 4, metres: vec![2.0; 16] };
        // Focal length 2 px: the last column lies 0.75 of the depth to the right, the top row 0.75 above the eye.
        let seen = view.seen(&pose(1.0, -1.0, 0.0), &depth, 3, 0).unwrap();
        assert!(seen.place.distance_m(FloorPoint::new(2.5, -3.0)) < 1e-5);
        assert!((seen.height_m - 2.5).abs() < 1e-5 && (seen.range_m - 2.5).abs() < 1e-5);
        // Turned left by a quarter, ahead is -x and right is -z.
        let seen = view.seen(&pose(1.0, -1.0, FRAC_PI_2), &depth, 3, 0).unwrap();
        assert!(seen.place.distance_m(FloorPoint::new(-1.0, -2.5)) < 1e-5);
        assert!(view.along(&pose(1.0, -1.0, FRAC_PI_2), 3, 2.5).distance_m(seen.place) < 1e-5);
    }

    #[test]
    fn missing_depth_has_no_surface() {
        let view = PinholeCamera::new(&TaskSpec { width: 2, height: 2, ..TaskSpec::default() });
        let depth = DepthImage { width: 2, height: 2, metres: vec![0.0, f32::NAN, 99.0] };
        for row in 0..2 {
            for column in 0..2 {
                assert!(view.seen(&Pose2d::default(), &depth, column, row).is_none());
            }
        }
    }

    #[test]
    fn bearings_are_positive_to_the_left() {
        let here = pose(0.0, 0.0, 0.0);
        assert!((here.bearing_rad(FloorPoint::new(-1.0, 0.0)) - FRAC_PI_2).abs() < 1e-6);
        assert!(pose(0.0, 0.0, FRAC_PI_2).bearing_rad(FloorPoint::new(-1.0, 0.0)).abs() < 1e-6);
        assert!((here.bearing_rad(FloorPoint::new(1.0, -1.0)) + FRAC_PI_2 / 2.0).abs() < 1e-6);
        assert!((pose(0.0, 0.0, 3.0).turn_rad(&pose(1.0, 0.0, -3.0)) - 0.283_185).abs() < 1e-5);
    }
}
