use crate::perception::{Place, Recognition, Stand, Thing};
use avln_client::{Mission, Observation, TaskSpec};
use std::sync::Arc;

/// What a host tells an agent that runs beside it, beyond its observations, so that one can see what a perfect sense would
/// be worth. None of it crosses the wire: whoever plays from elsewhere has none. Places are in the frame of poses.
pub trait Hints: Send + Sync {
    /// Where the source is that sounds in the last observation; `None` in silence.
    fn source(&self) -> Option<Place>;

    /// The targets in view that have not been found.
    fn targets(&self) -> Vec<Sight>;
}

/// A target in view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sight {
    /// Its goal.
    pub goal: usize,
    /// Corner of its box with the lowest coordinates, metres; y counts from the floor that the body stands on.
    pub min_m: [f32; 3],
    /// Corner with the highest.
    pub max_m: [f32; 3],
}

/// Perception that sees targets, all of them and nothing else, because it is told.
pub struct Told {
    hints: Arc<dyn Hints>,
    goals: usize,
}

impl Told {
    /// Sees what `hints` tell.
    pub fn new(hints: Arc<dyn Hints>) -> Self {
        Self { hints, goals: 0 }
    }

    fn thing(&self, sight: Sight) -> Thing {
        let ([x0, y0, z0], [x1, y1, z1]) = (sight.min_m, sight.max_m);
        Thing {
            min: Place::new(x0, z0),
            max: Place::new(x1, z1),
            low_m: y0,
            high_m: y1,
            embedding: (0..self.goals).map(|goal| if goal == sight.goal { 1.0 } else { 0.0 }).collect(),
            views: 1,
            ..Thing::default()
        }
    }
}

impl Recognition for Told {
    fn begin(&mut self, _task: &TaskSpec, mission: &Mission) {
        self.goals = mission.goals.len();
    }

    fn see(&mut self, _: &Stand, _: &Observation, _: &dyn Fn(Place) -> bool) -> Option<Vec<Thing>> {
        Some(self.hints.targets().into_iter().map(|sight| self.thing(sight)).collect())
    }

    fn fit(&self, thing: &Thing, goal: usize) -> f32 {
        thing.embedding.get(goal).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::GoalCue;

    struct OneTarget;

    impl Hints for OneTarget {
        fn source(&self) -> Option<Place> {
            None
        }
        fn targets(&self) -> Vec<Sight> {
            vec![Sight { goal: 1, min_m: [1.0, 0.0, -2.0], max_m: [2.0, 0.8, -1.5] }]
        }
    }

    #[test]
    fn what_is_told_fits_its_goal_and_no_other() {
        let mut told = Told::new(Arc::new(OneTarget));
        let goals = ["bed", "sofa"].map(|label| GoalCue::Category(label.into())).to_vec();
        told.begin(&TaskSpec::default(), &Mission { goals, ..Mission::default() });
        let seen = told.see(&Stand::default(), &Observation::default(), &|_| false).unwrap();
        assert_eq!((seen.len(), seen[0].high_m, seen[0].max), (1, 0.8, Place::new(2.0, -1.5)));
        assert_eq!((told.fit(&seen[0], 0), told.fit(&seen[0], 1)), (0.0, 1.0));
    }
}
