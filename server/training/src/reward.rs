//! Rewards.

use crate::options::outside;
use crate::{RewardRule, TrainingError};

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
