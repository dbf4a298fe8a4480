//! Path following, and exploration with a growing map.

use crate::geometry::{FloorPoint, PinholeCamera, Pose2d};
use crate::map::occupancy::Occupancy;
use crate::path::{Path, PathFollower};
use avln_client::{Action, Observation, TaskSpec};

/// Look-ahead on the path, metres.
const AIM_M: f32 = 1.0;
/// A step forward below this share was blocked.
const BLOCKED: f32 = 0.3;
/// Steps without progress after which the body breaks loose.
const PATIENCE: u32 = 16;

/// A controller that turns paths into actions and detects blocked steps.
#[derive(Clone, Debug)]
pub struct MotionController {
    forward_m: f32,
    turn_rad: f32,
    last: Option<(Action, Pose2d)>,
    anchor: FloorPoint,
    idle_steps: u32,
}

impl MotionController {
    /// Creates the controller for a body at rest.
    pub fn new(task: &TaskSpec) -> Self {
        Self {
            forward_m: task.forward_m,
            turn_rad: task.turn_rad,
            last: None,
            anchor: FloorPoint::default(),
            idle_steps: 0,
        }
    }

    /// Marks the obstacle that blocked the last step on the map.
    pub fn mark_blocked(&self, pose: &Pose2d, map: &mut Occupancy) {
        if let Some((Action::MoveForward, before)) = &self.last
            && before.place.distance_m(pose.place) < BLOCKED * self.forward_m
        {
            map.mark_bump(pose.offset(0.2, 0.0));
        }
    }

    /// Records the chosen action.
    pub fn record(&mut self, action: Action, pose: &Pose2d) {
        self.last = Some((action, *pose));
    }

    /// Returns the next action on a path; `None` at the end.
    pub fn follow(&mut self, path: &Path, pose: &Pose2d, map: &Occupancy) -> Option<Action> {
        let end = *path.places.last()?;
        if end.distance_m(pose.place) < 0.6 * self.forward_m {
            return None;
        }
        if self.is_stuck(pose) {
            return Some(self.break_loose());
        }
        let aim = path.aim(map, AIM_M)?;
        Some(self.turn_toward(pose.bearing_rad(aim)).unwrap_or(Action::MoveForward))
    }

    /// Returns the turn towards a bearing; `None` if no turn brings it closer to straight ahead.
    pub fn turn_toward(&self, bearing_rad: f32) -> Option<Action> {
        let enough_rad = 0.55 * self.turn_rad;
        match bearing_rad {
            b if b > enough_rad => Some(Action::TurnLeft),
            b if b < -enough_rad => Some(Action::TurnRight),
            _ => None,
        }
    }

    fn is_stuck(&mut self, pose: &Pose2d) -> bool {
        if pose.place.distance_m(self.anchor) > self.forward_m {
            (self.anchor, self.idle_steps) = (pose.place, 0);
        }
        self.idle_steps += 1;
        self.idle_steps > PATIENCE
    }

    /// Returns the next action of breaking loose: three turns, then up to three steps forward.
    fn break_loose(&mut self) -> Action {
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

/// An explorer: it maps the surroundings while it walks, and plans paths on the map.
pub struct Explorer {
    /// The map.
    pub map: Occupancy,
    motion: MotionController,
    follower: PathFollower,
    view: PinholeCamera,
    pose: Pose2d,
}

impl Explorer {
    /// Nearer frontiers are already in view, metres.
    const NEAR_M: f32 = 0.4;

    /// Creates an explorer with an empty map.
    pub fn new(task: &TaskSpec) -> Self {
        let (motion, view) = (MotionController::new(task), PinholeCamera::new(task));
        let (map, follower, pose) = (Occupancy::default(), PathFollower::default(), Pose2d::default());
        Self { map, motion, follower, view, pose }
    }

    /// Adds the floor and obstacles of an observation to the map.
    pub fn observe(&mut self, observation: &Observation) {
        self.pose = Pose2d::new(&observation.pose);
        self.motion.mark_blocked(&self.pose, &mut self.map);
        if let Some(depth) = &observation.depth {
            self.map.see(&self.view, &self.pose, depth);
        }
    }

    /// Records the chosen action, for the detection of blocked steps.
    pub fn record(&mut self, action: Action) {
        self.motion.record(action, &self.pose);
    }

    /// Returns the body's pose.
    pub fn pose(&self) -> Pose2d {
        self.pose
    }

    /// Returns the next action on the path to within `reach_m` metres; `None` at the path's end.
    pub fn go_to(&mut self, to: FloorPoint, reach_m: f32) -> Option<Action> {
        let path = self.follower.path_to(&self.map, self.pose.place, to, reach_m);
        self.motion.follow(&path, &self.pose, &self.map)
    }

    /// Returns the turn towards a point; `None` within `enough_rad`.
    pub fn face(&self, place: FloorPoint, enough_rad: f32) -> Option<Action> {
        let bearing_rad = self.pose.bearing_rad(place);
        self.motion.turn_toward(bearing_rad).filter(|_| bearing_rad.abs() > enough_rad)
    }

    /// Returns the frontier of the highest value; `None` if everything is explored.
    pub fn frontier(&self, worth: impl Fn(FloorPoint) -> f32) -> Option<FloorPoint> {
        let here = self.pose.place;
        let open = self.map.frontiers().into_iter().map(|(place, _)| place);
        let open = open.filter(|place| place.distance_m(here) > Self::NEAR_M);
        open.max_by(|a, b| worth(*a).total_cmp(&worth(*b)))
    }

    /// Returns the next action towards the nearest frontier; clears the map if everything is explored.
    pub fn explore(&mut self) -> Action {
        const REACH_M: f32 = 0.2;
        let here = self.pose.place;
        let step = self.frontier(|place| -place.distance_m(here)).and_then(|aim| self.go_to(aim, REACH_M));
        step.unwrap_or_else(|| {
            self.map = Occupancy::default();
            Action::TurnLeft
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::occupancy::Cell;
    use crate::path::find_path;
    use avln_client::{DepthImage, Pose};

    #[test]
    fn body_turns_to_its_path_and_walks() {
        let (mut motion, map) = (MotionController::new(&TaskSpec::default()), Occupancy::default());
        let pose = Pose2d::new(&Pose::default());
        let mut act =
            |x, z| motion.follow(&find_path(&map, pose.place, FloorPoint::new(x, z), 0.1), &pose, &map);
        assert_eq!(act(0.0, -2.0), Some(Action::MoveForward));
        assert_eq!(act(-2.0, 0.0), Some(Action::TurnLeft));
        assert_eq!(act(2.0, 0.0), Some(Action::TurnRight));
        assert_eq!(act(0.05, -0.05), None);
    }

    #[test]
    fn blocked_steps_are_marked_and_break_loose() {
        let (mut motion, mut map) = (MotionController::new(&TaskSpec::default()), Occupancy::default());
        let pose = Pose2d::new(&Pose::default());
        motion.record(Action::MoveForward, &pose);
        motion.mark_blocked(&pose, &mut map);
        assert_eq!(map.bumps(Cell::at(pose.offset(0.2, 0.0))), 1);
        let path = find_path(&Occupancy::default(), pose.place, FloorPoint::new(0.0, -2.0), 0.1);
        let actions: Vec<_> =
            (0..20).filter_map(|_| motion.follow(&path, &pose, &Occupancy::default())).collect();
        assert!(actions.contains(&Action::TurnLeft));
    }

    /// A depth image with a wall `away_m` ahead.
    fn before_a_wall(away_m: f32) -> Observation {
        let row_m = |row: usize| match (row as f32 + 0.5 - 32.0) / 32.0 {
            down if down > 0.0 => (1.0 / down).min(away_m),
            _ => away_m,
        };
        let metres = (0..64 * 64).map(|i| row_m(i / 64)).collect();
        Observation { depth: Some(DepthImage { width: 64, height: 64, metres }), ..Observation::default() }
    }

    #[test]
    fn explorer_walks_to_unseen_areas() {
        let task = TaskSpec { width: 64, height: 64, ..TaskSpec::default() };
        let mut explorer = Explorer::new(&task);
        explorer.observe(&before_a_wall(3.02));
        let nearest = explorer.frontier(|place| -place.distance_m(FloorPoint::default())).unwrap();
        assert!(nearest.distance_m(FloorPoint::default()) < 3.5, "{nearest:?}");
        assert_ne!(explorer.explore(), Action::Submit);
        assert_eq!(explorer.face(FloorPoint::new(-2.0, 0.0), 0.5), Some(Action::TurnLeft));
        assert_eq!(explorer.face(FloorPoint::new(0.1, -2.0), 0.5), None);
    }

    #[test]
    fn exploration_restarts_when_complete() {
        let mut explorer = Explorer::new(&TaskSpec::default());
        assert_eq!((explorer.explore(), explorer.frontier(|_| 1.0)), (Action::TurnLeft, None));
    }
}
