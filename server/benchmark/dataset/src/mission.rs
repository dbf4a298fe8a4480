//! Missions and their constraints.

mod draw;

use crate::cue::CueSpec;
use avln_episode::{Mission, Order, Rules};
use avln_geom::{Point3, Pose};
use avln_truth::{EpisodeTruth, Target};
use avln_world::SceneAssets;
pub use draw::{reference_tours, sample_missions};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Episode in a data set, playable in both orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeSpec {
    /// Id inside the split.
    pub id: String,
    /// Name of the scene.
    pub scene: String,
    /// Seed for random draws at run time.
    pub seed: u64,
    /// Start pose.
    pub start: Pose,
    /// Goals in order.
    pub goals: Vec<GoalSpec>,
    /// Shortest tour in goal order.
    pub ordered: ReferenceTour,
    /// Shortest tour in any order.
    pub unordered: ReferenceTour,
}

/// Goal in an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalSpec {
    /// Target.
    pub target: Target,
    /// Cue.
    pub cue: CueSpec,
    /// Other instances in the same category, at most 255.
    #[serde(default)]
    pub distractors: u8,
}

/// Shortest tour from the start through all success regions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceTour {
    /// Length, metres.
    pub length_m: f64,
    /// Actions: moves, turns and one claim per goal. Turns connect the headings closest to the legs.
    #[serde(default)]
    pub steps: u32,
    /// Corners on the floor.
    pub path: Vec<Point3<f32>>,
}

impl EpisodeSpec {
    /// Returns the mission for the agent; renders the pictures.
    pub fn mission(&self, assets: &SceneAssets, rules: &Rules, order: Order) -> Mission {
        let goals = self.goals.iter().map(|goal| goal.cue.present(assets, rules, &goal.target)).collect();
        Mission { order, goals }
    }

    /// Returns the hidden truth.
    pub fn truth(&self, order: Order) -> EpisodeTruth {
        let tour = match order {
            Order::Ordered => &self.ordered,
            Order::Unordered => &self.unordered,
        };
        EpisodeTruth {
            episode: self.id.clone(),
            scene: self.scene.clone(),
            seed: self.seed,
            start: self.start,
            order,
            targets: self.goals.iter().map(|goal| goal.target.clone()).collect(),
            reference_m: tour.length_m,
            reference_path: tour.path.clone(),
        }
    }
}

/// Count and constraints for drawn missions.
#[derive(Clone, Debug, PartialEq)]
pub struct MissionOptions {
    /// Mission count.
    pub episodes: usize,
    /// Goal count, 2 to 4 in the paper, uniform.
    pub goals: RangeInclusive<usize>,
    /// Least walking distance from the start to a success region, metres.
    pub min_start_m: f64,
    /// Least walking distance between two success regions of a mission, metres.
    pub min_separation_m: f64,
    /// Distractor count in the scene.
    pub distractors: RangeInclusive<u8>,
    /// Wanted length; unconstrained if `None`.
    pub steps: Option<StepGoal>,
    /// Random seed.
    pub seed: u64,
}

/// Wanted reference steps in ordered missions.
///
/// Each mission is drawn several times, and the draw closest to a wanted step count is kept. That count is `mean` for
/// the middle goal count, proportional for others, and uniform within `spread`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepGoal {
    /// Mean over all missions, actions.
    pub mean: f64,
    /// Half the distribution width relative to the mean, 0 to 1.
    pub spread: f64,
    /// Draws per mission, at least 1.
    pub draws: u32,
}

impl MissionOptions {
    /// Returns options for 2 to 4 goals, at least 2 m from the start and 1 m apart.
    pub fn new(episodes: usize, seed: u64) -> Self {
        Self {
            episodes,
            goals: 2..=4,
            min_start_m: 2.0,
            min_separation_m: 1.0,
            distractors: 0..=u8::MAX,
            steps: None,
            seed,
        }
    }
}
