use avln_episode::{Modality, Order, Rules};
use avln_geom::{Aabb, Point3, Pose};
use serde::{Deserialize, Serialize};

/// The hidden side of one episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeTruth {
    /// Id of the episode inside its split.
    pub episode: String,
    /// Name of the scene.
    pub scene: String,
    /// Seed of everything that is drawn while the episode runs.
    pub seed: u64,
    /// Where the body starts.
    pub start: Pose,
    /// Whether goals must be completed in order.
    pub order: Order,
    /// The targets, one for each goal of the mission, in its order.
    pub targets: Vec<Target>,
    /// Length of the shortest tour from the start through the success regions, metres.
    pub reference_m: f64,
    /// The same tour as points on the floor, for replays.
    pub reference_path: Vec<Point3<f32>>,
}

/// One goal's target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Instance id in the scene; never 0.
    pub instance: u32,
    /// Category of the instance.
    pub category: String,
    /// How the goal is described to the agent.
    pub modality: Modality,
    /// Box around the instance.
    pub bounds: Aabb,
    /// Where its sound comes from.
    pub source: Point3<f32>,
    /// Height of the floor from which it can be reached, metres.
    pub floor_y_m: f32,
    /// Sampled points of the success region: places of the base, on the navmesh.
    pub region: Vec<Point3<f32>>,
    /// Poses from which the target was seen when the mission was made.
    pub viewpoints: Vec<Pose>,
    /// Shortest walk from the start to the success region, metres.
    pub start_distance_m: f64,
}

impl Target {
    /// How far apart two storeys' floors are at least, metres: places nearer than half of it share a floor.
    const STOREY_M: f32 = 2.0;

    /// Distance from the camera of a body that stands at `base` to the target's box, metres, when `base` lies in
    /// the success region of the rule [`DistanceRule::CameraToBox`](avln_episode::DistanceRule::CameraToBox).
    ///
    /// `sees` tells whether any point of the target is in line of sight from an eye, at some heading, within an
    /// elevation of so many radians.
    pub fn distance_within_region(
        &self,
        base: &Point3<f32>,
        rules: &Rules,
        sees: impl FnOnce(&Point3<f32>, f32) -> bool,
    ) -> Option<f64> {
        let mut eye = *base;
        eye.y += rules.camera_height_m;
        let distance_m = self.bounds.distance_m(&eye);
        let on_its_floor = (base.y - self.floor_y_m).abs() < 0.5 * Self::STOREY_M;
        let within = distance_m <= rules.success_radius_m && on_its_floor && sees(&eye, Rules::HALF_VIEW_RAD);
        within.then_some(f64::from(distance_m))
    }
}
