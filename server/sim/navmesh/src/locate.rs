use crate::plane::Spot;
use crate::polygons::Polygons;

/// Side of a bin, cells (0.5 m).
const BIN_CELLS: f64 = 10.0;

/// A grid of bins for polygon lookups.
pub(crate) struct Bins {
    columns: i64,
    rows: i64,
    first: Vec<u32>,
    polygons: Vec<u32>,
}

impl Bins {
    /// Bytes that the lists take.
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.first.as_slice()) + size_of_val(self.polygons.as_slice())
    }

    /// Registers every polygon in all bins touched by its bounding rectangle.
    pub(crate) fn new(polygons: &Polygons) -> Self {
        let boxes: Vec<_> = (0..polygons.len()).map(|polygon| bounds(polygons.corners(polygon))).collect();
        let reach = boxes.iter().fold((0, 0), |(x, y), b| (b.2.max(x), b.3.max(y)));
        let (columns, rows) = (reach.0 + 1, reach.1 + 1);
        let mut entries: Vec<(i64, u32)> = Vec::new();
        for (&(x0, y0, x1, y1), polygon) in boxes.iter().zip(0..) {
            entries.extend((y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (y * columns + x, polygon))));
        }
        entries.sort_unstable();
        let first = (0..=rows * columns).map(|bin| entries.partition_point(|entry| entry.0 < bin) as u32);
        Self {
            columns,
            rows,
            first: first.collect(),
            polygons: entries.iter().map(|entry| entry.1).collect(),
        }
    }

    /// Polygons with a bounding rectangle in the bin of `spot`, ascending.
    pub(crate) fn at(&self, spot: &Spot) -> &[u32] {
        self.bin((spot.x / BIN_CELLS).floor() as i64, (spot.y / BIN_CELLS).floor() as i64)
    }

    /// Visits the polygons within `reach` cells of `spot`, roughly nearest first, with duplicates and some
    /// beyond the reach. `visit` returns the new reach.
    pub(crate) fn around(&self, spot: &Spot, mut reach: f64, mut visit: impl FnMut(u32) -> f64) {
        let clamp = |value: f64, count: i64| ((value / BIN_CELLS).floor() as i64).clamp(0, count - 1);
        let (x, y) = (clamp(spot.x, self.columns), clamp(spot.y, self.rows));
        for ring in 0..self.columns.max(self.rows) {
            if (ring - 1) as f64 * BIN_CELLS > reach {
                return;
            }
            for (dx, dy) in ring_around(ring) {
                for &polygon in self.bin(x + dx, y + dy) {
                    reach = visit(polygon);
                }
            }
        }
    }

    fn bin(&self, x: i64, y: i64) -> &[u32] {
        if !(0..self.columns).contains(&x) || !(0..self.rows).contains(&y) {
            return &[];
        }
        let bin = (y * self.columns + x) as usize;
        &self.polygons[self.first[bin] as usize..self.first[bin + 1] as usize]
    }
}

fn bounds(corners: &[Spot]) -> (i64, i64, i64, i64) {
    let bin = |value: f64| (value / BIN_CELLS).floor() as i64;
    let (min, max) = corners.iter().fold((corners[0], corners[0]), |(min, max), c| (min.inf(c), max.sup(c)));
    (bin(min.x), bin(min.y), bin(max.x), bin(max.y))
}

/// The offsets at Chebyshev distance `ring`.
fn ring_around(ring: i64) -> impl Iterator<Item = (i64, i64)> {
    (-ring..=ring).flat_map(move |dy| {
        let step = if dy.abs() == ring { 1 } else { (2 * ring).max(1) as usize };
        (-ring..=ring).step_by(step).map(move |dx| (dx, dy))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polygons::tests::letter_l;

    #[test]
    fn rings_have_eight_bins_a_step() {
        assert_eq!(ring_around(0).collect::<Vec<_>>(), [(0, 0)]);
        assert_eq!((ring_around(1).count(), ring_around(3).count()), (8, 24));
    }

    #[test]
    fn a_bin_knows_its_polygons_and_far_spots_find_them() {
        let bins = Bins::new(&letter_l());
        assert_eq!(bins.at(&Spot::new(15.0, 5.0)), [0, 2, 3].as_slice());
        assert!(bins.at(&Spot::new(-5.0, 5.0)).is_empty());
        let mut seen = Vec::new();
        bins.around(&Spot::new(1e6, -1e6), f64::INFINITY, |polygon| {
            seen.push(polygon);
            f64::INFINITY
        });
        assert!((0..4).all(|polygon| seen.contains(&polygon)));
    }
}
