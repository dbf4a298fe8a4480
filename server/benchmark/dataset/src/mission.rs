//! Missions: what one episode asks for, and how missions are drawn among the instances of a house.

mod choose;
mod draw;
mod options;

use crate::cue::CueSpec;
use avln_episode::{Mission, Order, Rules};
use avln_geom::{Point3, Pose};
use avln_truth::{EpisodeTruth, Target};
use avln_world::SceneAssets;
pub use draw::sample_missions;
pub use options::{MissionOptions, StepGoal};
use serde::{Deserialize, Serialize};

/// One episode of the data set: it can be played in both orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeSpec {
    /// Id inside the split.
    pub id: String,
    /// Name of the scene.
    pub scene: String,
    /// Seed of everything that is drawn while the episode runs.
    pub seed: u64,
    /// Where the body starts.
    pub start: Pose,
    /// The goals, in their order.
    pub goals: Vec<GoalSpec>,
    /// Shortest tour in the order of the goals.
    pub ordered: ReferenceTour,
    /// Shortest tour in any order.
    pub unordered: ReferenceTour,
}

/// One goal of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalSpec {
    /// What must be found.
    pub target: Target,
    /// How the agent is told.
    pub cue: CueSpec,
    /// Other instances of the target's category in the scene, 255 for more.
    #[serde(default)]
    pub distractors: u8,
}

/// The shortest tour from the start through the success regions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceTour {
    /// Its length, metres.
    pub length_m: f64,
    /// Actions that it takes: moves, turns and one Submit or Stop a goal; turns are counted between the headings that
    /// lie nearest to its legs.
    #[serde(default)]
    pub steps: u32,
    /// Its corners on the floor.
    pub path: Vec<Point3<f32>>,
}

impl EpisodeSpec {
    /// What the agent is told; pictures are rendered now.
    pub fn mission(&self, assets: &SceneAssets, rules: &Rules, order: Order) -> Mission {
        let goals = self.goals.iter().map(|goal| goal.cue.present(assets, rules, &goal.target)).collect();
        Mission { order, goals }
    }

    /// What the agent is not told.
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
