//! Air cells of a building on a cubic grid, unobstructed steps between them, and traversal by rays.

use avln_geom::{Aabb, Point3, RayMesh, Vector3};
use avln_scene::Scene;
use std::ops::RangeInclusive;
use std::sync::Arc;

// Smaller connected air is the inside of a wall, a slab or furniture. Only cells with six air neighbours count.
const MIN_ROOM_M3: f32 = 0.8;

pub(crate) struct Air {
    pub(crate) rays: Arc<RayMesh>,
    pub(crate) grid: Grid,
    /// Per cell: true if the centre is room air.
    pub(crate) in_room: Vec<bool>,
    /// Per cell: true if the step to the next cell in x, y, z is free.
    free_steps: Vec<[bool; 3]>,
}

impl Air {
    /// Scans the surfaces in `scene`; `rays` must contain the same triangles.
    pub(crate) fn new(scene: &Scene, rays: Arc<RayMesh>) -> Self {
        let grid = Grid::new(scene.bounds());
        let mut open = vec![true; grid.len()];
        let mut free_steps = vec![[true; 3]; grid.len()];
        for triangle in 0..scene.mesh.triangles.len() {
            let corners = scene.corners(triangle);
            close_cells_near(&grid, &corners, &mut open);
            block_steps_through(&grid, &corners, &mut free_steps);
        }
        let mut air = Self { rays, grid, in_room: open, free_steps };
        air.keep_rooms();
        air
    }

    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.in_room.as_slice()) + size_of_val(self.free_steps.as_slice())
    }

    /// Returns the room cells reachable from `cell` in a single free step.
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

    /// Marks the cells connected to `seed`; returns how many have six air neighbours.
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
    pub(crate) fn visible_cells(&self, point: &Point3<f32>) -> Vec<usize> {
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

    /// Returns the room cell for a point inside furniture or outside: the nearest cell behind a single
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
        let distance = |cell: &usize| self.distance_to(point, *cell);
        let rooms = (0..self.grid.len()).filter(|cell| self.in_room[*cell]);
        best.map(|(_, cell)| cell).or_else(|| rooms.min_by(|a, b| distance(a).total_cmp(&distance(b))))
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

type Triangle = [Point3<f32>; 3];

/// Cells with a centre this close to a surface are closed, metres.
const SKIN_M: f32 = 0.04;

fn close_cells_near(grid: &Grid, corners: &Triangle, open: &mut [bool]) {
    let ranges = [0, 1, 2].map(|axis| span(grid, corners, axis, SKIN_M));
    let [Some(xs), Some(ys), Some(zs)] = ranges else { return };
    for z in zs {
        for y in ys.clone() {
            for x in xs.clone() {
                let cell = grid.index([x, y, z]);
                open[cell] &= distance_squared(&grid.center(cell), corners) >= SKIN_M * SKIN_M;
            }
        }
    }
}

/// Blocks the steps between neighbouring centres that the triangle cuts.
fn block_steps_through(grid: &Grid, corners: &Triangle, free_steps: &mut [[bool; 3]]) {
    for axis in 0..3 {
        let across = [(axis + 1) % 3, (axis + 2) % 3];
        let (Some(us), Some(vs)) =
            (span(grid, corners, across[0], 1e-4), span(grid, corners, across[1], 1e-4))
        else {
            continue;
        };
        for u in us {
            for v in vs.clone() {
                block_column(grid, corners, axis, [u, v], free_steps);
            }
        }
    }
}

/// Blocks the cut steps in a row on `axis`; `column` is the row position on the next two axes.
fn block_column(
    grid: &Grid,
    corners: &Triangle,
    axis: usize,
    column: [usize; 2],
    free_steps: &mut [[bool; 3]],
) {
    let across = [(axis + 1) % 3, (axis + 2) % 3];
    let line = [0, 1].map(|i| grid.first_center[across[i]] + column[i] as f32 * grid.cell_m);
    let flat = corners.map(|corner| [corner[across[0]] - line[0], corner[across[1]] - line[1]]);
    let Some(weights) = weights_at_origin(&flat) else { return };
    let height: f32 = weights.iter().zip(corners).map(|(weight, corner)| weight * corner[axis]).sum();
    let position = ((height - grid.first_center[axis]) / grid.cell_m).floor();
    if position >= 0.0 && (position as usize) < grid.size[axis] {
        let mut cell = [0; 3];
        cell[axis] = position as usize;
        (cell[across[0]], cell[across[1]]) = (column[0], column[1]);
        free_steps[grid.index(cell)][axis] = false;
    }
}

/// Barycentric weights for the origin in a flat triangle; `None` outside.
fn weights_at_origin(corners: &[[f32; 2]; 3]) -> Option<[f32; 3]> {
    let cross = |a: [f32; 2], b: [f32; 2]| a[0] * b[1] - a[1] * b[0];
    let [a, b, c] = *corners;
    let areas = [cross(b, c), cross(c, a), cross(a, b)];
    let total: f32 = areas.iter().sum();
    let weights = areas.map(|area| area / total);
    // A tolerance at the edges, so that no gap opens between adjacent triangles.
    (total != 0.0 && weights.iter().all(|weight| *weight >= -1e-4)).then_some(weights)
}

/// Returns the index range on `axis` within `margin_m` around the triangle.
fn span(grid: &Grid, corners: &Triangle, axis: usize, margin_m: f32) -> Option<RangeInclusive<usize>> {
    let [a, b, c] = corners.map(|corner| corner[axis]);
    let position = |at: f32| (at - grid.first_center[axis]) / grid.cell_m;
    let low = position(a.min(b).min(c) - margin_m).ceil().max(0.0);
    let high = position(a.max(b).max(c) + margin_m).floor().min(grid.size[axis] as f32 - 1.0);
    (low <= high).then_some(low as usize..=high as usize)
}

/// Squared distance from `point` to the triangle (Ericson, "Real-Time Collision Detection", 5.1.5).
fn distance_squared(point: &Point3<f32>, corners: &Triangle) -> f32 {
    let [a, b, c] = corners;
    let (ab, ac) = (b - a, c - a);
    let normal = ab.cross(&ac);
    let area = normal.norm_squared();
    let inside =
        |from: &Point3<f32>, to: &Point3<f32>| (to - from).cross(&(point - from)).dot(&normal) >= 0.0;
    if area > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        let height = (point - a).dot(&normal);
        return height * height / area;
    }
    let edges = [(a, ab), (b, c - b), (c, a - c)];
    edges.iter().map(|(from, edge)| edge_distance_squared(point, from, edge)).fold(f32::INFINITY, f32::min)
}

fn edge_distance_squared(point: &Point3<f32>, from: &Point3<f32>, edge: &Vector3<f32>) -> f32 {
    let offset = point - from;
    let along = (offset.dot(edge) / edge.norm_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    (offset - edge * along).norm_squared()
}

/// Cell edge, metres.
const CELL_M: f32 = 0.2;

/// Cell limit; larger buildings get larger cells.
const MAX_CELLS: f32 = 1.0e6;

/// Cubic cells in a box; cell (x, y, z) has index `(z * size_y + y) * size_x + x`.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
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

    pub(crate) fn contains(&self, point: &Point3<f32>) -> bool {
        (0..3).all(|axis| {
            let place = (point[axis] - self.first_center[axis]) / self.cell_m + 0.5;
            (0.0..self.size[axis] as f32).contains(&place)
        })
    }

    /// Index distance between neighbours on `axis`.
    pub(crate) fn stride(&self, axis: usize) -> usize {
        [1, self.size[0], self.size[0] * self.size[1]][axis]
    }

    /// Returns the cells within `reach` cells around `point`, or around the cell nearest to it.
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

/// Visits every voxel on the ray from `from` in the unit direction `direction` (Amanatides and Woo 1987):
/// index, distances at entry and exit in metres.
pub(crate) fn march(
    grid: &Grid,
    from: &Point3<f32>,
    direction: &Vector3<f32>,
    length_m: f32,
    mut visit: impl FnMut(usize, f32, f32),
) {
    let Some((mut at_m, end_m)) = inside(grid, from, direction, length_m) else { return };
    let (mut voxel, mut crossing_m, mut step_m, mut step) = ([0_i32; 3], [0.0; 3], [0.0; 3], [0_i32; 3]);
    for axis in 0..3 {
        let start = from[axis] + direction[axis] * at_m - low(grid, axis);
        let last = grid.size[axis] as i32 - 1;
        voxel[axis] = ((start / grid.cell_m) as i32).clamp(0, last);
        let forward = direction[axis] > 0.0;
        step[axis] = if forward { 1 } else { -1 };
        let slowness = inverse(direction[axis]);
        step_m[axis] = grid.cell_m * slowness.abs();
        let wall = (voxel[axis] + i32::from(forward)) as f32 * grid.cell_m + low(grid, axis);
        crossing_m[axis] = (wall - from[axis]) * slowness;
    }
    loop {
        let axis = if crossing_m[0] < crossing_m[1] { 0 } else { 1 };
        let axis = if crossing_m[2] < crossing_m[axis] { 2 } else { axis };
        let leave_m = crossing_m[axis].min(end_m);
        if leave_m > at_m {
            visit(grid.index(voxel.map(|place| place as usize)), at_m, leave_m);
            at_m = leave_m;
        }
        voxel[axis] += step[axis];
        if leave_m >= end_m || voxel[axis] < 0 || voxel[axis] >= grid.size[axis] as i32 {
            return;
        }
        crossing_m[axis] += step_m[axis];
    }
}

fn low(grid: &Grid, axis: usize) -> f32 {
    grid.first_center[axis] - 0.5 * grid.cell_m
}

fn inverse(direction: f32) -> f32 {
    const HUGE: f32 = 1e12;
    if direction.abs() < 1.0 / HUGE { HUGE.copysign(direction) } else { 1.0 / direction }
}

/// Part inside the grid box: start and end on the ray, metres.
fn inside(grid: &Grid, from: &Point3<f32>, direction: &Vector3<f32>, length_m: f32) -> Option<(f32, f32)> {
    let (mut near_m, mut far_m) = (0.0_f32, length_m);
    for axis in 0..3 {
        let high = low(grid, axis) + grid.size[axis] as f32 * grid.cell_m;
        let slowness = inverse(direction[axis]);
        let (a, b) = ((low(grid, axis) - from[axis]) * slowness, (high - from[axis]) * slowness);
        near_m = near_m.max(a.min(b));
        far_m = far_m.min(a.max(b));
    }
    (near_m < far_m).then_some((near_m, far_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;

    #[test]
    fn triangle_distances_match_hand_computed_values() {
        let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]].map(Point3::from);
        for (point, squared) in [
            ([0.5, 0.5, 3.0], 9.0),
            ([1.0, -2.0, 0.0], 4.0),
            ([-3.0, -4.0, 0.0], 25.0),
            ([2.0, 2.0, 0.0], 2.0),
        ] {
            assert!((distance_squared(&Point3::from(point), &corners) - squared).abs() < 1e-5, "{point:?}");
        }
    }

    #[test]
    fn shared_edges_have_no_gap() {
        let (a, b) = ([[-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]], [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]]);
        assert!(weights_at_origin(&a).is_some() || weights_at_origin(&b).is_some());
        assert!(weights_at_origin(&[[1.0, 1.0], [2.0, 1.0], [1.0, 2.0]]).is_none());
    }

    #[test]
    fn legs_are_divided_among_their_voxels() {
        let grid = Grid { first_center: Point3::new(-1.0, 0.5, 2.0), cell_m: 0.2, size: [12, 7, 9] };
        let mut rng = Rng::new(4);
        for _ in 0..500 {
            let mut vector = |reach: f32| Vector3::from_fn(|_, _| rng.range(-reach, reach));
            let (from, direction) = (Point3::new(0.0, 1.0, 3.0) + vector(2.0), vector(1.0).normalize());
            let (mut before_m, mut total_m) = (None, 0.0);
            march(&grid, &from, &direction, 3.0, |voxel, enter_m, leave_m| {
                assert!(before_m.is_none_or(|before: f32| before == enter_m));
                let middle = from + direction * (0.5 * (enter_m + leave_m));
                let off = middle - grid.center(voxel);
                assert!(off.amax() < 0.5 * grid.cell_m + 1e-4, "{off}");
                before_m = Some(leave_m);
                total_m += leave_m - enter_m;
            });
            let expected_m = inside(&grid, &from, &direction, 3.0).map_or(0.0, |(near, far)| far - near);
            assert!((total_m - expected_m).abs() < 1e-4, "{total_m} of {expected_m}");
        }
    }
}
