//! Pairing of heard sources with goals.

use crate::weights::Weights;
use avln_kit::geometry::FloorPoint;
use avln_kit::map::{IntensityMemory, SourceBelief, SourceEstimate, range_m};
use avln_kit::outcome::SubmitOutcome;

/// Log-likelihood per unit fit.
const TRUST: f32 = 5.0;
/// Log-likelihood after an unsuccessful Submit: the distance may have been too large.
const MISSED: f32 = -2.0;
/// Assumed fit of unseen objects.
const UNSEEN: f32 = 0.35;

/// Pairs between sources and goals: known pairs, unsuccessful Submits, and fits with cues.
#[derive(Clone, Debug)]
pub(crate) struct GoalPairing {
    /// Fit of a source (row) with a goal (column), 0 to 1; `None` before the first view.
    fits: Vec<Vec<Option<f32>>>,
    /// Unsuccessful Submits at a source (row) for a goal (column).
    missed: Vec<Vec<u32>>,
    /// Sources by found goal.
    done: Vec<Option<usize>>,
    ordered: bool,
}

impl GoalPairing {
    pub(crate) fn new(count: usize, ordered: bool) -> Self {
        Self {
            fits: vec![vec![None; count]; count],
            missed: vec![vec![0; count]; count],
            done: vec![None; count],
            ordered,
        }
    }

    /// Returns the goal count, equal to the source count.
    fn count(&self) -> usize {
        self.done.len()
    }

    pub(crate) fn is_ordered(&self) -> bool {
        self.ordered
    }

    /// Returns the goals that a Submit may be for.
    pub(crate) fn active(&self) -> impl Iterator<Item = usize> {
        let next = self.next();
        (0..self.count()).filter(move |&goal| match next {
            Some(next) => goal == next,
            None => self.done[goal].is_none(),
        })
    }

    /// Returns the next goal of an ordered mission.
    fn next(&self) -> Option<usize> {
        self.ordered.then(|| self.done.iter().position(Option::is_none)).flatten()
    }

    /// Returns true if one goal is left.
    pub(crate) fn is_last(&self) -> bool {
        self.done.iter().filter(|source| source.is_none()).count() == 1
    }

    /// Records the fit of the object at a source with a goal.
    pub(crate) fn see(&mut self, source: usize, goal: usize, fit: f32) {
        self.fits[source][goal] = Some(fit);
    }

    /// Forgets a source's fits after the estimate moved.
    pub(crate) fn forget(&mut self, source: usize) {
        self.fits[source].fill(None);
    }

    pub(crate) fn found(&mut self, source: usize) {
        match self.next() {
            Some(goal) => self.done[goal] = Some(source),
            None => {
                let open = (0..self.count()).filter(|&goal| self.done[goal].is_none());
                let best = open.max_by(|&a, &b| self.score(source, a).total_cmp(&self.score(source, b)));
                if let Some(goal) = best {
                    self.done[goal] = Some(source);
                }
            }
        }
    }

    /// Records a goal as found without a source.
    pub(crate) fn close(&mut self, goal: usize) {
        self.done[goal] = Some(goal);
    }

    pub(crate) fn missed(&mut self, source: usize) {
        if let Some(goal) = self.next() {
            self.missed[source][goal] += 1;
        }
    }

    /// Returns the probability that a Submit at a source is for the right goal; 1 in unordered missions.
    pub(crate) fn right(&self, source: usize) -> f32 {
        let Some(next) = self.next() else { return 1.0 };
        let open_goals: Vec<usize> = (0..self.count()).filter(|&goal| self.done[goal].is_none()).collect();
        let mut sources: Vec<usize> =
            (0..self.count()).filter(|source| !self.done.contains(&Some(*source))).collect();
        let place = open_goals.iter().position(|&goal| goal == next).unwrap_or(0);
        let (mut right, mut all) = (0.0, 1e-9);
        // All pairings are enumerated: missions usually have two to four goals.
        permutations(&mut sources, 0, &mut |pairing| {
            let pairs = pairing.iter().zip(&open_goals);
            let score = pairs.map(|(&source, &goal)| self.score(source, goal)).sum();
            let likelihood = libm::expf(score);
            all += likelihood;
            right += if pairing.get(place) == Some(&source) { likelihood } else { 0.0 };
        });
        right / all
    }

    /// Returns the log-likelihood of a pair.
    fn score(&self, source: usize, goal: usize) -> f32 {
        let tried = MISSED * self.missed[source][goal] as f32;
        TRUST * self.fits[source][goal].unwrap_or(UNSEEN) + tried
    }
}

fn permutations(items: &mut [usize], from: usize, visit: &mut dyn FnMut(&[usize])) {
    if from >= items.len() {
        return visit(items);
    }
    for other in from..items.len() {
        items.swap(from, other);
        permutations(items, from + 1, visit);
        items.swap(from, other);
    }
}

/// A sounding target's memory on one storey: the paper's audio memories A_bear and A_int.
#[derive(Default)]
pub(crate) struct SourceMemory {
    pub(crate) belief: SourceBelief,
    pub(crate) estimate: Option<SourceEstimate>,
    pub(crate) intensity: IntensityMemory,
    /// Number of near views at the estimate, and the first viewed position.
    pub(crate) looks: u32,
    looked_at: FloorPoint,
    /// Positions after unsuccessful Submits, and the level above which the next Submit is worthwhile.
    pub(crate) missed: Vec<FloorPoint>,
    pub(crate) missed_level: f32,
    /// Steps spent heading for the source.
    pub(crate) sought_steps: u32,
}

#[derive(Clone, Copy)]
pub(crate) struct PendingSubmit {
    pub(crate) source: usize,
    pub(crate) object: usize,
    pub(crate) goal: usize,
    pub(crate) level: f32,
    pub(crate) outcome: SubmitOutcome,
}

impl SourceMemory {
    /// Sets the estimate. Returns true, and resets the looks, if it left the viewed position.
    pub(crate) fn locate(&mut self, estimate: Option<SourceEstimate>) -> bool {
        const SAME_M: f32 = 1.0;
        self.estimate = estimate;
        let is_there = estimate.is_some_and(|estimate| estimate.place.distance_m(self.looked_at) <= SAME_M);
        let is_elsewhere = self.looks > 0 && !is_there;
        if is_elsewhere {
            self.looks = 0;
        }
        is_elsewhere
    }

    /// Returns true if the estimate is certain and the source was heard within visual range.
    pub(crate) fn is_located(&self, weights: &Weights) -> bool {
        let heard_m = range_m(self.intensity.loudest());
        let certainty = self.estimate.map(|estimate| estimate.certainty);
        certainty.is_some_and(|certainty| certainty >= weights.certain) && heard_m <= weights.look_range_m
    }

    /// Returns true if a Submit at this level and position differs from the unsuccessful ones: it is louder or elsewhere.
    pub(crate) fn is_worth_submit(&self, level: f32, here: FloorPoint) -> bool {
        const ELSEWHERE_M: f32 = 0.4;
        level > self.missed_level || self.missed.iter().all(|place| place.distance_m(here) >= ELSEWHERE_M)
    }

    pub(crate) fn look_at(&mut self, place: FloorPoint) {
        if self.looks == 0 {
            self.looked_at = place;
        }
        self.looks += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unordered_missions_accept_any_source() {
        let mut goals = GoalPairing::new(3, false);
        assert_eq!((goals.right(2), goals.next()), (1.0, None));
        goals.found(1);
        assert_eq!(goals.active().count(), 2);
    }

    #[test]
    fn misses_lower_the_probability_of_a_source() {
        let mut goals = GoalPairing::new(3, true);
        assert!((goals.right(0) - 1.0 / 3.0).abs() < 1e-4);
        goals.missed(0);
        assert!(goals.right(0) < 0.1 && (goals.right(1) - 0.47).abs() < 0.01, "{}", goals.right(1));
        (0..2).for_each(|_| goals.missed(0));
        assert!(goals.right(0) < 0.01);
        goals.found(1);
        assert_eq!(goals.active().collect::<Vec<_>>(), [1]);
        assert!((goals.right(0) - 0.5).abs() < 1e-4 && goals.right(1) == 0.0);
    }

    #[test]
    fn fits_of_other_sources_count() {
        let mut goals = GoalPairing::new(2, true);
        goals.see(1, 1, 1.0);
        goals.see(1, 0, 0.0);
        assert!(goals.right(0) > 0.9, "{}", goals.right(0));
    }
}
