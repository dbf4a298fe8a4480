use avln_episode::{Modality, Order};
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
    pub instance: u16,
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
