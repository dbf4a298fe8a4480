//! Extruded outlines: boards, discs, arches.

use super::{Model, Span};
use crate::paint::Paint;
use avln_geom::Point3;

impl Model {
    /// Extrudes a convex outline in x and y, counter-clockwise from +z, in z.
    pub(crate) fn prism_z(&mut self, outline: &[[f32; 2]], z: Span, paint: Paint) {
        self.prism(outline, z, paint, |[x, y], z| Point3::new(x, y, z));
    }

    /// A convex outline in x and -z, counter-clockwise from above, pulled upwards.
    pub(crate) fn prism_y(&mut self, outline: &[[f32; 2]], y: Span, paint: Paint) {
        self.prism(outline, y, paint, |[x, back], y| Point3::new(x, y, -back));
    }

    /// Extrudes a convex outline in -z and y, counter-clockwise from +x, in x.
    pub(crate) fn prism_x(&mut self, outline: &[[f32; 2]], x: Span, paint: Paint) {
        self.prism(outline, x, paint, |[back, y], x| Point3::new(x, y, -back));
    }

    fn prism(
        &mut self,
        outline: &[[f32; 2]],
        [low, high]: Span,
        paint: Paint,
        at: impl Fn([f32; 2], f32) -> Point3<f32>,
    ) {
        let count = outline.len();
        for i in 0..count {
            let (a, b) = (outline[i], outline[(i + 1) % count]);
            self.quad([at(a, low), at(b, low), at(b, high), at(a, high)], paint);
        }
        for i in 1..count - 1 {
            let fan = [outline[0], outline[i], outline[i + 1]];
            self.triangle(fan.map(|corner| at(corner, high)), paint);
            self.triangle([fan[0], fan[2], fan[1]].map(|corner| at(corner, low)), paint);
        }
    }

    /// A box without its back face.
    pub(crate) fn lid(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        self.solid(x, y, z);
        let p = |i: usize, j: usize, k: usize| Point3::new(x[i], y[j], z[k]);
        self.quad([p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)], paint);
        self.quad([p(1, 0, 1), p(1, 0, 0), p(1, 1, 0), p(1, 1, 1)], paint);
        self.quad([p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)], paint);
        self.quad([p(0, 1, 1), p(1, 1, 1), p(1, 1, 0), p(0, 1, 0)], paint);
        self.quad([p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)], paint);
    }

    /// A box without its underside.
    pub(crate) fn slab(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        self.solid(x, y, z);
        self.rim(x, y, z, paint);
        let p = |i: usize, k: usize| Point3::new(x[i], y[1], z[k]);
        self.quad([p(0, 1), p(1, 1), p(1, 0), p(0, 0)], paint);
    }

    /// The four upright sides of a box.
    pub(crate) fn rim(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        let p = |i: usize, j: usize, k: usize| Point3::new(x[i], y[j], z[k]);
        self.quad([p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)], paint);
        self.quad([p(1, 0, 0), p(0, 0, 0), p(0, 1, 0), p(1, 1, 0)], paint);
        self.quad([p(1, 0, 1), p(1, 0, 0), p(1, 1, 0), p(1, 1, 1)], paint);
        self.quad([p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)], paint);
    }

    /// An outline in x and y seen from +z, with a picture stretched over its bounds.
    pub(crate) fn pictured(&mut self, outline: &[[f32; 2]], z: f32, paint: Paint) {
        let range = |axis: usize| {
            outline.iter().fold([f32::MAX, f32::MIN], |[low, high], p| [low.min(p[axis]), high.max(p[axis])])
        };
        let (x, y) = (range(0), range(1));
        let first = self.corners.len() as u32;
        for &[px, py] in outline {
            let uv = avln_geom::Point2::new((px - x[0]) / (x[1] - x[0]), 1.0 - (py - y[0]) / (y[1] - y[0]));
            let (position, normal) = (Point3::new(px, py, z), avln_geom::Vector3::z());
            self.corners.push(super::Corner { position, normal, uv });
        }
        for i in 1..outline.len() as u32 - 1 {
            self.triangles.push(([first, first + i, first + i + 1], paint));
        }
    }
}
