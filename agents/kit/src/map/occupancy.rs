use crate::perception::{Place, Stand, View};
use avln_client::DepthImage;

/// Side of a cell, metres.
pub const CELL_M: f32 = 0.05;
/// Cells a side: a square of 50 m around the start.
const SIDE: i32 = 1000;
/// What is lower than this is stepped on, what is higher than the second walked under, metres.
const OBSTACLE_M: [f32; 2] = [0.22, 1.5];
/// What reaches into these heights keeps sound at the height of ears away, metres; lintels of doors lie above.
const WALL_M: [f32; 2] = [1.25, 1.9];
/// Farther away sight lines are too far apart to fill the floor between them, metres.
const CARVE_M: f32 = 6.0;
/// A body cannot stand nearer than this to an obstacle, metres: its radius and half a cell.
const HARD_M: f32 = 0.13;
/// Nearer than this to an obstacle the body is better not, metres.
const SOFT_M: f32 = 0.3;

/// A cell of the floor plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Cell {
    /// Counted along x.
    pub column: i32,
    /// Counted along z.
    pub row: i32,
}

impl Cell {
    /// How many there are in a row of the map.
    pub(crate) const COLUMNS: i32 = SIDE;
    /// How many there are.
    pub(super) const COUNT: usize = (SIDE * SIDE) as usize;

    /// Its number among all; `None` outside of the map.
    pub(super) fn index(self) -> Option<usize> {
        let inside = (0..SIDE).contains(&self.column) && (0..SIDE).contains(&self.row);
        inside.then_some((self.row * SIDE + self.column) as usize)
    }

    /// The cell that a place lies in.
    pub fn at(place: Place) -> Self {
        let index = |coordinate: f32| (coordinate / CELL_M).floor() as i32 + SIDE / 2;
        Self { column: index(place.x), row: index(place.z) }
    }

    /// The place in its middle.
    pub fn center(self) -> Place {
        let coordinate = |index: i32| (index - SIDE / 2) as f32 * CELL_M + 0.5 * CELL_M;
        Place::new(coordinate(self.column), coordinate(self.row))
    }

    /// The cell so many columns and rows away.
    pub fn moved(self, columns: i32, rows: i32) -> Self {
        Self { column: self.column + columns, row: self.row + rows }
    }
}

/// Where there is floor, where there are obstacles, and where nothing has been seen.
pub struct Occupancy {
    /// Positive: seen as an obstacle; negative: seen free; 0: unknown.
    evidence: Vec<i8>,
    /// The body was blocked here, whatever the camera shows.
    bumps: Vec<u8>,
    /// Something was seen here at the height of heads.
    walls: Vec<bool>,
    /// Corners of the rectangle of everything seen.
    seen: [Place; 2],
    /// Obstacles within [`HARD_M`] and within [`SOFT_M`].
    hard: Vec<u16>,
    soft: Vec<u16>,
    disks: [Vec<(i32, i32)>; 2],
}

impl Default for Occupancy {
    fn default() -> Self {
        let count = Cell::COUNT;
        let disks = [disk(HARD_M), disk(SOFT_M)];
        let (evidence, walls, bumps) = (vec![0; count], vec![false; count], vec![0; count]);
        Self {
            evidence,
            bumps,
            walls,
            seen: [Place::default(); 2],
            hard: vec![0; count],
            soft: vec![0; count],
            disks,
        }
    }
}

impl Occupancy {
    const HIT: i8 = 3;
    const LIMIT: i8 = 12;

    /// Adds what a depth picture shows of floor and obstacles.
    pub fn see(&mut self, view: &View, stand: &Stand, depth: &DepthImage) {
        let mut hits = Vec::new();
        for column in 0..view.width {
            let free_m = self.look_along(view, stand, depth, column, &mut hits);
            let steps = (free_m / CELL_M) as i32;
            for step in 0..steps {
                self.add(Cell::at(view.along(stand, column, step as f32 * CELL_M)), -1);
            }
        }
        hits.sort_unstable();
        hits.dedup();
        hits.into_iter().for_each(|cell| self.add(cell, Self::HIT));
        self.stood(stand.place);
    }

    /// Collects the obstacles of one column and returns how far its sight line is free of them, metres.
    fn look_along(
        &mut self,
        view: &View,
        stand: &Stand,
        depth: &DepthImage,
        column: usize,
        hits: &mut Vec<Cell>,
    ) -> f32 {
        let (mut nearest_m, mut farthest_m) = (f32::INFINITY, 0.0_f32);
        for row in 0..view.height {
            let Some(seen) = view.seen(stand, depth, column, row) else { continue };
            self.widen(seen.place);
            if (WALL_M[0]..WALL_M[1]).contains(&seen.height_m) {
                self.wall(stand.place, seen.place);
            }
            farthest_m = farthest_m.max(seen.range_m);
            if (OBSTACLE_M[0]..OBSTACLE_M[1]).contains(&seen.height_m) {
                nearest_m = nearest_m.min(seen.range_m);
                hits.push(Cell::at(seen.place));
            }
        }
        (nearest_m - 1.5 * CELL_M).min(farthest_m).min(CARVE_M)
    }

    /// Marks a wall seen from a place two cells thick, so that no line of samples slips through.
    fn wall(&mut self, from: Place, place: Place) {
        let behind = from.toward(place, 1.0 + CELL_M / from.distance_m(place).max(CELL_M));
        for cell in [Cell::at(place), Cell::at(behind)] {
            cell.index().into_iter().for_each(|index| self.walls[index] = true);
        }
    }

    /// Something is thought to be anywhere in a rectangle given by two corners, although nothing of it has been seen.
    pub fn suppose(&mut self, area: [Place; 2]) {
        area.into_iter().for_each(|corner| self.widen(corner));
    }

    fn widen(&mut self, place: Place) {
        let [low, high] = &mut self.seen;
        (low.x, low.z) = (low.x.min(place.x), low.z.min(place.z));
        (high.x, high.z) = (high.x.max(place.x), high.z.max(place.z));
    }

    /// Corners of the rectangle of everything seen, `margin_m` wider on all sides.
    pub fn area(&self, margin_m: f32) -> [Place; 2] {
        let [low, high] = self.seen;
        [Place::new(low.x - margin_m, low.z - margin_m), Place::new(high.x + margin_m, high.z + margin_m)]
    }

    /// How far a place lies outside of the rectangle of everything seen, metres; 0 inside.
    pub fn outside_m(&self, place: Place) -> f32 {
        let [low, high] = self.seen;
        let dx = (low.x - place.x).max(place.x - high.x).max(0.0);
        dx.hypot((low.z - place.z).max(place.z - high.z).max(0.0))
    }

    /// The body has been here: there is room.
    fn stood(&mut self, place: Place) {
        let here = Cell::at(place);
        for dc in -1..=1 {
            for dr in -1..=1 {
                self.add(here.moved(dc, dr), -Self::LIMIT);
            }
        }
    }

    /// The body was blocked here by something that the camera did not show; ways had better lead elsewhere.
    pub fn bumped(&mut self, place: Place) {
        for &(dc, dr) in &self.disks[0] {
            let cell = Cell::at(place).moved(dc, dr);
            cell.index()
                .into_iter()
                .for_each(|index| self.bumps[index] = self.bumps[index].saturating_add(1));
        }
    }

    /// How often the body was blocked here.
    pub fn bumps(&self, cell: Cell) -> u8 {
        cell.index().map_or(0, |index| self.bumps[index])
    }

    fn add(&mut self, cell: Cell, amount: i8) {
        let Some(index) = cell.index() else { return };
        let before = self.evidence[index];
        let after = (before + amount).clamp(-Self::LIMIT, Self::LIMIT);
        self.evidence[index] = if after == 0 { amount.signum() } else { after };
        match (before > 0, self.evidence[index] > 0) {
            (false, true) => self.crowd(cell, 1),
            (true, false) => self.crowd(cell, -1),
            _ => {}
        }
    }

    fn crowd(&mut self, cell: Cell, change: i16) {
        for (counts, disk) in [&mut self.hard, &mut self.soft].into_iter().zip(&self.disks) {
            for &(dc, dr) in disk {
                if let Some(index) = cell.moved(dc, dr).index() {
                    counts[index] = counts[index].saturating_add_signed(change);
                }
            }
        }
    }

    /// Whether nothing has been seen here.
    pub fn is_unknown(&self, cell: Cell) -> bool {
        cell.index().is_some_and(|index| self.evidence[index] == 0)
    }

    /// Whether floor without an obstacle has been seen here.
    pub fn is_free(&self, cell: Cell) -> bool {
        cell.index().is_some_and(|index| self.evidence[index] < 0)
    }

    /// Whether an obstacle has been seen here, or the map ends.
    pub fn is_obstacle(&self, cell: Cell) -> bool {
        cell.index().is_none_or(|index| self.evidence[index] > 0)
    }

    /// Whether sound at the height of ears is kept away.
    pub fn is_wall(&self, cell: Cell) -> bool {
        cell.index().is_none_or(|index| self.walls[index] && self.evidence[index] >= 0)
    }

    /// Whether an obstacle leaves no room for the body here. Unknown cells have room.
    pub fn is_blocked(&self, cell: Cell) -> bool {
        cell.index().is_none_or(|index| self.hard[index] > 0)
    }

    /// Whether an obstacle is so near that the body is better elsewhere.
    pub fn is_tight(&self, cell: Cell) -> bool {
        cell.index().is_none_or(|index| self.soft[index] > 0)
    }

    /// Whether no wall keeps sound away on the straight line between two places, but for its end: a source may be fixed
    /// to a wall.
    pub fn hears(&self, from: Place, to: Place) -> bool {
        const SAMPLE_M: f32 = 0.09;
        const TAIL_M: f32 = 0.25;
        let length_m = from.distance_m(to);
        let steps = ((length_m - TAIL_M) / SAMPLE_M).max(0.0) as i32;
        (1..=steps).all(|step| !self.is_wall(Cell::at(from.toward(to, step as f32 * SAMPLE_M / length_m))))
    }

    /// Whether a place lies before the camera within `near_m`, and not behind a wall.
    pub fn is_in_view(&self, stand: &Stand, place: Place, near_m: f32) -> bool {
        const ASIDE_RAD: f32 = 0.6;
        place.distance_m(stand.place) <= near_m
            && stand.bearing_rad(place).abs() <= ASIDE_RAD
            && self.hears(stand.place, place)
    }

    /// Centres of the stretches of border between free floor and the unknown, each with its length in cells.
    pub fn frontiers(&self) -> Vec<(Place, usize)> {
        const BLOCK: i32 = 10;
        let mut found = Vec::new();
        let [low, high] = self.area(CELL_M).map(Cell::at);
        for row in (low.row..=high.row).step_by(BLOCK as usize) {
            for column in (low.column..=high.column).step_by(BLOCK as usize) {
                found.extend(self.frontier_in(Cell { column, row }, BLOCK));
            }
        }
        found
    }

    fn frontier_in(&self, corner: Cell, block: i32) -> Option<(Place, usize)> {
        const SHORTEST: usize = 4;
        let cells = (0..block * block).map(|i| corner.moved(i % block, i / block));
        let border: Vec<Cell> = cells.filter(|&cell| self.is_frontier(cell)).collect();
        let middle = border.get(border.len() / 2)?;
        (border.len() >= SHORTEST).then(|| (middle.center(), border.len()))
    }

    fn is_frontier(&self, cell: Cell) -> bool {
        const SIDES: [(i32, i32); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];
        self.is_free(cell)
            && !self.is_blocked(cell)
            && SIDES.iter().any(|&(dc, dr)| self.is_unknown(cell.moved(dc, dr)))
    }
}

/// Offsets of the cells within a radius.
fn disk(radius_m: f32) -> Vec<(i32, i32)> {
    let reach = (radius_m / CELL_M).ceil() as i32;
    let offsets = (-reach..=reach).flat_map(|dc| (-reach..=reach).map(move |dr| (dc, dr)));
    offsets.filter(|&(dc, dr)| (dc as f32).hypot(dr as f32) * CELL_M <= radius_m).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::{Pose, TaskSpec};

    impl Occupancy {
        /// Free floor in a rectangle given by two corners, metres.
        pub(crate) fn with_floor(mut self, from: Place, to: Place) -> Self {
            self.fill(from, to, -Self::LIMIT);
            self
        }

        /// Seen somehow in a rectangle.
        pub(crate) fn with_area(mut self, area: [Place; 2]) -> Self {
            self.suppose(area);
            self
        }

        /// A wall in a rectangle.
        pub(crate) fn with_wall(mut self, from: Place, to: Place) -> Self {
            self.fill(from, to, Self::LIMIT);
            self.fill(from, to, Self::LIMIT);
            self
        }

        fn fill(&mut self, from: Place, to: Place, amount: i8) {
            let (from, to) = (Cell::at(from), Cell::at(to));
            for column in from.column..=to.column {
                for row in from.row..=to.row {
                    let cell = Cell { column, row };
                    self.add(cell, amount);
                    self.widen(cell.center());
                    cell.index().into_iter().for_each(|index| self.walls[index] = amount > 0);
                }
            }
        }
    }

    #[test]
    fn a_wall_ahead_is_an_obstacle_and_the_floor_before_it_is_free() {
        let task = TaskSpec { width: 64, height: 64, ..TaskSpec::default() };
        let view = View::new(&task);
        // A wall 3.02 m ahead; pixels that look down below it see the floor 1 m under the camera.
        let row_depth = |row: usize| {
            let down = (row as f32 + 0.5 - 32.0) / 32.0;
            if down > 0.0 { (1.0 / down).min(3.02) } else { 3.02 }
        };
        let metres = (0..64 * 64).map(|i| row_depth(i / 64)).collect();
        let depth = DepthImage { width: 64, height: 64, metres };
        let mut map = Occupancy::default();
        map.see(&view, &Stand::new(&Pose::default()), &depth);
        assert!(map.is_obstacle(Cell::at(Place::new(0.0, -3.01))));
        assert!(map.is_blocked(Cell::at(Place::new(0.0, -2.92))));
        assert!(map.is_free(Cell::at(Place::new(0.0, -2.0))) && map.is_free(Cell::at(Place::new(0.5, -1.5))));
        assert!(
            map.is_unknown(Cell::at(Place::new(0.0, -3.5))) && map.is_unknown(Cell::at(Place::new(0.0, 1.0)))
        );
        assert!(!map.hears(Place::default(), Place::new(0.0, -3.9)));
        assert!(map.hears(Place::default(), Place::new(0.0, -3.1)));
    }

    #[test]
    fn frontiers_lie_on_the_border_of_the_unknown_and_not_along_walls() {
        let map = Occupancy::default()
            .with_floor(Place::new(0.0, 0.0), Place::new(2.0, 2.0))
            .with_wall(Place::new(-0.1, -0.1), Place::new(2.2, -0.05))
            .with_wall(Place::new(-0.1, -0.1), Place::new(-0.05, 2.2))
            .with_wall(Place::new(-0.1, 2.06), Place::new(2.2, 2.1));
        let frontiers = map.frontiers();
        assert!(!frontiers.is_empty());
        assert!(frontiers.iter().all(|(place, _)| (place.x - 2.0).abs() < 0.1), "{frontiers:?}");
    }

    #[test]
    fn an_obstacle_that_is_seen_through_goes_away() {
        let mut map = Occupancy::default().with_wall(Place::new(1.0, 1.0), Place::new(1.0, 1.0));
        let cell = Cell::at(Place::new(1.0, 1.0));
        assert!(map.is_obstacle(cell) && map.is_blocked(cell.moved(2, 0)) && map.is_tight(cell.moved(5, 0)));
        (0..30).for_each(|_| map.add(cell, -1));
        assert!(map.is_free(cell) && !map.is_blocked(cell.moved(2, 0)) && !map.is_tight(cell.moved(5, 0)));
    }
}
