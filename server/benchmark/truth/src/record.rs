use avln_episode::{Action, EndReason, Pose};
use serde::{Deserialize, Serialize};

/// The facts of one finished episode, as the referee saw them. Scores are computed from these alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Name of the rules that were in force.
    pub rules: String,
    /// Pose of the base before the first action.
    pub start: Pose,
    /// One entry for each action, in order.
    pub steps: Vec<StepFacts>,
    /// One entry for each Submit, and for a Stop, in order.
    pub submits: Vec<SubmitFacts>,
    /// For each goal: whether the body stood in its success region before the first action.
    pub in_region_at_start: Vec<bool>,
    /// For each goal: walking distance from the last pose to its success region, metres; `None` when unreachable.
    pub final_distance_m: Vec<Option<f64>>,
    /// Why the episode ended.
    pub end: EndReason,
}

/// What one action did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepFacts {
    /// The action.
    pub action: Action,
    /// Pose of the base afterwards, in the world.
    pub pose: Pose,
    /// Whether the body was held back by an obstacle.
    pub collided: bool,
    /// Bit i is set when the body now stands in the success region of goal i.
    pub in_region: u8,
    /// Goal whose target sounded during the step; `None` in silence.
    pub sounding: Option<u8>,
    /// Hash of the simulation's state afterwards.
    pub state_hash: u64,
}

/// What one Submit, or a Stop, was worth.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubmitFacts {
    /// Number of the step, counted from 1.
    pub step: u32,
    /// The goal that it completed.
    pub completed: Option<u8>,
    /// The goal that it made impossible (rule `skips_goal`).
    pub skipped: Option<u8>,
    /// The goal that it would have completed if another instance of the target's category were the target.
    #[serde(default)]
    pub wrong_instance: Option<u8>,
}

impl Record {
    /// The step at which each goal was completed, for `goal_count` goals.
    pub fn found_at(&self, goal_count: usize) -> Vec<Option<u32>> {
        let step_of = |goal| self.submits.iter().find(|s| s.completed == Some(goal)).map(|s| s.step);
        (0..goal_count as u8).map(step_of).collect()
    }
}
