use crate::map::Occupancy;
use crate::perception::{Place, Stand, View};
use crate::{Course, Motion};
use avln_client::{Action, Observation, TaskSpec};

/// A body that draws a map as it goes, and finds its way by it.
pub struct Scout {
    /// The map so far.
    pub map: Occupancy,
    motion: Motion,
    course: Course,
    view: View,
    stand: Stand,
}

impl Scout {
    /// Nearer frontiers are seen past, metres.
    const NEAR_M: f32 = 0.4;

    /// A body that has seen nothing yet.
    pub fn new(task: &TaskSpec) -> Self {
        let (motion, view) = (Motion::new(task), View::new(task));
        let (map, course, stand) = (Occupancy::default(), Course::default(), Stand::default());
        Self { map, motion, course, view, stand }
    }

    /// Takes in what an observation says of floor and obstacles.
    pub fn observe(&mut self, observation: &Observation) {
        self.stand = Stand::new(&observation.pose);
        self.motion.feel(&self.stand, &mut self.map);
        if let Some(depth) = &observation.depth {
            self.map.see(&self.view, &self.stand, depth);
        }
    }

    /// Remembers what was decided, so that it is felt when it was in vain.
    pub fn note(&mut self, action: Action) {
        self.motion.note(action, &self.stand);
    }

    /// Where the body stands and looks.
    pub fn stand(&self) -> Stand {
        self.stand
    }

    /// The next action on the way to within `reach_m` of a place; `None` where that way ends.
    pub fn go(&mut self, to: Place, reach_m: f32) -> Option<Action> {
        let way = self.course.way(&self.map, self.stand.place, to, reach_m);
        self.motion.along(&way, &self.stand, &self.map)
    }

    /// The turn that brings a place within `enough_rad` of straight ahead; `None` when it is.
    pub fn face(&self, place: Place, enough_rad: f32) -> Option<Action> {
        let bearing_rad = self.stand.bearing_rad(place);
        self.motion.toward(bearing_rad).filter(|_| bearing_rad.abs() > enough_rad)
    }

    /// The frontier that is worth most; `None` when all has been seen.
    pub fn frontier(&self, worth: impl Fn(Place) -> f32) -> Option<Place> {
        let here = self.stand.place;
        let open = self.map.frontiers().into_iter().map(|(place, _)| place);
        let open = open.filter(|place| place.distance_m(here) > Self::NEAR_M);
        open.max_by(|a, b| worth(*a).total_cmp(&worth(*b)))
    }

    /// The next action of exploring by the nearest frontier. When all has been seen, the map is drawn anew.
    pub fn explore(&mut self) -> Action {
        const REACH_M: f32 = 0.2;
        let here = self.stand.place;
        let step = self.frontier(|place| -place.distance_m(here)).and_then(|aim| self.go(aim, REACH_M));
        step.unwrap_or_else(|| {
            self.map = Occupancy::default();
            Action::TurnLeft
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::DepthImage;

    /// A picture of a wall `away_m` ahead that fills it.
    fn before_a_wall(away_m: f32) -> Observation {
        let row_m = |row: usize| match (row as f32 + 0.5 - 32.0) / 32.0 {
            down if down > 0.0 => (1.0 / down).min(away_m),
            _ => away_m,
        };
        let metres = (0..64 * 64).map(|i| row_m(i / 64)).collect();
        Observation { depth: Some(DepthImage { width: 64, height: 64, metres }), ..Observation::default() }
    }

    #[test]
    fn it_goes_where_nothing_has_been_seen() {
        let task = TaskSpec { width: 64, height: 64, ..TaskSpec::default() };
        let mut scout = Scout::new(&task);
        scout.observe(&before_a_wall(3.02));
        let nearest = scout.frontier(|place| -place.distance_m(Place::default())).unwrap();
        assert!(nearest.distance_m(Place::default()) < 3.5, "{nearest:?}");
        assert_ne!(scout.explore(), Action::Submit);
        assert_eq!(scout.face(Place::new(-2.0, 0.0), 0.5), Some(Action::TurnLeft));
        assert_eq!(scout.face(Place::new(0.1, -2.0), 0.5), None);
    }

    #[test]
    fn where_all_has_been_seen_it_begins_anew() {
        let mut scout = Scout::new(&TaskSpec::default());
        assert_eq!((scout.explore(), scout.frontier(|_| 1.0)), (Action::TurnLeft, None));
    }
}
