//! Path search on the occupancy map.

use crate::geometry::FloorPoint;
use crate::map::occupancy::{CELL_M, Cell, Occupancy};
use std::collections::BinaryHeap;

/// Cells between search nodes.
const STRIDE: i32 = 2;
/// Cost per metre near obstacles and through unknown cells, in metres on open floor.
const TIGHT: f32 = 2.5;
const UNKNOWN: f32 = 1.3;
/// Additional cost per blocked step in the cell.
const BUMP: f32 = 6.0;
const MOST_NODES: usize = 40_000;
pub(crate) const SIDES: [(i32, i32); 8] =
    [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)];

/// A path over the floor plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    /// Points about 0.1 m apart, starting at the body.
    pub places: Vec<FloorPoint>,
    /// Distance from the last point to the goal, metres.
    pub left_m: f32,
    /// Cost in metres on open floor.
    pub cost_m: f32,
}

struct Nodes {
    /// Lowest cost so far, metres; 0 for an unvisited node.
    cost_m: Vec<f32>,
    /// Index of the side towards the predecessor, and the closed flag.
    before: Vec<u8>,
    count: usize,
}

impl Nodes {
    const CLOSED: u8 = 8;
    const COLUMNS: i32 = Cell::COLUMNS / STRIDE;

    fn new() -> Self {
        let count = (Self::COLUMNS * Self::COLUMNS) as usize;
        Self { cost_m: vec![0.0; count], before: vec![0; count], count: 0 }
    }

    fn index(cell: Cell) -> Option<usize> {
        let (column, row) = (cell.column / STRIDE, cell.row / STRIDE);
        let inside = cell.column >= 0 && cell.row >= 0 && column < Self::COLUMNS && row < Self::COLUMNS;
        inside.then_some((row * Self::COLUMNS + column) as usize)
    }

    /// Records a path that enters a cell from side `before`, unless a cheaper path is known.
    fn improve(&mut self, cell: Cell, cost_m: f32, before: usize) -> bool {
        let Some(index) = Self::index(cell) else { return false };
        let known_m = self.cost_m[index];
        let is_better = known_m == 0.0 || cost_m < known_m;
        if is_better {
            self.count += usize::from(known_m == 0.0);
            (self.cost_m[index], self.before[index]) = (cost_m, before as u8);
        }
        is_better
    }

    /// Closes a node and returns the cost; `None` if already closed.
    fn close(&mut self, cell: Cell) -> Option<f32> {
        let index = Self::index(cell)?;
        let is_open = self.before[index] & Self::CLOSED == 0;
        self.before[index] |= Self::CLOSED;
        is_open.then(|| self.cost_m[index])
    }

    /// Returns the lowest cost to a cell, metres; 0 for an unvisited node.
    fn cost_m(&self, cell: Cell) -> f32 {
        Self::index(cell).map_or(0.0, |index| self.cost_m[index])
    }

    fn before(&self, cell: Cell) -> Option<Cell> {
        let (dc, dr) = SIDES[usize::from(self.before[Self::index(cell)?] & !Self::CLOSED)];
        Some(cell.moved(-dc * STRIDE, -dr * STRIDE))
    }
}

/// A queue of cells by estimated cost, cheapest first.
struct OpenCells(BinaryHeap<u64>);

impl OpenCells {
    /// Creates a queue with a single cell.
    fn new(cost_m: f32, cell: Cell) -> Self {
        let mut queue = Self(BinaryHeap::new());
        queue.push(cost_m, cell);
        queue
    }

    /// Adds a cell; ignores negative indices, which are outside the map.
    fn push(&mut self, cost_m: f32, cell: Cell) {
        let (Ok(column), Ok(row)) = (u16::try_from(cell.column), u16::try_from(cell.row)) else { return };
        // A single number compares faster than a tuple; column and row fix the order of equal costs.
        let cheapness = u64::from(!millimetres(cost_m));
        self.0.push(cheapness << 32 | u64::from(column) << 16 | u64::from(row));
    }

    fn pop(&mut self) -> Option<Cell> {
        let key = self.0.pop()?;
        Some(Cell { column: i32::from((key >> 16) as u16), row: i32::from(key as u16) })
    }
}

/// Finds the cheapest path to within `reach_m` metres around `goal`, or to the nearest reachable cell.
pub fn find_path(map: &Occupancy, from: FloorPoint, goal: FloorPoint, reach_m: f32) -> Path {
    let start = Cell::at(from);
    let mut nodes = Nodes::new();
    // Cost 0 marks unvisited nodes, so the start needs a positive cost.
    nodes.improve(start, f32::MIN_POSITIVE, 0);
    let mut open = OpenCells::new(from.distance_m(goal), start);
    let mut nearest = (from.distance_m(goal), start);
    while let Some(cell) = open.pop() {
        let Some(cost_m) = nodes.close(cell) else { continue };
        let left_m = cell.center().distance_m(goal);
        if left_m < nearest.0 {
            nearest = (left_m, cell);
        }
        if left_m <= reach_m || nodes.count > MOST_NODES {
            break;
        }
        for (side, (dc, dr)) in SIDES.into_iter().enumerate() {
            let next = cell.moved(dc * STRIDE, dr * STRIDE);
            let Some(step_m) = step_cost_m(map, cell, next, from) else { continue };
            // The straight-line distance never overestimates: open floor costs 1 per metre.
            let total_m = cost_m + step_m;
            if nodes.improve(next, total_m, side) {
                open.push(total_m + next.center().distance_m(goal), next);
            }
        }
    }
    trace(&nodes, start, nearest, from)
}

/// Returns a step's cost; `None` if the body does not fit.
fn step_cost_m(map: &Occupancy, cell: Cell, next: Cell, from: FloorPoint) -> Option<f32> {
    // A body that already stands too close to an obstacle must be able to leave.
    const ESCAPE_M: f32 = 0.25;
    let escapes = next.center().distance_m(from) <= ESCAPE_M && !map.is_obstacle(next);
    if map.is_blocked(next) && !escapes {
        return None;
    }
    let length_m = cell.center().distance_m(next.center());
    let factor = match (map.is_tight(next), map.is_unknown(next)) {
        (true, _) => TIGHT,
        (false, true) => UNKNOWN,
        (false, false) => 1.0,
    };
    Some(length_m * (factor + BUMP * f32::from(map.bumps(next))))
}

pub(crate) fn millimetres(metres: f32) -> u32 {
    (metres * 1000.0) as u32
}

fn trace(nodes: &Nodes, start: Cell, (left_m, end): (f32, Cell), from: FloorPoint) -> Path {
    let mut places = Vec::new();
    let mut cell = end;
    while cell != start {
        places.push(cell.center());
        cell = nodes.before(cell).unwrap_or(start);
    }
    places.push(from);
    places.reverse();
    Path { places, left_m, cost_m: nodes.cost_m(end) }
}

impl Path {
    /// Returns the most distant point within `most_m` with a free straight line to it.
    pub fn aim(&self, map: &Occupancy, most_m: f32) -> Option<FloorPoint> {
        let from = *self.places.first()?;
        let fits = |place: FloorPoint| {
            let steps = (from.distance_m(place) / CELL_M) as i32;
            // The first cells are skipped: the body may be closer to an obstacle than any planned path.
            (4..=steps).all(|step| {
                let share = step as f32 * CELL_M / from.distance_m(place).max(CELL_M);
                let cell = Cell::at(from.toward(place, share));
                !map.is_blocked(cell) && map.bumps(cell) == 0
            })
        };
        let ahead = self.places[1..].iter().copied();
        let straight = ahead.take_while(|&place| from.distance_m(place) <= most_m && fits(place));
        straight.last().or(self.places.get(1).copied())
    }
}

/// Steps for which a path's end stays the target.
const KEPT_STEPS: u32 = 40;
/// Goals within this distance count as equal, metres.
const SAME_M: f32 = 0.5;
/// Distance to the end at which a path is complete, metres.
const GONE_M: f32 = 0.3;

/// A path follower with hysteresis: paths to an unreachable goal end elsewhere after every image.
#[derive(Clone, Debug, Default)]
pub struct PathFollower {
    to: FloorPoint,
    end: FloorPoint,
    steps_left: u32,
}

impl PathFollower {
    /// Returns a path to within `reach_m` metres around `to`, to the previous end unless complete or old.
    pub fn path_to(&mut self, map: &Occupancy, from: FloorPoint, to: FloorPoint, reach_m: f32) -> Path {
        let continues = self.steps_left > 0
            && self.to.distance_m(to) <= SAME_M
            && self.end.distance_m(to) > reach_m
            && self.end.distance_m(from) > GONE_M;
        if continues {
            self.steps_left -= 1;
            let path = find_path(map, from, self.end, GONE_M);
            if path.left_m <= GONE_M {
                return Path { left_m: self.end.distance_m(to), ..path };
            }
        }
        let path = find_path(map, from, to, reach_m);
        let end = path.places.last().copied().unwrap_or(from);
        *self = Self { to, end, steps_left: KEPT_STEPS };
        path
    }
}

/// Costs of the cheapest paths from one place to all reachable cells: one search instead of a path per destination.
pub struct ReachField {
    nodes: Nodes,
}

impl ReachField {
    /// Computes the costs from `from` over known floor; with `through_unknown` also through unseen cells within `most_m`.
    pub fn new(map: &Occupancy, from: FloorPoint, most_m: f32, through_unknown: bool) -> Self {
        let start = Cell::at(from);
        let mut nodes = Nodes::new();
        nodes.improve(start, f32::MIN_POSITIVE, 0);
        let mut open = OpenCells::new(0.0, start);
        while let Some(cell) = open.pop() {
            let Some(cost_m) = nodes.close(cell) else { continue };
            if cost_m > most_m {
                break;
            }
            for (side, (dc, dr)) in SIDES.into_iter().enumerate() {
                let next = cell.moved(dc * STRIDE, dr * STRIDE);
                if !through_unknown && map.is_unknown(next) {
                    continue;
                }
                let Some(step_m) = step_cost_m(map, cell, next, from) else { continue };
                let total_m = cost_m + step_m;
                if nodes.improve(next, total_m, side) {
                    open.push(total_m, next);
                }
            }
        }
        Self { nodes }
    }

    /// Returns the cost to a point, metres on open floor; `None` for an unreachable point.
    pub fn cost_m(&self, place: FloorPoint) -> Option<f32> {
        Some(self.nodes.cost_m(Cell::at(place))).filter(|cost_m| *cost_m > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room() -> Occupancy {
        Occupancy::default().with_floor(FloorPoint::new(-3.0, -3.0), FloorPoint::new(3.0, 3.0))
    }

    #[test]
    fn paths_on_open_floor_are_straight() {
        let path = find_path(&room(), FloorPoint::new(-2.0, 0.0), FloorPoint::new(2.0, 0.0), 0.1);
        assert!((path.cost_m - 4.0).abs() < 0.2 && path.left_m <= 0.1, "{path:?}");
        let aim = path.aim(&room(), 0.8).unwrap();
        assert!((aim.x + 1.25).abs() < 0.1 && aim.z.abs() < 0.1, "{aim:?}");
    }

    #[test]
    fn paths_lead_around_walls() {
        let map = room().with_wall(FloorPoint::new(0.0, -2.0), FloorPoint::new(0.1, 8.0));
        let (from, goal) = (FloorPoint::new(-1.0, 1.0), FloorPoint::new(1.0, 1.0));
        let path = find_path(&map, from, goal, 0.1);
        // Past the wall's end at (0, -2): more than 2 √(1² + 3²) metres.
        assert!(path.left_m <= 0.1 && path.cost_m > 6.1, "{}", path.cost_m);
        assert!(path.places.iter().all(|&place| !map.is_blocked(Cell::at(place))));
        assert!(path.places.iter().any(|place| place.z < -2.0));
    }

    #[test]
    fn unreachable_goals_end_at_nearest_cell() {
        let goal = FloorPoint::new(1.0, 0.0);
        let map = room().with_wall(FloorPoint::new(0.6, -0.4), FloorPoint::new(1.4, 0.4));
        let path = find_path(&map, FloorPoint::new(-1.0, 0.0), goal, 0.1);
        assert!(path.left_m > 0.4 && path.left_m < 0.75, "{}", path.left_m);
        assert!(path.places.iter().all(|&place| !map.is_blocked(Cell::at(place))));
    }

    /// A room with two niches in the north wall, both equally distant from a goal behind the wall.
    fn room_with_niches() -> Occupancy {
        Occupancy::default()
            .with_floor(FloorPoint::new(-3.0, -3.0), FloorPoint::new(3.0, 3.0))
            .with_wall(FloorPoint::new(-3.0, -3.1), FloorPoint::new(3.0, -3.0))
            .with_wall(FloorPoint::new(-0.5, -3.0), FloorPoint::new(0.5, -1.0))
            .with_wall(FloorPoint::new(-9.0, -9.0), FloorPoint::new(9.0, -3.0))
    }

    #[test]
    fn follower_keeps_its_end_until_reached() {
        let (map, mut follower) = (room_with_niches(), PathFollower::default());
        let to = FloorPoint::new(0.05, -4.0);
        let first = follower.path_to(&map, FloorPoint::new(1.0, 0.0), to, 0.5);
        let end = *first.places.last().unwrap();
        assert!(first.left_m > 0.9 && end.x > 0.5, "{end:?}");
        // The goal moves a little to the left, but the path still leads to the right.
        let there = FloorPoint::new(-0.2, -4.0);
        let other = find_path(&map, FloorPoint::new(0.8, 0.0), there, 0.5);
        assert!(other.places.last().unwrap().x < -0.5, "{:?}", other.places.last());
        let kept = follower.path_to(&map, FloorPoint::new(0.8, 0.0), there, 0.5);
        assert!(kept.places.last().unwrap().distance_m(end) <= GONE_M);
        assert!((kept.left_m - end.distance_m(there)).abs() < 1e-6);
        // At its end a new path is planned.
        let next = follower.path_to(&map, end, there, 0.5);
        assert!(next.places.last().unwrap().x < -0.5);
    }

    #[test]
    fn new_goals_get_new_paths() {
        let (map, mut follower) = (room_with_niches(), PathFollower::default());
        follower.path_to(&map, FloorPoint::new(1.0, 0.0), FloorPoint::new(0.05, -4.0), 0.5);
        let back = follower.path_to(&map, FloorPoint::new(1.0, 0.0), FloorPoint::new(-2.0, 2.0), 0.2);
        assert!(back.left_m <= 0.2);
    }

    const FAR_M: f32 = 100.0;

    fn walled_room() -> Occupancy {
        room().with_wall(FloorPoint::new(0.0, -2.0), FloorPoint::new(0.1, 9.0))
    }

    #[test]
    fn costs_equal_those_of_paths() {
        let (map, from) = (walled_room(), FloorPoint::new(-1.0, 1.0));
        let field = ReachField::new(&map, from, FAR_M, false);
        for goal in [FloorPoint::new(1.0, 1.0), FloorPoint::new(-2.0, -2.0), FloorPoint::new(2.0, -1.0)] {
            let path = find_path(&map, from, goal, 0.1);
            let cost_m = field.cost_m(goal).unwrap();
            assert!((cost_m - path.cost_m).abs() < 0.25, "{cost_m} {}", path.cost_m);
        }
    }

    #[test]
    fn closed_rooms_are_unreachable() {
        let map = walled_room().with_wall(FloorPoint::new(0.0, -4.0), FloorPoint::new(0.1, -2.0));
        let beyond = FloorPoint::new(1.0, 1.0);
        let from = FloorPoint::new(-1.0, 1.0);
        assert_eq!(ReachField::new(&map, from, FAR_M, false).cost_m(beyond), None);
        assert!(ReachField::new(&map, from, FAR_M, true).cost_m(beyond).is_some(), "around the outside");
        assert_eq!(ReachField::new(&map, from, FAR_M, false).cost_m(FloorPoint::new(-5.0, 0.0)), None);
    }
}
