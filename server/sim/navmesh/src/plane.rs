//! The ground plane in lattice units: where corners of the mesh have whole coordinates, so that what a corner
//! sees of other corners is decided exactly.

use avln_geom::{Point2, Point3, Vector2};

/// A place in the ground plane, in cells: world x and z from the lattice's origin.
pub(crate) type Spot = Point2<f64>;
/// An offset in the ground plane, in cells.
pub(crate) type Offset = Vector2<f64>;

/// Width of a lattice cell, metres.
pub(crate) const CELL_M: f32 = 0.05;
/// Height of a lattice cell, metres.
pub(crate) const LEVEL_M: f32 = 0.05;

/// Ties lattice coordinates to the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lattice {
    pub(crate) origin: Point3<f32>,
}

impl Lattice {
    pub(crate) fn spot(&self, point: &Point3<f32>) -> Spot {
        let along = |value: f32, origin: f32| (f64::from(value) - f64::from(origin)) / f64::from(CELL_M);
        Spot::new(along(point.x, self.origin.x), along(point.z, self.origin.z))
    }

    pub(crate) fn point(&self, spot: &Spot, height_m: f32) -> Point3<f32> {
        let back = |cells: f64, origin: f32| (f64::from(origin) + cells * f64::from(CELL_M)) as f32;
        Point3::new(back(spot.x, self.origin.x), height_m, back(spot.y, self.origin.z))
    }

    /// World height of a level of the lattice.
    pub(crate) fn height_m(&self, level: u16) -> f32 {
        self.origin.y + f32::from(level) * LEVEL_M
    }
}

/// Twice the area of the triangle `a`, `b`, `c`, cells squared; positive when `c` lies left of the way from `a` to `b`.
pub(crate) fn turn(a: &Spot, b: &Spot, c: &Spot) -> f64 {
    (b - a).perp(&(c - a))
}

/// The point of the segment from `a` to `b` nearest to `p`.
pub(crate) fn nearest_on_segment(p: &Spot, a: &Spot, b: &Spot) -> Spot {
    let along = b - a;
    let length_squared = along.norm_squared();
    if length_squared == 0.0 {
        return *a;
    }
    a + along * ((p - a).dot(&along) / length_squared).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lattice_goes_there_and_back() {
        let lattice = Lattice { origin: Point3::new(-3.0, 1.0, 2.0) };
        let point = Point3::new(-2.5, 1.25, 2.1);
        let spot = lattice.spot(&point);
        assert!((spot - Spot::new(10.0, 2.0)).norm() < 1e-5, "{spot}");
        assert!((lattice.point(&spot, 1.25) - point).norm() < 1e-6);
        assert_eq!(lattice.height_m(5), 1.25);
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
