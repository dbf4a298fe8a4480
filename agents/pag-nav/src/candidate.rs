//! Candidates: evidence, grounding score and stages.

use crate::verify::SubmitGate;
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
    /// Consistency with the audio-intensity memory (s_int).
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

/// A source's audio memories at a position, for the switch `source_positions`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SoundSupport {
    pub(crate) off_m: f32,
    pub(crate) certainty: f32,
    pub(crate) loudest_range_m: f32,
    /// Agreement of a source at the position with the loudest positions, 0 to 1.
    pub(crate) explained: f32,
}

impl SoundSupport {
    /// Returns the support for the source at the position, 0 to 1.
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
    /// The estimated source that supports it most.
    pub(crate) source: Option<usize>,
    /// p(o): the point of the object nearest to the source, otherwise to the body.
    pub(crate) place: FloorPoint,
    pub(crate) evidence: Evidence,
}

impl Candidate {
    /// Returns true for the same object and goal.
    pub(crate) fn is_same(&self, object: usize, goal: usize) -> bool {
        (self.object, self.goal) == (object, goal)
    }
}

/// Returns o* = argmax S_ground over the plausible candidates. The current choice `kept` has an advantage of `loyalty`.
pub(crate) fn best(
    candidates: impl Iterator<Item = Candidate>,
    kept: Option<(usize, usize)>,
    weights: &Weights,
) -> Option<Candidate> {
    let score = |candidate: &Candidate| candidate.evidence.score(weights);
    let ranked = |candidate: &Candidate| {
        let is_kept = kept.is_some_and(|(object, goal)| candidate.is_same(object, goal));
        score(candidate) + if is_kept { weights.loyalty } else { 0.0 }
    };
    candidates
        .filter(|candidate| score(candidate) >= weights.plausible)
        .max_by(|a, b| ranked(a).total_cmp(&ranked(b)))
}

/// The paper's stages, by the best candidate for a goal: none, plausible, or confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Stage {
    Search,
    Ground,
    Verify,
}

/// The last decision, for traces.
#[derive(Clone, Copy, Default)]
pub(crate) struct Decision {
    /// The last sound, and the counted source.
    pub(crate) heard: Option<(Option<usize>, HeardSound)>,
    pub(crate) stage: Option<Stage>,
    pub(crate) candidate: Option<Candidate>,
    pub(crate) gate: Option<SubmitGate>,
    /// The chosen frontier and S_search.
    pub(crate) frontier: Option<(FloorPoint, f32)>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::Preset;

    fn weights() -> Weights {
        Weights {
            ground_vis: 0.5,
            ground_context: 0.1,
            ground_audio: 0.4,
            plausible: 0.4,
            loyalty: 0.1,
            ..Weights::default()
        }
    }

    fn candidate(object: usize, vis: f32, context: f32, sound: f32) -> Candidate {
        let evidence = Evidence { vis, context, sound };
        Candidate { object, goal: 0, source: None, place: FloorPoint::default(), evidence }
    }

    #[test]
    fn score_is_the_weighted_sum() {
        let evidence = Evidence { vis: 0.6, context: 0.5, sound: 0.8 };
        assert!((evidence.score(&weights()) - (0.3 + 0.05 + 0.32)).abs() < 1e-6);
        assert!((evidence.seen(&weights()) - 0.35 / 0.6).abs() < 1e-6);
    }

    #[test]
    fn sight_alone_is_plausible_near_the_floor() {
        for preset in Preset::ALL {
            let weights = preset.weights();
            let seen = candidate(0, weights.least_vis(false) + 0.05, 0.3, 0.0);
            assert!(best([seen].into_iter(), None, &weights).is_some(), "{preset:?}");
        }
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
        let chosen = |of: &[Candidate], kept| best(of.iter().copied(), kept, &weights()).map(|c| c.object);
        assert_eq!((chosen(&all, None), chosen(&all[..1], None)), (Some(1), Some(0)));
        assert_eq!((chosen(&all[2..], None), chosen(&[], None)), (None, None));
        assert_eq!((chosen(&all, Some((0, 0))), chosen(&all, Some((2, 0)))), (Some(0), Some(1)));
    }
}
