use super::Weights;
use avln_kit::perception::Place;

/// What speaks for a candidate o of a goal g, each 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Evidence {
    /// Visual-semantic compatibility of cue and candidate (s_vis of the paper).
    pub(crate) vis: f32,
    /// What rooms and things around it make of it (P_ctx).
    pub(crate) context: f32,
    /// Consistency with the audio memories (s_int).
    pub(crate) sound: f32,
}

impl Evidence {
    /// S_ground(o, g) = lambda_v s_vis + lambda_c P_ctx + lambda_a s_int.
    pub(crate) fn score(&self, weights: &Weights) -> f32 {
        weights.ground_vis * self.vis
            + weights.ground_context * self.context
            + weights.ground_audio * self.sound
    }

    /// What is seen alone: the score without its sound, as a share of the most that it can be.
    pub(crate) fn seen(&self, weights: &Weights) -> f32 {
        let silent = Self { sound: 0.0, ..*self };
        silent.score(weights) / (weights.ground_vis + weights.ground_context)
    }
}

/// What the audio memories of one source say of one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HeardThere {
    /// Distance from the place to where the source is believed to be, metres.
    pub(crate) off_m: f32,
    /// Certainty of that belief, 0 to 1.
    pub(crate) certainty: f32,
    /// Range that the loudest sound of the source told, metres.
    pub(crate) loudest_range_m: f32,
    /// How well a source there explains where the sound was loud, 0 to 1.
    pub(crate) explained: f32,
}

impl HeardThere {
    /// s_int: how much the memories support that the source is there, 0 to 1.
    pub(crate) fn consistency(&self, weights: &Weights) -> f32 {
        let off = self.off_m / weights.sound_scale_m;
        let certain = (self.certainty / weights.certain).min(1.0);
        let loud = (weights.look_range_m / self.loudest_range_m).min(1.0);
        (-0.5 * off * off).exp() * certain * loud * self.explained
    }
}

/// An object hypothesis as a candidate of a goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Candidate {
    /// Index of the hypothesis in the object memory.
    pub(crate) object: usize,
    pub(crate) goal: usize,
    /// The sound that supports it most.
    pub(crate) source: usize,
    /// Where it is.
    pub(crate) place: Place,
    pub(crate) evidence: Evidence,
}

/// o* = argmax S_ground over the candidates that are plausible.
pub(crate) fn best(candidates: impl Iterator<Item = Candidate>, weights: &Weights) -> Option<Candidate> {
    let score = |candidate: &Candidate| candidate.evidence.score(weights);
    candidates
        .filter(|candidate| score(candidate) >= weights.plausible)
        .max_by(|a, b| score(a).total_cmp(&score(b)))
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
        Candidate { object, goal: 0, source: 0, place: Place::default(), evidence }
    }

    #[test]
    fn the_score_is_the_weighted_sum() {
        let evidence = Evidence { vis: 0.6, context: 0.5, sound: 0.8 };
        assert!((evidence.score(&weights()) - (0.3 + 0.05 + 0.32)).abs() < 1e-6);
        assert!((evidence.seen(&weights()) - 0.35 / 0.6).abs() < 1e-6);
    }

    #[test]
    fn sound_supports_what_is_where_it_was_loud() {
        let weights = Weights { sound_scale_m: 0.4, certain: 0.5, look_range_m: 3.0, ..Weights::default() };
        let there = HeardThere { off_m: 0.0, certainty: 0.9, loudest_range_m: 1.0, explained: 0.8 };
        assert!((there.consistency(&weights) - 0.8).abs() < 1e-6);
        // 0.4 m off, half as certain as is enough, never nearer than twice the range: 0.607 / 4 of that.
        let far = HeardThere { off_m: 0.4, certainty: 0.25, loudest_range_m: 6.0, ..there };
        assert!((far.consistency(&weights) - 0.8 * 0.6065 / 4.0).abs() < 1e-3);
    }

    #[test]
    fn the_best_of_the_plausible_is_chosen() {
        // 0.35 + 0.05 + 0.08 = 0.48, 0.1 + 0.05 + 0.36 = 0.51, 0.3 + 0.05 = 0.35.
        let all = [candidate(0, 0.7, 0.5, 0.2), candidate(1, 0.2, 0.5, 0.9), candidate(2, 0.6, 0.5, 0.0)];
        let chosen = |of: &[Candidate]| best(of.iter().copied(), &weights()).map(|c| c.object);
        assert_eq!((chosen(&all), chosen(&all[..1])), (Some(1), Some(0)));
        assert_eq!((chosen(&all[2..]), chosen(&[])), (None, None));
    }
}
