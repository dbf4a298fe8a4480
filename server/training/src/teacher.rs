//! Teachers: privileged agents that answer in any state.

use crate::explorer::Explorer;
use crate::privileged::Guide;
use avln_episode::{Action, Order};
use avln_referee::Referee;
use avln_truth::{EpisodeTruth, StepFacts, Target};
use avln_world::{Point3, Pose};
use std::f32::consts::{PI, TAU};

/// A teacher, which claims a goal as soon as the claim is right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Teacher {
    /// Walks the shortest tour through the open goals.
    Path,
    /// Walks to the nearest floor that it has not seen; claims only goals whose targets it has seen within 3.5 m, and walks to such
    /// a target on the shortest path. Knows the floor in straight reach within 3.5 m and the camera's angle of view. With nothing
    /// left to see, it follows [`Teacher::Path`].
    Explore,
}

/// Distance within which a corner counts as passed, metres.
const PASSED_M: f32 = 0.15;

/// Remaining way at which the teacher walks on into the region, metres: a way ends at the region's border.
const ARRIVED_M: f64 = 0.3;
/// Largest distance to the next place in the region, metres.
const INSIDE_M: f32 = 1.0;
/// A forward step below this displacement was blocked, metres. Sliding along a wall moves the body a little.
const STUCK_M: f32 = 0.02;
/// Distance within which two blocked steps are at the same place, metres.
const SAME_PLACE_M: f32 = 0.5;
/// Most turns on a way out: all but one of a full turn.
const MOST_TURNS: usize = 11;

/// Returns the claim that is right here, with its goal: Stop for the last goal, and without remaining Submits.
pub(crate) fn right_claim(referee: &Referee) -> Option<(Action, usize)> {
    let claim = claim(referee);
    referee.completes(claim).map(|goal| (claim, goal))
}

fn claim(referee: &Referee) -> Action {
    let open = referee.is_open().iter().filter(|open| **open).count();
    if open <= 1 || referee.remaining_submits() == 0 { Action::Stop } else { Action::Submit }
}

/// Returns the action of the teacher [`Teacher::Path`], or with an explorer that of [`Teacher::Explore`].
pub(crate) fn expert(
    referee: &Referee,
    guide: &Guide,
    truth: &EpisodeTruth,
    explorer: Option<&Explorer>,
) -> Action {
    let Some(routed) = guide.routed() else { return Action::Stop };
    let is_known = |goal: usize| explorer.is_none_or(|explorer| explorer.has_seen(goal));
    if let Some((claim, goal)) = right_claim(referee)
        && is_known(goal)
    {
        return claim;
    }
    let goal = match truth.order {
        Order::Unordered if explorer.is_some() => nearest(referee, is_known),
        _ => Some(routed).filter(|&goal| is_known(goal)),
    };
    match (goal, explorer.and_then(Explorer::next)) {
        (None, Some(unseen)) => {
            let world = referee.world();
            let way = world.assets().navmesh.path(&world.standing(), &unseen);
            follow(referee, truth, &aim(&world.pose(), &way.unwrap_or_default()))
        }
        _ => approach(referee, truth, goal.unwrap_or(routed)),
    }
}

/// Returns the nearest open goal among the known ones.
fn nearest(referee: &Referee, is_known: impl Fn(usize) -> bool) -> Option<usize> {
    let is_open = referee.is_open();
    let known = (0..is_open.len()).filter(|&goal| is_open[goal] && is_known(goal));
    let away_m = |goal: &usize| referee.walk_m(*goal).unwrap_or(f64::INFINITY);
    known.min_by(|a, b| away_m(a).total_cmp(&away_m(b)))
}

/// Returns the next action on the shortest way to a goal, or its claim inside the region.
fn approach(referee: &Referee, truth: &EpisodeTruth, goal: usize) -> Action {
    if referee.is_in_region(goal) {
        return claim(referee);
    }
    let pose = referee.world().pose();
    let has_arrived = referee.walk_m(goal).is_some_and(|way_m| way_m < ARRIVED_M);
    let inside = if has_arrived { inner_place(&pose, &truth.targets[goal]) } else { None };
    let aim = inside.unwrap_or_else(|| aim(&pose, &referee.walk(goal).unwrap_or_default()));
    follow(referee, truth, &aim)
}

/// Returns the next action towards a place in straight reach. A stuck body turns and walks on.
fn follow(referee: &Referee, truth: &EpisodeTruth, aim: &Point3<f32>) -> Action {
    let turn_rad = (referee.rules().turn_deg as f32).to_radians();
    let bearing_rad = bearing_rad(&referee.world().pose(), aim);
    way_out(referee.facts(), &truth.start, bearing_rad).unwrap_or_else(|| toward(bearing_rad, turn_rad))
}

/// Returns the next action of a stuck body: one turn and a step, and one more turn each time that it is stuck at the same place
/// again. A function of the steps, so that the teacher answers in any state.
fn way_out(steps: &[StepFacts], start: &Pose, bearing_rad: f32) -> Option<Action> {
    let (last, turns) = last_blocked(steps, start)?;
    let since = &steps[last + 1..];
    let side = if bearing_rad > 0.0 { Action::TurnLeft } else { Action::TurnRight };
    let side = since.first().map_or(side, |step| step.action);
    let is_turning = matches!(side, Action::TurnLeft | Action::TurnRight);
    if !is_turning || since.len() > turns || since.iter().any(|step| step.action != side) {
        return None;
    }
    Some(if since.len() < turns { side } else { Action::MoveForward })
}

/// Returns the last blocked step, and the number of turns after it.
fn last_blocked(steps: &[StepFacts], start: &Pose) -> Option<(usize, usize)> {
    let mut last: Option<(usize, usize, Point3<f32>)> = None;
    let mut before = start.position;
    for (index, step) in steps.iter().enumerate() {
        let place = step.pose.position;
        if step.action == Action::MoveForward && (place - before).xz().norm() < STUCK_M {
            let is_same = |stuck: &Point3<f32>| (place - stuck).xz().norm() < SAME_PLACE_M;
            let turns = last.filter(|(_, _, stuck)| is_same(stuck)).map_or(0, |(_, turns, _)| turns);
            last = Some((index, turns % MOST_TURNS + 1, place));
        }
        before = place;
    }
    last.map(|(index, turns, _)| (index, turns))
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
