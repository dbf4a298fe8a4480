//! Missions: what one episode asks for, and how missions are drawn among the instances of a house.

mod draw;

use crate::cue::CueSpec;
use avln_episode::{Mission, Order, Rules};
use avln_geom::{Point3, Pose};
use avln_truth::{EpisodeTruth, Target};
use avln_world::SceneAssets;
pub use draw::{reference_tours, sample_missions};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

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

/// How many missions to draw in a scene, and what makes one worth playing.
#[derive(Clone, Debug, PartialEq)]
pub struct MissionOptions {
    /// Missions to draw.
    pub episodes: usize,
    /// Goals of a mission, 2 to 4 in the paper; every number is as likely as the others.
    pub goals: RangeInclusive<usize>,
    /// Least walking distance from the start to a success region, metres.
    pub min_start_m: f64,
    /// Least walking distance between two success regions of a mission, metres.
    pub min_separation_m: f64,
    /// How many other instances of its category a target may have in the scene.
    pub distractors: RangeInclusive<u8>,
    /// How long missions should be; as they come when there is none.
    pub steps: Option<StepGoal>,
    /// Seed of everything that is drawn.
    pub seed: u64,
}

/// How many reference steps missions should have, ordered.
///
/// Each mission is drawn a few times, and the draw nearest to a wanted number is kept. The wanted number is `mean` for
/// a mission of the middle number of goals, in proportion for others, spread evenly by `spread` to both sides.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepGoal {
    /// Wanted mean over all missions, actions.
    pub mean: f64,
    /// Half the width of the wanted distribution as a share of the mean, 0 to 1.
    pub spread: f64,
    /// Draws that are compared, at least 1.
    pub draws: u32,
}

impl MissionOptions {
    /// `episodes` missions of 2 to 4 goals, at least 2 m from the start and 1 m from each other.
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
