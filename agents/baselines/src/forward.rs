use crate::allowance::Allowance;
use avln_client::{Action, Agent, Mission, Observation, Pose, TaskSpec};

/// A step forward that moved by less than this share of its length hit something.
const BLOCKED: f32 = 0.5;

/// Walks ahead; where it is blocked, it turns right until it is not. Submits after equal shares of its steps. All that it
/// senses is its own pose.
#[derive(Clone, Debug, Default)]
pub struct ForwardAndTurn {
    forward_m: f32,
    allowance: Allowance,
    last: Option<(Action, Pose)>,
}

impl ForwardAndTurn {
    fn is_blocked(&self, pose: &Pose) -> bool {
        let Some((Action::MoveForward, before)) = &self.last else { return false };
        let [dx, dz] = [0, 2].map(|axis| pose.position[axis] - before.position[axis]);
        dx.hypot(dz) < BLOCKED * self.forward_m
    }
}

impl Agent for ForwardAndTurn {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let allowance = Allowance::new(mission.goals.len(), task.max_steps);
        *self = Self { forward_m: task.forward_m, allowance, last: None };
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let onward = if self.is_blocked(&observation.pose) { Action::TurnRight } else { Action::MoveForward };
        let action = self.allowance.due(observation).unwrap_or(onward);
        self.last = Some((action, observation.pose));
        action
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_on_until_it_is_blocked() {
        let mut agent = ForwardAndTurn::default();
        agent.begin(&TaskSpec::default(), &Mission::default());
        let mut seen = Observation { remaining_steps: 9, ..Observation::default() };
        assert_eq!(agent.act(&seen), Action::MoveForward);
        seen.pose.position[2] -= 0.25;
        assert_eq!(agent.act(&seen), Action::MoveForward);
        assert_eq!(agent.act(&seen), Action::TurnRight);
        assert_eq!(agent.act(&seen), Action::MoveForward);
        assert_eq!(agent.act(&Observation { remaining_steps: 1, ..seen }), Action::Stop);
    }
}
