//! Walks the tree of boxes from near to far.

use super::screen::PixelRect;
use super::{NEAR_M, Raster};
use avln_geom::{Point3, Vector3};

/// Corners of a box.
const CORNERS: usize = 8;

/// More than rounding can change a nearness by.
pub(super) const ROUNDING: f32 = 1.0 + 1e-5;

impl Raster<'_> {
    /// Draws all that can be seen.
    #[inline(always)]
    pub(crate) fn draw(&mut self) {
        self.scratch.records.clear();
        self.scratch.open.clear();
        if !self.view.nodes.is_empty() {
            self.scratch.open.push((0, 0.0));
        }
        while let Some((node, _)) = self.scratch.open.pop() {
            let &[.., number, kind] = &self.view.nodes[node as usize];
            if !self.may_show(node) {
                continue;
            }
            if kind == 1 {
                self.draw_cluster(number as usize);
                self.scratch.screen.settle();
            } else {
                let children = [number, number + 1].map(|child| (child, self.distance(child)));
                let [left, right] = children;
                self.scratch.open.extend(if left.1 <= right.1 { [right, left] } else { [left, right] });
            }
        }
    }

    fn bounds(&self, node: u32) -> [Point3<f32>; 2] {
        let words = &self.view.nodes[node as usize];
        let corner = |first: usize| Point3::from([0, 1, 2].map(|axis| f32::from_bits(words[first + axis])));
        [corner(0), corner(3)]
    }

    /// The square of the distance from the eye to a box.
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

    /// Whether something in a box could be seen.
    #[inline(always)]
    fn may_show(&self, node: u32) -> bool {
        let [x, y, z] = self.camera_from_box(&self.bounds(node));
        let (nearest_m, farthest_m) = range(&z);
        if farthest_m < NEAR_M {
            return false;
        }
        if nearest_m < NEAR_M {
            return self.may_face(&x, &y, &z);
        }
        let screen = &self.scratch.screen;
        let [middle_x, middle_y] = self.lens.middle;
        let along =
            |values: &[f32; CORNERS], middle: f32| range(&std::array::from_fn(|i| values[i] / z[i] + middle));
        let ((left, right), (top, bottom)) = (along(&x, middle_x), along(&y, middle_y));
        PixelRect::between([left, top], [right, bottom], [screen.width, screen.height])
            .is_some_and(|pixels| screen.shows(&pixels, ROUNDING / nearest_m))
    }

    /// The corners of a box in the camera frame: all x, all y, all z.
    #[inline(always)]
    fn camera_from_box(&self, [min, max]: &[Point3<f32>; 2]) -> [[f32; CORNERS]; 3] {
        let (low, high) = (min - self.lens.eye, max - self.lens.eye);
        let along = |axis: &Vector3<f32>| {
            let [x, y, z] = [0, 1, 2].map(|i: usize| [axis[i] * low[i], axis[i] * high[i]]);
            std::array::from_fn(|corner| x[corner & 1] + y[corner >> 1 & 1] + z[corner >> 2])
        };
        [along(&self.lens.right), along(&self.lens.down), along(&self.lens.forward)]
    }

    /// Whether a box around or beside the pinhole can be in the picture: false when it lies beyond one of its borders.
    fn may_face(&self, x: &[f32; CORNERS], y: &[f32; CORNERS], z: &[f32; CORNERS]) -> bool {
        let [half_x, half_y] = self.lens.half;
        [(x, half_x), (y, half_y)].into_iter().all(|(values, half)| {
            let beyond = |sign: f32| (0..CORNERS).all(|i| sign * values[i] > half * z[i]);
            !beyond(1.0) && !beyond(-1.0)
        })
    }
}

/// The smallest and the largest of some values.
#[inline(always)]
fn range(values: &[f32; CORNERS]) -> (f32, f32) {
    values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(least, most), &value| {
        (if value < least { value } else { least }, if value > most { value } else { most })
    })
}
