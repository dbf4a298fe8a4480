//! Options of training environments.

use crate::{CheapSenses, ProgressReward, Teacher, TrainingError};
use avln_episode::{Order, Rules, Sensors};

/// Settings of all environments in a vector.
#[derive(Clone, Debug)]
pub struct EnvOptions {
    /// Rules of the episodes. Training may shorten the horizon; benchmark phases never use these rules.
    pub rules: Rules,
    /// Sensors of the benchmark. With `audio`, every step simulates the sound.
    pub sensors: Sensors,
    /// Senses without images and waveforms.
    pub cheap: CheapSenses,
    /// Side of goal images in the observation, pixels.
    pub goal_side: u32,
    /// True to add the goal texts and images to the observation.
    pub goal_cues: bool,
    /// Reward.
    pub reward: RewardRule,
    /// True to add privileged information about targets and the teacher to the row, as in [`Layout`](crate::Layout).
    pub privileged: bool,
    /// Teacher.
    pub teacher: Teacher,
    /// True to add images with instance and category numbers. Without colour and depth, they cost a rendering.
    pub ids: bool,
    /// True to add a map of the storey.
    pub top_down: bool,
    /// Submits beyond those of the rules, 0 to 100.
    pub added_submits: u32,
    /// Action after an episode's end.
    pub autoreset: AutoReset,
}

impl EnvOptions {
    /// Returns the paper's rules with all sensors at `side × side` pixels and the reward `progress`.
    pub fn paper(side: u32) -> Self {
        Self {
            rules: Rules::paper(),
            sensors: Sensors::all(side, side),
            cheap: CheapSenses::default(),
            goal_side: 64,
            goal_cues: true,
            reward: RewardRule::Progress(ProgressReward::AUTHORS),
            privileged: false,
            teacher: Teacher::Path,
            ids: false,
            top_down: false,
            added_submits: 0,
            autoreset: AutoReset::NextStep,
        }
    }

    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        within("max_steps", self.rules.max_steps, 1, 100_000)?;
        within("goal_side", self.goal_side, 8, 512)?;
        self.cheap.check(self)?;
        within("added_submits", self.added_submits, 0, 100)?;
        if let RewardRule::Progress(weights) = self.reward {
            weights.check()?;
        }
        self.sensors.validate().map_err(avln_referee::RefereeError::from)?;
        Ok(())
    }
}

/// Reward of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RewardRule {
    /// Geodesic progress towards the routed goal, right and wrong claims, and slack.
    Progress(ProgressReward),
    /// 1 for a found goal, otherwise 0.
    Sparse,
    /// Always 0, for rewards computed by the caller.
    None,
}

/// Behaviour of a vector at an episode's end, as in Gymnasium 1.x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AutoReset {
    /// The next step ignores its action and returns the first observation of the next episode.
    NextStep,
    /// The last step returns the first observation of the next episode; the final observation has a row of its own.
    SameStep,
    /// The caller resets.
    Disabled,
}

/// Goal order of the episodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Goals {
    /// Always the given order.
    Fixed(Order),
    /// Drawn per episode.
    Drawn,
}

/// Limits for drawn missions.
#[derive(Clone, Debug, PartialEq)]
pub struct Curriculum {
    /// Fewest and most goals, 1 to 4.
    pub goals: [usize; 2],
    /// Smallest and largest walking distance from the start to every success region, metres.
    pub distance_m: [f64; 2],
    /// Fewest and most rooms per house of a recipe; the recipe's numbers if `None`.
    pub rooms: Option<[u8; 2]>,
    /// Fewest and most storeys per house of a recipe; the recipe's numbers if `None`.
    pub storeys: Option<[u8; 2]>,
}

impl Default for Curriculum {
    /// The paper's missions: 2 to 4 goals, at least 3 m from the start.
    fn default() -> Self {
        Self { goals: [2, 4], distance_m: [3.0, 1000.0], rooms: None, storeys: None }
    }
}

impl Curriculum {
    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        let [fewest, most] = self.goals;
        if !(1 <= fewest && fewest <= most && most <= 4) {
            return Err(outside(
                "goals",
                format!("[{fewest}, {most}]"),
                "use [fewest, most] between 1 and 4",
            ));
        }
        let [nearest_m, farthest_m] = self.distance_m;
        if !(0.0 <= nearest_m && nearest_m < farthest_m && farthest_m <= 1000.0) {
            let value = format!("[{nearest_m}, {farthest_m}]");
            return Err(outside("distance_m", value, "use [nearest, farthest] between 0 and 1000"));
        }
        Ok(())
    }
}

pub(crate) fn outside(option: &'static str, value: String, limits: &str) -> TrainingError {
    TrainingError::Option { option, value, limits: limits.to_owned() }
}

pub(crate) fn within(option: &'static str, value: u32, least: u32, most: u32) -> Result<(), TrainingError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(outside(option, value.to_string(), &format!("{least} to {most} are possible")))
}
