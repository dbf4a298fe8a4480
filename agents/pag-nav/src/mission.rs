//! Mission state S_t, and the joint association of heard sources with goals.

/// The paper's mission state: completed goals by the agent's own account, and the Submits that are left.
#[derive(Clone, Debug, Default)]
pub(crate) struct MissionState {
    is_done: Vec<bool>,
    pub(crate) is_ordered: bool,
    pub(crate) remaining_submits: u32,
}

impl MissionState {
    pub(crate) fn new(goals: usize, is_ordered: bool) -> Self {
        let remaining_submits = goals.saturating_sub(1) as u32;
        Self { is_done: vec![false; goals], is_ordered, remaining_submits }
    }

    pub(crate) fn goals(&self) -> usize {
        self.is_done.len()
    }

    /// Returns the open goals.
    pub(crate) fn open(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.is_done.len()).filter(|&goal| !self.is_done[goal])
    }

    /// Returns the goals that a claim may be for: the next one of an ordered mission, otherwise all open ones.
    pub(crate) fn active(&self) -> impl Iterator<Item = usize> + '_ {
        self.open().take(if self.is_ordered { 1 } else { usize::MAX })
    }

    /// Returns true if the goal is active.
    pub(crate) fn is_active(&self, goal: usize) -> bool {
        self.active().any(|active| active == goal)
    }

    /// Counts a goal as completed.
    pub(crate) fn complete(&mut self, goal: usize) {
        if let Some(is_done) = self.is_done.get_mut(goal) {
            *is_done = true;
        }
    }

    /// Returns true if the next claim is a Stop: one open goal, or no Submit left. An N-th Submit is never sent.
    pub(crate) fn is_last_claim(&self) -> bool {
        self.open().count() <= 1 || self.remaining_submits == 0
    }
}

/// Log-likelihood per unit fit.
const TRUST: f32 = 5.0;
/// Log-likelihood after an unsuccessful Submit: the distance may have been too large.
const MISSED: f32 = -2.0;
/// Assumed fit of unseen objects, and of the objects at sources without a goal.
const UNSEEN: f32 = 0.35;

/// Pairs between sources and goals: known pairs, unsuccessful Submits, and fits with cues. Sources may outnumber goals.
#[derive(Clone, Debug)]
pub(crate) struct GoalPairing {
    /// Fit of a source (row) with a goal (column), 0 to 1; `None` before the first view.
    fits: Vec<Vec<Option<f32>>>,
    /// Unsuccessful Submits at a source (row) for a goal (column).
    missed: Vec<Vec<u32>>,
    /// Sources of completed goals.
    is_found: Vec<bool>,
}

impl GoalPairing {
    pub(crate) fn new(sources: usize, goals: usize) -> Self {
        Self {
            fits: vec![vec![None; goals]; sources],
            missed: vec![vec![0; goals]; sources],
            is_found: vec![false; sources],
        }
    }

    /// Records the fit of the object at a source with a goal.
    pub(crate) fn see(&mut self, source: usize, goal: usize, fit: f32) {
        self.fits[source][goal] = Some(fit);
    }

    /// Forgets a source's fits after the estimate moved.
    pub(crate) fn forget(&mut self, source: usize) {
        self.fits[source].fill(None);
    }

    /// Records the source of a completed goal.
    pub(crate) fn found(&mut self, source: usize) {
        self.is_found[source] = true;
    }

    pub(crate) fn missed(&mut self, source: usize, goal: usize) {
        self.missed[source][goal] += 1;
    }

    /// Returns the probability that a source belongs to an active goal: 1 in unordered missions without other sources.
    pub(crate) fn right(&self, source: usize, mission: &MissionState) -> f32 {
        let open: Vec<usize> = mission.open().collect();
        let wanted = open.iter().map(|&goal| mission.is_active(goal)).collect();
        let mut sum = PairingSum {
            pairing: self,
            open,
            wanted,
            source,
            taken: self.is_found.clone(),
            right: 0.0,
            all: 0.0,
        };
        if sum.taken.iter().filter(|is_taken| !**is_taken).count() < sum.open.len() {
            // Sources and goals disagree after a wrong outcome: nothing can be excluded.
            return 1.0;
        }
        sum.assign(0, 0.0, false);
        sum.right / sum.all.max(1e-9)
    }

    /// Returns the log-likelihood of a pair, against a source without a goal.
    fn score(&self, source: usize, goal: usize) -> f32 {
        let tried = MISSED * self.missed[source][goal] as f32;
        TRUST * (self.fits[source][goal].unwrap_or(UNSEEN) - UNSEEN) + tried
    }
}

/// A sum over all assignments of open goals to different sources: missions have two to four goals.
struct PairingSum<'a> {
    pairing: &'a GoalPairing,
    open: Vec<usize>,
    /// True for active goals.
    wanted: Vec<bool>,
    source: usize,
    taken: Vec<bool>,
    right: f32,
    all: f32,
}

impl PairingSum<'_> {
    fn assign(&mut self, place: usize, score: f32, is_right: bool) {
        let Some(&goal) = self.open.get(place) else {
            let likelihood = libm::expf(score);
            self.all += likelihood;
            self.right += if is_right { likelihood } else { 0.0 };
            return;
        };
        for source in 0..self.taken.len() {
            if !self.taken[source] {
                self.taken[source] = true;
                let is_right = is_right || (source == self.source && self.wanted[place]);
                self.assign(place + 1, score + self.pairing.score(source, goal), is_right);
                self.taken[source] = false;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordered_missions_never_skip_a_goal() {
        let mut mission = MissionState::new(3, true);
        assert!(mission.active().eq([0]) && !mission.is_active(1));
        mission.complete(0);
        assert!(mission.active().eq([1]) && mission.open().eq([1, 2]));
    }

    #[test]
    fn unordered_missions_have_all_open_goals() {
        let mut mission = MissionState::new(3, false);
        mission.complete(1);
        assert!(mission.active().eq([0, 2]) && mission.is_active(2) && !mission.is_active(1));
    }

    #[test]
    fn last_claims_are_stops() {
        let mut mission = MissionState::new(3, false);
        assert!(!mission.is_last_claim());
        mission.remaining_submits = 0;
        assert!(mission.is_last_claim());
        mission.remaining_submits = 2;
        (0..2).for_each(|goal| mission.complete(goal));
        assert!(mission.is_last_claim());
    }

    #[test]
    fn unordered_missions_accept_any_source() {
        let goals = GoalPairing::new(3, 3);
        assert!((goals.right(2, &MissionState::new(3, false)) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn misses_lower_the_probability_of_a_source() {
        let (mut goals, mut mission) = (GoalPairing::new(3, 3), MissionState::new(3, true));
        let right = |goals: &GoalPairing, mission: &MissionState, source| goals.right(source, mission);
        assert!((right(&goals, &mission, 0) - 1.0 / 3.0).abs() < 1e-4);
        goals.missed(0, 0);
        assert!(right(&goals, &mission, 0) < 0.1 && (right(&goals, &mission, 1) - 0.47).abs() < 0.01);
        (0..2).for_each(|_| goals.missed(0, 0));
        assert!(right(&goals, &mission, 0) < 0.01);
        goals.found(1);
        mission.complete(0);
        assert!((right(&goals, &mission, 0) - 0.5).abs() < 1e-4 && right(&goals, &mission, 1) == 0.0);
    }

    #[test]
    fn fits_of_other_sources_count() {
        let mut goals = GoalPairing::new(2, 2);
        goals.see(1, 1, 1.0);
        goals.see(1, 0, 0.0);
        assert!(goals.right(0, &MissionState::new(2, true)) > 0.9);
    }

    #[test]
    fn sources_without_a_goal_are_possible() {
        let (mut goals, mission) = (GoalPairing::new(4, 2), MissionState::new(2, false));
        assert!((goals.right(0, &mission) - 0.5).abs() < 1e-4);
        (0..2).for_each(|goal| goals.see(0, goal, 0.0));
        assert!(goals.right(0, &mission) < 0.3);
        goals.see(1, 0, 0.9);
        assert!(goals.right(1, &mission) > 0.8);
    }

    #[test]
    fn too_few_sources_exclude_nothing() {
        let mut goals = GoalPairing::new(2, 2);
        goals.found(0);
        assert_eq!(goals.right(1, &MissionState::new(2, true)), 1.0);
    }
}
