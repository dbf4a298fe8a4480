//! Hidden episode types: targets, sound sources, success regions, reference paths, and the sealed record.
//!
//! Entry points: [`EpisodeTruth`] and [`Record`].
//!
//! Crates reachable by agents or visitors (`avln-grpc`, `avln-web`) never import or re-export this crate.

use avln_episode::{Action, DistanceRule, EndReason, Modality, Order, Rules};
use avln_geom::{Aabb, Point3, Pose};
use serde::{Deserialize, Serialize};

/// An episode's hidden part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeTruth {
    /// Episode id inside the split.
    pub episode: String,
    /// Scene name.
    pub scene: String,
    /// Seed for random draws at run time.
    pub seed: u64,
    /// Start pose.
    pub start: Pose,
    /// Goal order.
    pub order: Order,
    /// Targets in goal order.
    pub targets: Vec<Target>,
    /// Sounding non-goals, by the rules' number.
    // Not serialised by default, so that truths without distractors stay the same.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub distractor_sources: Vec<DistractorSource>,
    /// Shortest tour length through all success regions, metres.
    pub reference_m: f64,
    /// This tour's corners on the floor, for replays.
    pub reference_path: Vec<Point3<f32>>,
}

/// A sounding instance that is no goal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistractorSource {
    /// Instance id in the scene; never 0.
    pub instance: u32,
    /// Instance category.
    pub category: String,
    /// Sound source position.
    pub source: Point3<f32>,
}

/// A goal's target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Instance id in the scene; never 0.
    pub instance: u32,
    /// Instance category.
    pub category: String,
    /// Cue kind.
    pub modality: Modality,
    /// Bounding box.
    pub bounds: Aabb,
    /// Sound source position.
    pub source: Point3<f32>,
    /// Floor height at the target, metres.
    pub floor_y_m: f32,
    /// Sampled base positions in the success region, on the navmesh.
    pub region: Vec<Point3<f32>>,
    /// Poses from which the survey saw the target.
    pub viewpoints: Vec<Pose>,
    /// Walking distance from the start to the success region, metres.
    pub start_distance_m: f64,
}

impl Target {
    /// Least storey height, metres: points within half this height share a floor.
    const STOREY_M: f32 = 2.0;

    /// Returns the distance from the camera at `base` to the target, metres, if `base` is in the success region: to the mesh
    /// under [`DistanceRule::CameraToMesh`], otherwise to the box.
    ///
    /// `to_mesh_m(eye)` measures the distance to the target's mesh. `sees(eye, half_view_rad)` checks whether the target is
    /// visible at some heading, within this elevation.
    pub fn distance_within_region(
        &self,
        base: &Point3<f32>,
        rules: &Rules,
        to_mesh_m: impl FnOnce(&Point3<f32>) -> f32,
        sees: impl FnOnce(&Point3<f32>, f32) -> bool,
    ) -> Option<f64> {
        let mut eye = *base;
        eye.y += rules.camera_height_m;
        let distance_m = match rules.success_distance {
            DistanceRule::CameraToMesh => to_mesh_m(&eye),
            DistanceRule::CameraToBox | DistanceRule::BaseToViewpoint => self.bounds.distance_m(&eye),
        };
        let on_its_floor = (base.y - self.floor_y_m).abs() < 0.5 * Self::STOREY_M;
        // The line of sight casts rays, so it is tested last.
        let within = distance_m <= rules.success_radius_m && on_its_floor && sees(&eye, Rules::HALF_VIEW_RAD);
        within.then_some(f64::from(distance_m))
    }
}

/// Facts from a finished episode, recorded by the referee. Scoring uses only these and the truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Rule set name.
    pub rules: String,
    /// Base pose before the first action.
    pub start: Pose,
    /// Facts per action, in order.
    pub steps: Vec<StepFacts>,
    /// Facts per Submit or Stop, in order.
    pub submits: Vec<SubmitFacts>,
    /// Per goal: whether the start was in the success region.
    pub in_region_at_start: Vec<bool>,
    /// Per goal: walking distance from the last pose to the success region, metres; `None` if unreachable.
    pub final_distance_m: Vec<Option<f64>>,
    /// End reason.
    pub end: EndReason,
}

/// Facts about an action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepFacts {
    /// The action.
    pub action: Action,
    /// Base pose afterwards, world frame.
    pub pose: Pose,
    /// True if an obstacle blocked the body.
    pub collided: bool,
    /// Bit i: the body is in goal i's success region.
    pub in_region: u8,
    /// Sounding source: a goal, or the goal count plus a distractor's index; `None` for silence.
    pub sounding: Option<u8>,
    /// State hash afterwards.
    pub state_hash: u64,
}

/// Facts about one Submit or Stop.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubmitFacts {
    /// Step number from 1.
    pub step: u32,
    /// Completed goal.
    pub completed: Option<u8>,
    /// Goal made impossible by the rule `skips_goal`.
    pub skipped: Option<u8>,
    /// Goal that would match if another instance in its category were the target.
    #[serde(default)]
    pub wrong_instance: Option<u8>,
}

impl Record {
    /// Returns the completion step per goal.
    pub fn found_at(&self, goal_count: usize) -> Vec<Option<u32>> {
        // The first completion counts; rule sets never reopen a goal.
        let step_of = |goal| self.submits.iter().find(|s| s.completed == Some(goal)).map(|s| s.step);
        (0..goal_count as u8).map(step_of).collect()
    }
}
