use avln_client::{Action, Agent, Mission, Observation, TaskSpec};

/// The reference agent of the paper (section 4).
#[derive(Clone, Debug, Default)]
pub struct PagNav {
    last_z: f32,
}

impl PagNav {
    /// An agent that has played nothing yet.
    pub fn new() -> Self {
        Self::default()
    }
}

impl Agent for PagNav {
    fn begin(&mut self, _task: &TaskSpec, _mission: &Mission) {
        self.last_z = f32::NAN;
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let z = observation.pose.position[2];
        let blocked = (z - self.last_z).abs() < 0.01;
        self.last_z = z;
        match (observation.remaining_steps <= 1, blocked) {
            (true, _) => Action::Stop,
            (false, true) => Action::TurnLeft,
            (false, false) => Action::MoveForward,
        }
    }
}
