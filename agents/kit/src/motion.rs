use crate::map::Occupancy;
use crate::path::Path;
use crate::perception::{Place, Stand};
use avln_client::{Action, TaskSpec};

/// How far ahead of the body on its way it aims, metres.
const AIM_M: f32 = 1.0;
/// A step forward that moved by less than this share of its length hit something.
const BLOCKED: f32 = 0.3;
/// Steps that the body may stay on one spot while it wants to walk before it breaks loose.
const PATIENCE: u32 = 16;

/// Turns ways into actions, and notices what was in the way.
#[derive(Clone, Debug)]
pub struct Motion {
    forward_m: f32,
    turn_rad: f32,
    last: Option<(Action, Stand)>,
    anchor: Place,
    idle_steps: u32,
}

impl Motion {
    /// The motion of a body that has not moved yet.
    pub fn new(task: &TaskSpec) -> Self {
        Self {
            forward_m: task.forward_m,
            turn_rad: task.turn_rad,
            last: None,
            anchor: Place::default(),
            idle_steps: 0,
        }
    }

    /// Marks on the map what blocked the last step.
    pub fn feel(&self, stand: &Stand, map: &mut Occupancy) {
        if let Some((Action::MoveForward, before)) = &self.last
            && before.place.distance_m(stand.place) < BLOCKED * self.forward_m
        {
            map.bumped(stand.offset(0.2, 0.0));
        }
    }

    /// Remembers what was decided.
    pub fn note(&mut self, action: Action, stand: &Stand) {
        self.last = Some((action, *stand));
    }

    /// The next action along a way; `None` at its end.
    pub fn along(&mut self, path: &Path, stand: &Stand, map: &Occupancy) -> Option<Action> {
        let end = *path.places.last()?;
        if end.distance_m(stand.place) < 0.6 * self.forward_m {
            return None;
        }
        if self.is_stuck(stand) {
            return Some(self.loose());
        }
        let aim = path.aim(map, AIM_M)?;
        Some(self.toward(stand.bearing_rad(aim)).unwrap_or(Action::MoveForward))
    }

    /// The turn that brings a bearing ahead; `None` when it is as near ahead as turns can bring it.
    pub fn toward(&self, bearing_rad: f32) -> Option<Action> {
        let enough_rad = 0.55 * self.turn_rad;
        match bearing_rad {
            b if b > enough_rad => Some(Action::TurnLeft),
            b if b < -enough_rad => Some(Action::TurnRight),
            _ => None,
        }
    }

    fn is_stuck(&mut self, stand: &Stand) -> bool {
        if stand.place.distance_m(self.anchor) > self.forward_m {
            (self.anchor, self.idle_steps) = (stand.place, 0);
        }
        self.idle_steps += 1;
        self.idle_steps > PATIENCE
    }

    /// Three turns and two steps, then the way is tried anew.
    fn loose(&mut self) -> Action {
        match self.idle_steps - PATIENCE {
            1..=3 => Action::TurnLeft,
            4..=5 => Action::MoveForward,
            _ => {
                self.idle_steps = 0;
                Action::MoveForward
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Cell;
    use crate::path::path;
    use avln_client::Pose;

    #[test]
    fn the_body_turns_to_its_way_and_walks_it() {
        let (mut motion, map) = (Motion::new(&TaskSpec::default()), Occupancy::default());
        let stand = Stand::new(&Pose::default());
        let mut act = |x, z| motion.along(&path(&map, stand.place, Place::new(x, z), 0.1), &stand, &map);
        assert_eq!(act(0.0, -2.0), Some(Action::MoveForward));
        assert_eq!(act(-2.0, 0.0), Some(Action::TurnLeft));
        assert_eq!(act(2.0, 0.0), Some(Action::TurnRight));
        assert_eq!(act(0.05, -0.05), None);
    }

    #[test]
    fn what_blocks_a_step_is_marked_and_the_body_breaks_loose() {
        let (mut motion, mut map) = (Motion::new(&TaskSpec::default()), Occupancy::default());
        let stand = Stand::new(&Pose::default());
        motion.note(Action::MoveForward, &stand);
        motion.feel(&stand, &mut map);
        assert_eq!(map.bumps(Cell::at(stand.offset(0.2, 0.0))), 1);
        let way = path(&Occupancy::default(), stand.place, Place::new(0.0, -2.0), 0.1);
        let actions: Vec<_> =
            (0..20).filter_map(|_| motion.along(&way, &stand, &Occupancy::default())).collect();
        assert!(actions.contains(&Action::TurnLeft));
    }
}
