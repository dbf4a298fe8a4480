//! Occupancy map: free, blocked and unknown cells from depth images and collisions.

use crate::geometry::{FloorPoint, PinholeCamera, Pose2d, floor};
use avln_client::DepthImage;

/// Cell side, metres.
pub const CELL_M: f32 = 0.05;
/// Cells per side: a square of 50 m around the start.
const SIDE: i32 = 1000;
/// Obstacle heights, metres: the body steps onto lower surfaces and passes below higher ones.
const OBSTACLE_M: [f32; 2] = [0.22, 1.5];
/// Heights at which surfaces block sound, metres; door lintels are higher.
const WALL_M: [f32; 2] = [1.25, 1.9];
/// Range in which lines of sight clear the floor, metres; more distant lines are too sparse.
const CARVE_M: f32 = 6.0;
/// Smallest body distance to obstacles, metres: radius plus half a cell.
const HARD_M: f32 = 0.13;
/// Preferred distance to obstacles, metres.
const SOFT_M: f32 = 0.3;

/// A cell on the floor plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Cell {
    /// Index in x.
    pub column: i32,
    /// Index in z.
    pub row: i32,
}

impl Cell {
    pub(crate) const COLUMNS: i32 = SIDE;
    pub(crate) const COUNT: usize = (SIDE * SIDE) as usize;

    /// Returns the index in row-major order; `None` outside the map.
    pub(crate) fn index(self) -> Option<usize> {
        let inside = (0..SIDE).contains(&self.column) && (0..SIDE).contains(&self.row);
        inside.then_some((self.row * SIDE + self.column) as usize)
    }

    /// Returns a point's cell.
    pub fn at(place: FloorPoint) -> Self {
        let index = |coordinate: f32| floor(coordinate / CELL_M) + SIDE / 2;
        Self { column: index(place.x), row: index(place.z) }
    }

    /// Returns the centre.
    pub fn center(self) -> FloorPoint {
        let coordinate = |index: i32| (index - SIDE / 2) as f32 * CELL_M + 0.5 * CELL_M;
        FloorPoint::new(coordinate(self.column), coordinate(self.row))
    }

    /// Returns the cell at an offset.
    pub fn moved(self, columns: i32, rows: i32) -> Self {
        Self { column: self.column + columns, row: self.row + rows }
    }
}

/// An occupancy map with free floor, obstacles and unknown cells.
pub struct Occupancy {
    /// Evidence: positive for obstacles, negative for free floor, 0 for unknown.
    evidence: Vec<i8>,
    /// Blocked steps, by invisible obstacles.
    bumps: Vec<u8>,
    /// Surfaces at ear level.
    walls: Vec<bool>,
    has_walls: bool,
    /// Corners around all seen surfaces.
    seen: [FloorPoint; 2],
    /// Obstacle count within [`HARD_M`] and within [`SOFT_M`].
    hard: Vec<u16>,
    soft: Vec<u16>,
    disks: [Vec<(i32, i32)>; 2],
}

impl Default for Occupancy {
    fn default() -> Self {
        Self {
            evidence: vec![0; Cell::COUNT],
            bumps: vec![0; Cell::COUNT],
            walls: vec![false; Cell::COUNT],
            has_walls: false,
            seen: [FloorPoint::default(); 2],
            hard: vec![0; Cell::COUNT],
            soft: vec![0; Cell::COUNT],
            disks: [disk(HARD_M), disk(SOFT_M)],
        }
    }
}

impl Occupancy {
    const HIT: i8 = 3;
    const LIMIT: i8 = 12;

    /// Adds a depth image's floor and obstacles.
    pub fn see(&mut self, view: &PinholeCamera, pose: &Pose2d, depth: &DepthImage) {
        let mut hits = Vec::new();
        for column in 0..view.width {
            let free_m = self.look_along(view, pose, depth, column, &mut hits);
            let steps = (free_m / CELL_M) as i32;
            for step in 0..steps {
                self.add(Cell::at(view.along(pose, column, step as f32 * CELL_M)), -1);
            }
        }
        // A cell counts once per image, and after the free lines of sight: obstacles prevail at their border.
        hits.sort_unstable();
        hits.dedup();
        hits.into_iter().for_each(|cell| self.add(cell, Self::HIT));
        self.clear_body(pose.place);
    }

    /// Collects an image column's obstacles. Returns the obstacle-free range, metres.
    fn look_along(
        &mut self,
        view: &PinholeCamera,
        pose: &Pose2d,
        depth: &DepthImage,
        column: usize,
        hits: &mut Vec<Cell>,
    ) -> f32 {
        let (mut nearest_m, mut farthest_m) = (f32::INFINITY, 0.0_f32);
        for row in 0..view.height {
            let Some(seen) = view.seen(pose, depth, column, row) else { continue };
            self.widen(seen.place);
            if (WALL_M[0]..WALL_M[1]).contains(&seen.height_m) {
                self.wall(pose.place, seen.place);
            }
            farthest_m = farthest_m.max(seen.range_m);
            if (OBSTACLE_M[0]..OBSTACLE_M[1]).contains(&seen.height_m) {
                nearest_m = nearest_m.min(seen.range_m);
                hits.push(Cell::at(seen.place));
            }
        }
        (nearest_m - 1.5 * CELL_M).min(farthest_m).min(CARVE_M)
    }

    /// Marks a wall two cells thick, so that lines of samples cannot pass through.
    fn wall(&mut self, from: FloorPoint, place: FloorPoint) {
        let behind = from.toward(place, 1.0 + CELL_M / from.distance_m(place).max(CELL_M));
        for cell in [Cell::at(place), Cell::at(behind)] {
            cell.index().into_iter().for_each(|index| self.walls[index] = true);
        }
        self.has_walls = true;
    }

    /// Extends the seen area to a rectangle given by two corners.
    pub fn suppose(&mut self, area: [FloorPoint; 2]) {
        area.into_iter().for_each(|corner| self.widen(corner));
    }

    fn widen(&mut self, place: FloorPoint) {
        let [low, high] = &mut self.seen;
        (low.x, low.z) = (low.x.min(place.x), low.z.min(place.z));
        (high.x, high.z) = (high.x.max(place.x), high.z.max(place.z));
    }

    /// Returns the seen area's corners, with a margin.
    pub fn area(&self, margin_m: f32) -> [FloorPoint; 2] {
        let [low, high] = self.seen;
        [
            FloorPoint::new(low.x - margin_m, low.z - margin_m),
            FloorPoint::new(high.x + margin_m, high.z + margin_m),
        ]
    }

    /// Returns a point's distance to the seen area, metres; 0 inside.
    pub fn outside_m(&self, place: FloorPoint) -> f32 {
        let [low, high] = self.seen;
        let dx = (low.x - place.x).max(place.x - high.x).max(0.0);
        libm::hypotf(dx, (low.z - place.z).max(place.z - high.z).max(0.0))
    }

    fn clear_body(&mut self, place: FloorPoint) {
        let here = Cell::at(place);
        for dc in -1..=1 {
            for dr in -1..=1 {
                self.add(here.moved(dc, dr), -Self::LIMIT);
            }
        }
    }

    /// Records an obstacle that the camera did not show; paths avoid it.
    pub fn mark_bump(&mut self, place: FloorPoint) {
        for &(dc, dr) in &self.disks[0] {
            let cell = Cell::at(place).moved(dc, dr);
            if let Some(index) = cell.index() {
                self.bumps[index] = self.bumps[index].saturating_add(1);
            }
        }
    }

    /// Returns the blocked steps in a cell.
    pub fn bumps(&self, cell: Cell) -> u8 {
        cell.index().map_or(0, |index| self.bumps[index])
    }

    fn add(&mut self, cell: Cell, amount: i8) {
        let Some(index) = cell.index() else { return };
        let before = self.evidence[index];
        let after = (before + amount).clamp(-Self::LIMIT, Self::LIMIT);
        // 0 means unknown: a seen cell never returns to that state.
        self.evidence[index] = if after == 0 { amount.signum() } else { after };
        match (before > 0, self.evidence[index] > 0) {
            (false, true) => self.crowd(cell, 1),
            (true, false) => self.crowd(cell, -1),
            _ => {}
        }
    }

    fn crowd(&mut self, cell: Cell, change: i16) {
        // Counts per cell make `is_blocked` a lookup; paths query it for every node.
        for (counts, disk) in [&mut self.hard, &mut self.soft].into_iter().zip(&self.disks) {
            for &(dc, dr) in disk {
                if let Some(index) = cell.moved(dc, dr).index() {
                    counts[index] = counts[index].saturating_add_signed(change);
                }
            }
        }
    }

    /// Returns true for an unseen cell.
    pub fn is_unknown(&self, cell: Cell) -> bool {
        cell.index().is_some_and(|index| self.evidence[index] == 0)
    }

    /// Returns true for free floor.
    pub fn is_free(&self, cell: Cell) -> bool {
        cell.index().is_some_and(|index| self.evidence[index] < 0)
    }

    /// Returns true for an obstacle, or outside the map.
    pub fn is_obstacle(&self, cell: Cell) -> bool {
        cell.index().is_none_or(|index| self.evidence[index] > 0)
    }

    /// Returns true if a surface blocks sound at ear level.
    pub fn is_wall(&self, cell: Cell) -> bool {
        cell.index().is_none_or(|index| self.walls[index] && self.evidence[index] >= 0)
    }

    /// Returns true if obstacles leave no room for the body. Unknown cells have room.
    pub fn is_blocked(&self, cell: Cell) -> bool {
        cell.index().is_none_or(|index| self.hard[index] > 0)
    }

    /// Returns true if obstacles are closer than preferred.
    pub fn is_tight(&self, cell: Cell) -> bool {
        cell.index().is_none_or(|index| self.soft[index] > 0)
    }

    /// Returns true without a wall between two points. The end is exempt: a source may be fixed to a wall.
    pub fn has_clear_line(&self, from: FloorPoint, to: FloorPoint) -> bool {
        const SAMPLE_M: f32 = 0.09;
        const TAIL_M: f32 = 0.25;
        // The map of a blind agent has no walls. Cells outside count as walls.
        if !self.has_walls && Cell::at(from).index().is_some() && Cell::at(to).index().is_some() {
            return true;
        }
        let length_m = from.distance_m(to);
        let steps = ((length_m - TAIL_M) / SAMPLE_M).max(0.0) as i32;
        (1..=steps).all(|step| !self.is_wall(Cell::at(from.toward(to, step as f32 * SAMPLE_M / length_m))))
    }

    /// Returns true if a point is in front of the camera within `near_m`, and not behind a wall.
    pub fn is_in_view(&self, pose: &Pose2d, place: FloorPoint, near_m: f32) -> bool {
        const ASIDE_RAD: f32 = 0.6;
        place.distance_m(pose.place) <= near_m
            && pose.bearing_rad(place).abs() <= ASIDE_RAD
            && self.has_clear_line(pose.place, place)
    }

    /// Returns the frontiers between free floor and unknown cells: centre, and length in cells.
    pub fn frontiers(&self) -> Vec<(FloorPoint, usize)> {
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

    fn frontier_in(&self, corner: Cell, block: i32) -> Option<(FloorPoint, usize)> {
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

fn disk(radius_m: f32) -> Vec<(i32, i32)> {
    let reach = (radius_m / CELL_M).ceil() as i32;
    let offsets = (-reach..=reach).flat_map(|dc| (-reach..=reach).map(move |dr| (dc, dr)));
    offsets.filter(|&(dc, dr)| libm::hypotf(dc as f32, dr as f32) * CELL_M <= radius_m).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::{Pose, TaskSpec};

    impl Occupancy {
        /// Adds free floor in a rectangle given by two corners, metres.
        pub(crate) fn with_floor(mut self, from: FloorPoint, to: FloorPoint) -> Self {
            self.fill(from, to, -Self::LIMIT);
            self
        }

        /// Extends the seen area to a rectangle.
        pub(crate) fn with_area(mut self, area: [FloorPoint; 2]) -> Self {
            self.suppose(area);
            self
        }

        /// Adds a wall in a rectangle.
        pub(crate) fn with_wall(mut self, from: FloorPoint, to: FloorPoint) -> Self {
            self.fill(from, to, Self::LIMIT);
            self.fill(from, to, Self::LIMIT);
            self
        }

        fn fill(&mut self, from: FloorPoint, to: FloorPoint, amount: i8) {
            let (from, to) = (Cell::at(from), Cell::at(to));
            for column in from.column..=to.column {
                for row in from.row..=to.row {
                    let cell = Cell { column, row };
                    self.add(cell, amount);
                    self.widen(cell.center());
                    cell.index().into_iter().for_each(|index| self.walls[index] = amount > 0);
                }
            }
            self.has_walls |= amount > 0;
        }
    }

    #[test]
    fn walls_are_obstacles_and_floor_is_free() {
        let task = TaskSpec { width: 64, height: 64, ..TaskSpec::default() };
        let view = PinholeCamera::new(&task);
        // A wall 3.02 m ahead; pixels that look down below it see the floor 1 m under the camera.
        let row_depth = |row: usize| {
            let down = (row as f32 + 0.5 - 32.0) / 32.0;
            if down > 0.0 { (1.0 / down).min(3.02) } else { 3.02 }
        };
        let metres = (0..64 * 64).map(|i| row_depth(i / 64)).collect();
        let depth = DepthImage { width: 64, height: 64, metres };
        let mut map = Occupancy::default();
        map.see(&view, &Pose2d::new(&Pose::default()), &depth);
        assert!(map.is_obstacle(Cell::at(FloorPoint::new(0.0, -3.01))));
        assert!(map.is_blocked(Cell::at(FloorPoint::new(0.0, -2.92))));
        assert!(
            map.is_free(Cell::at(FloorPoint::new(0.0, -2.0)))
                && map.is_free(Cell::at(FloorPoint::new(0.5, -1.5)))
        );
        assert!(
            map.is_unknown(Cell::at(FloorPoint::new(0.0, -3.5)))
                && map.is_unknown(Cell::at(FloorPoint::new(0.0, 1.0)))
        );
        assert!(!map.has_clear_line(FloorPoint::default(), FloorPoint::new(0.0, -3.9)));
        assert!(map.has_clear_line(FloorPoint::default(), FloorPoint::new(0.0, -3.1)));
    }

    #[test]
    fn frontiers_avoid_walls() {
        let map = Occupancy::default()
            .with_floor(FloorPoint::new(0.0, 0.0), FloorPoint::new(2.0, 2.0))
            .with_wall(FloorPoint::new(-0.1, -0.1), FloorPoint::new(2.2, -0.05))
            .with_wall(FloorPoint::new(-0.1, -0.1), FloorPoint::new(-0.05, 2.2))
            .with_wall(FloorPoint::new(-0.1, 2.06), FloorPoint::new(2.2, 2.1));
        let frontiers = map.frontiers();
        assert!(!frontiers.is_empty());
        assert!(frontiers.iter().all(|(place, _)| (place.x - 2.0).abs() < 0.1), "{frontiers:?}");
    }

    #[test]
    fn seen_through_obstacles_disappear() {
        let mut map = Occupancy::default().with_wall(FloorPoint::new(1.0, 1.0), FloorPoint::new(1.0, 1.0));
        let cell = Cell::at(FloorPoint::new(1.0, 1.0));
        assert!(map.is_obstacle(cell) && map.is_blocked(cell.moved(2, 0)) && map.is_tight(cell.moved(5, 0)));
        (0..30).for_each(|_| map.add(cell, -1));
        assert!(map.is_free(cell) && !map.is_blocked(cell.moved(2, 0)) && !map.is_tight(cell.moved(5, 0)));
    }
}
