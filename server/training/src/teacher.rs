//! Teachers: privileged agents that answer in any state.

use crate::privileged::Guide;
use avln_episode::Action;
use avln_referee::Referee;
use avln_truth::{EpisodeTruth, StepFacts, Target};
use avln_world::{Point3, Pose};
use std::f32::consts::{PI, TAU};

/// A teacher.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Teacher {
    /// Walks the shortest tour through the open goals and claims each in its success region.
    Path,
}

/// Distance within which a corner counts as passed, metres.
const PASSED_M: f32 = 0.15;

/// Remaining way at which the teacher walks on into the region, metres: a way ends at the region's border.
const ARRIVED_M: f64 = 0.3;
/// Largest distance to the next place in the region, metres.
const INSIDE_M: f32 = 1.0;
/// A forward step below this displacement was blocked, metres. Sliding along a wall moves the body a little.
const STUCK_M: f32 = 0.02;

impl Teacher {
    /// Returns the action in the referee's state.
    pub(crate) fn action(self, referee: &Referee, guide: &Guide, truth: &EpisodeTruth) -> Action {
        let Some(goal) = guide.routed() else { return Action::Stop };
        if referee.is_in_region(goal) {
            let open = referee.is_open().iter().filter(|open| **open).count();
            let is_last = open == 1 || referee.remaining_submits() == 0;
            return if is_last { Action::Stop } else { Action::Submit };
        }
        let pose = referee.world().pose();
        let has_arrived = referee.walk_m(goal).is_some_and(|way_m| way_m < ARRIVED_M);
        let inside = if has_arrived { inner_place(&pose, &truth.targets[goal]) } else { None };
        let aim = inside.unwrap_or_else(|| aim(&pose, &referee.walk(goal).unwrap_or_default()));
        let turn_rad = (referee.rules().turn_deg as f32).to_radians();
        let bearing_rad = bearing_rad(&pose, &aim);
        match blocked_steps_ago(referee.facts(), &truth.start) {
            // A stuck body turns once and walks on.
            Some(1) if bearing_rad > 0.0 => Action::TurnLeft,
            Some(1) => Action::TurnRight,
            Some(2) => Action::MoveForward,
            _ => toward(bearing_rad, turn_rad),
        }
    }
}

/// Returns how long ago the last forward step was blocked, if that is the last or last but one step.
fn blocked_steps_ago(steps: &[StepFacts], start: &Pose) -> Option<usize> {
    let pose = |index: usize| steps.get(index).map_or(start, |step| &step.pose);
    let is_blocked = |ago: usize| {
        let Some(index) = steps.len().checked_sub(ago) else { return false };
        let before = index.checked_sub(1).map_or(start, pose);
        let moved_m = (pose(index).position - before.position).xz().norm();
        steps[index].action == Action::MoveForward && moved_m < STUCK_M
    };
    (1..=2).find(|&ago| is_blocked(ago))
}

/// Returns the place near the body that is closest to the target.
fn inner_place(pose: &Pose, target: &Target) -> Option<Point3<f32>> {
    let away_m = |place: &Point3<f32>| (place - pose.position).xz().norm();
    let center = target.bounds.center();
    let near = target.region.iter().filter(|place| (PASSED_M..INSIDE_M).contains(&away_m(place)));
    near.min_by(|a, b| (*a - center).norm().total_cmp(&(*b - center).norm())).copied()
}

/// Returns the next corner that is not yet passed.
fn aim(pose: &Pose, way: &[Point3<f32>]) -> Point3<f32> {
    let ahead = way.iter().find(|corner| (*corner - pose.position).xz().norm() >= PASSED_M);
    ahead.or(way.last()).copied().unwrap_or(pose.position)
}

/// Turns towards a bearing, or walks if no turn brings it closer to straight ahead.
fn toward(bearing_rad: f32, turn_rad: f32) -> Action {
    if bearing_rad.abs() <= 0.5 * turn_rad + 1e-3 {
        Action::MoveForward
    } else if bearing_rad > 0.0 {
        Action::TurnLeft
    } else {
        Action::TurnRight
    }
}

/// Returns a point's direction from straight ahead, radians, -π to π, positive to the left.
pub(crate) fn bearing_rad(pose: &Pose, point: &Point3<f32>) -> f32 {
    let offset = point - pose.position;
    let bearing_rad = avln_geom::angle::atan2(-offset.x, -offset.z);
    (bearing_rad - pose.heading_rad + PI).rem_euclid(TAU) - PI
}

/// Returns the direction of a way from straight ahead, radians.
pub(crate) fn way_bearing_rad(pose: &Pose, way: &[Point3<f32>]) -> f32 {
    bearing_rad(pose, &aim(pose, way))
}
