use avln_client::{Action, Agent, Mission, Observation, TaskSpec};
use avln_pag_nav::PagNav;

/// An agent of one episode, whose trace ends with it.
pub(super) struct Traced(pub(super) PagNav);

impl Agent for Traced {
    fn enter(&mut self, episode: &str) {
        self.0.enter(episode);
    }

    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        self.0.begin(task, mission);
    }

    fn act(&mut self, observation: &Observation) -> Action {
        self.0.act(observation)
    }
}

impl Drop for Traced {
    fn drop(&mut self) {
        if let Err(error) = self.0.end_trace() {
            eprintln!("{error}");
        }
    }
}
