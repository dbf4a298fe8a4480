use crate::map::{CELL_M, Cell, Occupancy};
use crate::perception::Place;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Cells from node to node of the search.
const STRIDE: i32 = 2;
/// What a metre costs near obstacles and through the unknown, in metres of open floor.
const TIGHT: f32 = 2.5;
const UNKNOWN: f32 = 1.3;
/// What is added to that for every time that the body was blocked there.
const BUMP: f32 = 6.0;
/// Most nodes that one search opens.
const MOST_NODES: usize = 40_000;
const SIDES: [(i32, i32); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)];

/// A way over the floor plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    /// Places about 0.1 m apart, the body's own first.
    pub places: Vec<Place>,
    /// Distance from the last place to the goal, metres.
    pub left_m: f32,
    /// Cost in metres of open floor.
    pub cost_m: f32,
}

/// What the search knows of each cell that it may come to.
struct Nodes {
    /// Cost of the cheapest way so far, metres; 0 where none is known.
    cost_m: Vec<f32>,
    /// Number of the side by which that way comes, and whether it is final.
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

    /// The place of a cell in the lists: of `STRIDE` cells in a row the search comes to one.
    fn index(cell: Cell) -> Option<usize> {
        let (column, row) = (cell.column / STRIDE, cell.row / STRIDE);
        let inside = cell.column >= 0 && cell.row >= 0 && column < Self::COLUMNS && row < Self::COLUMNS;
        inside.then_some((row * Self::COLUMNS + column) as usize)
    }

    /// Takes a way to a cell, by the side `before`, unless a cheaper one is known.
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

    /// Makes the way to a cell final and gives back its cost; `None` where it is already.
    fn close(&mut self, cell: Cell) -> Option<f32> {
        let index = Self::index(cell)?;
        let is_open = self.before[index] & Self::CLOSED == 0;
        self.before[index] |= Self::CLOSED;
        is_open.then(|| self.cost_m[index])
    }

    fn cost_m(&self, cell: Cell) -> f32 {
        Self::index(cell).map_or(0.0, |index| self.cost_m[index])
    }

    /// The cell from which the way to this one comes.
    fn before(&self, cell: Cell) -> Option<Cell> {
        let (dc, dr) = SIDES[usize::from(self.before[Self::index(cell)?] & !Self::CLOSED)];
        Some(cell.moved(-dc * STRIDE, -dr * STRIDE))
    }
}

/// The cheapest way from `from` to within `reach_m` of `goal`, through unknown places where that is shorter; where none
/// leads there, the way to the reachable place nearest to it.
pub fn path(map: &Occupancy, from: Place, goal: Place, reach_m: f32) -> Path {
    let start = Cell::at(from);
    let mut nodes = Nodes::new();
    nodes.improve(start, f32::MIN_POSITIVE, 0);
    let mut open = BinaryHeap::from([(Reverse(millimetres(from.distance_m(goal))), start)]);
    let mut nearest = (from.distance_m(goal), start);
    while let Some((_, cell)) = open.pop() {
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
            let total_m = cost_m + step_m;
            if nodes.improve(next, total_m, side) {
                open.push((Reverse(millimetres(total_m + next.center().distance_m(goal))), next));
            }
        }
    }
    trace(&nodes, start, nearest, from)
}

/// Cost of one step; `None` where the body does not fit. Out of a tight spot every step is allowed.
fn step_cost_m(map: &Occupancy, cell: Cell, next: Cell, from: Place) -> Option<f32> {
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

fn trace(nodes: &Nodes, start: Cell, (left_m, end): (f32, Cell), from: Place) -> Path {
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

fn millimetres(metres: f32) -> u32 {
    (metres * 1000.0) as u32
}

impl Path {
    /// The farthest place of the way that lies straight ahead within `most_m`, without an obstacle between.
    pub fn aim(&self, map: &Occupancy, most_m: f32) -> Option<Place> {
        let from = *self.places.first()?;
        let fits = |place: Place| {
            let steps = (from.distance_m(place) / CELL_M) as i32;
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

#[cfg(test)]
mod tests {
    use super::*;

    fn room() -> Occupancy {
        Occupancy::default().with_floor(Place::new(-3.0, -3.0), Place::new(3.0, 3.0))
    }

    #[test]
    fn on_open_floor_the_way_is_straight() {
        let way = path(&room(), Place::new(-2.0, 0.0), Place::new(2.0, 0.0), 0.1);
        assert!((way.cost_m - 4.0).abs() < 0.2 && way.left_m <= 0.1, "{way:?}");
        let aim = way.aim(&room(), 0.8).unwrap();
        assert!((aim.x + 1.25).abs() < 0.1 && aim.z.abs() < 0.1, "{aim:?}");
    }

    #[test]
    fn a_wall_is_walked_around() {
        let map = room().with_wall(Place::new(0.0, -2.0), Place::new(0.1, 8.0));
        let (from, goal) = (Place::new(-1.0, 1.0), Place::new(1.0, 1.0));
        let way = path(&map, from, goal, 0.1);
        // Past the wall's end at (0, -2): more than 2 √(1² + 3²) metres.
        assert!(way.left_m <= 0.1 && way.cost_m > 6.1, "{}", way.cost_m);
        assert!(way.places.iter().all(|&place| !map.is_blocked(Cell::at(place))));
        assert!(way.places.iter().any(|place| place.z < -2.0));
    }

    #[test]
    fn where_no_way_leads_it_ends_as_near_as_can_be() {
        let goal = Place::new(1.0, 0.0);
        let map = room().with_wall(Place::new(0.6, -0.4), Place::new(1.4, 0.4));
        let way = path(&map, Place::new(-1.0, 0.0), goal, 0.1);
        assert!(way.left_m > 0.4 && way.left_m < 0.75, "{}", way.left_m);
        assert!(way.places.iter().all(|&place| !map.is_blocked(Cell::at(place))));
    }
}
