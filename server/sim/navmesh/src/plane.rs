//! The ground plane in lattice units: integer mesh corners make visibility between corners exact.

use avln_geom::{Point2, Point3};

/// A position in the ground plane, cells: world x and z from the lattice origin.
pub(crate) type Spot = Point2<f64>;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LatticePoint {
    pub(crate) spot: Spot,
    pub(crate) height_m: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lattice {
    pub(crate) origin: Point3<f32>,
    /// Cell width, metres.
    pub(crate) cell_m: f32,
    /// Cell height, metres.
    pub(crate) level_m: f32,
}

impl Lattice {
    pub(crate) fn spot(&self, point: &Point3<f32>) -> Spot {
        let along = |value: f32, origin: f32| (f64::from(value) - f64::from(origin)) / f64::from(self.cell_m);
        Spot::new(along(point.x, self.origin.x), along(point.z, self.origin.z))
    }

    pub(crate) fn point(&self, spot: &Spot, height_m: f32) -> Point3<f32> {
        let back = |cells: f64, origin: f32| (f64::from(origin) + cells * f64::from(self.cell_m)) as f32;
        Point3::new(back(spot.x, self.origin.x), height_m, back(spot.y, self.origin.z))
    }

    // Recast rounds corners to f32 after each operation; [`Lattice::point`] rounds once.
    pub(crate) fn corner(&self, spot: &Spot, height_m: f32) -> Point3<f32> {
        let back = |cells: f64, origin: f32| origin + cells as f32 * self.cell_m;
        Point3::new(back(spot.x, self.origin.x), height_m, back(spot.y, self.origin.z))
    }

    pub(crate) fn height_m(&self, level: u16) -> f32 {
        self.origin.y + f32::from(level) * self.level_m
    }

    pub(crate) fn cells(&self, metres: f64) -> f64 {
        metres / f64::from(self.cell_m)
    }

    pub(crate) fn apart_m(&self, a: &LatticePoint, b: &LatticePoint) -> f64 {
        let flat_m = (a.spot - b.spot).norm() * f64::from(self.cell_m);
        let rise_m = a.height_m - b.height_m;
        if rise_m == 0.0 { flat_m } else { (flat_m * flat_m + rise_m * rise_m).sqrt() }
    }
}

/// Doubled triangle area, cells squared; positive if `c` is left of the line from `a` to `b`.
pub(crate) fn turn(a: &Spot, b: &Spot, c: &Spot) -> f64 {
    (b - a).perp(&(c - a))
}

/// Returns the segment point nearest to `p`.
pub(crate) fn nearest_on_segment(p: &Spot, a: &Spot, b: &Spot) -> Spot {
    a + (b - a) * share_of_segment(p, a, b)
}

/// Returns the height at the point nearest to `p` on sloped segments, metres.
pub(crate) fn nearest_height_m(p: &Spot, sides: impl Iterator<Item = [LatticePoint; 2]>) -> f64 {
    let mut best = (f64::INFINITY, 0.0);
    for [a, b] in sides {
        let share = share_of_segment(p, &a.spot, &b.spot);
        let gap = (a.spot + (b.spot - a.spot) * share - p).norm_squared();
        if gap < best.0 {
            best = (gap, a.height_m + (b.height_m - a.height_m) * share);
        }
    }
    best.1
}

/// Returns the parameter (0 at `a`, 1 at `b`) for the segment point nearest to `p`.
pub(crate) fn share_of_segment(p: &Spot, a: &Spot, b: &Spot) -> f64 {
    let along = b - a;
    let length_squared = along.norm_squared();
    if length_squared == 0.0 { 0.0 } else { ((p - a).dot(&along) / length_squared).clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattice_conversion_is_invertible() {
        let lattice = Lattice { origin: Point3::new(-3.0, 1.0, 2.0), cell_m: 0.05, level_m: 0.2 };
        let point = Point3::new(-2.5, 1.25, 2.1);
        let spot = lattice.spot(&point);
        assert!((spot - Spot::new(10.0, 2.0)).norm() < 1e-5, "{spot}");
        assert!((lattice.point(&spot, 1.25) - point).norm() < 1e-6);
        assert_eq!(lattice.height_m(5), 2.0);
    }

    #[test]
    fn distances_include_height() {
        let lattice = Lattice { origin: Point3::origin(), cell_m: 0.5, level_m: 0.2 };
        let point = |x: f64, height_m: f64| LatticePoint { spot: Spot::new(x, 0.0), height_m };
        assert_eq!(lattice.apart_m(&point(0.0, 1.0), &point(6.0, 1.0)), 3.0);
        assert_eq!(lattice.apart_m(&point(0.0, 1.0), &point(6.0, 5.0)), 5.0);
    }

    #[test]
    fn left_is_positive_and_segments_end() {
        let (a, b) = (Spot::new(0.0, 0.0), Spot::new(4.0, 0.0));
        assert_eq!(turn(&a, &b, &Spot::new(1.0, 3.0)), 12.0);
        assert_eq!(nearest_on_segment(&Spot::new(1.0, 3.0), &a, &b), Spot::new(1.0, 0.0));
        assert_eq!(nearest_on_segment(&Spot::new(7.0, 4.0), &a, &b), b);
        assert_eq!(nearest_on_segment(&Spot::new(7.0, 4.0), &a, &a), a);
    }
}
