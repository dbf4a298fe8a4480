//! Grid with cubic cells, and traversal by rays.

use avln_geom::{Aabb, Point3, Vector3};

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
    pub(super) fn new(bounds: Option<Aabb>) -> Self {
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
    pub(super) fn around(&self, point: &Point3<f32>, reach: usize) -> Vec<usize> {
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
