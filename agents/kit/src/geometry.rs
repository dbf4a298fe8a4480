//! Points and poses on the floor plan, and the pinhole camera.

use avln_client::nalgebra::{Point2, Rotation2, Vector2};
use avln_client::{DepthImage, Pose, TaskSpec};
use std::ops::{Add, Sub};

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
        (self - other).norm()
    }

    /// Returns the point at `share` (0 to 1) of the way to `other`.
    pub fn toward(self, other: Self, share: f32) -> Self {
        self + (other - self) * share
    }

    /// Returns the point in the axes of [`Pose2d`]: ahead of heading 0, then left of it.
    fn point(self) -> Point2<f32> {
        Point2::new(-self.z, -self.x)
    }
}

impl Sub for FloorPoint {
    type Output = Vector2<f32>;

    /// Returns the offset from `other`, metres right and back.
    fn sub(self, other: Self) -> Vector2<f32> {
        Vector2::new(self.x - other.x, self.z - other.z)
    }
}

impl Add<Vector2<f32>> for FloorPoint {
    type Output = Self;

    /// Returns the point at an offset, metres right and back.
    fn add(self, offset: Vector2<f32>) -> Self {
        Self { x: self.x + offset.x, z: self.z + offset.y }
    }
}

impl From<Point2<f32>> for FloorPoint {
    /// Converts a point with the axes ahead and left.
    fn from(point: Point2<f32>) -> Self {
        Self { x: -point.y, z: -point.x }
    }
}

/// Returns the largest integer up to `value`: inline, because `f32::floor` is a library call without SSE 4.1.
pub(crate) fn floor(value: f32) -> i32 {
    let whole = value as i32;
    whole.saturating_sub(i32::from(whole as f32 > value))
}

/// A pose on the floor plan.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pose2d {
    /// Body position.
    pub place: FloorPoint,
    /// Heading: a counter-clockwise rotation in the axes ahead and left.
    heading: Rotation2<f32>,
}

impl Pose2d {
    /// Projects a pose onto the floor plan.
    pub fn new(pose: &Pose) -> Self {
        // nalgebra takes its sines from libm here (`libm-force`): the platform's functions differ in the last bit between
        // systems, and calibration compares actions bit for bit (docs/decisions/0019).
        let [x, _, z] = pose.position();
        Self { place: FloorPoint { x, z }, heading: Rotation2::new(pose.heading_rad()) }
    }

    /// Returns the point `ahead_m` in front and `right_m` to the right.
    pub fn offset(&self, ahead_m: f32, right_m: f32) -> FloorPoint {
        (self.place.point() + self.heading * Vector2::new(ahead_m, -right_m)).into()
    }

    /// Returns the rotation from this pose to `other`, radians, -π to π, positive to the left.
    pub fn turn_rad(&self, other: &Self) -> f32 {
        self.heading.angle_to(&other.heading)
    }

    /// Returns true if both poses have nearly the same view.
    pub fn sees_like(&self, other: &Self) -> bool {
        const MOVED_M: f32 = 0.45;
        const TURNED_RAD: f32 = 0.8;
        self.place.distance_m(other.place) < MOVED_M && self.turn_rad(other).abs() < TURNED_RAD
    }

    /// Returns the direction of a point from straight ahead, radians, -π to π, positive to the left.
    pub fn bearing_rad(&self, place: FloorPoint) -> f32 {
        let offset = self.heading.inverse() * (place.point() - self.place.point());
        libm::atan2f(offset.y, offset.x)
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

    /// Returns true if the image shows the surface at a point or behind it, at `height_m` above the body's base; false if it is out of
    /// the image or occluded by more than `slack_m`.
    pub fn reaches(
        &self,
        pose: &Pose2d,
        depth: &DepthImage,
        (place, height_m): (FloorPoint, f32),
        slack_m: f32,
    ) -> bool {
        let (range_m, bearing_rad) = (place.distance_m(pose.place), pose.bearing_rad(place));
        let ahead_m = range_m * libm::cosf(bearing_rad);
        if ahead_m <= 0.0 {
            return false;
        }
        let column = 0.5 * self.width as f32 - self.focal_px * libm::tanf(bearing_rad);
        let row = 0.5 * self.height as f32 + self.focal_px * (self.camera_height_m - height_m) / ahead_m;
        let is_inside = |at: f32, count: usize| at >= 0.0 && at < count as f32;
        is_inside(column, self.width)
            && is_inside(row, self.height)
            && self
                .seen(pose, depth, column as usize, row as usize)
                .is_some_and(|surface| surface.range_m + slack_m >= range_m)
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
        Pose2d::new(&Pose::new([x, 0.5, z], heading_rad))
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
    fn near_surfaces_occlude_points() {
        let view = PinholeCamera::new(&TaskSpec { width: 64, height: 64, ..TaskSpec::default() });
        let depth = DepthImage { width: 64, height: 64, metres: vec![2.0; 64 * 64] };
        let reaches = |x: f32, z: f32, height_m: f32| {
            view.reaches(&pose(0.0, 0.0, 0.0), &depth, (FloorPoint::new(x, z), height_m), 0.3)
        };
        assert!(reaches(0.0, -1.5, 0.8) && reaches(0.0, -2.2, 0.8) && reaches(1.0, -1.5, 0.8));
        assert!(!reaches(0.0, -2.5, 0.8), "it is behind the surface");
        assert!(!reaches(0.0, 1.5, 0.8), "it is behind the camera");
        assert!(!reaches(0.0, -0.5, 0.1), "it is below the image");
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
