//! Pinhole camera and projection.

use avln_geom::{Point3, UnitQuaternion, Vector3, angle};
use avln_scene::InstanceId;

/// A pinhole camera with square pixels, sampled at their centres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Pinhole, world frame.
    pub eye: Point3<f32>,
    /// Orientation: -Z is forward, +Y up, +X right. [`angle::about_up`] returns it for a level camera.
    pub world_from_camera: UnitQuaternion<f32>,
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Horizontal angle of view, radians, in (0, pi).
    pub hfov_rad: f32,
    /// Depth range, metres; colour is unlimited.
    pub depth_max_m: f32,
}

/// A camera image, row-major from the top-left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraImage {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `height × width × 3` bytes, sRGB.
    pub rgb: Vec<u8>,
    /// `height × width` planar depths, metres; 0 without a hit in range.
    pub depth: Vec<f32>,
    /// `height × width` instances; hidden from agents. [`InstanceId::NONE`] for no instance.
    pub instances: Vec<InstanceId>,
}

/// The camera frame: x right and y down, in pixels at one metre of depth, z forward in metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens {
    pub(crate) eye: Point3<f32>,
    pub(crate) right: Vector3<f32>,
    pub(crate) down: Vector3<f32>,
    pub(crate) forward: Vector3<f32>,
    /// Half the image size, pixels.
    pub(crate) half: [f32; 2],
    /// Image centre, relative to the first pixel's centre.
    pub(crate) middle: [f32; 2],
}

impl Camera {
    pub(crate) fn lens(&self) -> Lens {
        // The tangent of half the angle stays finite and positive.
        const NARROWEST_RAD: f32 = 1e-3;
        let half_angle =
            (0.5 * self.hfov_rad).clamp(NARROWEST_RAD, 0.5 * std::f32::consts::PI - NARROWEST_RAD);
        let (sin, cos) = angle::sin_cos(half_angle);
        let half = [0.5 * self.width as f32, 0.5 * self.height as f32];
        let focal_px = half[0] * cos / sin;
        let axes = self.world_from_camera.to_rotation_matrix();
        let axis = |column: usize| Vector3::from(axes.matrix().column(column));
        Lens {
            eye: self.eye,
            right: axis(0) * focal_px,
            down: -axis(1) * focal_px,
            forward: -axis(2),
            half,
            middle: half.map(|half| half - 0.5),
        }
    }
}

impl Lens {
    /// Converts a world point to the camera frame.
    #[inline]
    pub(crate) fn camera_from_world(&self, point: &Point3<f32>) -> Vector3<f32> {
        let offset = point - self.eye;
        Vector3::new(self.right.dot(&offset), self.down.dot(&offset), self.forward.dot(&offset))
    }
}
