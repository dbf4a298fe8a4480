use avln_client::{Action, Observation};

/// Submits of an agent that does not know where its goals are: one after each equal share of its steps, and Stop as the
/// last step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Allowance {
    share_steps: u32,
    submits: u32,
}

impl Allowance {
    /// For a mission of `goals` goals and `max_steps` steps.
    pub(crate) fn new(goals: usize, max_steps: u32) -> Self {
        let goals = u32::try_from(goals).unwrap_or(u32::MAX).max(1);
        Self { share_steps: (max_steps / goals).max(1), submits: 0 }
    }

    /// What is due now, if anything.
    pub(crate) fn due(&mut self, seen: &Observation) -> Option<Action> {
        if seen.remaining_steps <= 1 {
            return Some(Action::Stop);
        }
        let is_due = seen.step + 1 >= (self.submits + 1) * self.share_steps && seen.remaining_submits > 0;
        self.submits += u32::from(is_due);
        is_due.then_some(Action::Submit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn submits_lie_apart_and_stop_is_the_last_step() {
        let (mut allowance, mut submits_left) = (Allowance::new(4, 100), 3);
        let mut due = Vec::new();
        for step in 0..100 {
            let seen = Observation {
                step,
                remaining_steps: 100 - step,
                remaining_submits: submits_left,
                ..Observation::default()
            };
            let Some(action) = allowance.due(&seen) else { continue };
            submits_left -= u32::from(action == Action::Submit);
            due.push((step, action));
        }
        let submit = |step| (step, Action::Submit);
        assert_eq!(due, [submit(24), submit(49), submit(74), (99, Action::Stop)]);
    }
}
