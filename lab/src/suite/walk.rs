//! A body's way through a house by its map, from what an agent is told of its pose.

use avln_client::{Action, Pose};

/// A place on the floor: x and z in the world, metres.
pub type FloorPoint = [f32; 2];

/// Walks along paths; knows where the body is from the start pose and what the agent is told.
pub struct Walker {
    start: FloorPoint,
    start_heading_rad: f32,
    before: FloorPoint,
    last: Action,
    /// Moves that lead out of a place where one is stuck, the next one last.
    way_out: Vec<Action>,
}

/// A corner nearer than this is passed, metres.
pub const PASSED_M: f32 = 0.15;
const HALF_TURN_RAD: f32 = 15.0 * std::f32::consts::PI / 180.0;

/// Distance between two places, metres.
pub fn distance_m(a: FloorPoint, b: FloorPoint) -> f32 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

impl Walker {
    /// A walker at `start`, looking along `heading_rad`.
    pub fn new(start: FloorPoint, start_heading_rad: f32) -> Self {
        Self { start, start_heading_rad, before: [f32::MAX; 2], last: Action::TurnLeft, way_out: vec![] }
    }

    /// The told pose in the world: place and heading.
    pub fn locate(&self, told: &Pose) -> (FloorPoint, f32) {
        let (sin, cos) = self.start_heading_rad.sin_cos();
        let [x, _, z] = told.position;
        let place = [self.start[0] + x * cos + z * sin, self.start[1] - x * sin + z * cos];
        (place, self.start_heading_rad + told.heading_rad)
    }

    /// The next move along `leg`, the shortest path to the aim. A body that is stuck turns once and goes on.
    pub fn step(&mut self, told: &Pose, leg: &[FloorPoint]) -> Action {
        let (place, heading_rad) = self.locate(told);
        let ahead = leg.iter().copied().find(|corner| distance_m(*corner, place) >= PASSED_M);
        let aim = ahead.or(leg.last().copied()).unwrap_or(place);
        let bearing_rad = (place[0] - aim[0]).atan2(place[1] - aim[1]);
        let turn_rad = (bearing_rad - heading_rad + std::f32::consts::PI).rem_euclid(std::f32::consts::TAU)
            - std::f32::consts::PI;
        let toward = if turn_rad > 0.0 { Action::TurnLeft } else { Action::TurnRight };
        if self.last == Action::MoveForward && distance_m(self.before, place) < 0.02 {
            self.way_out = vec![Action::MoveForward, toward];
        }
        let aligned = turn_rad.abs() <= HALF_TURN_RAD + 1e-3;
        let action = self.way_out.pop().unwrap_or(if aligned { Action::MoveForward } else { toward });
        (self.before, self.last) = (place, action);
        action
    }
}
