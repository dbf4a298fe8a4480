//! Elevation map: surface heights around the body, stairs, and storeys.

use crate::geometry::{FloorPoint, PinholeCamera, Pose2d};
use crate::map::occupancy::Cell;
use crate::path::{SIDES, millimetres};
use avln_client::DepthImage;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// Surfaces above or below the body by more than this are ignored, metres: another storey, or an underpass.
const BAND_M: f32 = 1.5;
/// Farther surfaces are ignored, metres.
const FAR_M: f32 = 6.0;
/// Highest step with a margin for depth noise, metres.
const STEP_M: f32 = 0.22;
/// Longest unseen stretch that the body crosses, metres: from a distance only risers are visible.
const UNSEEN_M: f32 = 0.3;
/// Cells between search nodes.
const STRIDE: i32 = 2;
const MOST_NODES: usize = 20_000;
/// Radius around the body's middle in which heights must differ by less than a step, cells.
const BODY: i32 = 2;

/// Surface heights. Stairs rise step by step, furniture in a single step. Overlapping surfaces overwrite older ones.
pub struct Elevation {
    /// Height by cell for the highest surface, metres above the start; negative infinity if unseen.
    tops_m: Vec<f32>,
}

/// A path over stairs.
#[derive(Clone, Debug, PartialEq)]
pub struct ClimbPath {
    /// Points about 0.1 m apart, starting at the body.
    pub places: Vec<FloorPoint>,
    /// Height at the end above the start, metres.
    pub height_m: f32,
}

#[derive(Clone, Copy)]
struct ClimbNode {
    before: Cell,
    cost_m: f32,
    /// Height at the last seen surface on the path, metres, and the distance since.
    height_m: f32,
    unseen_m: f32,
}

impl ClimbPath {
    /// Returns the last point.
    pub fn end(&self) -> FloorPoint {
        self.places.last().copied().unwrap_or_default()
    }

    /// Returns the last point before the path leaves the radius `most_m`.
    pub fn ahead(&self, most_m: f32) -> FloorPoint {
        let start = self.places.first().copied().unwrap_or_default();
        let near = self.places.iter().take_while(|place| place.distance_m(start) <= most_m);
        near.last().copied().unwrap_or(start)
    }
}

impl Default for Elevation {
    fn default() -> Self {
        Self { tops_m: vec![f32::NEG_INFINITY; Cell::COUNT] }
    }
}

impl Elevation {
    /// Adds a depth image from a body `height_m` above the start.
    pub fn see(&mut self, view: &PinholeCamera, pose: &Pose2d, height_m: f32, depth: &DepthImage) {
        for column in 0..view.width {
            for row in 0..view.height {
                let seen = view.seen(pose, depth, column, row);
                let near = seen.filter(|seen| seen.height_m.abs() <= BAND_M && seen.range_m <= FAR_M);
                let Some(seen) = near else { continue };
                self.add(Cell::at(seen.place), height_m + seen.height_m);
            }
        }
    }

    /// Records an invisible obstacle before a body `height_m` above the start.
    pub fn mark_bump(&mut self, place: FloorPoint, height_m: f32) {
        self.add(Cell::at(place), height_m + 1.0);
    }

    fn add(&mut self, cell: Cell, height_m: f32) {
        let Some(index) = cell.index() else { return };
        let top_m = &mut self.tops_m[index];
        // A large jump means another storey or an underpass: the newest surface wins, since it is the one in view.
        let is_of_another_storey = (*top_m - height_m).abs() > BAND_M;
        *top_m = if is_of_another_storey { height_m } else { top_m.max(height_m) };
    }

    /// Returns the highest seen surface in a cell, metres above the start.
    fn top_m(&self, cell: Cell) -> Option<f32> {
        cell.index().map(|index| self.tops_m[index]).filter(|top_m| top_m.is_finite())
    }

    /// Finds a path from a body `height_m` above the start to the nearest `wanted` surface and height.
    pub fn climb(
        &self,
        from: FloorPoint,
        height_m: f32,
        wanted: impl Fn(FloorPoint, f32) -> bool,
    ) -> Option<ClimbPath> {
        let start = Cell::at(from);
        // The hash map is only used for lookups, so its order cannot change a result.
        let mut nodes =
            HashMap::from([(start, ClimbNode { before: start, cost_m: 0.0, height_m, unseen_m: 0.0 })]);
        let mut open = BinaryHeap::from([(Reverse(0_u32), start)]);
        while let Some((Reverse(cost_mm), cell)) = open.pop() {
            let here = nodes[&cell];
            if cost_mm > millimetres(here.cost_m) {
                continue;
            }
            // A target must be a seen surface: heights across unseen stretches are guesses.
            if here.unseen_m == 0.0 && wanted(cell.center(), here.height_m) {
                return Some(ClimbPath { places: trace(&nodes, start, cell), height_m: here.height_m });
            }
            if nodes.len() > MOST_NODES {
                return None;
            }
            for (columns, rows) in SIDES {
                let next = cell.moved(columns * STRIDE, rows * STRIDE);
                let Some(node) = self.step(cell, next, &here) else { continue };
                if nodes.get(&next).is_none_or(|known| node.cost_m < known.cost_m) {
                    nodes.insert(next, node);
                    open.push((Reverse(millimetres(node.cost_m)), next));
                }
            }
        }
        None
    }

    /// Returns the node after a step; `None` if the body cannot take it.
    fn step(&self, cell: Cell, next: Cell, here: &ClimbNode) -> Option<ClimbNode> {
        let length_m = cell.center().distance_m(next.center());
        let (cost_m, unseen_m) = (here.cost_m + length_m, here.unseen_m + length_m);
        let node = match self.top_m(next) {
            Some(top_m) => ClimbNode { before: cell, cost_m, height_m: top_m, unseen_m: 0.0 },
            None => ClimbNode { before: cell, cost_m, height_m: here.height_m, unseen_m },
        };
        let fits = (node.height_m - here.height_m).abs() <= STEP_M && node.unseen_m <= UNSEEN_M;
        (fits && self.has_room(next, node.height_m)).then_some(node)
    }

    /// Returns true if all surrounding heights are within a step.
    fn has_room(&self, cell: Cell, height_m: f32) -> bool {
        let around =
            (-BODY..=BODY).flat_map(|columns| (-BODY..=BODY).map(move |rows| cell.moved(columns, rows)));
        around.filter_map(|near| self.top_m(near)).all(|top_m| (top_m - height_m).abs() <= STEP_M)
    }
}

fn trace(nodes: &HashMap<Cell, ClimbNode>, start: Cell, end: Cell) -> Vec<FloorPoint> {
    let mut places = vec![end.center()];
    let mut cell = end;
    while cell != start {
        cell = nodes[&cell].before;
        places.push(cell.center());
    }
    places.reverse();
    places
}

/// Smallest height between storeys, metres: a landing between two flights counts as a storey.
const APART_M: f32 = 1.2;
/// Storey limit, including landings.
const MOST_STOREYS: usize = 8;

/// The memories for other storeys. Maps have no height: a map applies to a single storey.
pub struct Storeys<M> {
    /// Body height above the start, metres.
    height_m: f32,
    /// Memories for other storeys, by height.
    away: Vec<(f32, M)>,
}

impl<M> Default for Storeys<M> {
    fn default() -> Self {
        Self { height_m: 0.0, away: Vec::new() }
    }
}

impl<M> Storeys<M> {
    /// Returns true if `height_m` above the start belongs to the current storey.
    pub fn is_on(&self, height_m: f32) -> bool {
        is_same(self.height_m, height_m)
    }

    /// Moves the body to `height_m`; on another storey swaps `here` for its memory, and returns true.
    pub fn enter(&mut self, height_m: f32, here: &mut M, begin: impl FnOnce() -> M) -> bool {
        if self.is_on(height_m) {
            return false;
        }
        let known = self.away.iter().position(|(other_m, _)| is_same(*other_m, height_m));
        let (entered_m, memory) = match known {
            Some(known) => self.away.remove(known),
            None => (height_m, begin()),
        };
        self.away.truncate(MOST_STOREYS - 2);
        self.away.insert(0, (self.height_m, std::mem::replace(here, memory)));
        self.height_m = entered_m;
        true
    }
}

fn is_same(one_m: f32, other_m: f32) -> bool {
    (one_m - other_m).abs() <= APART_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::occupancy::CELL_M;

    /// A floor of 6 m by 6 m around the start with heights `top_m`; `None` is unseen.
    fn surface(top_m: impl Fn(FloorPoint) -> Option<f32>) -> Elevation {
        let mut known = Elevation::default();
        let cells = (-60..60).flat_map(|x| (-60..60).map(move |z| (x, z)));
        for (x, z) in cells {
            let place = FloorPoint::new((x as f32 + 0.5) * CELL_M, (z as f32 + 0.5) * CELL_M);
            top_m(place).into_iter().for_each(|top_m| known.add(Cell::at(place), top_m));
        }
        known
    }

    /// Eight steps of 0.17 m along x from 1 m on, between walls.
    fn stairs(place: FloorPoint) -> f32 {
        match (place.x, place.z.abs()) {
            (x, _) if x < 1.0 => 0.0,
            (x, z) if z < 0.5 => 0.17 * ((x - 1.0) / 0.25 + 1.0).floor().min(8.0),
            _ => 2.0,
        }
    }

    #[test]
    fn stairs_are_climbed_in_both_directions() {
        let known = surface(|place| Some(stairs(place)));
        let path = known.climb(FloorPoint::new(-1.0, 1.0), 0.0, |_, height_m| height_m > 1.0).unwrap();
        let (end, ahead) = (path.end(), path.ahead(0.35));
        assert!((2.25..2.6).contains(&end.x) && end.z.abs() < 0.4, "{end:?}");
        assert!((0.2..=0.35).contains(&ahead.distance_m(path.places[0])), "{ahead:?}");
        assert!((path.height_m - 1.02).abs() < 1e-3, "{}", path.height_m);
        assert!(path.places.windows(2).all(|pair| pair[0].distance_m(pair[1]) < 0.15));
        let down = surface(|place| Some(-stairs(place).min(1.4)));
        assert!(down.climb(FloorPoint::new(-1.0, 0.0), 0.0, |_, height_m| height_m < -1.0).is_some());
    }

    #[test]
    fn furniture_is_not_climbed() {
        let table = |place: FloorPoint| if place.x > 1.0 && place.z.abs() < 1.0 { 0.75 } else { 0.0 };
        let known = surface(|place| Some(table(place)));
        assert_eq!(known.climb(FloorPoint::default(), 0.0, |_, height_m| height_m > 0.3), None);
    }

    #[test]
    fn short_unseen_stretches_are_crossed() {
        let hidden =
            |to_m: f32| surface(move |place| (!(0.8..to_m).contains(&place.x)).then(|| stairs(place)));
        let climb =
            |known: Elevation| known.climb(FloorPoint::new(0.5, 0.0), 0.0, |_, height_m| height_m > 1.0);
        assert!(climb(hidden(1.0)).is_some());
        assert_eq!(climb(hidden(1.7)), None);
    }

    #[test]
    fn upper_surfaces_replace_lower_ones() {
        let mut known = surface(|_| Some(0.0));
        let cell = Cell::at(FloorPoint::default());
        known.add(cell, 2.9);
        assert_eq!(known.top_m(cell), Some(2.9));
        known.add(cell, 2.0);
        assert_eq!(known.top_m(cell), Some(2.9));
        known.mark_bump(FloorPoint::default(), 2.9);
        assert_eq!(known.top_m(cell), Some(3.9));
    }

    #[test]
    fn storeys_keep_their_memory() {
        let (mut storeys, mut here) = (Storeys::default(), "ground");
        assert!(!storeys.enter(1.1, &mut here, || unreachable!()));
        assert!(storeys.enter(1.4, &mut here, || "landing") && here == "landing");
        assert!(storeys.enter(2.9, &mut here, || "upper") && here == "upper");
        here = "upper, seen";
        assert!(storeys.enter(1.5, &mut here, || unreachable!()) && here == "landing");
        assert!(storeys.enter(0.1, &mut here, || unreachable!()) && here == "ground");
        assert!(storeys.enter(2.8, &mut here, || unreachable!()) && here == "upper, seen");
    }

    #[test]
    fn oldest_storeys_are_forgotten() {
        let (mut storeys, mut here) = (Storeys::default(), 0);
        (1..20).for_each(|storey| assert!(storeys.enter(3.0 * storey as f32, &mut here, || storey)));
        assert_eq!(storeys.away.len(), MOST_STOREYS - 1);
        assert!(storeys.enter(3.0 * 18.0, &mut here, || unreachable!()) && here == 18);
    }
}
