//! Options of training environments: rules, senses, rewards and curricula.

use crate::{CheapSenses, Teacher, TrainingError};
use avln_episode::{Order, Rules, Sensors};
use avln_world::Detail;

/// Settings of all environments in a vector.
#[derive(Clone, Debug)]
pub struct EnvOptions {
    /// Rules of the episodes. Training may shorten the horizon; benchmark phases never use these rules.
    pub rules: Rules,
    /// Sensors of the benchmark. With `audio`, every step simulates the sound.
    pub sensors: Sensors,
    /// Detail of camera images.
    pub detail: Detail,
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
            detail: Detail::Exact,
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

/// Coefficients of the reward `progress`:
///
/// `slack + per_m · (distance before - distance after) + submit or stop + found · goals found now + complete, if a Stop completes
/// the mission`. The distance is that of the routed goal; progress is 0 in a step that changes this goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProgressReward {
    /// Every step.
    pub slack: f64,
    /// Per metre of walking distance.
    pub per_m: f64,
    /// Submit, right or wrong.
    pub submit: f64,
    /// Stop.
    pub stop: f64,
    /// Goal found by a Submit or Stop.
    pub found: f64,
    /// Stop after which all goals are found.
    pub complete: f64,
}

impl ProgressReward {
    /// The values in the released code of the paper's authors.
    pub const AUTHORS: Self =
        Self { slack: -0.01, per_m: 1.0, submit: -2.0, stop: -5.0, found: 10.0, complete: 20.0 };

    pub(crate) fn check(&self) -> Result<(), TrainingError> {
        let Self { slack, per_m, submit, stop, found, complete } = *self;
        let values = [slack, per_m, submit, stop, found, complete];
        if values.iter().all(|value| value.is_finite()) {
            return Ok(());
        }
        Err(outside("reward", format!("{self:?}"), "use finite coefficients"))
    }
}

/// Facts about a step for its reward.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RewardFacts {
    pub(crate) progress_m: f64,
    pub(crate) is_submit: bool,
    pub(crate) is_stop: bool,
    pub(crate) found: u32,
    pub(crate) is_complete: bool,
}

impl RewardFacts {
    pub(crate) fn reward(&self, rule: RewardRule) -> f64 {
        let when = |happened: bool, value: f64| if happened { value } else { 0.0 };
        match rule {
            RewardRule::None => 0.0,
            RewardRule::Sparse => f64::from(self.found),
            RewardRule::Progress(weights) => {
                weights.slack
                    + weights.per_m * self.progress_m
                    + when(self.is_submit, weights.submit)
                    + when(self.is_stop, weights.stop)
                    + weights.found * f64::from(self.found)
                    + when(self.is_stop && self.is_complete, weights.complete)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROGRESS: RewardRule = RewardRule::Progress(ProgressReward::AUTHORS);

    #[test]
    fn progress_adds_all_terms() {
        let walk = RewardFacts { progress_m: 0.25, ..RewardFacts::default() };
        assert!((walk.reward(PROGRESS) - 0.24).abs() < 1e-12);
        let wrong = RewardFacts { is_submit: true, ..RewardFacts::default() };
        assert!((wrong.reward(PROGRESS) + 2.01).abs() < 1e-12);
        let end = RewardFacts { is_stop: true, found: 1, is_complete: true, ..RewardFacts::default() };
        assert!((end.reward(PROGRESS) - 24.99).abs() < 1e-12);
        assert_eq!((end.reward(RewardRule::Sparse), end.reward(RewardRule::None)), (1.0, 0.0));
    }

    #[test]
    fn coefficients_weigh_each_term() {
        let weights =
            ProgressReward { slack: 1.0, per_m: 8.0, submit: 16.0, stop: 32.0, found: 64.0, complete: 128.0 };
        let facts =
            RewardFacts { progress_m: 0.5, is_submit: false, is_stop: true, found: 2, is_complete: true };
        assert_eq!(facts.reward(RewardRule::Progress(weights)), 1.0 + 4.0 + 32.0 + 128.0 + 128.0);
        assert!(weights.check().is_ok());
        let error = ProgressReward { found: f64::NAN, ..weights }.check().expect_err("not a number");
        assert!(error.to_string().contains("use finite coefficients"), "{error}");
    }
}
