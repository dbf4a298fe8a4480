use super::Cell;
use crate::perception::{Place, Stand, View};
use avln_client::DepthImage;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// What is this much higher or lower than the body is not looked at, metres: another storey, or what one walks under.
const BAND_M: f32 = 1.5;
/// Farther surfaces are not looked at, metres.
const FAR_M: f32 = 6.0;
/// The highest step that a body takes, metres, and some for what pictures get wrong.
const STEP_M: f32 = 0.22;
/// How far the body walks over what it has not seen, metres: the depth of a step, of which one sees no more than the riser from afar.
const UNSEEN_M: f32 = 0.3;
/// Cells from node to node of the search.
const STRIDE: i32 = 2;
/// Most nodes that one search opens.
const MOST_NODES: usize = 20_000;
/// Nothing higher or lower by more than a step may be this near to the body's middle, in cells.
const BODY: i32 = 2;

/// How high surfaces are: what tells stairs, which rise step by step, from furniture, which does so at once. Of what lies above each
/// other it knows what was seen last.
pub struct Elevation {
    /// The highest surface in each cell, metres above the start; negative infinity where none was seen.
    tops_m: Vec<f32>,
}

/// A way over stairs.
#[derive(Clone, Debug, PartialEq)]
pub struct Climb {
    /// Places about 0.1 m apart, the body's own first.
    pub places: Vec<Place>,
    /// Height of its end above the start, metres.
    pub height_m: f32,
}

/// How the search came to a cell.
#[derive(Clone, Copy)]
struct Node {
    before: Cell,
    cost_m: f32,
    /// Height of the last surface that was seen on the way, metres, and how long ago that was.
    height_m: f32,
    unseen_m: f32,
}

impl Climb {
    /// Its last place.
    pub fn end(&self) -> Place {
        self.places.last().copied().unwrap_or_default()
    }

    /// The farthest of its first places that lie within `most_m` of its start.
    pub fn ahead(&self, most_m: f32) -> Place {
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
    /// Adds what a depth picture shows to a body `height_m` above its start.
    pub fn see(&mut self, view: &View, stand: &Stand, height_m: f32, depth: &DepthImage) {
        for column in 0..view.width {
            for row in 0..view.height {
                let seen = view.seen(stand, depth, column, row);
                let near = seen.filter(|seen| seen.height_m.abs() <= BAND_M && seen.range_m <= FAR_M);
                let Some(seen) = near else { continue };
                self.add(Cell::at(seen.place), height_m + seen.height_m);
            }
        }
    }

    /// The body was blocked at a place, `height_m` above its start, by something that pictures do not show.
    pub fn bumped(&mut self, place: Place, height_m: f32) {
        self.add(Cell::at(place), height_m + 1.0);
    }

    fn add(&mut self, cell: Cell, height_m: f32) {
        let Some(index) = cell.index() else { return };
        let top_m = &mut self.tops_m[index];
        let is_of_another_storey = (*top_m - height_m).abs() > BAND_M;
        *top_m = if is_of_another_storey { height_m } else { top_m.max(height_m) };
    }

    /// The highest surface that was seen in a cell, metres above the start.
    fn top_m(&self, cell: Cell) -> Option<f32> {
        cell.index().map(|index| self.tops_m[index]).filter(|top_m| top_m.is_finite())
    }

    /// The way by which a body at `from`, `height_m` above its start, comes by steps to the nearest surface that is `wanted` by
    /// its place and height; `None` where none is known.
    pub fn climb(&self, from: Place, height_m: f32, wanted: impl Fn(Place, f32) -> bool) -> Option<Climb> {
        const SIDES: [(i32, i32); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)];
        let start = Cell::at(from);
        let mut nodes =
            HashMap::from([(start, Node { before: start, cost_m: 0.0, height_m, unseen_m: 0.0 })]);
        let mut open = BinaryHeap::from([(Reverse(0_u32), start)]);
        while let Some((Reverse(cost_mm), cell)) = open.pop() {
            let here = nodes[&cell];
            if cost_mm > millimetres(here.cost_m) {
                continue;
            }
            if here.unseen_m == 0.0 && wanted(cell.center(), here.height_m) {
                return Some(Climb { places: trace(&nodes, start, cell), height_m: here.height_m });
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

    /// How the search comes from a cell to the next; `None` where the body does not.
    fn step(&self, cell: Cell, next: Cell, here: &Node) -> Option<Node> {
        let length_m = cell.center().distance_m(next.center());
        let (cost_m, unseen_m) = (here.cost_m + length_m, here.unseen_m + length_m);
        let node = match self.top_m(next) {
            Some(top_m) => Node { before: cell, cost_m, height_m: top_m, unseen_m: 0.0 },
            None => Node { before: cell, cost_m, height_m: here.height_m, unseen_m },
        };
        let fits = (node.height_m - here.height_m).abs() <= STEP_M && node.unseen_m <= UNSEEN_M;
        (fits && self.has_room(next, node.height_m)).then_some(node)
    }

    /// Whether nothing around a cell is higher or lower than its surface by more than a step.
    fn has_room(&self, cell: Cell, height_m: f32) -> bool {
        let around =
            (-BODY..=BODY).flat_map(|columns| (-BODY..=BODY).map(move |rows| cell.moved(columns, rows)));
        around.filter_map(|near| self.top_m(near)).all(|top_m| (top_m - height_m).abs() <= STEP_M)
    }
}

fn trace(nodes: &HashMap<Cell, Node>, start: Cell, end: Cell) -> Vec<Place> {
    let mut places = vec![end.center()];
    let mut cell = end;
    while cell != start {
        cell = nodes[&cell].before;
        places.push(cell.center());
    }
    places.reverse();
    places
}

fn millimetres(metres: f32) -> u32 {
    (metres * 1000.0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::CELL_M;

    /// A floor of 6 m by 6 m around the start, with `top_m` telling how high each place is, where it is seen.
    fn surface(top_m: impl Fn(Place) -> Option<f32>) -> Elevation {
        let mut known = Elevation::default();
        let cells = (-60..60).flat_map(|x| (-60..60).map(move |z| (x, z)));
        for (x, z) in cells {
            let place = Place::new((x as f32 + 0.5) * CELL_M, (z as f32 + 0.5) * CELL_M);
            top_m(place).into_iter().for_each(|top_m| known.add(Cell::at(place), top_m));
        }
        known
    }

    /// Eight steps of 0.17 m along x from 1 m on, between walls.
    fn stairs(place: Place) -> f32 {
        match (place.x, place.z.abs()) {
            (x, _) if x < 1.0 => 0.0,
            (x, z) if z < 0.5 => 0.17 * ((x - 1.0) / 0.25 + 1.0).floor().min(8.0),
            _ => 2.0,
        }
    }

    #[test]
    fn stairs_are_climbed_step_by_step() {
        let known = surface(|place| Some(stairs(place)));
        let way = known.climb(Place::new(-1.0, 1.0), 0.0, |_, height_m| height_m > 1.0).unwrap();
        let (end, ahead) = (way.end(), way.ahead(0.35));
        assert!((2.25..2.6).contains(&end.x) && end.z.abs() < 0.4, "{end:?}");
        assert!((0.2..=0.35).contains(&ahead.distance_m(way.places[0])), "{ahead:?}");
        assert!((way.height_m - 1.02).abs() < 1e-3, "{}", way.height_m);
        assert!(way.places.windows(2).all(|pair| pair[0].distance_m(pair[1]) < 0.15));
        let down = surface(|place| Some(-stairs(place).min(1.4)));
        assert!(down.climb(Place::new(-1.0, 0.0), 0.0, |_, height_m| height_m < -1.0).is_some());
    }

    #[test]
    fn furniture_is_no_stairs() {
        let table = |place: Place| if place.x > 1.0 && place.z.abs() < 1.0 { 0.75 } else { 0.0 };
        let known = surface(|place| Some(table(place)));
        assert_eq!(known.climb(Place::default(), 0.0, |_, height_m| height_m > 0.3), None);
    }

    #[test]
    fn what_is_too_near_to_be_seen_is_walked_over() {
        let hidden =
            |to_m: f32| surface(move |place| (!(0.8..to_m).contains(&place.x)).then(|| stairs(place)));
        let climb = |known: Elevation| known.climb(Place::new(0.5, 0.0), 0.0, |_, height_m| height_m > 1.0);
        assert!(climb(hidden(1.0)).is_some());
        assert_eq!(climb(hidden(1.7)), None);
    }

    #[test]
    fn what_lies_below_is_forgotten_for_what_is_seen_above() {
        let mut known = surface(|_| Some(0.0));
        let cell = Cell::at(Place::default());
        known.add(cell, 2.9);
        assert_eq!(known.top_m(cell), Some(2.9));
        known.add(cell, 2.0);
        assert_eq!(known.top_m(cell), Some(2.9));
        known.bumped(Place::default(), 2.9);
        assert_eq!(known.top_m(cell), Some(3.9));
    }
}
