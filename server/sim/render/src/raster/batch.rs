//! Triangle projection and edge setup, eight triangles at a time.

use super::screen::{PixelRect, SLACK_PX};
use super::{NEAR_M, ROUNDING, Raster, Scratch};
use crate::lanes::{Floats, LANES, Numbers};
use crate::model::CLUSTER;
use std::array::from_fn;

// Corner indices are bytes.
const BYTE: usize = 256;

/// A cluster's corners on the screen.
pub(super) struct Projected {
    /// Column and row, relative to the first pixel's centre.
    pub(super) x: [f32; BYTE],
    pub(super) y: [f32; BYTE],
    /// Reciprocal depth, 1/metres; negative behind the pinhole.
    pub(super) nearness: [f32; BYTE],
    pub(super) depth_m: [f32; BYTE],
}

/// Eight projected triangles; lanes with a corner behind the pinhole are undefined.
#[derive(Clone, Copy, Default)]
pub(super) struct Batch {
    pub(super) corners: [Position; 3],
    pub(super) nearness: [Floats; 3],
    /// Reciprocal of the doubled signed area.
    pub(super) inverse: Floats,
    /// First column and row, and the end after the last; empty ranges have end <= first.
    first: [Numbers; 2],
    end: [Numbers; 2],
    /// Largest nearness plus a rounding margin.
    nearest: Floats,
    /// Opposite to the corners.
    edges: [Edges; 3],
    /// Plane of reciprocal depth.
    slope: [Floats; 2],
    anchor: Position,
    least: Floats,
}

/// A cluster's batches.
pub(super) type Batches = [Batch; CLUSTER / LANES];

/// A linear function over the image: `x·column + y·row + constant`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plane {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) constant: f32,
}

/// A linear function, anchored at a position.
#[derive(Clone, Copy, Debug)]
pub(super) struct Anchored {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) column: f32,
    pub(super) row: f32,
    pub(super) value: f32,
}

/// An edge: inside if the plane is above `limit`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub(super) plane: Plane,
    pub(super) limit: f32,
}

/// A triangle before drawing.
pub(super) struct TriangleSetup {
    pub(super) edges: [Edge; 3],
    pub(super) nearness: Anchored,
    /// Largest nearness plus a rounding margin.
    pub(super) nearest: f32,
    pub(super) pixels: PixelRect,
}

impl Plane {
    #[inline(always)]
    pub(super) fn at(&self, column: f32, row: f32) -> f32 {
        self.x * column + (self.y * row + self.constant)
    }

    #[inline(always)]
    pub(super) fn times(&self, factor: f32) -> Self {
        Self { x: self.x * factor, y: self.y * factor, constant: self.constant * factor }
    }
}

impl Anchored {
    #[inline(always)]
    pub(super) fn at(&self, column: f32, row: f32) -> f32 {
        self.x * (column - self.column) + (self.y * (row - self.row) + self.value)
    }
}

impl Planes {
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize) -> Plane {
        Plane { x: self.x.0[lane], y: self.y.0[lane], constant: self.constant.0[lane] }
    }
}

impl Default for Projected {
    fn default() -> Self {
        let zeros = [0.0; BYTE];
        Self { x: zeros, y: zeros, nearness: zeros, depth_m: zeros }
    }
}

impl Raster<'_> {
    /// Draws a cluster's visible part.
    #[inline(always)]
    pub(super) fn draw_cluster(&mut self, number: usize) {
        let [coordinate, _, first, counts] = self.view.clusters[number];
        let (count, corners) = ((counts & 0xffff) as usize, (counts >> 16) as usize);
        let nearest_m = self.project(coordinate as usize, corners);
        let crosses = nearest_m < NEAR_M;
        let view = self.view;
        let triangles = &view.triangles[first as usize..first as usize + count];
        for (triangles, which) in triangles.chunks(LANES).zip(0..CLUSTER / LANES) {
            let batch = &mut self.scratch.batches[which];
            batch.gather(&self.scratch.projected, triangles);
            batch.prepare([self.scratch.screen.width, self.scratch.screen.height]);
            for lane in 0..triangles.len() {
                let at = which * LANES + lane;
                if crosses && self.clip(number, at) {
                    continue;
                }
                let Scratch { batches, screen, waiting, .. } = &mut *self.scratch;
                let batch = &batches[which];
                let Some(pixels) = batch.pixels(lane) else { continue };
                if screen.shows(&pixels, batch.nearest.0[lane]) {
                    waiting.push((at as u8, pixels));
                }
            }
        }
        self.draw_waiting(number);
        self.make_records(number);
    }

    /// Projects `count` corners with coordinates from `first`; returns the smallest depth, metres.
    #[inline(always)]
    fn project(&mut self, first: usize, count: usize) -> f32 {
        let eights = count.div_ceil(LANES);
        let coordinates = self.view.coordinates[first..].as_chunks::<LANES>().0;
        let (lens, out) = (&self.lens, &mut *self.scratch.projected);
        let mut nearest_m = Floats::of(f32::INFINITY);
        for eight in 0..eights.min(BYTE / LANES) {
            let [x, y, z] = [0, 1, 2].map(|axis| coordinates[axis * eights + eight]);
            let offset = [
                Floats(x) - Floats::of(lens.eye.x),
                Floats(y) - Floats::of(lens.eye.y),
                Floats(z) - Floats::of(lens.eye.z),
            ];
            let along = |axis: &avln_geom::Vector3<f32>| {
                Floats::of(axis.x) * offset[0]
                    + Floats::of(axis.y) * offset[1]
                    + Floats::of(axis.z) * offset[2]
            };
            let depth_m = along(&lens.forward);
            let nearness = Floats::of(1.0) / depth_m;
            let [middle_x, middle_y] = lens.middle.map(Floats::of);
            out.x.as_chunks_mut().0[eight] = (along(&lens.right) * nearness + middle_x).0;
            out.y.as_chunks_mut().0[eight] = (along(&lens.down) * nearness + middle_y).0;
            out.nearness.as_chunks_mut().0[eight] = nearness.0;
            out.depth_m.as_chunks_mut().0[eight] = depth_m.0;
            nearest_m = depth_m.least(nearest_m);
        }
        nearest_m.0.into_iter().fold(f32::INFINITY, |a, b| if b < a { b } else { a })
    }
}

impl Batch {
    #[inline(always)]
    fn gather(&mut self, from: &Projected, triangles: &[[u32; 2]]) {
        let words: [u32; LANES] = from_fn(|lane| triangles.get(lane).map_or(0, |[corners, _]| *corners));
        for corner in 0..3 {
            let at: [usize; LANES] = from_fn(|lane| (words[lane] >> (8 * corner) & 0xff) as usize);
            let take = |values: &[f32; BYTE]| Floats(from_fn(|lane| values[at[lane]]));
            self.corners[corner] = [take(&from.x), take(&from.y)];
            self.nearness[corner] = take(&from.nearness);
        }
    }

    /// Returns a batch with one triangle: column, row and reciprocal depth by corner.
    pub(super) fn single(corners: [[f32; 3]; 3], size: [usize; 2]) -> Self {
        let of = |value: usize| corners.map(|corner| Floats::of(corner[value]));
        let (x, y) = (of(0), of(1));
        let mut batch =
            Self { corners: [[x[0], y[0]], [x[1], y[1]], [x[2], y[2]]], nearness: of(2), ..Self::default() };
        batch.prepare(size);
        batch
    }

    #[inline(always)]
    fn prepare(&mut self, size: [usize; 2]) {
        let [a, b, c] = self.corners;
        let (zero, one) = (Floats::of(0.0), Floats::of(1.0));
        let area = double_area(a, b, c);
        self.inverse = one / area;
        let side = zero.above(area).choose(-one, one);
        self.edges = [edges(b, c, side), edges(c, a, side), edges(a, b, side)];
        let [na, nb, nc] = self.nearness;
        let plane = planes(&self.corners, self.inverse, self.nearness);
        self.slope = [plane.x, plane.y];
        // The farthest corner as anchor minimises rounding.
        let (is_b, is_c) = (na.above(nb), na.least(nb).above(nc));
        let farthest = |axis: usize| is_c.choose(c[axis], is_b.choose(b[axis], a[axis]));
        self.anchor = [farthest(0), farthest(1)];
        self.least = na.least(nb).least(nc);
        self.nearest = na.most(nb).most(nc) * Floats::of(ROUNDING);
        for axis in 0..2 {
            let end = Floats::of(size[axis] as f32);
            let slack = Floats::of(SLACK_PX);
            let low = a[axis].least(b[axis]).least(c[axis]) - slack;
            let high = a[axis].most(b[axis]).most(c[axis]) + slack;
            self.first[axis] = low.most(zero).least(end).rounded_up();
            self.end[axis] = (high + one).most(zero).least(end).rounded_down();
        }
        // The doubled area is neither 0 nor infinite nor NaN.
        let is_there = area.abs().above(zero) & Floats::of(f32::INFINITY).above(area.abs());
        self.end[0] = is_there.keep_numbers(self.end[0]);
    }

    /// Returns the pixels that a triangle may cover, if any.
    #[inline(always)]
    pub(super) fn pixels(&self, lane: usize) -> Option<PixelRect> {
        let first = [self.first[0].0[lane], self.first[1].0[lane]];
        let end = [self.end[0].0[lane], self.end[1].0[lane]];
        let is_there = (first[0] < end[0]) & (first[1] < end[1]);
        is_there.then_some(PixelRect { first, end })
    }

    #[inline(always)]
    pub(super) fn setup(&self, lane: usize, pixels: PixelRect) -> TriangleSetup {
        let edge = |corner: usize| Edge {
            plane: self.edges[corner].plane.lane(lane),
            limit: self.edges[corner].limit.0[lane],
        };
        TriangleSetup {
            edges: [edge(0), edge(1), edge(2)],
            nearness: Anchored {
                x: self.slope[0].0[lane],
                y: self.slope[1].0[lane],
                column: self.anchor[0].0[lane],
                row: self.anchor[1].0[lane],
                value: self.least.0[lane],
            },
            nearest: self.nearest.0[lane],
            pixels,
        }
    }
}

/// A screen position: columns to the right and rows down, relative to the first pixel's centre.
pub(super) type Position = [Floats; 2];

/// Eight [`Plane`]s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Planes {
    pub(super) x: Floats,
    pub(super) y: Floats,
    pub(super) constant: Floats,
}

/// Eight [`Edge`]s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Edges {
    pub(super) plane: Planes,
    /// Slightly below 0 if points on the line are inside, otherwise 0.
    pub(super) limit: Floats,
}

/// Doubled areas; positive for corners in clockwise order on the screen.
#[inline(always)]
pub(super) fn double_area([ax, ay]: Position, [bx, by]: Position, [cx, cy]: Position) -> Floats {
    (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
}

/// Returns the edges from `a` to `b`, with the inside on the right for `side` 1 and on the left for -1.
#[inline(always)]
pub(super) fn edges([ax, ay]: Position, [bx, by]: Position, side: Floats) -> Edges {
    let zero = Floats::of(0.0);
    let (x, y) = ((ay - by) * side, (bx - ax) * side);
    // The anchor is the end nearer to the first pixel, which minimises rounding. It is the same from `b` to `a`,
    // so both triangles at an edge have equal values with opposite signs.
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

/// Returns the planes through values at three corners; `inverse` is the reciprocal [`double_area`].
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
    use avln_geom::Rng;

    fn at(planes: &Planes, [column, row]: Position) -> Floats {
        planes.x * column + (planes.y * row + planes.constant)
    }

    #[test]
    fn opposite_edges_have_opposite_values_and_one_owner() {
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
    fn left_and_upper_edges_include_their_points() {
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
