//! Mission state S_t: open goals and remaining Submits.

/// The paper's mission state: completed goals by the agent's own account, and the Submits that are left.
#[derive(Clone, Debug, Default)]
pub(crate) struct MissionState {
    is_done: Vec<bool>,
    is_ordered: bool,
    pub(crate) remaining_submits: u32,
}

impl MissionState {
    pub(crate) fn new(goals: usize, is_ordered: bool) -> Self {
        let remaining_submits = goals.saturating_sub(1) as u32;
        Self { is_done: vec![false; goals], is_ordered, remaining_submits }
    }

    pub(crate) fn is_ordered(&self) -> bool {
        self.is_ordered
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
}
