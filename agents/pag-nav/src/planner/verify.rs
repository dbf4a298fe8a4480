use super::Weights;
use serde::Serialize;

/// The stages of the paper, by how far the grounding of a goal has come: no reliable candidate, a plausible one, a
/// confirmed one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Stage {
    Search,
    Ground,
    Verify,
}

impl Stage {
    /// The stage for the best candidate, given whether it has been verified; `None` where there is none.
    pub(crate) fn of(is_verified: Option<bool>) -> Self {
        match is_verified {
            None => Self::Search,
            Some(false) => Self::Ground,
            Some(true) => Self::Verify,
        }
    }
}

/// What visual-semantic verification asks of a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Demand {
    /// Looks from nearby.
    pub(crate) looks: u32,
    /// Share of what can be seen that speaks for the goal, 0 to 1.
    pub(crate) fit: f32,
    /// Certainty of where its sound comes from, 0 to 1.
    pub(crate) certainty: f32,
}

impl Demand {
    /// The demand where any target will do: something stands at a sound that is certain enough. That it is a goal is what its
    /// sound says. It relaxes as [`Demand::after`] does, down to a look.
    pub(crate) fn of_any(sought_steps: u32, remaining_steps: u32, weights: &Weights) -> Self {
        let certainty = patience(sought_steps, remaining_steps, weights) * weights.any_certain;
        Self { looks: 1, fit: 0.0, certainty }
    }

    /// The demand where one target will do, after a source has been sought for `sought_steps`, with `remaining_steps` left in
    /// the episode.
    ///
    /// Perception cannot verify everything that a person could, so the demand relaxes with patience, down to nothing but one
    /// look.
    pub(crate) fn after(sought_steps: u32, remaining_steps: u32, weights: &Weights) -> Self {
        let share = patience(sought_steps, remaining_steps, weights);
        let looks = (share * weights.verify_looks as f32).ceil() as u32;
        Self { looks: looks.max(1), fit: share * weights.verify_fit, certainty: 0.0 }
    }

    /// The same for the last goal, where a Submit that finds nothing ends the episode: the sound must be certain as well, until
    /// the last `hurry_steps`.
    pub(crate) fn of_last(self, remaining_steps: u32, weights: &Weights) -> Self {
        let certainty = if remaining_steps < weights.hurry_steps { 0.0 } else { weights.last_certain };
        Self { certainty, ..self }
    }

    /// Whether a candidate that was looked at `looks` times, fits as well as `fit` and is at a sound of which one is so certain
    /// meets it (V of the paper).
    pub(crate) fn is_met(&self, looks: u32, fit: f32, certainty: f32) -> bool {
        looks >= self.looks && fit >= self.fit && certainty >= self.certainty
    }
}

/// The share of a demand that stands, 1 to 0: less in proportion to the steps beyond `patience_steps` for which the agent has
/// sought a source, nothing after twice the patience, nor in the last `hurry_steps` of the episode.
fn patience(sought_steps: u32, remaining_steps: u32, weights: &Weights) -> f32 {
    if remaining_steps < weights.hurry_steps {
        return 0.0;
    }
    let beyond = sought_steps.saturating_sub(weights.patience_steps) as f32;
    (1.0 - beyond / weights.patience_steps.max(1) as f32).max(0.0)
}

/// The Submit gate of the paper.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gate {
    /// The candidate passed visual-semantic verification: V(o*, g).
    pub(crate) is_verified: bool,
    /// Distance from the body to the candidate, metres: |p - p(o*)|.
    pub(crate) distance_m: f32,
    /// Angle between heading and candidate, radians.
    pub(crate) bearing_rad: f32,
}

impl Gate {
    /// Whether a Submit is allowed within `delta_sub_m` and `theta_sub_rad`.
    pub(crate) fn is_open(&self, delta_sub_m: f32, theta_sub_rad: f32) -> bool {
        self.is_verified && self.distance_m <= delta_sub_m && self.bearing_rad.abs() <= theta_sub_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_follow_the_grounding() {
        assert_eq!(Stage::of(None), Stage::Search);
        assert_eq!(Stage::of(Some(false)), Stage::Ground);
        assert_eq!(Stage::of(Some(true)), Stage::Verify);
    }

    #[test]
    fn the_gate_opens_only_when_all_is_right() {
        for case in 0..8 {
            let right = |bit: u32| case >> bit & 1 == 1;
            let gate = Gate {
                is_verified: right(0),
                distance_m: if right(1) { 1.2 } else { 1.3 },
                bearing_rad: if right(2) { -0.5 } else { -0.7 },
            };
            assert_eq!(gate.is_open(1.2, 0.6), case == 7, "{gate:?}");
        }
    }

    #[test]
    fn the_demand_relaxes_with_patience_and_in_a_hurry() {
        let weights = Weights {
            verify_looks: 3,
            verify_fit: 0.4,
            patience_steps: 100,
            hurry_steps: 150,
            ..Weights::default()
        };
        let asked = |looks, fit| Demand { looks, fit, certainty: 0.0 };
        let demand = |sought, remaining| Demand::after(sought, remaining, &weights);
        assert_eq!(demand(0, 800), asked(3, 0.4));
        assert_eq!(demand(100, 800), asked(3, 0.4));
        let half = demand(150, 800);
        assert!(half.looks == 2 && (half.fit - 0.2).abs() < 1e-6, "{half:?}");
        assert_eq!(demand(500, 800), asked(1, 0.0));
        assert_eq!(demand(0, 149), asked(1, 0.0));
        assert!(demand(0, 800).is_met(3, 0.4, 0.0) && !demand(0, 800).is_met(3, 0.39, 1.0));
        assert!(!demand(0, 800).is_met(2, 0.9, 1.0) && !demand(500, 800).is_met(0, 1.0, 1.0));
    }

    #[test]
    fn any_target_asks_for_certainty_until_patience_ends() {
        let weights =
            Weights { any_certain: 0.8, patience_steps: 100, hurry_steps: 150, ..Weights::default() };
        let certainty = |sought, remaining| Demand::of_any(sought, remaining, &weights).certainty;
        assert_eq!(certainty(100, 800), 0.8);
        assert!((certainty(150, 800) - 0.4).abs() < 1e-6);
        assert_eq!((certainty(200, 800), certainty(0, 149)), (0.0, 0.0));
        let first = Demand::of_any(0, 800, &weights);
        assert!(first.is_met(1, 0.0, 0.8) && !first.is_met(1, 1.0, 0.79) && !first.is_met(0, 1.0, 1.0));
    }

    #[test]
    fn the_last_goal_asks_for_certainty_until_time_runs_out() {
        let weights = Weights { any_certain: 0.0, last_certain: 0.9, hurry_steps: 150, ..Weights::default() };
        let last = |remaining| Demand::of_any(0, remaining, &weights).of_last(remaining, &weights);
        assert!(
            last(150).is_met(1, 0.0, 0.9)
                && !last(150).is_met(1, 1.0, 0.89)
                && !last(150).is_met(0, 1.0, 1.0)
        );
        assert!(last(149).is_met(1, 0.0, 0.0));
    }
}
