use crate::rng::Rng;
use avln_client::{Action, Agent, Mission, Observation, Pose, TaskSpec};

/// Chance of a Submit in a step.
const SUBMIT: f64 = 0.01;
/// Chance of beginning a turn in a step.
const TURN: f64 = 0.12;
/// Most turns in a row that a walk turns by; half a circle at 30 degrees.
const MAX_TURNS: u32 = 6;
/// A step forward that moved by less than this share of its length hit something.
const BLOCKED: f32 = 0.5;

/// Walks ahead, turns by a random angle now and then and whenever it is blocked, submits rarely and stops with its last
/// step. All that it senses is its own pose.
#[derive(Clone, Debug)]
pub struct RandomAgent {
    rng: Rng,
    forward_m: f32,
    last: Option<(Action, Pose)>,
    turning: Option<(Action, u32)>,
}

impl RandomAgent {
    /// The agent of `seed`: the same seed and the same observations give the same actions.
    pub fn new(seed: u64) -> Self {
        Self { rng: Rng::new(seed), forward_m: 0.0, last: None, turning: None }
    }

    fn choose(&mut self, observation: &Observation) -> Action {
        if observation.remaining_steps <= 1 {
            return Action::Stop;
        }
        if let Some(turn) = self.turn_on() {
            return turn;
        }
        if observation.remaining_submits > 0 && self.rng.unit() < SUBMIT {
            return Action::Submit;
        }
        if self.is_blocked(&observation.pose) || self.rng.unit() < TURN {
            return self.begin_turn();
        }
        Action::MoveForward
    }

    /// The next turn of a turn that was begun.
    fn turn_on(&mut self) -> Option<Action> {
        let (side, left) = self.turning.take()?;
        self.turning = (left > 1).then_some((side, left - 1));
        Some(side)
    }

    fn begin_turn(&mut self) -> Action {
        let side = if self.rng.unit() < 0.5 { Action::TurnLeft } else { Action::TurnRight };
        let turns = self.rng.between(1, MAX_TURNS);
        self.turning = (turns > 1).then_some((side, turns - 1));
        side
    }

    fn is_blocked(&self, pose: &Pose) -> bool {
        let Some((Action::MoveForward, before)) = &self.last else { return false };
        let [dx, dz] = [0, 2].map(|axis| pose.position[axis] - before.position[axis]);
        dx.hypot(dz) < BLOCKED * self.forward_m
    }
}

impl Agent for RandomAgent {
    fn begin(&mut self, task: &TaskSpec, _mission: &Mission) {
        self.forward_m = task.forward_m;
        self.last = None;
        self.turning = None;
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let action = self.choose(observation);
        self.last = Some((action, observation.pose));
        action
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What an agent does that stands before a wall (`free` false) or in the open.
    fn walk(seed: u64, steps: u32, free: bool) -> Vec<Action> {
        let mut agent = RandomAgent::new(seed);
        agent.begin(&TaskSpec::default(), &Mission::default());
        let mut seen = Observation { remaining_submits: 3, ..Observation::default() };
        (0..steps)
            .map(|step| {
                seen.remaining_steps = steps - step;
                let action = agent.act(&seen);
                match action {
                    Action::MoveForward if free => seen.pose.position[2] -= 0.25,
                    Action::Submit => seen.remaining_submits -= 1,
                    _ => {}
                }
                action
            })
            .collect()
    }

    fn count(actions: &[Action], wanted: Action) -> usize {
        actions.iter().filter(|&&action| action == wanted).count()
    }

    #[test]
    fn a_seed_fixes_the_walk_and_seeds_differ() {
        assert_eq!(walk(1, 500, true), walk(1, 500, true));
        assert_ne!(walk(1, 500, true), walk(2, 500, true));
    }

    #[test]
    fn it_walks_most_of_the_time_submits_within_its_means_and_stops_last() {
        for seed in 0..20 {
            let actions = walk(seed, 1000, true);
            assert!(count(&actions, Action::MoveForward) > 500, "seed {seed}");
            assert!(count(&actions, Action::Submit) <= 3, "seed {seed}");
            assert_eq!(actions.iter().position(|&action| action == Action::Stop), Some(999), "seed {seed}");
        }
    }

    #[test]
    fn before_a_wall_it_turns_after_every_step_forward() {
        let actions = walk(3, 300, false);
        let stubborn = actions.windows(2).filter(|pair| pair == &[Action::MoveForward; 2]);
        assert_eq!(stubborn.count(), 0);
        assert!(count(&actions, Action::TurnLeft) > 0 && count(&actions, Action::TurnRight) > 0);
    }
}
