//! Edges of eight triangles on the screen. Positions are in pixels from the centre of the first pixel, columns to the right
//! and rows down.

use crate::lanes::Floats;

/// A position on the screen.
pub(super) type Position = [Floats; 2];

/// A number that grows linearly over the picture: `x·column + y·row + constant`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Planes {
    pub(super) x: Floats,
    pub(super) y: Floats,
    pub(super) constant: Floats,
}

/// Edges: inside if the plane is above `limit`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Edges {
    pub(super) plane: Planes,
    /// Slightly below 0 if points on the line are inside, otherwise 0.
    pub(super) limit: Floats,
}

/// Twice the area of triangles; positive when their corners turn to the right.
#[inline(always)]
pub(super) fn double_area([ax, ay]: Position, [bx, by]: Position, [cx, cy]: Position) -> Floats {
    (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
}

/// Edges from `a` to `b` of triangles with the inside on the right for `side` 1 and on the left for -1.
///
/// From `b` to `a` the values are equal with opposite signs: planes are anchored at the end nearer to the
/// first pixel, which minimises rounding.
#[inline(always)]
pub(super) fn edges([ax, ay]: Position, [bx, by]: Position, side: Floats) -> Edges {
    let zero = Floats::of(0.0);
    let (x, y) = ((ay - by) * side, (bx - ax) * side);
    let (far_a, far_b) = (ax.abs() + ay.abs(), bx.abs() + by.abs());
    let is_left = ax.above(bx) | (ax.equals(bx) & ay.above(by));
    let from_b = far_a.above(far_b) | (far_a.equals(far_b) & is_left);
    let (anchor_x, anchor_y) = (from_b.choose(bx, ax), from_b.choose(by, ay));
    let is_top_left = x.above(zero) | (x.equals(zero) & y.above(zero));
    Edges {
        plane: Planes { x, y, constant: -(x * anchor_x + y * anchor_y) },
        limit: is_top_left.keep(Floats::of(-f32::MIN_POSITIVE)),
    }
}

/// Planes through values at three corners; `inverse` is the reciprocal of the triangles' [`double_area`].
#[inline(always)]
pub(super) fn planes(corners: &[Position; 3], inverse: Floats, [a, b, c]: [Floats; 3]) -> Planes {
    let [[ax, ay], [bx, by], [cx, cy]] = *corners;
    let x = ((b - a) * (cy - ay) - (c - a) * (by - ay)) * inverse;
    let y = ((c - a) * (bx - ax) - (b - a) * (cx - ax)) * inverse;
    Planes { x, y, constant: a - (x * ax + y * ay) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::LANES;
    use avln_geom::Rng;

    fn at(planes: &Planes, [column, row]: Position) -> Floats {
        planes.x * column + (planes.y * row + planes.constant)
    }

    #[test]
    fn both_sides_of_an_edge_have_the_same_numbers_and_one_owns_the_line() {
        let mut rng = Rng::new(4);
        for round in 0..300 {
            let mut points = || [0, 0].map(|_: i32| Floats([0.0; LANES].map(|_| rng.range(-300.0, 300.0))));
            let (a, mut b) = (points(), points());
            if round % 3 == 0 {
                b[0] = a[0];
            }
            let (here, there) = (edges(a, b, Floats::of(1.0)), edges(b, a, Floats::of(1.0)));
            let numbers = |edges: &Edges| [edges.plane.x, edges.plane.y, edges.plane.constant];
            assert_eq!(numbers(&here), numbers(&there).map(|value| -value));
            assert_eq!(here, edges(b, a, Floats::of(-1.0)));
            let owners = here.limit + there.limit;
            assert_eq!(owners, Floats::of(-f32::MIN_POSITIVE));
        }
    }

    #[test]
    fn left_and_upper_edges_own_their_points() {
        let point = |x, y| [Floats::of(x), Floats::of(y)];
        let (a, b, c) = (point(0.0, 0.0), point(4.0, 0.0), point(0.0, 4.0));
        assert!(double_area(a, b, c).above(Floats::of(0.0)).any());
        let limit = |from, to| edges(from, to, Floats::of(1.0)).limit.0[0];
        assert!(limit(a, b) < 0.0, "the upper edge");
        assert_eq!(limit(b, c), 0.0, "the slanted edge on the right");
        assert!(limit(c, a) < 0.0, "the left edge");
        let inside = at(&edges(b, c, Floats::of(1.0)).plane, point(1.0, 1.0));
        assert!(inside.above(Floats::of(0.0)).any());
    }

    #[test]
    fn a_plane_passes_through_its_corners() {
        let point = |x, y| [Floats::of(x), Floats::of(y)];
        let corners = [point(1.0, 2.0), point(40.0, 3.0), point(7.0, 30.0)];
        let values = [0.3, 0.5, 0.9];
        let inverse = Floats::of(1.0) / double_area(corners[0], corners[1], corners[2]);
        let planes = planes(&corners, inverse, values.map(Floats::of));
        for (corner, value) in corners.into_iter().zip(values) {
            assert!((at(&planes, corner).0[0] - value).abs() < 1e-6);
        }
    }
}
