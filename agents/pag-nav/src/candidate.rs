//! Candidates: evidence, stages, verification and the Submit gate.

use crate::weights::Weights;
use avln_kit::geometry::FloorPoint;
use avln_kit::hearing::HeardSound;
use serde::Serialize;

/// The evidence for a candidate o and goal g; all parts 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Evidence {
    /// Visual-semantic compatibility with the cue (s_vis of the paper).
    pub(crate) vis: f32,
    /// Support of rooms and neighbouring objects (P_ctx).
    pub(crate) context: f32,
    /// Consistency with the audio memories (s_int).
    pub(crate) sound: f32,
}

impl Evidence {
    /// Returns S_ground(o, g) = lambda_v s_vis + lambda_c P_ctx + lambda_a s_int.
    pub(crate) fn score(&self, weights: &Weights) -> f32 {
        weights.ground_vis * self.vis
            + weights.ground_context * self.context
            + weights.ground_audio * self.sound
    }

    /// Returns the visual share of the score, 0 to 1.
    pub(crate) fn seen(&self, weights: &Weights) -> f32 {
        let silent = Self { sound: 0.0, ..*self };
        silent.score(weights) / (weights.ground_vis + weights.ground_context)
    }
}

/// A source's audio memories at a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SoundSupport {
    pub(crate) off_m: f32,
    pub(crate) certainty: f32,
    pub(crate) loudest_range_m: f32,
    /// Agreement of a source at the position with the loudest positions, 0 to 1.
    pub(crate) explained: f32,
}

impl SoundSupport {
    /// Returns s_int, the support for the source at the position, 0 to 1.
    pub(crate) fn consistency(&self, weights: &Weights) -> f32 {
        let off = self.off_m / weights.sound_scale_m;
        let certain = (self.certainty / weights.certain).min(1.0);
        let loud = (weights.look_range_m / self.loudest_range_m).min(1.0);
        libm::expf(-0.5 * off * off) * certain * loud * self.explained
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Candidate {
    /// Index in the object memory.
    pub(crate) object: usize,
    pub(crate) goal: usize,
    /// The source that supports it most.
    pub(crate) source: usize,
    pub(crate) place: FloorPoint,
    pub(crate) evidence: Evidence,
}

/// Returns o* = argmax S_ground over the plausible candidates.
pub(crate) fn best(candidates: impl Iterator<Item = Candidate>, weights: &Weights) -> Option<Candidate> {
    let score = |candidate: &Candidate| candidate.evidence.score(weights);
    candidates
        .filter(|candidate| score(candidate) >= weights.plausible)
        .max_by(|a, b| score(a).total_cmp(&score(b)))
}

/// The paper's stages, by the best candidate for a goal: none, plausible, or confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Stage {
    Search,
    Ground,
    Verify,
}

impl Stage {
    /// Returns the stage for the best candidate, given the verification; `None` without a candidate.
    pub(crate) fn of(is_verified: Option<bool>) -> Self {
        match is_verified {
            None => Self::Search,
            Some(false) => Self::Ground,
            Some(true) => Self::Verify,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct VerificationDemand {
    /// Near views.
    pub(crate) looks: u32,
    /// Fit with the goal, 0 to 1.
    pub(crate) fit: f32,
    /// Certainty of the source, 0 to 1.
    pub(crate) certainty: f32,
}

impl VerificationDemand {
    /// The demand in unordered missions: one view and a certain source; relaxes like [`Self::after`].
    pub(crate) fn of_any(sought_steps: u32, remaining_steps: u32, weights: &Weights) -> Self {
        let certainty = patience(sought_steps, remaining_steps, weights) * weights.any_certain;
        Self { looks: 1, fit: 0.0, certainty }
    }

    /// The demand in ordered missions; relaxes with patience, since perception cannot verify everything.
    pub(crate) fn after(sought_steps: u32, remaining_steps: u32, weights: &Weights) -> Self {
        let share = patience(sought_steps, remaining_steps, weights);
        let looks = (share * weights.verify_looks as f32).ceil() as u32;
        Self { looks: looks.max(1), fit: share * weights.verify_fit, certainty: 0.0 }
    }

    /// Adds the last goal's demand, whose Submit may end the episode: a certain source, until the last steps.
    pub(crate) fn of_last(self, remaining_steps: u32, weights: &Weights) -> Self {
        let certainty = if remaining_steps < weights.hurry_steps { 0.0 } else { weights.last_certain };
        Self { certainty, ..self }
    }

    /// Returns true if a candidate with these views, fit and certainty meets the demand (V of the paper).
    pub(crate) fn is_met(&self, looks: u32, fit: f32, certainty: f32) -> bool {
        looks >= self.looks && fit >= self.fit && certainty >= self.certainty
    }
}

/// Returns the share of the demand, 1 to 0: falls after `patience_steps`, 0 in the last `hurry_steps`.
fn patience(sought_steps: u32, remaining_steps: u32, weights: &Weights) -> f32 {
    if remaining_steps < weights.hurry_steps {
        return 0.0;
    }
    let beyond = sought_steps.saturating_sub(weights.patience_steps) as f32;
    (1.0 - beyond / weights.patience_steps.max(1) as f32).max(0.0)
}

/// The Submit gate of the paper.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct SubmitGate {
    /// The candidate passed verification: V(o*, g).
    pub(crate) is_verified: bool,
    /// Distance to the candidate, metres: |p - p(o*)|.
    pub(crate) distance_m: f32,
    /// Bearing of the candidate, radians.
    pub(crate) bearing_rad: f32,
}

impl SubmitGate {
    /// Returns true if a Submit is allowed within `delta_sub_m` and `theta_sub_rad`.
    pub(crate) fn is_open(&self, delta_sub_m: f32, theta_sub_rad: f32) -> bool {
        self.is_verified && self.distance_m <= delta_sub_m && self.bearing_rad.abs() <= theta_sub_rad
    }
}

#[derive(Clone, Copy, Default)]
pub(crate) struct Decision {
    /// The last sound, and the source that it is attributed to.
    pub(crate) heard: Option<(usize, HeardSound)>,
    pub(crate) stage: Option<Stage>,
    pub(crate) candidate: Option<Candidate>,
    pub(crate) gate: Option<SubmitGate>,
    /// The chosen frontier and S_search.
    pub(crate) frontier: Option<(FloorPoint, f32)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights() -> Weights {
        Weights {
            ground_vis: 0.5,
            ground_context: 0.1,
            ground_audio: 0.4,
            plausible: 0.4,
            ..Weights::default()
        }
    }

    fn candidate(object: usize, vis: f32, context: f32, sound: f32) -> Candidate {
        let evidence = Evidence { vis, context, sound };
        Candidate { object, goal: 0, source: 0, place: FloorPoint::default(), evidence }
    }

    #[test]
    fn score_is_the_weighted_sum() {
        let evidence = Evidence { vis: 0.6, context: 0.5, sound: 0.8 };
        assert!((evidence.score(&weights()) - (0.3 + 0.05 + 0.32)).abs() < 1e-6);
        assert!((evidence.seen(&weights()) - 0.35 / 0.6).abs() < 1e-6);
    }

    #[test]
    fn sound_supports_nearby_objects() {
        let weights = Weights { sound_scale_m: 0.4, certain: 0.5, look_range_m: 3.0, ..Weights::default() };
        let there = SoundSupport { off_m: 0.0, certainty: 0.9, loudest_range_m: 1.0, explained: 0.8 };
        assert!((there.consistency(&weights) - 0.8).abs() < 1e-6);
        // 0.4 m off, half as certain as is enough, never nearer than twice the range: 0.607 / 4 of that.
        let far = SoundSupport { off_m: 0.4, certainty: 0.25, loudest_range_m: 6.0, ..there };
        assert!((far.consistency(&weights) - 0.8 * 0.6065 / 4.0).abs() < 1e-3);
    }

    #[test]
    fn best_plausible_candidate_is_chosen() {
        // 0.35 + 0.05 + 0.08 = 0.48, 0.1 + 0.05 + 0.36 = 0.51, 0.3 + 0.05 = 0.35.
        let all = [candidate(0, 0.7, 0.5, 0.2), candidate(1, 0.2, 0.5, 0.9), candidate(2, 0.6, 0.5, 0.0)];
        let chosen = |of: &[Candidate]| best(of.iter().copied(), &weights()).map(|c| c.object);
        assert_eq!((chosen(&all), chosen(&all[..1])), (Some(1), Some(0)));
        assert_eq!((chosen(&all[2..]), chosen(&[])), (None, None));
    }

    #[test]
    fn stages_follow_verification() {
        assert_eq!(Stage::of(None), Stage::Search);
        assert_eq!(Stage::of(Some(false)), Stage::Ground);
        assert_eq!(Stage::of(Some(true)), Stage::Verify);
    }

    #[test]
    fn gate_needs_all_conditions() {
        for case in 0..8 {
            let right = |bit: u32| case >> bit & 1 == 1;
            let gate = SubmitGate {
                is_verified: right(0),
                distance_m: if right(1) { 1.2 } else { 1.3 },
                bearing_rad: if right(2) { -0.5 } else { -0.7 },
            };
            assert_eq!(gate.is_open(1.2, 0.6), case == 7, "{gate:?}");
        }
    }

    #[test]
    fn demand_relaxes_with_patience_and_hurry() {
        let weights = Weights {
            verify_looks: 3,
            verify_fit: 0.4,
            patience_steps: 100,
            hurry_steps: 150,
            ..Weights::default()
        };
        let asked = |looks, fit| VerificationDemand { looks, fit, certainty: 0.0 };
        let demand = |sought, remaining| VerificationDemand::after(sought, remaining, &weights);
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
    fn unordered_missions_demand_certainty_until_patience_ends() {
        let weights =
            Weights { any_certain: 0.8, patience_steps: 100, hurry_steps: 150, ..Weights::default() };
        let certainty = |sought, remaining| VerificationDemand::of_any(sought, remaining, &weights).certainty;
        assert_eq!(certainty(100, 800), 0.8);
        assert!((certainty(150, 800) - 0.4).abs() < 1e-6);
        assert_eq!((certainty(200, 800), certainty(0, 149)), (0.0, 0.0));
        let first = VerificationDemand::of_any(0, 800, &weights);
        assert!(first.is_met(1, 0.0, 0.8) && !first.is_met(1, 1.0, 0.79) && !first.is_met(0, 1.0, 1.0));
    }

    #[test]
    fn last_goal_demands_certainty_until_hurry() {
        let weights = Weights { any_certain: 0.0, last_certain: 0.9, hurry_steps: 150, ..Weights::default() };
        let last =
            |remaining| VerificationDemand::of_any(0, remaining, &weights).of_last(remaining, &weights);
        assert!(
            last(150).is_met(1, 0.0, 0.9)
                && !last(150).is_met(1, 1.0, 0.89)
                && !last(150).is_met(0, 1.0, 1.0)
        );
        assert!(last(149).is_met(1, 0.0, 0.0));
    }
}
