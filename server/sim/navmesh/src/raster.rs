//! Triangle rasterisation into heightfield columns.

// Follows Recast's `rasterizeTri` and `addSpan` operation by operation: walls at round numbers are on cell
// borders, where the last bit selects the filled cells.

use avln_geom::Point3;
use rerecast::{AreaType, Heightfield, Span};

/// Most corners after four cuts.
const MAX_CORNERS: usize = 7;
const X: usize = 0;
const Y: usize = 1;
const Z: usize = 2;

#[derive(Clone, Copy)]
struct Outline {
    corners: [Point3<f32>; MAX_CORNERS],
    count: usize,
}

impl Outline {
    const NONE: Self = Self { corners: [Point3::new(0.0, 0.0, 0.0); MAX_CORNERS], count: 0 };

    fn corners(&self) -> &[Point3<f32>] {
        &self.corners[..self.count]
    }

    fn push(&mut self, corner: Point3<f32>) {
        if let Some(place) = self.corners.get_mut(self.count) {
            *place = corner;
            self.count += 1;
        }
    }

    fn reach(&self, axis: usize) -> (f32, f32) {
        let values = self.corners().iter().map(|corner| corner[axis]);
        values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    }

    /// Returns the parts below and above `at`; corners on the line belong to both.
    fn split(&self, axis: usize, at: f32) -> (Self, Self) {
        let (mut below, mut above) = (Self::NONE, Self::NONE);
        let Some(mut last) = self.corners().last() else { return (below, above) };
        for corner in self.corners() {
            let (rest, rest_before) = (at - corner[axis], at - last[axis]);
            if (rest >= 0.0) != (rest_before >= 0.0) {
                let crossing = last + (corner - last) * (rest_before / (rest_before - rest));
                below.push(crossing);
                above.push(crossing);
                if rest > 0.0 {
                    below.push(*corner);
                } else if rest < 0.0 {
                    above.push(*corner);
                }
            } else {
                if rest >= 0.0 {
                    below.push(*corner);
                }
                if rest <= 0.0 {
                    above.push(*corner);
                }
            }
            last = corner;
        }
        (below, above)
    }
}

/// Fills the cells touched by a triangle. Merged spans share their area if their tops differ by at most
/// `merge_levels`.
pub(crate) fn rasterise(
    field: &mut Heightfield,
    corners: [Point3<f32>; 3],
    area: AreaType,
    merge_levels: u16,
) {
    let mut rest = Outline::NONE;
    corners.into_iter().for_each(|corner| rest.push(corner));
    let (min, cell_m) = (field.aabb.min, field.cell_size);
    let cells_per_m = 1.0 / cell_m;
    let (low, high) = rest.reach(Z);
    let rows = i32::from(field.height);
    let first = (((low - min[Z]) * cells_per_m) as i32).clamp(-1, rows - 1);
    let last = (((high - min[Z]) * cells_per_m) as i32).clamp(0, rows - 1);
    for z in first..=last {
        let (row, above) = rest.split(Z, min[Z] + z as f32 * cell_m + cell_m);
        rest = above;
        if row.count >= 3 && z >= 0 {
            fill_row(field, row, z as u16, area, merge_levels);
        }
    }
}

fn fill_row(field: &mut Heightfield, row: Outline, z: u16, area: AreaType, merge_levels: u16) {
    let (min, cell_m) = (field.aabb.min, field.cell_size);
    let cells_per_m = 1.0 / cell_m;
    let columns = i32::from(field.width);
    let (low, high) = row.reach(X);
    let (first, last) = (((low - min[X]) * cells_per_m) as i32, ((high - min[X]) * cells_per_m) as i32);
    if last < 0 || first >= columns {
        return;
    }
    let mut rest = row;
    for x in first.clamp(-1, columns - 1)..=last.clamp(0, columns - 1) {
        let (cell, above) = rest.split(X, min[X] + x as f32 * cell_m + cell_m);
        rest = above;
        if cell.count >= 3
            && x >= 0
            && let Some((low, high)) = levels(field, &cell)
        {
            let span = Span { min: low, max: high, area, next: None };
            add(field, usize::from(z) * columns as usize + x as usize, span, merge_levels);
        }
    }
}

/// Returns the filled levels; `None` outside the field.
fn levels(field: &Heightfield, cell: &Outline) -> Option<(u16, u16)> {
    let (bottom, levels_per_m) = (field.aabb.min[Y], 1.0 / field.cell_height);
    let top = field.aabb.max[Y] - bottom;
    let (low, high) = cell.reach(Y);
    let (low, high) = (low - bottom, high - bottom);
    if high < 0.0 || low > top {
        return None;
    }
    let low = (low.max(0.0) * levels_per_m).floor() as u16;
    let high = (high.min(top) * levels_per_m).ceil() as u16;
    Some((low, high.max(low.saturating_add(1))))
}

/// Adds a span to a column, merged with touching spans.
fn add(field: &mut Heightfield, column: usize, mut span: Span, merge_levels: u16) {
    let mut before = None;
    let mut next = field.spans[column];
    while let Some(key) = next {
        let other = &field.allocated_spans[key];
        if other.min > span.max {
            break;
        }
        next = other.next;
        if other.max < span.min {
            before = Some(key);
            continue;
        }
        (span.min, span.max) = (span.min.min(other.min), span.max.max(other.max));
        if span.max - other.max <= merge_levels {
            span.area = AreaType(span.area.0.max(other.area.0));
        }
        field.allocated_spans.remove(key);
        match before {
            Some(before) => field.allocated_spans[before].next = next,
            None => field.spans[column] = next,
        }
    }
    span.next = next;
    let added = field.allocated_spans.insert(span);
    match before {
        Some(before) => field.allocated_spans[before].next = Some(added),
        None => field.spans[column] = Some(added),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rerecast::{Aabb3d, HeightfieldBuilder};

    fn field() -> Heightfield {
        let aabb = Aabb3d { min: [0.0; 3].into(), max: [1.0, 2.0, 1.0].into() };
        HeightfieldBuilder { aabb, cell_size: 0.1, cell_height: 0.2 }.build().expect("a small field")
    }

    fn spans(field: &Heightfield, x: usize, z: usize) -> Vec<(u16, u16, u8)> {
        let first = field.spans[z * usize::from(field.width) + x];
        let keys = std::iter::successors(first, |key| field.allocated_spans[*key].next);
        keys.map(|key| &field.allocated_spans[key]).map(|s| (s.min, s.max, s.area.0)).collect()
    }

    fn fill(field: &mut Heightfield, corners: [[f32; 3]; 3], area: u8) {
        rasterise(field, corners.map(Point3::from), AreaType(area), 1);
    }

    #[test]
    fn triangle_fills_covered_cells_only() {
        let mut field = field();
        // Half of a square that ends at z = 0.6, the border between the rows 5 and 6.
        fill(&mut field, [[0.0, 0.5, 0.0], [0.0, 0.5, 0.6], [0.6, 0.5, 0.0]], 63);
        assert_eq!(spans(&field, 0, 0), [(2, 3, 63)]);
        assert_eq!((spans(&field, 0, 5).len(), spans(&field, 5, 0).len()), (1, 1));
        assert!((7..10).all(|i| spans(&field, 0, i).is_empty() && spans(&field, i, 0).is_empty()));
        assert!(spans(&field, 5, 5).is_empty());
    }

    #[test]
    fn touching_spans_merge_and_separate_spans_are_sorted() {
        let mut field = field();
        let level = |y: f32| [[0.0, y, 0.0], [0.0, y, 0.3], [0.3, y, 0.0]];
        fill(&mut field, level(1.7), 0);
        fill(&mut field, level(0.1), 63);
        assert_eq!(spans(&field, 0, 0), [(0, 1, 63), (8, 9, 0)]);
        // One level higher: the area of the lower span remains. Two levels higher: separate area.
        fill(&mut field, level(0.3), 0);
        assert_eq!(spans(&field, 0, 0), [(0, 2, 63), (8, 9, 0)]);
        fill(&mut field, [[0.0, 0.3, 0.0], [0.0, 0.9, 0.3], [0.3, 0.9, 0.0]], 0);
        assert_eq!(spans(&field, 0, 0)[0], (0, 4, 0));
        fill(&mut field, [[0.0, 0.1, 0.0], [0.0, 1.9, 0.0], [0.05, 1.9, 0.05]], 0);
        assert_eq!(spans(&field, 0, 0), [(0, 10, 0)]);
    }

    #[test]
    fn triangles_outside_fill_nothing() {
        let mut field = field();
        fill(&mut field, [[0.0, 5.0, 0.0], [0.0, 5.0, 0.3], [0.3, 5.0, 0.0]], 63);
        fill(&mut field, [[-3.0, 0.5, 0.0], [-3.0, 0.5, 0.3], [-2.0, 0.5, 0.0]], 63);
        assert!(field.spans.iter().all(Option::is_none));
    }
}
