use crate::allowance::Allowance;
use avln_client::{Action, Agent, Mission, Observation, TaskSpec};
use avln_kit::Scout;

/// Goes to the nearest border of what it has seen, over and over (Yamauchi 1997). Knows no goal and hears nothing; submits
/// after equal shares of its steps.
#[derive(Default)]
pub struct Frontier {
    scout: Option<Scout>,
    allowance: Allowance,
}

impl Agent for Frontier {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let allowance = Allowance::new(mission.goals.len(), task.max_steps);
        *self = Self { scout: Some(Scout::new(task)), allowance };
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let Some(scout) = &mut self.scout else { return Action::Stop };
        scout.observe(observation);
        let action = self.allowance.due(observation).unwrap_or_else(|| scout.explore());
        scout.note(action);
        action
    }
}
