//! Projects the triangles of a cluster and works out their edges, eight at a time.

use super::edges::{Edges, Planes, Position, double_area, edges, planes};
use super::screen::{PixelRect, SLACK_PX};
use super::walk::ROUNDING;
use super::{NEAR_M, Raster, Scratch};
use crate::lanes::{Floats, LANES, Numbers};
use crate::model::CLUSTER;
use std::array::from_fn;

/// Corners are numbered by bytes.
const BYTE: usize = 256;

/// Corners of a cluster on the screen.
pub(super) struct Projected {
    /// Column and row, relative to the centre of the first pixel.
    pub(super) x: [f32; BYTE],
    pub(super) y: [f32; BYTE],
    /// Reciprocal depth, 1/metres; negative behind the pinhole.
    pub(super) nearness: [f32; BYTE],
    /// Depth, metres.
    pub(super) depth_m: [f32; BYTE],
}

/// Eight projected triangles with corners in front of the pinhole; other lanes are undefined.
#[derive(Clone, Copy, Default)]
pub(super) struct Batch {
    /// Of each triangle's three corners.
    pub(super) corners: [Position; 3],
    pub(super) nearness: [Floats; 3],
    /// Reciprocal of twice the signed area.
    pub(super) inverse: Floats,
    /// First column and row covered by the triangle, and the end after the last; empty ranges have end <=
    /// first.
    first: [Numbers; 2],
    end: [Numbers; 2],
    /// Nearness of the nearest corner and a little more.
    nearest: Floats,
    /// Edges opposite to the corners.
    edges: [Edges; 3],
    /// Planes of reciprocal depth, anchored at the farthest corners to minimise rounding.
    slope: [Floats; 2],
    anchor: Position,
    least: Floats,
}

/// All triangles of a cluster.
pub(super) type Batches = [Batch; CLUSTER / LANES];

/// A number that grows linearly over the picture: `x·column + y·row + constant`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plane {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) constant: f32,
}

/// A plane with its value at an anchor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Anchored {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) column: f32,
    pub(super) row: f32,
    pub(super) value: f32,
}

/// An edge: inside if its plane is above `limit`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub(super) plane: Plane,
    pub(super) limit: f32,
}

/// A triangle that is about to be drawn.
pub(super) struct TriangleSetup {
    pub(super) edges: [Edge; 3],
    pub(super) nearness: Anchored,
    /// The largest nearness that it has anywhere, and a little more.
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
    /// Draws the visible part of a cluster.
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
        self.make_swatches(number);
    }

    /// Projects `count` corners of a cluster with coordinates from `first`; returns the smallest depth,
    /// metres.
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
    /// Takes the corners of up to eight triangles.
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

    /// A batch with a single triangle: column, row and reciprocal depth per corner.
    pub(super) fn single(corners: [[f32; 3]; 3], size: [usize; 2]) -> Self {
        let of = |value: usize| corners.map(|corner| Floats::of(corner[value]));
        let (x, y) = (of(0), of(1));
        let mut batch =
            Self { corners: [[x[0], y[0]], [x[1], y[1]], [x[2], y[2]]], nearness: of(2), ..Self::default() };
        batch.prepare(size);
        batch
    }

    /// Works out edges and extents.
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
        // Twice the area is neither 0 nor infinite nor not a number.
        let is_there = area.abs().above(zero) & Floats::of(f32::INFINITY).above(area.abs());
        self.end[0] = is_there.keep_numbers(self.end[0]);
    }

    /// Pixels that a triangle may cover, if any.
    #[inline(always)]
    pub(super) fn pixels(&self, lane: usize) -> Option<PixelRect> {
        let first = [self.first[0].0[lane], self.first[1].0[lane]];
        let end = [self.end[0].0[lane], self.end[1].0[lane]];
        let is_there = (first[0] < end[0]) & (first[1] < end[1]);
        is_there.then_some(PixelRect { first, end })
    }

    #[inline(always)]
    pub(super) fn stroke(&self, lane: usize, pixels: PixelRect) -> TriangleSetup {
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
