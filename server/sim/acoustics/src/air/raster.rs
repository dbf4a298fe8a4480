//! Rasterisation of triangles into the air grid.

use super::Grid;
use avln_geom::{Point3, Vector3};
use std::ops::RangeInclusive;

/// Cell centres within this distance of a surface belong to the surface, metres.
const SKIN_M: f32 = 0.04;

/// Closes the cells with a centre within the skin of the triangle.
pub(super) fn close_cells_near(grid: &Grid, corners: &[Point3<f32>; 3], open: &mut [bool]) {
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

/// Blocks the steps between neighbouring centres cut by the triangle.
pub(super) fn block_steps_through(grid: &Grid, corners: &[Point3<f32>; 3], free_steps: &mut [[bool; 3]]) {
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

/// Blocks the cut steps in a row of centres in direction `axis`; `column` contains the indices on the
/// following two axes.
fn block_column(
    grid: &Grid,
    corners: &[Point3<f32>; 3],
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

/// Barycentric weights of the origin in a flat triangle; `None` outside. Edges are inside with a small
/// tolerance, so that no gap opens between adjacent triangles.
fn weights_at_origin(corners: &[[f32; 2]; 3]) -> Option<[f32; 3]> {
    let cross = |a: [f32; 2], b: [f32; 2]| a[0] * b[1] - a[1] * b[0];
    let [a, b, c] = *corners;
    let areas = [cross(b, c), cross(c, a), cross(a, b)];
    let total: f32 = areas.iter().sum();
    let weights = areas.map(|area| area / total);
    (total != 0.0 && weights.iter().all(|weight| *weight >= -1e-4)).then_some(weights)
}

/// Returns the index range on `axis` within `margin_m` of the triangle's extent.
fn span(
    grid: &Grid,
    corners: &[Point3<f32>; 3],
    axis: usize,
    margin_m: f32,
) -> Option<RangeInclusive<usize>> {
    let [a, b, c] = corners.map(|corner| corner[axis]);
    let position = |at: f32| (at - grid.first_center[axis]) / grid.cell_m;
    let low = position(a.min(b).min(c) - margin_m).ceil().max(0.0);
    let high = position(a.max(b).max(c) + margin_m).floor().min(grid.size[axis] as f32 - 1.0);
    (low <= high).then_some(low as usize..=high as usize)
}

/// Squared distance from `point` to the triangle (Ericson, "Real-Time Collision Detection", 5.1.5).
fn distance_squared(point: &Point3<f32>, corners: &[Point3<f32>; 3]) -> f32 {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_to_a_triangle_by_hand() {
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
    fn a_line_through_a_shared_edge_is_blocked_by_one_of_the_two() {
        let (a, b) = ([[-1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]], [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]]);
        assert!(weights_at_origin(&a).is_some() || weights_at_origin(&b).is_some());
        assert!(weights_at_origin(&[[1.0, 1.0], [2.0, 1.0], [1.0, 2.0]]).is_none());
    }
}
