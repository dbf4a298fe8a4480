//! Ground truth for privileged agents: the running episodes' states, as hints.

use avln_episode::{Order, Pose, Rules};
use avln_geom::{Aabb, Point3, angle};
use avln_kit::geometry::FloorPoint;
use avln_kit::perception::{Hints, TargetHint};
use avln_referee::Referee;
use avln_truth::EpisodeTruth;
use avln_world::{InstanceId, SceneAssets};
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_4, PI, TAU};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Largest distance to a visible target, metres.
const IN_VIEW_M: f32 = 6.0;

/// An episode's state at the last observation.
pub(super) struct EpisodeState {
    pub(super) pose: Pose,
    /// Position of the sounding source, a target or a distractor.
    source: Option<Point3<f32>>,
    /// Unfinished goals, by index.
    pub(super) is_open: Vec<bool>,
    pub(super) assets: Arc<SceneAssets>,
}

/// Running episodes' states, by handle.
#[derive(Default)]
pub(super) struct LiveEpisodes(Mutex<BTreeMap<String, Arc<EpisodeState>>>);

impl LiveEpisodes {
    pub(super) fn note(&self, handle: &str, referee: &Referee) {
        let state = EpisodeState {
            pose: referee.world().pose(),
            source: referee.sounding_position(),
            is_open: referee.is_open(),
            assets: referee.world().assets().clone(),
        };
        self.lock().insert(handle.to_owned(), Arc::new(state));
    }

    pub(super) fn forget(&self, handle: &str) {
        self.lock().remove(handle);
    }

    fn last(&self, handle: &str) -> Option<Arc<EpisodeState>> {
        self.lock().get(handle).cloned()
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Arc<EpisodeState>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Hints with ground truth for a privileged agent.
pub(super) struct TrueHints {
    live: Arc<LiveEpisodes>,
    pub(super) rules: Rules,
    episode: Mutex<Option<(String, Arc<EpisodeTruth>)>>,
}

impl TrueHints {
    pub(super) fn new(live: Arc<LiveEpisodes>, rules: Rules) -> Self {
        Self { live, rules, episode: Mutex::default() }
    }

    /// Switches to a handle's episode.
    pub(super) fn follow(&self, handle: &str, truth: EpisodeTruth) {
        let episode = Some((handle.to_owned(), Arc::new(truth)));
        *self.episode.lock().unwrap_or_else(PoisonError::into_inner) = episode;
    }

    /// Returns the episode's ground truth and state.
    pub(super) fn now(&self) -> Option<(Arc<EpisodeTruth>, Arc<EpisodeState>)> {
        let episode = self.episode.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let (handle, truth) = episode?;
        Some((truth, self.live.last(&handle)?))
    }
}

impl Hints for TrueHints {
    fn source(&self) -> Option<FloorPoint> {
        let (truth, now) = self.now()?;
        let source = in_agent_frame(&truth.start, &now.source?);
        Some(FloorPoint::new(source.x, source.z))
    }

    fn targets(&self) -> Vec<TargetHint> {
        let Some((truth, now)) = self.now() else { return Vec::new() };
        let in_view = |goal: &usize| {
            let target = &truth.targets[*goal];
            let mut eye = now.pose.position;
            eye.y += self.rules.camera_height_m;
            now.is_open[*goal]
                && target.bounds.distance_m(&eye) <= IN_VIEW_M
                && is_ahead(&now.pose, &target.bounds)
                && now.assets.sees(&eye, InstanceId(target.instance), Rules::HALF_VIEW_RAD)
        };
        let goals = (0..truth.targets.len()).filter(in_view);
        goals.map(|goal| hint(goal, &truth.targets[goal].bounds, &truth.start, now.pose.position.y)).collect()
    }
}

/// Returns the open goals that a Submit can complete.
pub(super) fn claimable(order: Order, open: &[usize]) -> &[usize] {
    match order {
        Order::Ordered => &open[..open.len().min(1)],
        Order::Unordered => open,
    }
}

/// Returns the direction of a floor position `aim` from straight ahead, radians, -π to π, positive to the left.
pub(super) fn bearing_rad(here: [f32; 2], heading_rad: f32, aim: [f32; 2]) -> f32 {
    let bearing_rad = angle::atan2(here[0] - aim[0], here[1] - aim[1]);
    (bearing_rad - heading_rad + PI).rem_euclid(TAU) - PI
}

/// Converts a world position to the agent's frame, with origin `start`.
fn in_agent_frame(start: &Pose, place: &Point3<f32>) -> Point3<f32> {
    Pose::new(*place, 0.0).relative_to(start).position
}

/// Returns `true` if a box's centre is within 45 degrees of the view direction.
fn is_ahead(pose: &Pose, bounds: &Aabb) -> bool {
    let middle = bounds.min + (bounds.max - bounds.min) * 0.5;
    let [here, middle] = [&pose.position, &middle].map(|place| [place.x, place.z]);
    bearing_rad(here, pose.heading_rad, middle).abs() <= FRAC_PI_4
}

/// Returns the hint for a visible target: the box in the agent's frame, heights above the floor.
fn hint(goal: usize, bounds: &Aabb, start: &Pose, floor_y_m: f32) -> TargetHint {
    let corners = [bounds.min.x, bounds.max.x].into_iter().flat_map(|x| {
        [bounds.min.z, bounds.max.z].map(|z| in_agent_frame(start, &Point3::new(x, bounds.min.y, z)))
    });
    let (mut min_m, mut max_m) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for corner in corners {
        (min_m[0], max_m[0]) = (min_m[0].min(corner.x), max_m[0].max(corner.x));
        (min_m[2], max_m[2]) = (min_m[2].min(corner.z), max_m[2].max(corner.z));
    }
    (min_m[1], max_m[1]) = (bounds.min.y - floor_y_m, bounds.max.y - floor_y_m);
    TargetHint { goal, min_m, max_m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::FRAC_PI_2;

    #[test]
    fn target_boxes_are_in_the_start_frame() {
        // Turned left by a quarter, ahead is -x of the world; the box is 2 to 3 m ahead and up to 1 m to the right.
        let start = Pose::new(Point3::new(5.0, 0.5, 5.0), FRAC_PI_2);
        let bounds = Aabb::new(Point3::new(2.0, 0.5, 4.0), Point3::new(3.0, 1.3, 5.0));
        let seen = hint(1, &bounds, &start, 0.5);
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(near(seen.min_m, [0.0, 0.0, -3.0]) && near(seen.max_m, [1.0, 0.8, -2.0]), "{seen:?}");
        assert!(is_ahead(&start, &bounds) && !is_ahead(&Pose { heading_rad: 0.0, ..start }, &bounds));
    }
}
