use avln_geom::{Point3, UnitQuaternion, Vector3, angle};
use avln_scene::{InstanceId, Scene};

/// A pinhole; pixels are square and looked at through their centres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The pinhole, world frame.
    pub eye: Point3<f32>,
    /// The camera's frame in the world: it looks along its -Z, +Y is up in the picture, +X to the right.
    /// [`angle::about_up`] gives that of a level camera.
    pub world_from_camera: UnitQuaternion<f32>,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Angle between the left and the right border, radians, in (0, pi).
    pub hfov_rad: f32,
    /// Depth is reported up to here, metres; colour has no such limit.
    pub depth_max_m: f32,
}

/// What a camera sees, row-major from the top-left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `height × width × 3` bytes, sRGB.
    pub rgb: Vec<u8>,
    /// `height × width` distances along the viewing direction, metres; 0 where there is nothing within reach.
    pub depth: Vec<f32>,
    /// `height × width` instances; hidden from agents. [`InstanceId::NONE`] where there is none.
    pub instances: Vec<InstanceId>,
}

/// The camera frame: x to the right and y down, both in pixels at one metre of depth, z ahead in metres.
///
/// The ray through the point (x, y) of the picture, counted in pixels from its middle, is (x, y, 1) in this frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens {
    eye: Point3<f32>,
    right: Vector3<f32>,
    down: Vector3<f32>,
    forward: Vector3<f32>,
    focal_px: f32,
    /// Half of the picture, pixels.
    pub(crate) half: [f32; 2],
}

impl Camera {
    pub(crate) fn lens(&self) -> Lens {
        /// Keeps the tangent of half the angle finite and above 0.
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
            focal_px,
            half,
        }
    }
}

impl Lens {
    /// A world point in the camera frame.
    #[inline]
    pub(crate) fn camera_from_world(&self, point: &Point3<f32>) -> Vector3<f32> {
        let offset = point - self.eye;
        Vector3::new(self.right.dot(&offset), self.down.dot(&offset), self.forward.dot(&offset))
    }

    /// The corners of a triangle in the camera frame.
    #[inline]
    pub(crate) fn corners(&self, scene: &Scene, triangle: u32) -> [Vector3<f32>; 3] {
        let place = |corner: u32| self.camera_from_world(&scene.mesh.positions[corner as usize]);
        let [a, b, c] = scene.mesh.triangles[triangle as usize];
        [place(a), place(b), place(c)]
    }

    /// The pinhole, world frame.
    pub(crate) fn eye(&self) -> Point3<f32> {
        self.eye
    }

    /// Pixels that a metre covers at a metre of depth.
    pub(crate) fn focal_px(&self) -> f32 {
        self.focal_px
    }
}
