//! Privileged information: facts about the targets for losses and rewards, and teachers.

use crate::explorer::{Explorer, bearing_rad};
use crate::layout::{Layout, MAX_GOALS, Row};
use avln_episode::{Action, Order, Sensors};
use avln_referee::Referee;
use avln_scoring::efficiency;
use avln_truth::{EpisodeTruth, StepFacts, Target};
use avln_world::{CameraView, InstanceId, Point3, Pose, mpcat40_number};

/// Largest snap distance from a stored point to the mesh, metres.
const SNAP_M: f32 = 0.5;

/// The route through the open goals.
pub(crate) struct Guide {
    /// Walking distances from region to region, metres; infinite without a way.
    between_m: Vec<Vec<f64>>,
    /// Next goal; `None` if all are found or skipped.
    pub(crate) routed: Option<usize>,
}

impl Guide {
    /// Measures the ways between the targets.
    pub(crate) fn new(referee: &Referee, truth: &EpisodeTruth) -> Self {
        let navmesh = &referee.world().assets().navmesh;
        let goals = truth.targets.len();
        let nearest_m = |from: usize, to: usize| {
            let places = truth.targets[from].region.iter().filter_map(|place| navmesh.snap(place, SNAP_M));
            let ways_m = places.filter_map(|place| referee.walk_from_m(&place, to));
            ways_m.fold(f64::INFINITY, f64::min)
        };
        let row = |from| (0..goals).map(|to| if from == to { 0.0 } else { nearest_m(from, to) }).collect();
        let mut guide = Self { between_m: (0..goals).map(row).collect(), routed: None };
        guide.route(referee, truth.order);
        guide
    }

    /// Chooses the next goal: the given order, or the start of the shortest tour. A chosen goal stays until it is found.
    pub(crate) fn route(&mut self, referee: &Referee, order: Order) {
        let is_open = referee.is_open();
        if self.routed.is_some_and(|goal| is_open[goal]) {
            return;
        }
        let open: Vec<usize> = (0..is_open.len()).filter(|&goal| is_open[goal]).collect();
        self.routed = match order {
            Order::Ordered => open.first().copied(),
            Order::Unordered => open.iter().copied().min_by(|&a, &b| {
                let tour_m =
                    |first| referee.walk_m(first).unwrap_or(f64::INFINITY) + self.tour_m(first, &open);
                tour_m(a).total_cmp(&tour_m(b))
            }),
        };
    }

    /// Returns the shortest tour from a goal through all other open ones, metres.
    fn tour_m(&self, from: usize, open: &[usize]) -> f64 {
        let rest: Vec<usize> = open.iter().copied().filter(|&goal| goal != from).collect();
        let tours_m = rest.iter().map(|&next| self.between_m[from][next] + self.tour_m(next, &rest));
        if rest.is_empty() { 0.0 } else { tours_m.fold(f64::INFINITY, f64::min) }
    }
}

/// Writes the privileged entries.
pub(crate) fn put(
    row: &mut Row,
    layout: &Layout,
    referee: &Referee,
    guide: &Guide,
    truth: &EpisodeTruth,
    path_m: f64,
    explorer: Option<&Explorer>,
) {
    let goals = truth.targets.len().min(MAX_GOALS);
    let pose = referee.world().pose();
    let (mut distances_m, mut bearings_rad) = ([-1.0; MAX_GOALS], [0.0; MAX_GOALS]);
    let (mut positions, mut open, mut inside) = ([0.0; 3 * MAX_GOALS], [0; MAX_GOALS], [0; MAX_GOALS]);
    let is_open = referee.is_open();
    for goal in 0..goals {
        if let Some(way) = referee.walk(goal) {
            distances_m[goal] = referee.walk_m(goal).map_or(-1.0, |walk_m| walk_m as f32);
            bearings_rad[goal] = bearing_rad(&pose, &aim(&pose, &way));
        }
        let center = truth.targets[goal].bounds.center();
        let relative = Pose::new(center, 0.0).relative_to(&truth.start).position;
        positions[3 * goal..][..3].copy_from_slice(relative.coords.as_slice());
        open[goal] = u8::from(is_open[goal]);
        inside[goal] = u8::from(referee.is_in_region(goal));
    }
    row.put(layout, "distance_m", &distances_m);
    row.put(layout, "bearing_rad", &bearings_rad);
    row.put(layout, "target_position", &positions);
    row.put(layout, "is_open", &open);
    row.put(layout, "is_in_region", &inside);
    let number = |index: Option<usize>| index.map_or(-1, |index| index as i64);
    row.put(layout, "sounding", &[number(referee.sounding())]);
    row.put(layout, "routed", &[number(guide.routed)]);
    let expert = expert(referee, guide, truth, explorer);
    row.put(layout, "expert", &[i64::from(expert.index())]);
    row.put(layout, "expert_submit", &[u8::from(right_claim(referee).is_some())]);
    let success = if referee.is_found().iter().all(|found| *found) { 1.0 } else { 0.0 };
    row.put(layout, "success", &[success as f32]);
    row.put(layout, "spl", &[(success * efficiency(truth.reference_m, path_m)) as f32]);
}

/// Writes the images with instance and category numbers.
pub(crate) fn put_ids(row: &mut Row, layout: &Layout, referee: &Referee, truth: &EpisodeTruth) {
    let world = referee.world();
    let Sensors { width, height, hfov_rad, .. } = *referee.sensors();
    let camera = world.camera(CameraView { width, height, hfov_rad });
    let kept = referee.instances().filter(|kept| !kept.is_empty());
    let instances = kept.map_or_else(|| world.assets().render(&camera).instances, <[InstanceId]>::to_vec);
    let mut targets = [0; MAX_GOALS];
    targets.iter_mut().zip(&truth.targets).for_each(|(to, target)| *to = target.instance as i32);
    row.put(layout, "target_instance", &targets);
    // Neighbouring pixels mostly show the same instance.
    let mut last = (InstanceId::NONE, 0);
    if let Some(semantic) = row.array::<u8>(layout, "semantic") {
        for (to, &instance) in semantic.iter_mut().zip(&instances) {
            if instance != last.0 {
                let category = world.assets().scene.object(instance).map(|object| object.category.as_str());
                last = (instance, category.and_then(mpcat40_number).unwrap_or(0));
            }
            *to = last.1;
        }
    }
    if let Some(numbers) = row.array::<i32>(layout, "instance") {
        numbers.iter_mut().zip(&instances).for_each(|(to, instance)| *to = instance.0 as i32);
    }
}

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
fn right_claim(referee: &Referee) -> Option<(Action, usize)> {
    let claim = claim(referee);
    referee.completes(claim).map(|goal| (claim, goal))
}

fn claim(referee: &Referee) -> Action {
    let open = referee.is_open().iter().filter(|open| **open).count();
    if open <= 1 || referee.remaining_submits() == 0 { Action::Stop } else { Action::Submit }
}

/// Returns the action of the teacher [`Teacher::Path`], or with an explorer that of [`Teacher::Explore`].
fn expert(referee: &Referee, guide: &Guide, truth: &EpisodeTruth, explorer: Option<&Explorer>) -> Action {
    let Some(routed) = guide.routed else { return Action::Stop };
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
