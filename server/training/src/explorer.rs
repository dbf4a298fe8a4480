//! A frontier explorer: the floor seen so far, and the nearest unseen part.
//!
//! The state is a function of the poses since the start, so that it can be rebuilt from a record.

use avln_episode::Rules;
use avln_truth::Target;
use avln_world::{InstanceId, NavMesh, NavPoint, Places, Point3, Pose, Scene, SceneAssets, Vector3};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// Range within which floor and targets are seen, metres: that of the explorer of HM3D-OVON.
const RANGE_M: f64 = 3.5;
/// Range within which the floor is seen in all directions, metres; also the neighbours of its places, around corners.
const FEET_M: f64 = 0.3;
/// Steps per metre, and further steps, after which a place counts as seen: the body does not reach it.
const PATIENCE: (f64, f64) = (12.0, 24.0);
/// Fewest connected unseen places worth a visit: 1 square metre.
const LEAST_UNSEEN: usize = 16;
/// Largest snap distance from the body to the mesh, metres.
const SNAP_M: f32 = 0.3;

/// The explorer of an episode.
pub(crate) struct Explorer {
    assets: Arc<SceneAssets>,
    grid: Arc<FloorGrid>,
    half_hfov_rad: f32,
    camera_height_m: f32,
    /// Per place of the grid.
    seen: Vec<bool>,
    /// Per goal: true once its target was in view and in range.
    seen_targets: Vec<bool>,
    /// Body position of `reach`.
    stood: Option<Point3<f32>>,
    /// Places in straight reach, ascending, with their distances in metres.
    reach: Vec<(u32, f64)>,
    /// Unseen place, the nearest one when it was chosen; `None` if all is seen.
    next: Option<u32>,
    /// Steps until `next` counts as seen.
    patience: u32,
}

/// A place at the border of the search, by distance; equal distances by number.
#[derive(PartialEq)]
struct Border(f64, u32);

impl Eq for Border {}

impl PartialOrd for Border {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Border {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

impl Explorer {
    /// Creates an explorer that has seen nothing.
    pub(crate) fn new(
        assets: Arc<SceneAssets>,
        grid: Arc<FloorGrid>,
        goals: usize,
        rules: &Rules,
        hfov_rad: f32,
    ) -> Self {
        let (seen, seen_targets) = (vec![false; grid.places.len()], vec![false; goals]);
        let (half_hfov_rad, camera_height_m) = (0.5 * hfov_rad, rules.camera_height_m);
        let (stood, reach, next) = (None, Vec::new(), None);
        Self {
            assets,
            grid,
            half_hfov_rad,
            camera_height_m,
            seen,
            seen_targets,
            stood,
            reach,
            next,
            patience: 0,
        }
    }

    /// Returns true if a goal's target was in view and in range.
    pub(crate) fn has_seen(&self, goal: usize) -> bool {
        self.seen_targets[goal]
    }

    /// Returns the unseen place to visit; `None` if all is seen.
    pub(crate) fn next(&self) -> Option<NavPoint> {
        self.next.map(|place| self.grid.places[place as usize])
    }

    /// Adds the view from a pose.
    pub(crate) fn look(&mut self, pose: &Pose, targets: &[Target]) {
        if self.stood != Some(pose.position) {
            let navmesh = &self.assets.navmesh;
            let standing = navmesh.snap(&pose.position, SNAP_M);
            let reach = standing.map(|standing| navmesh.exits(&standing, &self.grid.index).places);
            (self.stood, self.reach) = (Some(pose.position), reach.unwrap_or_default());
        }
        for &(place, distance_m) in &self.reach {
            let is_ahead = || self.is_ahead(pose, &self.grid.places[place as usize].position());
            self.seen[place as usize] |= distance_m < FEET_M || distance_m < RANGE_M && is_ahead();
        }
        let under = self.reach.iter().filter(|(_, distance_m)| *distance_m < FEET_M);
        for (next, _) in under.flat_map(|&(place, _)| self.grid.neighbours(place)) {
            self.seen[next as usize] = true;
        }
        for (goal, target) in targets.iter().enumerate() {
            self.seen_targets[goal] = self.seen_targets[goal] || self.sees(pose, target);
        }
        self.choose();
    }

    /// Chooses another place, if the present one is seen or not reached in time.
    fn choose(&mut self) {
        self.patience = self.patience.saturating_sub(1);
        if let Some(place) = self.next.filter(|_| self.patience == 0) {
            self.seen[place as usize] = true;
        }
        if self.next.is_none_or(|place| self.seen[place as usize]) {
            let nearest = self.nearest_unseen();
            self.next = nearest.map(|(_, place)| place);
            let (steps_per_m, further) = PATIENCE;
            self.patience = nearest.map_or(0, |(way_m, _)| (further + steps_per_m * way_m) as u32);
        }
    }

    fn sees(&self, pose: &Pose, target: &Target) -> bool {
        let eye = pose.position + Vector3::y() * self.camera_height_m;
        f64::from(target.bounds.distance_m(&eye)) < RANGE_M
            && self
                .assets
                .visible_points(&eye, InstanceId(target.instance), Rules::HALF_VIEW_RAD)
                .any(|point| self.is_ahead(pose, point))
    }

    fn is_ahead(&self, pose: &Pose, point: &Point3<f32>) -> bool {
        bearing_rad(pose, point).abs() <= self.half_hfov_rad
    }

    /// Returns the nearest unseen place on ways over seen ones, with its distance in metres (Dijkstra 1959).
    fn nearest_unseen(&mut self) -> Option<(f64, u32)> {
        let mut ways_m = vec![f64::INFINITY; self.seen.len()];
        let mut border = BinaryHeap::new();
        for &(place, distance_m) in self.reach.iter().filter(|(_, distance_m)| *distance_m < RANGE_M) {
            ways_m[place as usize] = distance_m;
            border.push(Reverse(Border(distance_m, place)));
        }
        while let Some(Reverse(Border(way_m, place))) = border.pop() {
            if way_m > ways_m[place as usize] {
                continue;
            }
            if !self.seen[place as usize] {
                let around = self.unseen_around(place);
                if around.len() >= LEAST_UNSEEN {
                    return Some((way_m, place));
                }
                around.iter().for_each(|&place| self.seen[place as usize] = true);
            }
            for (next, step_m) in self.grid.neighbours(place) {
                if way_m + step_m < ways_m[next as usize] {
                    ways_m[next as usize] = way_m + step_m;
                    border.push(Reverse(Border(way_m + step_m, next)));
                }
            }
        }
        None
    }

    /// Returns the unseen places connected with one of them, at most about [`LEAST_UNSEEN`].
    fn unseen_around(&self, place: u32) -> Vec<u32> {
        let mut found = vec![place];
        let mut next = 0;
        while next < found.len() && found.len() < LEAST_UNSEEN {
            for (neighbour, _) in self.grid.neighbours(found[next]) {
                if !self.seen[neighbour as usize] && !found.contains(&neighbour) {
                    found.push(neighbour);
                }
            }
            next += 1;
        }
        found
    }
}

/// Distance between neighbouring places along x and z, metres.
pub(crate) const SPACING_M: f32 = 0.25;
/// Largest distance between the end of a straight way and a place, metres.
const SAME_PLACE_M: f32 = 0.02;

/// Places on all storeys, with links between neighbours in straight reach.
pub(crate) struct FloorGrid {
    /// The places.
    pub(crate) places: Vec<NavPoint>,
    /// Index of the places by visibility.
    pub(crate) index: Places,
    /// Per place: neighbours, ascending.
    links: Vec<Vec<u32>>,
}

impl FloorGrid {
    /// Lays a grid on the floor.
    pub(crate) fn new(scene: &Scene, navmesh: &NavMesh) -> Self {
        let bounds = scene.bounds().map(|bounds| bounds.grown(1.0));
        let points = bounds.map(|bounds| navmesh.grid(&bounds, SPACING_M)).unwrap_or_default();
        let mut links = vec![Vec::new(); points.len()];
        let columns = columns(&points);
        for (from, point) in (0u32..).zip(&points) {
            for to in neighbours(navmesh, &points, &columns, point) {
                links[from as usize].push(to);
                links[to as usize].push(from);
            }
        }
        links.iter_mut().for_each(|links| links.sort_unstable());
        let index = Places::new(navmesh, &points);
        Self { places: points, index, links }
    }

    /// Returns the neighbours of a place, with their distances in metres.
    pub(crate) fn neighbours(&self, place: u32) -> impl Iterator<Item = (u32, f64)> {
        let from = self.places[place as usize].position();
        let distance_m = move |to: u32| f64::from((self.places[to as usize].position() - from).norm());
        self.links[place as usize].iter().map(move |&to| (to, distance_m(to)))
    }
}

/// Numbers of the places per column of the grid.
type Columns = BTreeMap<[i32; 2], Vec<u32>>;

fn column(place: &Point3<f32>) -> [i32; 2] {
    [place.x, place.z].map(|along| (along / SPACING_M).round() as i32)
}

fn columns(points: &[NavPoint]) -> Columns {
    let mut columns = Columns::new();
    for (number, point) in (0..).zip(points) {
        columns.entry(column(&point.position())).or_default().push(number);
    }
    columns
}

/// Returns the neighbours towards +x and +z in straight reach: one of each pair.
fn neighbours(navmesh: &NavMesh, points: &[NavPoint], columns: &Columns, from: &NavPoint) -> Vec<u32> {
    let [x, z] = column(&from.position());
    let steps = [[1, -1], [1, 0], [1, 1], [0, 1]];
    let reached = steps.iter().filter_map(|[dx, dz]| {
        let there = columns.get(&[x + dx, z + dz])?;
        let offset = Vector3::new(*dx as f32 * SPACING_M, 0.0, *dz as f32 * SPACING_M);
        let slide = navmesh.slide(from, &offset);
        let is_there =
            |to: &&u32| (points[**to as usize].position() - slide.end.position()).norm() < SAME_PLACE_M;
        there.iter().find(is_there).copied().filter(|_| !slide.blocked)
    });
    reached.collect()
}

/// Returns a point's direction from straight ahead, radians, -π to π, positive to the left.
pub(crate) fn bearing_rad(pose: &Pose, point: &Point3<f32>) -> f32 {
    let offset = point - pose.position;
    let bearing_rad = avln_geom::angle::atan2(-offset.x, -offset.z);
    (bearing_rad - pose.heading_rad + PI).rem_euclid(TAU) - PI
}
