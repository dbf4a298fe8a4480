//! Maps of a storey from above, and parts of a picture of an episode.

use avln_referee::Referee;
use avln_truth::EpisodeTruth;
use avln_world::{CameraView, Point3, Pose, SceneAssets, Vector3};
use serde::Serialize;
use std::collections::BTreeMap;

/// No floor and no obstacle.
const UNKNOWN: u8 = 0;
/// Walkable floor.
const FREE: u8 = 1;
/// Wall, furniture, or floor without room for the body.
const OBSTACLE: u8 = 2;
/// Points within this height of a storey belong to it, metres.
const STOREY_M: f32 = 1.0;
/// Least walkable area of a storey, square metres.
const LEAST_STOREY_M2: f32 = 2.0;
/// Largest snap distance from a point on the floor to the mesh, metres.
const SNAP_M: f32 = 0.3;
/// Longest way through a wall along the map's axes, metres.
const WALL_M: f32 = 0.5;
/// Begin of the vertical rays for obstacles above the storey, and their length, metres.
const RAY_M: (f32, f32) = (2.0, 2.5);

/// Place and scale of a square map: row 0 is farthest ahead of the origin pose, column 0 farthest to its left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MapFrame {
    /// Pose in the middle of the map.
    pub(crate) origin: Pose,
    /// Cell side, metres.
    pub(crate) cell_m: f32,
    /// Cells per side.
    pub(crate) side: usize,
    /// True to mark the inside of walls as obstacle; in pictures, unknown cells show the walls as lines.
    pub(crate) has_solid_walls: bool,
}

impl MapFrame {
    /// Returns column and row of a world position, cells from the top-left corner.
    pub(crate) fn cells(&self, place: &Point3<f32>) -> [f32; 2] {
        let relative = Pose::new(*place, 0.0).relative_to(&self.origin).position;
        [relative.x, relative.z].map(|along_m| along_m / self.cell_m + 0.5 * self.side as f32)
    }

    /// Returns a cell's centre at a height, world frame.
    fn center(&self, column: usize, row: usize, y_m: f32) -> Point3<f32> {
        let [x_m, z_m] = [column, row].map(|cell| (cell as f32 + 0.5 - 0.5 * self.side as f32) * self.cell_m);
        let place = self.origin.position + self.origin.right() * x_m - self.origin.forward() * z_m;
        Point3::new(place.x, y_m, place.z)
    }
}

/// The maps of a building in one frame, made on first use.
pub(crate) struct StoreyMaps {
    pub(crate) frame: MapFrame,
    /// Walkable polygons in reach of the origin.
    polygons: Vec<Vec<Point3<f32>>>,
    /// Floor heights, metres.
    storeys_m: Vec<f32>,
    maps: BTreeMap<usize, Vec<u8>>,
}

impl StoreyMaps {
    /// Finds the storeys of a building.
    pub(crate) fn new(assets: &SceneAssets, frame: MapFrame) -> Self {
        let navmesh = &assets.navmesh;
        let island = |place: &Point3<f32>| navmesh.snap(place, SNAP_M).map(|point| navmesh.island_of(&point));
        let home = island(&frame.origin.position);
        let mut polygons = navmesh.polygons();
        polygons.retain(|polygon| island(&middle(polygon)) == home);
        let storeys_m = storeys_m(&polygons);
        Self { frame, polygons, storeys_m, maps: BTreeMap::new() }
    }

    /// Returns the storey of a floor height.
    pub(crate) fn storey(&self, y_m: f32) -> usize {
        let away_m = |storey: &usize| (self.storeys_m[*storey] - y_m).abs();
        (0..self.storeys_m.len()).min_by(|a, b| away_m(a).total_cmp(&away_m(b))).unwrap_or(0)
    }

    /// Returns the map of a storey, row-major.
    pub(crate) fn map(&mut self, assets: &SceneAssets, storey: usize) -> &[u8] {
        let Self { frame, polygons, storeys_m, maps } = self;
        maps.entry(storey).or_insert_with(|| {
            let y_m = storeys_m.get(storey).copied().unwrap_or(frame.origin.position.y);
            let mut map = vec![UNKNOWN; frame.side * frame.side];
            put_obstacles(&mut map, frame, assets, y_m);
            for polygon in polygons.iter().filter(|polygon| (middle(polygon).y - y_m).abs() < STOREY_M) {
                put_floor(&mut map, frame, polygon);
            }
            if frame.has_solid_walls {
                fill_walls(&mut map, frame);
            }
            map
        })
    }
}

fn middle(polygon: &[Point3<f32>]) -> Point3<f32> {
    let sum: Vector3<f32> = polygon.iter().map(|corner| corner.coords).sum();
    Point3::from(sum / polygon.len() as f32)
}

fn area_m2(polygon: &[Point3<f32>]) -> f32 {
    let Some((first, rest)) = polygon.split_first() else { return 0.0 };
    rest.windows(2).map(|pair| 0.5 * (pair[0] - first).xz().perp(&(pair[1] - first).xz()).abs()).sum()
}

/// Returns the heights with the largest walkable areas, at least twice [`STOREY_M`] apart.
fn storeys_m(polygons: &[Vec<Point3<f32>>]) -> Vec<f32> {
    let mut areas = BTreeMap::<i32, f32>::new();
    for polygon in polygons {
        *areas.entry((middle(polygon).y / 0.1).round() as i32).or_default() += area_m2(polygon);
    }
    let mut levels: Vec<(i32, f32)> = areas.into_iter().collect();
    levels.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut storeys_m: Vec<f32> = Vec::new();
    for (level, area_m2) in levels {
        let y_m = level as f32 * 0.1;
        let is_apart = storeys_m.iter().all(|other_m| (other_m - y_m).abs() >= 2.0 * STOREY_M);
        if is_apart && (area_m2 >= LEAST_STOREY_M2 || storeys_m.is_empty()) {
            storeys_m.push(y_m);
        }
    }
    storeys_m
}

/// Marks the cells over a surface.
fn put_obstacles(map: &mut [u8], frame: &MapFrame, assets: &SceneAssets, y_m: f32) {
    let Some(bounds) = assets.scene.bounds() else { return };
    let (above_m, reach_m) = RAY_M;
    let down = -Vector3::y();
    for (index, cell) in map.iter_mut().enumerate() {
        let from = frame.center(index % frame.side, index / frame.side, y_m + above_m);
        let is_inside = (bounds.min.x..=bounds.max.x).contains(&from.x)
            && (bounds.min.z..=bounds.max.z).contains(&from.z);
        if is_inside && assets.cast(&from, &down, reach_m).is_some() {
            *cell = OBSTACLE;
        }
    }
}

/// Marks the cells whose centre is in a convex polygon.
fn put_floor(map: &mut [u8], frame: &MapFrame, polygon: &[Point3<f32>]) {
    let corners: Vec<[f32; 2]> = polygon.iter().map(|corner| frame.cells(corner)).collect();
    let range = |axis: usize| {
        let along = || corners.iter().map(|corner| corner[axis]);
        let first = along().fold(f32::INFINITY, f32::min).floor().max(0.0) as usize;
        let end = along().fold(f32::NEG_INFINITY, f32::max).ceil().max(0.0) as usize;
        first..end.min(frame.side)
    };
    for row in range(1) {
        for column in range(0) {
            if is_within(&corners, [column as f32 + 0.5, row as f32 + 0.5]) {
                map[row * frame.side + column] = FREE;
            }
        }
    }
}

/// Marks short unknown runs between known cells of a row or column: the inside of walls, which has no surface.
fn fill_walls(map: &mut [u8], frame: &MapFrame) {
    let (side, longest) = (frame.side, (WALL_M / frame.cell_m) as usize);
    let lines = (0..side).flat_map(|line| [(line * side, 1), (line, side)]);
    let inside: Vec<usize> =
        lines.flat_map(|(first, stride)| gaps(map, first, stride, side, longest)).collect();
    inside.into_iter().for_each(|index| map[index] = OBSTACLE);
}

/// Returns the unknown cells of a line in runs of at most `longest` cells between known ones.
fn gaps(map: &[u8], first: usize, stride: usize, side: usize, longest: usize) -> Vec<usize> {
    let line: Vec<usize> = (0..side).map(|step| first + step * stride).collect();
    let known = (0..side).filter(|step| map[line[*step]] != UNKNOWN);
    let mut last = None;
    let mut found = Vec::new();
    for step in known {
        if let Some(last) = last.replace(step).filter(|last| step - last - 1 <= longest) {
            found.extend(&line[last + 1..step]);
        }
    }
    found
}

/// Returns true for a point in a convex polygon with corners in either direction.
fn is_within(corners: &[[f32; 2]], [x, y]: [f32; 2]) -> bool {
    let next = corners.iter().cycle().skip(1);
    let sides =
        corners.iter().zip(next).map(|([ax, ay], [bx, by])| (bx - ax) * (y - ay) - (by - ay) * (x - ax));
    let (is_left, is_right) =
        sides.fold((true, true), |(left, right), side| (left && side >= 0.0, right && side <= 0.0));
    is_left || is_right
}

/// Cell side of the map, metres.
const CELL_M: f32 = 0.05;
/// Cells per side.
const SIDE: usize = 1024;

/// Parts of a picture. Places are columns and rows of the map, in cells from the top-left corner; the map shows the storey of the
/// agent, with -z of the scene at the top.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overview {
    /// The agent's view without noise: `side × side × 3` bytes, sRGB.
    #[serde(skip)]
    pub view: Vec<u8>,
    /// Map, `map_side × map_side`: 0 unknown, 1 walkable, 2 obstacle.
    #[serde(skip)]
    pub map: Vec<u8>,
    /// Cells per side of the map.
    pub map_side: usize,
    /// Cell side, metres.
    pub cell_m: f32,
    /// Walked lines on this storey.
    pub paths: Vec<Vec<[f32; 2]>>,
    /// Agent.
    pub agent: [f32; 2],
    /// Agent's heading, radians, 0 to the top, left positive.
    pub heading_rad: f32,
    /// Targets in goal order.
    pub targets: Vec<TargetMark>,
    /// Sounding source, if it is on this storey.
    pub sound: Option<[f32; 2]>,
}

/// A target in a picture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TargetMark {
    /// Centre.
    pub place: [f32; 2],
    /// True until it is found or skipped.
    pub is_open: bool,
    /// True if it is on the agent's storey.
    pub is_here: bool,
}

/// Returns the frame of the map: the scene's axes around the start.
pub(crate) fn overview_frame(truth: &EpisodeTruth) -> MapFrame {
    MapFrame {
        origin: Pose::new(truth.start.position, 0.0),
        cell_m: CELL_M,
        side: SIDE,
        has_solid_walls: false,
    }
}

impl Overview {
    pub(crate) fn new(referee: &Referee, truth: &EpisodeTruth, maps: &mut StoreyMaps, side: u32) -> Self {
        let (world, frame) = (referee.world(), maps.frame);
        let pose = world.pose();
        let view = CameraView { width: side, height: side, hfov_rad: referee.sensors().hfov_rad };
        let storey = maps.storey(pose.position.y);
        let is_here = |y_m: f32| maps.storey(y_m) == storey;
        let is_open = referee.is_open();
        let mark = |(target, &is_open): (&avln_truth::Target, &bool)| TargetMark {
            place: frame.cells(&target.bounds.center()),
            is_open,
            is_here: is_here(target.floor_y_m),
        };
        // Sources are at most a room's height above their floor.
        let sound = referee.sounding_position().filter(|place| is_here(place.y - 1.0));
        Self {
            view: world.assets().render(&world.camera(view)).rgb,
            map_side: SIDE,
            cell_m: CELL_M,
            paths: paths(referee, truth, &frame, is_here),
            agent: frame.cells(&pose.position),
            heading_rad: pose.heading_rad,
            targets: truth.targets.iter().zip(&is_open).map(mark).collect(),
            sound: sound.map(|place| frame.cells(&place)),
            map: maps.map(world.assets(), storey).to_vec(),
        }
    }
}

/// Returns the parts of the walked path on a storey.
fn paths(
    referee: &Referee,
    truth: &EpisodeTruth,
    frame: &MapFrame,
    is_here: impl Fn(f32) -> bool,
) -> Vec<Vec<[f32; 2]>> {
    let steps = referee.facts().iter().map(|step| step.pose.position);
    let places: Vec<Point3<f32>> = std::iter::once(truth.start.position).chain(steps).collect();
    let parts = places.chunk_by(|a, b| is_here(a.y) == is_here(b.y));
    let here = parts.filter(|part| part.first().is_some_and(|place| is_here(place.y)));
    here.map(|part| part.iter().map(|place| frame.cells(place)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_and_walls_are_filled() {
        let origin = Pose::new(Point3::new(1.0, 0.0, 1.0), 0.0);
        let frame = MapFrame { origin, cell_m: 0.5, side: 8, has_solid_walls: true };
        assert_eq!(frame.cells(&Point3::new(1.0, 0.0, 0.0)), [4.0, 2.0]);
        assert_eq!(frame.center(4, 2, 0.0), Point3::new(1.25, 0.0, 0.25));
        let mut map = vec![UNKNOWN; 64];
        let square = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]];
        put_floor(&mut map, &frame, &square.map(|[x, z]| Point3::new(x, 0.0, z)));
        assert_eq!(map.iter().filter(|cell| **cell == FREE).count(), 4);
        for index in [48, 50, 53] {
            map[index] = OBSTACLE;
        }
        fill_walls(&mut map, &frame);
        assert_eq!(map[48..56], [2, 2, 2, 0, 0, 2, 0, 0]);
    }

    #[test]
    fn storeys_are_levels_with_large_areas() {
        let square = |side: f32, y: f32| {
            [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].map(|[x, z]| Point3::new(x, y, z)).to_vec()
        };
        let storeys_m = storeys_m(&[square(5.0, 0.0), square(1.0, 0.8), square(4.0, 3.0), square(1.0, 6.0)]);
        assert_eq!(storeys_m, [0.0, 3.0]);
        assert!(super::storeys_m(&[]).is_empty());
    }
}
