//! Upholstered shapes: boxes with bevelled edges, pillows.

use super::{Corner, Model, Span, flat_uv};
use crate::paint::Paint;
use avln_geom::{Point3, Vector3};

impl Model {
    /// A box with edges cut by `bevel` metres and smooth shading.
    pub(crate) fn soft(&mut self, x: Span, y: Span, z: Span, bevel: f32, paint: Paint) {
        self.solid(x, y, z);
        let spans = [x, y, z];
        let bevel = spans.iter().map(|[low, high]| (high - low) / 2.1).fold(bevel, f32::min);
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                self.soft_face(&spans, axis, sign, bevel, paint);
            }
        }
        self.soft_edges(&spans, bevel, paint);
    }

    /// A flat side, pulled back from the edges.
    fn soft_face(&mut self, spans: &[Span; 3], axis: usize, sign: f32, bevel: f32, paint: Paint) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let corner = |at_u: usize, at_v: usize| {
            let mut point = Point3::origin();
            point[axis] = spans[axis][usize::from(sign > 0.0)];
            point[u] = inner(spans[u], at_u, bevel);
            point[v] = inner(spans[v], at_v, bevel);
            point
        };
        let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
        self.quad(if sign > 0.0 { corners } else { [corners[0], corners[3], corners[2], corners[1]] }, paint);
    }

    /// The twelve slanted edges and eight cut corners.
    fn soft_edges(&mut self, spans: &[Span; 3], bevel: f32, paint: Paint) {
        for corner in 0..8_usize {
            let at = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let tip = |axis: usize| soft_tip(spans, at, axis, bevel);
            let points = [tip(0), tip(1), tip(2)];
            let flip = at.iter().sum::<usize>() % 2 == 0;
            let points = if flip { [points[0], points[2], points[1]] } else { points };
            self.triangle(points, paint);
            for axis in (0..3).filter(|&axis| at[axis] == 0) {
                self.soft_edge(spans, at, axis, bevel, paint);
            }
        }
    }

    /// The bevelled edge at corner `at` in direction `axis`.
    fn soft_edge(&mut self, spans: &[Span; 3], at: [usize; 3], axis: usize, bevel: f32, paint: Paint) {
        let mut far = at;
        far[axis] = 1;
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let tip = |at: [usize; 3], side: usize| soft_tip(spans, at, side, bevel);
        let points = [tip(at, u), tip(at, v), tip(far, v), tip(far, u)];
        let flip = at[u] != at[v];
        self.quad(if flip { [points[3], points[2], points[1], points[0]] } else { points }, paint);
    }

    /// A flat triangle, counter-clockwise from the visible side.
    pub(crate) fn triangle(&mut self, points: [Point3<f32>; 3], paint: Paint) {
        let normal = (points[1] - points[0]).cross(&(points[2] - points[0]));
        let normal = normal.try_normalize(1e-12).unwrap_or_else(Vector3::y);
        let first = self.corners.len() as u32;
        let corner =
            |point: Point3<f32>| Corner { position: point, normal, uv: flat_uv(&point, &normal, paint) };
        self.corners.extend(points.map(corner));
        self.triangles.push(([first, first + 1, first + 2], paint));
    }

    /// A pillow on y = `y[0]`: thick in the centre, thin at the seam.
    pub(crate) fn pillow(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        const CELLS: usize = 5;
        let half = (y[1] - y[0]) / 2.0;
        let seam = y[0] + half;
        let at = |span: Span, index: usize| span[0] + (span[1] - span[0]) * index as f32 / CELLS as f32;
        let bulge = |index: usize| {
            let t = 2.0 * index as f32 / CELLS as f32 - 1.0;
            1.0 - t * t * t * t
        };
        for sign in [-1.0, 1.0] {
            let point = |i: usize, j: usize| {
                Point3::new(at(x, i), seam + sign * half * (bulge(i) * bulge(j)).sqrt(), at(z, j))
            };
            for i in 0..CELLS {
                for j in 0..CELLS {
                    let corners = [point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)];
                    let [a, b, c, d] = corners;
                    self.quad(if sign > 0.0 { corners } else { [a, d, c, b] }, paint);
                }
            }
        }
    }
}

/// The end of a span, `bevel` inside.
fn inner(span: Span, end: usize, bevel: f32) -> f32 {
    if end == 0 { span[0] + bevel } else { span[1] - bevel }
}

/// The point near box corner `at` on the flat side perpendicular to `axis`.
fn soft_tip(spans: &[Span; 3], at: [usize; 3], axis: usize, bevel: f32) -> Point3<f32> {
    let coordinate = |i: usize| if i == axis { spans[i][at[i]] } else { inner(spans[i], at[i], bevel) };
    Point3::new(coordinate(0), coordinate(1), coordinate(2))
}
