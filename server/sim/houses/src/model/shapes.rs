//! Boxes, prisms, turned shapes, rods, leaves and upholstered shapes.

use super::{Corner, Model, Span, flat_uv};
use crate::paint::Paint;
use avln_geom::{Point2, Point3, Vector3, angle};
use std::f32::consts::TAU;

impl Model {
    /// Extrudes a convex outline in x and y, counter-clockwise from +z, in z.
    pub(crate) fn prism_z(&mut self, outline: &[[f32; 2]], z: Span, paint: Paint) {
        self.prism(outline, z, paint, |[x, y], z| Point3::new(x, y, z));
    }

    /// Extrudes a convex outline in x and -z, counter-clockwise from above, in y.
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

    /// Adds a box without the back face.
    pub(crate) fn lid(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        self.solid(x, y, z);
        let p = |i: usize, j: usize, k: usize| Point3::new(x[i], y[j], z[k]);
        self.quad([p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)], paint);
        self.quad([p(1, 0, 1), p(1, 0, 0), p(1, 1, 0), p(1, 1, 1)], paint);
        self.quad([p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)], paint);
        self.quad([p(0, 1, 1), p(1, 1, 1), p(1, 1, 0), p(0, 1, 0)], paint);
        self.quad([p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)], paint);
    }

    /// Adds a box without the underside.
    pub(crate) fn slab(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        self.solid(x, y, z);
        self.rim(x, y, z, paint);
        let p = |i: usize, k: usize| Point3::new(x[i], y[1], z[k]);
        self.quad([p(0, 1), p(1, 1), p(1, 0), p(0, 0)], paint);
    }

    /// Adds the four upright sides of a box.
    pub(crate) fn rim(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        let p = |i: usize, j: usize, k: usize| Point3::new(x[i], y[j], z[k]);
        self.quad([p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)], paint);
        self.quad([p(1, 0, 0), p(0, 0, 0), p(0, 1, 0), p(1, 1, 0)], paint);
        self.quad([p(1, 0, 1), p(1, 0, 0), p(1, 1, 0), p(1, 1, 1)], paint);
        self.quad([p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)], paint);
    }

    /// Adds an outline in x and y seen from +z, with a picture stretched over the bounds.
    pub(crate) fn pictured(&mut self, outline: &[[f32; 2]], z: f32, paint: Paint) {
        let range = |axis: usize| {
            outline.iter().fold([f32::MAX, f32::MIN], |[low, high], p| [low.min(p[axis]), high.max(p[axis])])
        };
        let (x, y) = (range(0), range(1));
        let first = self.corners.len() as u32;
        for &[px, py] in outline {
            let uv = Point2::new((px - x[0]) / (x[1] - x[0]), 1.0 - (py - y[0]) / (y[1] - y[0]));
            let (position, normal) = (Point3::new(px, py, z), Vector3::z());
            self.corners.push(Corner { position, normal, uv });
        }
        for i in 1..outline.len() as u32 - 1 {
            self.triangles.push(([first, first + i, first + i + 1], paint));
        }
    }
}

impl Model {
    /// Adds a solid of revolution about the vertical axis at `center` (x, z). `profile` is (radius, height)
    /// from bottom to top; discs close open ends.
    pub(crate) fn lathe(&mut self, center: [f32; 2], profile: &[[f32; 2]], sides: usize, paint: Paint) {
        self.oval(center, [1.0, 1.0], profile, sides, paint);
    }

    /// Like [`Model::lathe`], scaled by `stretch` in x and z.
    pub(crate) fn oval(
        &mut self,
        center: [f32; 2],
        stretch: [f32; 2],
        profile: &[[f32; 2]],
        sides: usize,
        paint: Paint,
    ) {
        let ring = Ring { center, stretch, sides };
        for pair in profile.windows(2) {
            self.band(&ring, pair[0], pair[1], paint);
        }
        self.disc(&ring, profile[0], -1.0, paint);
        self.disc(&ring, profile[profile.len() - 1], 1.0, paint);
    }

    pub(crate) fn cylinder(&mut self, center: [f32; 2], y: Span, radius: f32, sides: usize, paint: Paint) {
        self.lathe(center, &[[radius, y[0]], [radius, y[1]]], sides, paint);
    }

    /// Adds a straight round bar between two points, without end faces.
    pub(crate) fn rod(&mut self, from: Point3<f32>, to: Point3<f32>, radius: f32, paint: Paint) {
        const SIDES: usize = 6;
        let axis = (to - from).normalize();
        let helper = if axis.y.abs() < 0.9 { Vector3::y() } else { Vector3::x() };
        let across = axis.cross(&helper).normalize();
        let up = axis.cross(&across);
        let normal = |side: usize| {
            let (sin, cos) = angle::sin_cos(TAU * side as f32 / SIDES as f32);
            across * cos + up * sin
        };
        for side in 0..SIDES {
            let (a, b) = (normal(side), normal(side + 1));
            let corner = |base: Point3<f32>, normal: Vector3<f32>| {
                let position = base + normal * radius;
                Corner { position, normal, uv: flat_uv(&position, &normal, paint) }
            };
            self.face([corner(from, a), corner(from, b), corner(to, b), corner(to, a)], paint);
        }
    }

    /// Adds a pointed leaf from `base` to `tip`, seen from above.
    pub(crate) fn leaf(&mut self, base: Point3<f32>, tip: Point3<f32>, width: f32, paint: Paint) {
        let along = tip - base;
        let across =
            along.cross(&Vector3::y()).try_normalize(1e-6).unwrap_or_else(Vector3::x) * (width / 2.0);
        let middle = base + along * 0.45 + Vector3::y() * (width * 0.2);
        self.quad([base, middle + across, tip, middle - across], paint);
    }

    fn band(&mut self, ring: &Ring, low: [f32; 2], high: [f32; 2], paint: Paint) {
        let slope = [high[1] - low[1], low[0] - high[0]];
        let length = (slope[0] * slope[0] + slope[1] * slope[1]).sqrt().max(1e-6);
        let tilt = slope.map(|value| value / length);
        for side in 0..ring.sides {
            let corner = |side: usize, [radius, y]: [f32; 2]| ring.corner(side, radius, y, tilt, paint);
            let corners =
                [corner(side, low), corner(side, high), corner(side + 1, high), corner(side + 1, low)];
            self.face(corners, paint);
        }
    }

    fn disc(&mut self, ring: &Ring, [radius, y]: [f32; 2], up: f32, paint: Paint) {
        if radius <= 1e-4 {
            return;
        }
        let first = self.corners.len() as u32;
        let normal = Vector3::y() * up;
        for side in 0..ring.sides {
            let position = ring.corner(side, radius, y, [0.0, up], paint).position;
            self.corners.push(Corner { position, normal, uv: flat_uv(&position, &normal, paint) });
        }
        for side in 1..ring.sides as u32 - 1 {
            let (b, c) = if up > 0.0 { (side + 1, side) } else { (side, side + 1) };
            self.triangles.push(([first, first + b, first + c], paint));
        }
    }
}

/// The sides of a turned shape.
struct Ring {
    center: [f32; 2],
    stretch: [f32; 2],
    sides: usize,
}

impl Ring {
    /// Corner number `side`; `tilt` is the normal's outward and upward part.
    fn corner(&self, side: usize, radius: f32, y: f32, tilt: [f32; 2], paint: Paint) -> Corner {
        // A half step puts flat sides, not edges, towards the axes.
        let turn = TAU * ((side % self.sides) as f32 + 0.5) / self.sides as f32;
        let (sin, cos) = angle::sin_cos(turn);
        let position = Point3::new(
            self.center[0] + cos * radius * self.stretch[0],
            y,
            self.center[1] + sin * radius * self.stretch[1],
        );
        let normal = Vector3::new(cos * tilt[0], tilt[1], sin * tilt[0]);
        Corner { position, normal, uv: flat_uv(&position, &normal, paint) }
    }
}

impl Model {
    /// Adds a box with edges cut by `bevel` metres.
    pub(crate) fn soft(&mut self, x: Span, y: Span, z: Span, bevel: f32, paint: Paint) {
        self.solid(x, y, z);
        let spans = [x, y, z];
        // Opposite bevels of a thin box must not meet.
        let bevel = spans.iter().map(|[low, high]| (high - low) / 2.1).fold(bevel, f32::min);
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                self.soft_face(&spans, axis, sign, bevel, paint);
            }
        }
        self.soft_edges(&spans, bevel, paint);
    }

    /// Adds a flat side, pulled back from the edges.
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

    /// Adds the twelve slanted edges and eight cut corners.
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

    /// Adds the bevelled edge at corner `at` in direction `axis`.
    fn soft_edge(&mut self, spans: &[Span; 3], at: [usize; 3], axis: usize, bevel: f32, paint: Paint) {
        let mut far = at;
        far[axis] = 1;
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let tip = |at: [usize; 3], side: usize| soft_tip(spans, at, side, bevel);
        let points = [tip(at, u), tip(at, v), tip(far, v), tip(far, u)];
        let flip = at[u] != at[v];
        self.quad(if flip { [points[3], points[2], points[1], points[0]] } else { points }, paint);
    }

    /// Adds a flat triangle, counter-clockwise from the visible side.
    pub(crate) fn triangle(&mut self, points: [Point3<f32>; 3], paint: Paint) {
        let normal = (points[1] - points[0]).cross(&(points[2] - points[0]));
        let normal = normal.try_normalize(1e-12).unwrap_or_else(Vector3::y);
        let first = self.corners.len() as u32;
        let corner =
            |point: Point3<f32>| Corner { position: point, normal, uv: flat_uv(&point, &normal, paint) };
        self.corners.extend(points.map(corner));
        self.triangles.push(([first, first + 1, first + 2], paint));
    }

    /// Adds a pillow on y = `y[0]`: thick in the centre, thin at the seam.
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

/// Span end, `bevel` inside.
fn inner(span: Span, end: usize, bevel: f32) -> f32 {
    if end == 0 { span[0] + bevel } else { span[1] - bevel }
}

/// Point near box corner `at` on the flat side perpendicular to `axis`.
fn soft_tip(spans: &[Span; 3], at: [usize; 3], axis: usize, bevel: f32) -> Point3<f32> {
    let coordinate = |i: usize| if i == axis { spans[i][at[i]] } else { inner(spans[i], at[i], bevel) };
    Point3::new(coordinate(0), coordinate(1), coordinate(2))
}
