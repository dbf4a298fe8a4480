//! Rasterisation: the nearest hit by pixel. The tree is traversed front to back; occluded boxes and triangles
//! are skipped.
//!
//! A pixel belongs to a projected triangle if its centre is inside the three edges. Both sides of an edge use
//! equal numbers up to sign, and the top-left rule assigns centres on an edge, so surfaces have no cracks and
//! no double pixels.

mod batch;
mod fill;
mod records;
mod screen;

use crate::camera::Lens;
use crate::lanes::{Floats, LANES};
use crate::model::{ModelView, Replacements};
use avln_geom::{Point3, Vector3};
use avln_simd::Work;
use batch::{Batches, Projected};
pub(crate) use records::ShadingRecords;
use screen::PixelRect;
pub(crate) use screen::Screen;
use std::array::from_fn;

/// Near plane, metres.
pub(crate) const NEAR_M: f32 = 1e-3;
/// Flag of replacement nodes in [`Scratch::open`].
const IS_SIMPLE: u32 = 1 << 31;
// Rounding changes a nearness by less than this factor.
const ROUNDING: f32 = 1.0 + 1e-5;

#[derive(Default)]
pub(crate) struct Scratch {
    pub(crate) screen: Screen,
    pub(crate) records: ShadingRecords,
    projected: Box<Projected>,
    batches: Box<Batches>,
    /// Triangles to draw in the current cluster, with covered pixels.
    waiting: Vec<(u8, PixelRect)>,
    /// Boxes to visit, the next one last.
    open: Vec<u32>,
}

pub(crate) struct Raster<'a> {
    pub(crate) view: ModelView<'a>,
    /// Replacements for boxes with errors of about half a pixel, if any.
    pub(crate) replacements: Option<&'a Replacements>,
    pub(crate) lens: Lens,
    pub(crate) scratch: &'a mut Scratch,
}

impl Work for Raster<'_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        self.scratch.records.clear();
        self.scratch.open.clear();
        if !self.view.nodes.is_empty() {
            self.scratch.open.push(0);
        }
        let exact = self.view;
        let simple = self.replacements.map(|replacements| replacements.view(exact)).unwrap_or_default();
        let mut is_simple = false;
        let most_per_m = 0.5 / self.lens.right.norm();
        while let Some(entry) = self.scratch.open.pop() {
            let node = entry & !IS_SIMPLE;
            if (entry != node) != is_simple {
                is_simple = !is_simple;
                self.view = if is_simple { simple } else { exact };
            }
            let &[.., number, kind] = &self.view.nodes[node as usize];
            let Some(nearest_m) = self.may_show(node) else { continue };
            if let Some(replacements) = self.replacements
                && !is_simple
                && let Some(replacement) = replacements.of(node, nearest_m * most_per_m)
            {
                self.scratch.open.extend(replacement.root.map(|root| root | IS_SIMPLE));
                continue;
            }
            if kind == 1 {
                self.draw_cluster(number as usize);
                self.scratch.screen.settle();
            } else {
                let [left, right] = [number, number + 1];
                let is_left_nearer = self.distance(left) <= self.distance(right);
                let flag = entry & IS_SIMPLE;
                self.scratch.open.extend(
                    if is_left_nearer { [right, left] } else { [left, right] }.map(|node| node | flag),
                );
            }
        }
    }
}

impl Raster<'_> {
    fn bounds(&self, node: u32) -> [Point3<f32>; 2] {
        let words = &self.view.nodes[node as usize];
        let corner = |first: usize| Point3::from([0, 1, 2].map(|axis| f32::from_bits(words[first + axis])));
        [corner(0), corner(3)]
    }

    /// Squared distance from the eye to a box.
    #[inline(always)]
    fn distance(&self, node: u32) -> f32 {
        let [min, max] = self.bounds(node);
        let eye = self.lens.eye;
        let gap = |axis: usize| {
            let (below, above) = (min[axis] - eye[axis], eye[axis] - max[axis]);
            let gap = if below > above { below } else { above };
            if gap > 0.0 { gap } else { 0.0 }
        };
        gap(0) * gap(0) + gap(1) * gap(1) + gap(2) * gap(2)
    }

    /// Returns a box's smallest depth, metres, if anything in it may be visible.
    #[inline(always)]
    fn may_show(&self, node: u32) -> Option<f32> {
        let [x, y, z] = self.camera_from_box(&self.bounds(node));
        let (nearest_m, farthest_m) = z.range();
        if farthest_m < NEAR_M {
            return None;
        }
        if nearest_m < NEAR_M {
            return self.may_face(&x.0, &y.0, &z.0).then_some(nearest_m);
        }
        let screen = &self.scratch.screen;
        let nearness = Floats::of(1.0) / z;
        let [middle_x, middle_y] = self.lens.middle.map(Floats::of);
        let (left, right) = (x * nearness + middle_x).range();
        let (top, bottom) = (y * nearness + middle_y).range();
        PixelRect::between([left, top], [right, bottom], [screen.width, screen.height])
            .is_some_and(|pixels| screen.shows(&pixels, ROUNDING / nearest_m))
            .then_some(nearest_m)
    }

    /// Returns a box's corners in the camera frame: all x, all y, all z.
    #[inline(always)]
    fn camera_from_box(&self, [min, max]: &[Point3<f32>; 2]) -> [Floats; 3] {
        let (low, high) = (min - self.lens.eye, max - self.lens.eye);
        let side = |axis: usize| {
            Floats(from_fn(|corner| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] }))
        };
        let sides = [side(0), side(1), side(2)];
        let along = |axis: &Vector3<f32>| {
            Floats::of(axis.x) * sides[0] + Floats::of(axis.y) * sides[1] + Floats::of(axis.z) * sides[2]
        };
        [along(&self.lens.right), along(&self.lens.down), along(&self.lens.forward)]
    }

    /// Returns false for a box near the pinhole that is beyond an image border.
    fn may_face(&self, x: &[f32; LANES], y: &[f32; LANES], z: &[f32; LANES]) -> bool {
        let [half_x, half_y] = self.lens.half;
        [(x, half_x), (y, half_y)].into_iter().all(|(values, half)| {
            let beyond = |sign: f32| (0..LANES).all(|i| sign * values[i] > half * z[i]);
            !beyond(1.0) && !beyond(-1.0)
        })
    }
}
