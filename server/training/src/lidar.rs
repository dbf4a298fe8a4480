//! The sense `lidar`: distances around the camera.

use avln_geom::angle;
use avln_world::{Point3, Pose, SceneAssets, Vector3};

/// Rays around the camera.
pub(crate) const RAYS: usize = 72;

/// Angle between two rays, degrees. Turns by a multiple see the same rays.
pub(crate) const STEP_DEG: u32 = 360 / RAYS as u32;

/// Horizontal rays at camera height. Their directions are fixed for the episode, so that a turn casts no new ray.
pub(crate) struct Lidar {
    height_m: f32,
    reach_m: f32,
    start_heading_rad: f32,
    /// Unit vectors, the first ahead at the start, left positive.
    directions: [Vector3<f32>; RAYS],
    eye: Option<Point3<f32>>,
    /// Distance by direction, metres; 0 without a surface within reach.
    distances_m: [f32; RAYS],
}

impl Lidar {
    /// Creates the sense for an episode that starts with this heading.
    pub(crate) fn new(start_heading_rad: f32, height_m: f32, reach_m: f32) -> Self {
        let direction = |ray: usize| {
            let turned_rad = ((ray as u32 * STEP_DEG) as f32).to_radians();
            let (sin, cos) = angle::sin_cos(start_heading_rad + turned_rad);
            Vector3::new(-sin, 0.0, -cos)
        };
        let directions = std::array::from_fn(direction);
        Self { height_m, reach_m, start_heading_rad, directions, eye: None, distances_m: [0.0; RAYS] }
    }

    /// Looks from a pose; returns true if its position is new.
    pub(crate) fn look(&mut self, assets: &SceneAssets, pose: &Pose) -> bool {
        let eye = pose.position + Vector3::y() * self.height_m;
        if self.eye.replace(eye) == Some(eye) {
            return false;
        }
        for (distance_m, direction) in self.distances_m.iter_mut().zip(&self.directions) {
            *distance_m = assets.cast(&eye, direction, self.reach_m).map_or(0.0, |hit| hit.distance_m);
        }
        true
    }

    /// Returns the distances from straight ahead to the left.
    pub(crate) fn distances_m(&self, heading_rad: f32) -> [f32; RAYS] {
        let turned_deg = (heading_rad - self.start_heading_rad).to_degrees();
        let turned = (turned_deg / STEP_DEG as f32).round() as i32;
        let first = turned.rem_euclid(RAYS as i32) as usize;
        std::array::from_fn(|ray| self.distances_m[(first + ray) % RAYS])
    }

    /// Returns the rays: direction, free length in metres, and whether a surface ends it.
    pub(crate) fn rays(&self) -> impl Iterator<Item = (&Vector3<f32>, f32, bool)> {
        let reach_m = self.reach_m;
        let ray = move |(direction, distance_m): (_, &f32)| match *distance_m {
            0.0 => (direction, reach_m, false),
            distance_m => (direction, distance_m, true),
        };
        self.directions.iter().zip(&self.distances_m).map(ray)
    }
}
