//! Stairs: finding a flight and climbing it step by step.

use avln_client::Action;
use avln_kit::explorer::MotionController;
use avln_kit::geometry::{FloorPoint, Pose2d};
use avln_kit::map::{ClimbPath, Elevation};
use std::f32::consts::TAU;

/// Least stair height, metres.
const FLIGHT_M: f32 = 0.9;
/// Preferred rise to the next target on stairs, metres; otherwise a single step within `NEAR_M`.
const RISE_M: f32 = 0.4;
const STEP_M: f32 = 0.12;
const NEAR_M: f32 = 1.0;
/// Distance to walk on a landing before looking around for further steps, metres.
const LANDING_M: f32 = 0.6;
/// Height tolerance for level ground, metres; twice that distance to a landing's middle counts as arrival.
const LEVEL_M: f32 = 0.1;
/// Look-ahead on the path, metres.
const AIM_M: f32 = 0.35;
/// A step forward below this length hit an obstacle, metres.
const BLOCKED_M: f32 = 0.08;
/// Step limit without progress, and the radius around failures without further attempts, metres.
const VAIN_STEPS: u32 = 50;
const FALSE_M: f32 = 1.0;

pub(crate) struct StairClimber {
    pub(crate) elevation: Elevation,
    /// Body height above the start, metres.
    pub(crate) height_m: f32,
    turn_rad: f32,
    climb: Option<StairClimb>,
    /// Supposed stairs without an exit.
    false_stairs: Vec<FloorPoint>,
}

#[derive(Clone, Copy)]
struct StairClimb {
    /// 1 up, -1 down.
    sign: f32,
    /// Greatest height in the climb's direction, metres, and steps since.
    best_m: f32,
    vain_steps: u32,
    /// Middle of the landing on which the next steps are sought.
    landing: Option<FloorPoint>,
    /// Turn since steps were last visible, radians.
    turned_rad: f32,
    /// Position before the last step forward.
    walked_from: Option<FloorPoint>,
}

impl StairClimber {
    pub(crate) fn new(turn_rad: f32) -> Self {
        let elevation = Elevation::default();
        Self { elevation, height_m: 0.0, turn_rad, climb: None, false_stairs: Vec::new() }
    }

    /// Returns the next action on stairs; `None` if the body is not on stairs, and none are known or `is_wanted` is false.
    pub(crate) fn next_action(
        &mut self,
        pose: &Pose2d,
        motion: &MotionController,
        is_wanted: bool,
    ) -> Option<Action> {
        let started = self.climb.take();
        let mut climb = started.or_else(|| if is_wanted { self.find(pose) } else { None })?;
        let is_blocked = climb.walked_from.is_some_and(|place| place.distance_m(pose.place) < BLOCKED_M);
        if is_blocked {
            self.elevation.mark_bump(pose.offset(0.2, 0.0), self.height_m);
        }
        let path = self.path_to_steps(&mut climb, pose);
        let turn = match &path {
            Some(path) => motion.turn_toward(pose.bearing_rad(path.ahead(AIM_M))),
            None => Some(Action::TurnLeft),
        };
        climb.turned_rad = if path.is_some() { 0.0 } else { climb.turned_rad + self.turn_rad };
        climb.walked_from = turn.is_none().then_some(pose.place);
        let is_near = path.is_none_or(|path| path.end().distance_m(pose.place) <= 2.0 * NEAR_M);
        climb.vain_steps += u32::from(is_near || is_blocked);
        self.record_progress(climb, pose.place);
        Some(turn.unwrap_or(Action::MoveForward))
    }

    /// Continues a climb with progress; otherwise remembers false stairs.
    fn record_progress(&mut self, mut climb: StairClimb, here: FloorPoint) {
        let rise_m = climb.sign * self.height_m;
        if rise_m >= climb.best_m + STEP_M {
            climb.best_m = rise_m;
            climb.vain_steps = 0;
        }
        let is_vain = climb.vain_steps >= VAIN_STEPS;
        if is_vain {
            self.false_stairs.push(here);
        }
        // After a full turn without steps in sight the body has reached the end of the stairs.
        self.climb = Some(climb).filter(|climb| climb.turned_rad < TAU && !is_vain);
    }

    /// Returns the path to the next steps, or to the middle of a landing; `None` if the body should turn to look around.
    fn path_to_steps(&self, climb: &mut StairClimb, pose: &Pose2d) -> Option<ClimbPath> {
        let here_m = self.height_m;
        let from = pose.place;
        let search = |wanted: &dyn Fn(FloorPoint, f32) -> bool| self.elevation.climb(from, here_m, wanted);
        let rise_m = |height_m: f32| climb.sign * (height_m - here_m);
        let high = search(&|place, height_m| rise_m(height_m) >= RISE_M && !self.is_false(place));
        let steps = high.or_else(|| {
            search(&|place, height_m| rise_m(height_m) >= STEP_M && place.distance_m(from) <= NEAR_M)
        });
        if steps.is_some() {
            climb.landing = None;
            return steps;
        }
        let is_level = |height_m: f32| rise_m(height_m).abs() <= LEVEL_M;
        let away = || search(&|place, height_m| is_level(height_m) && place.distance_m(from) >= LANDING_M);
        let middle = climb.landing.or_else(|| away().map(|path| path.end()))?;
        let is_there = middle.distance_m(from) <= 2.0 * LEVEL_M || climb.turned_rad > 0.0;
        let path = if is_there {
            None
        } else {
            search(&|place, height_m| is_level(height_m) && place.distance_m(middle) <= LEVEL_M)
        };
        climb.landing = Some(middle);
        path
    }

    fn find(&self, pose: &Pose2d) -> Option<StairClimb> {
        let here_m = self.height_m;
        let is_flight =
            |place: FloorPoint, height_m: f32| (height_m - here_m).abs() >= FLIGHT_M && !self.is_false(place);
        let stairs = self.elevation.climb(pose.place, here_m, is_flight)?;
        let sign = (stairs.height_m - here_m).signum();
        let best_m = sign * here_m;
        Some(StairClimb { sign, best_m, vain_steps: 0, landing: None, turned_rad: 0.0, walked_from: None })
    }

    /// Returns true near supposed stairs that led nowhere.
    fn is_false(&self, place: FloorPoint) -> bool {
        self.false_stairs.iter().any(|known| known.distance_m(place) <= FALSE_M)
    }
}
