//! The air of a building on a grid: open cells and unobstructed steps between them.

use avln_geom::{Aabb, Point3, RayMesh, Vector3};
use avln_scene::Scene;
use std::sync::Arc;

mod raster;

/// Edge of a cell, metres.
const CELL_M: f32 = 0.2;

/// Limit on the number of cells; larger buildings get larger cells.
const MAX_CELLS: f32 = 1.0e6;

/// Smallest volume of room air, cubic metres, counting cells with six air neighbours. Smaller connected air
/// is the inside of a wall, a slab or furniture.
const MIN_ROOM_M3: f32 = 0.8;

/// The air of a building in which sound travels.
pub(crate) struct Air {
    rays: Arc<RayMesh>,
    grid: Grid,
    /// Per cell: true if the centre is room air.
    in_room: Vec<bool>,
    /// Per cell: true if the step to the next cell in x, y, z is free.
    free_steps: Vec<[bool; 3]>,
}

/// A box of cubic cells; cell (x, y, z) has index `(z * size_y + y) * size_x + x`.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    /// Centre of cell 0.
    pub(crate) first_center: Point3<f32>,
    pub(crate) cell_m: f32,
    pub(crate) size: [usize; 3],
}

impl Grid {
    fn new(bounds: Option<Aabb>) -> Self {
        let finite = |bounds: &Aabb| bounds.size().iter().all(|edge_m| edge_m.is_finite());
        let Some(bounds) = bounds.filter(finite) else {
            return Self { first_center: Point3::origin(), cell_m: CELL_M, size: [0; 3] };
        };
        let edges = bounds.size();
        let mut cell_m = CELL_M;
        while edges.iter().map(|edge_m| (edge_m / cell_m).ceil().max(1.0)).product::<f32>() > MAX_CELLS {
            cell_m *= 1.25;
        }
        let size = [edges.x, edges.y, edges.z].map(|edge_m| ((edge_m / cell_m) as usize).max(1));
        let used = Vector3::from_fn(|axis, _| (size[axis] - 1) as f32 * cell_m);
        Self { first_center: bounds.min + (edges - used) * 0.5, cell_m, size }
    }

    pub(crate) fn len(&self) -> usize {
        self.size.iter().product()
    }

    pub(crate) fn index(&self, cell: [usize; 3]) -> usize {
        (cell[2] * self.size[1] + cell[1]) * self.size[0] + cell[0]
    }

    pub(crate) fn cell(&self, index: usize) -> [usize; 3] {
        let [size_x, size_y, _] = self.size;
        [index % size_x, index / size_x % size_y, index / (size_x * size_y)]
    }

    pub(crate) fn center(&self, index: usize) -> Point3<f32> {
        let cell = self.cell(index);
        self.first_center + Vector3::from_fn(|axis, _| cell[axis] as f32 * self.cell_m)
    }

    /// Returns true if `point` is inside the grid.
    pub(crate) fn holds(&self, point: &Point3<f32>) -> bool {
        (0..3).all(|axis| {
            let place = (point[axis] - self.first_center[axis]) / self.cell_m + 0.5;
            (0.0..self.size[axis] as f32).contains(&place)
        })
    }

    /// Index distance between neighbours in direction `axis`.
    pub(crate) fn stride(&self, axis: usize) -> usize {
        [1, self.size[0], self.size[0] * self.size[1]][axis]
    }

    /// Returns the cells within `reach` cells of `point` (of the nearest cell if `point` is outside).
    fn around(&self, point: &Point3<f32>, reach: usize) -> Vec<usize> {
        if self.len() == 0 {
            return Vec::new();
        }
        let ranges = [0, 1, 2].map(|axis| {
            let position = ((point[axis] - self.first_center[axis]) / self.cell_m).round();
            let middle = (position.max(0.0) as usize).min(self.size[axis] - 1);
            middle.saturating_sub(reach)..=(middle + reach).min(self.size[axis] - 1)
        });
        let [xs, ys, zs] = ranges;
        let rows = zs.flat_map(|z| ys.clone().map(move |y| (y, z)));
        rows.flat_map(|(y, z)| xs.clone().map(move |x| self.index([x, y, z]))).collect()
    }
}

impl Air {
    /// Scans the surfaces of `scene`; `rays` must be built over the same triangles.
    pub(crate) fn new(scene: &Scene, rays: Arc<RayMesh>) -> Self {
        let grid = Grid::new(scene.bounds());
        let mut open = vec![true; grid.len()];
        let mut free_steps = vec![[true; 3]; grid.len()];
        for triangle in 0..scene.mesh.triangles.len() {
            let corners = scene.corners(triangle);
            raster::close_cells_near(&grid, &corners, &mut open);
            raster::block_steps_through(&grid, &corners, &mut free_steps);
        }
        let mut air = Self { rays, grid, in_room: open, free_steps };
        air.keep_rooms();
        air
    }

    /// Bytes of the cell data.
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.in_room.as_slice()) + size_of_val(self.free_steps.as_slice())
    }

    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    pub(crate) fn rays(&self) -> &RayMesh {
        &self.rays
    }

    /// Returns true if the centre of `cell` is room air.
    pub(crate) fn in_room(&self, cell: usize) -> bool {
        self.in_room[cell]
    }

    /// Returns the open cells reachable from `cell` in a single free step.
    pub(crate) fn neighbours(&self, cell: usize) -> impl Iterator<Item = usize> + '_ {
        let position = self.grid.cell(cell);
        (0..3).flat_map(move |axis| {
            let stride = self.grid.stride(axis);
            let up = position[axis] + 1 < self.grid.size[axis] && self.free_steps[cell][axis];
            let down = position[axis] > 0 && self.free_steps[cell - stride][axis];
            let up = (up && self.in_room[cell + stride]).then(|| cell + stride);
            let down = (down && self.in_room[cell - stride]).then(|| cell - stride);
            [down, up].into_iter().flatten()
        })
    }

    /// Closes connected air too small or thin for a room; the largest part always stays.
    fn keep_rooms(&mut self) {
        let mut group_of = vec![u32::MAX; self.grid.len()];
        let mut counts: Vec<usize> = Vec::new();
        for seed in 0..self.grid.len() {
            if self.in_room[seed] && group_of[seed] == u32::MAX {
                let group = counts.len() as u32;
                counts.push(self.flood(seed, group, &mut group_of));
            }
        }
        let least = (MIN_ROOM_M3 / (self.grid.cell_m * self.grid.cell_m * self.grid.cell_m)) as usize;
        let least = least.min(counts.iter().copied().max().unwrap_or(0));
        for (in_room, group) in self.in_room.iter_mut().zip(group_of) {
            *in_room = *in_room && counts[group as usize] >= least;
        }
    }

    /// Marks all cells connected to `seed` and counts cells with six air neighbours.
    fn flood(&self, seed: usize, group: u32, group_of: &mut [u32]) -> usize {
        let mut stack = vec![seed];
        let mut count = 0;
        group_of[seed] = group;
        while let Some(cell) = stack.pop() {
            count += usize::from(self.neighbours(cell).count() == 6);
            for next in self.neighbours(cell) {
                if group_of[next] == u32::MAX {
                    group_of[next] = group;
                    stack.push(next);
                }
            }
        }
        count
    }

    /// Returns a few room cells visible from `point`, nearest first.
    pub(crate) fn clear_cells(&self, point: &Point3<f32>) -> Vec<usize> {
        const ENOUGH: usize = 8;
        for reach in 1..=2 {
            let cells = self.room_cells(point, reach).into_iter();
            let clear = cells.filter(|cell| self.rays.is_clear(point, &self.grid.center(*cell)));
            let cells: Vec<_> = clear.take(ENOUGH).collect();
            if !cells.is_empty() {
                return cells;
            }
        }
        Vec::new()
    }

    /// Returns the room cell for a point enclosed by furniture or outside: the nearest cell behind a single
    /// surface, otherwise the cell behind the fewest surfaces. `None` without room air.
    pub(crate) fn nearest_cell(&self, point: &Point3<f32>) -> Option<usize> {
        const REACH_M: f32 = 1.2;
        const ENOUGH: usize = 128;
        let near = self.room_cells(point, (REACH_M / self.grid.cell_m) as usize);
        let mut best = None;
        for cell in near.into_iter().take(ENOUGH) {
            let surfaces = self.surfaces_between(point, &self.grid.center(cell));
            if best.is_none_or(|(fewest, _)| surfaces < fewest) {
                best = Some((surfaces, cell));
            }
            if surfaces <= 1 {
                break;
            }
        }
        best.map(|(_, cell)| cell).or_else(|| self.nearest_of_all(point))
    }

    fn nearest_of_all(&self, point: &Point3<f32>) -> Option<usize> {
        let rooms = (0..self.grid.len()).filter(|cell| self.in_room[*cell]);
        rooms.min_by(|a, b| self.distance_to(point, *a).total_cmp(&self.distance_to(point, *b)))
    }

    fn room_cells(&self, point: &Point3<f32>, reach: usize) -> Vec<usize> {
        let mut cells = self.grid.around(point, reach);
        cells.retain(|cell| self.in_room[*cell]);
        cells.sort_by(|a, b| self.distance_to(point, *a).total_cmp(&self.distance_to(point, *b)));
        cells
    }

    fn distance_to(&self, point: &Point3<f32>, cell: usize) -> f32 {
        (self.grid.center(cell) - point).norm_squared()
    }

    fn surfaces_between(&self, from: &Point3<f32>, to: &Point3<f32>) -> usize {
        const SKIP_M: f32 = 1e-3;
        const ENOUGH: usize = 16;
        let offset = to - from;
        let length_m = offset.norm();
        let direction = offset / length_m.max(f32::MIN_POSITIVE);
        let (mut travelled_m, mut count) = (0.0, 0);
        while count < ENOUGH && travelled_m < length_m {
            let start = from + direction * travelled_m;
            let Some(hit) = self.rays.cast(&start, &direction, length_m - travelled_m) else { break };
            travelled_m += hit.distance + SKIP_M;
            count += 1;
        }
        count
    }
}
