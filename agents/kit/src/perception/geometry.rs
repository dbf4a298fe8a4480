use avln_client::{DepthImage, Pose, TaskSpec};

/// A place on the floor plan, metres: `x` right and `z` back of the frame of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Metres, as in poses.
    pub x: f32,
    /// Metres, as in poses.
    pub z: f32,
}

impl Place {
    /// The place at these coordinates, metres.
    pub fn new(x: f32, z: f32) -> Self {
        Self { x, z }
    }

    /// How far it is to another place, metres.
    pub fn distance_m(self, other: Self) -> f32 {
        let (dx, dz) = (self.x - other.x, self.z - other.z);
        (dx * dx + dz * dz).sqrt()
    }

    /// The place `share` (0 to 1) of the way to `other`.
    pub fn toward(self, other: Self, share: f32) -> Self {
        Self { x: self.x + (other.x - self.x) * share, z: self.z + (other.z - self.z) * share }
    }
}

/// Where the body stands and looks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stand {
    /// Where the base of the body is.
    pub place: Place,
    sin: f32,
    cos: f32,
}

impl Stand {
    /// Where a body of this pose stands.
    pub fn new(pose: &Pose) -> Self {
        let (sin, cos) = pose.heading_rad.sin_cos();
        let [x, _, z] = pose.position;
        Self { place: Place { x, z }, sin, cos }
    }

    /// The place `ahead_m` in front and `right_m` to the right.
    pub fn offset(&self, ahead_m: f32, right_m: f32) -> Place {
        Place {
            x: self.place.x - self.sin * ahead_m + self.cos * right_m,
            z: self.place.z - self.cos * ahead_m - self.sin * right_m,
        }
    }

    /// How far `other` is turned against this, radians, -π to π, positive to the left.
    pub fn turn_rad(&self, other: &Self) -> f32 {
        let (sin, cos) =
            (other.sin * self.cos - other.cos * self.sin, other.cos * self.cos + other.sin * self.sin);
        sin.atan2(cos)
    }

    /// Whether one sees about the same from both.
    pub fn sees_like(&self, other: &Self) -> bool {
        const MOVED_M: f32 = 0.45;
        const TURNED_RAD: f32 = 0.8;
        self.place.distance_m(other.place) < MOVED_M && self.turn_rad(other).abs() < TURNED_RAD
    }

    /// Direction of `place` from straight ahead, radians, -π to π, positive to the left.
    pub fn bearing_rad(&self, place: Place) -> f32 {
        let (dx, dz) = (place.x - self.place.x, place.z - self.place.z);
        let ahead = -self.sin * dx - self.cos * dz;
        let left = -self.cos * dx + self.sin * dz;
        left.atan2(ahead)
    }
}

/// The pinhole camera of a run.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    focal_px: f32,
    camera_height_m: f32,
    depth_max_m: f32,
}

/// A surface seen in one pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Where on the floor plan.
    pub place: Place,
    /// Height above the base of the body, metres.
    pub height_m: f32,
    /// Distance on the floor plan from the camera, metres.
    pub range_m: f32,
}

impl View {
    /// The camera that a task tells of.
    pub fn new(task: &TaskSpec) -> Self {
        let focal_px = 0.5 * task.width as f32 / (0.5 * task.hfov_rad).tan();
        Self {
            width: task.width as usize,
            height: task.height as usize,
            focal_px,
            camera_height_m: task.camera_height_m,
            depth_max_m: task.depth_max_m,
        }
    }

    /// Where the sight line of a column lies at `range_m` on the floor plan.
    pub fn along(&self, stand: &Stand, column: usize, range_m: f32) -> Place {
        let tan = self.tan_right(column);
        let ahead_m = range_m / (1.0 + tan * tan).sqrt();
        stand.offset(ahead_m, tan * ahead_m)
    }

    /// The surface in pixel (`column`, `row`); `None` where nothing was hit or the picture is of another size.
    pub fn seen(&self, stand: &Stand, depth: &DepthImage, column: usize, row: usize) -> Option<Seen> {
        let depth_m = *depth.metres.get(row * self.width + column)?;
        if !(depth_m > 0.0 && depth_m <= self.depth_max_m) {
            return None;
        }
        let right_m = self.tan_right(column) * depth_m;
        let up_m = (0.5 * self.height as f32 - row as f32 - 0.5) / self.focal_px * depth_m;
        Some(Seen {
            place: stand.offset(depth_m, right_m),
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

    fn stand(x: f32, z: f32, heading_rad: f32) -> Stand {
        Stand::new(&Pose { position: [x, 0.5, z], heading_rad })
    }

    #[test]
    fn a_pixel_is_lifted_by_hand() {
        let view = View::new(&TaskSpec { width: 4, height: 4, ..TaskSpec::default() });
        let depth = DepthImage { width: 4, height: 4, metres: vec![2.0; 16] };
        // Focal length 2 px: the last column lies 0.75 of the depth to the right, the top row 0.75 above the eye.
        let seen = view.seen(&stand(1.0, -1.0, 0.0), &depth, 3, 0).unwrap();
        assert!(seen.place.distance_m(Place::new(2.5, -3.0)) < 1e-5);
        assert!((seen.height_m - 2.5).abs() < 1e-5 && (seen.range_m - 2.5).abs() < 1e-5);
        // Turned left by a quarter, ahead is -x and right is -z.
        let seen = view.seen(&stand(1.0, -1.0, FRAC_PI_2), &depth, 3, 0).unwrap();
        assert!(seen.place.distance_m(Place::new(-1.0, -2.5)) < 1e-5);
        assert!(view.along(&stand(1.0, -1.0, FRAC_PI_2), 3, 2.5).distance_m(seen.place) < 1e-5);
    }

    #[test]
    fn nothing_hit_is_nothing_seen() {
        let view = View::new(&TaskSpec { width: 2, height: 2, ..TaskSpec::default() });
        let depth = DepthImage { width: 2, height: 2, metres: vec![0.0, f32::NAN, 99.0] };
        for row in 0..2 {
            for column in 0..2 {
                assert!(view.seen(&Stand::default(), &depth, column, row).is_none());
            }
        }
    }

    #[test]
    fn bearings_are_positive_to_the_left() {
        let here = stand(0.0, 0.0, 0.0);
        assert!((here.bearing_rad(Place::new(-1.0, 0.0)) - FRAC_PI_2).abs() < 1e-6);
        assert!(stand(0.0, 0.0, FRAC_PI_2).bearing_rad(Place::new(-1.0, 0.0)).abs() < 1e-6);
        assert!((here.bearing_rad(Place::new(1.0, -1.0)) + FRAC_PI_2 / 2.0).abs() < 1e-6);
        assert!((stand(0.0, 0.0, 3.0).turn_rad(&stand(1.0, 0.0, -3.0)) - 0.283_185).abs() < 1e-5);
    }
}
