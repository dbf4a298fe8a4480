//! Privileged information: facts about the targets for losses, teachers and rewards.

use crate::explorer::Explorer;
use crate::layout::{Layout, MAX_GOALS, Row, copy};
use crate::teacher::{expert, right_claim, way_bearing_rad};
use avln_episode::{Order, Sensors};
use avln_referee::Referee;
use avln_truth::EpisodeTruth;
use avln_world::{CameraView, InstanceId, Pose, mpcat40_number};

/// Largest snap distance from a stored point to the mesh, metres.
const SNAP_M: f32 = 0.5;

/// The route through the open goals.
pub(crate) struct Guide {
    /// Walking distances from region to region, metres; infinite without a way.
    between_m: Vec<Vec<f64>>,
    routed: Option<usize>,
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

    /// Returns the next goal; `None` if all are found.
    pub(crate) fn routed(&self) -> Option<usize> {
        self.routed
    }

    pub(crate) fn set_routed(&mut self, goal: Option<usize>) {
        self.routed = goal;
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
            bearings_rad[goal] = way_bearing_rad(&pose, &way);
        }
        let center = truth.targets[goal].bounds.center();
        let relative = Pose::new(center, 0.0).relative_to(&truth.start).position;
        positions[3 * goal..][..3].copy_from_slice(relative.coords.as_slice());
        open[goal] = u8::from(is_open[goal]);
        inside[goal] = u8::from(referee.is_in_region(goal));
    }
    copy(row.floats(layout, "distance_m"), Some(&distances_m));
    copy(row.floats(layout, "bearing_rad"), Some(&bearings_rad));
    copy(row.floats(layout, "target_position"), Some(&positions));
    copy(row.bytes(layout, "is_open"), Some(&open));
    copy(row.bytes(layout, "is_in_region"), Some(&inside));
    let number = |index: Option<usize>| index.map_or(-1, |index| index as i64);
    copy(row.integers(layout, "sounding"), Some(&[number(referee.sounding())]));
    copy(row.integers(layout, "routed"), Some(&[number(guide.routed())]));
    let expert = expert(referee, guide, truth, explorer);
    copy(row.integers(layout, "expert"), Some(&[i64::from(expert.index())]));
    copy(row.bytes(layout, "expert_submit"), Some(&[u8::from(right_claim(referee).is_some())]));
    let success = if is_open.iter().any(|open| *open) { 0.0 } else { 1.0 };
    let share = truth.reference_m / truth.reference_m.max(path_m).max(1e-9);
    copy(row.floats(layout, "success"), Some(&[success]));
    copy(row.floats(layout, "spl"), Some(&[success * share as f32]));
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
    copy(row.shorts(layout, "target_instance"), Some(&targets));
    // Neighbouring pixels mostly show the same instance.
    let mut last = (InstanceId::NONE, 0);
    if let Some(semantic) = row.bytes(layout, "semantic") {
        for (to, &instance) in semantic.iter_mut().zip(&instances) {
            if instance != last.0 {
                let category = world.assets().scene.object(instance).map(|object| object.category.as_str());
                last = (instance, category.and_then(mpcat40_number).unwrap_or(0));
            }
            *to = last.1;
        }
    }
    if let Some(numbers) = row.shorts(layout, "instance") {
        numbers.iter_mut().zip(&instances).for_each(|(to, instance)| *to = instance.0 as i32);
    }
}
