//! Turned and thin shapes: cylinders, cones, bowls, rods, leaves.

use super::{Corner, Model, Span, flat_uv};
use crate::paint::Paint;
use avln_geom::{Point3, Vector3, angle};
use std::f32::consts::TAU;

impl Model {
    /// A solid of revolution about the vertical axis at `center` (x, z). `profile` is (radius, height) from
    /// bottom to top; open ends are closed by discs.
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

    /// An upright cylinder.
    pub(crate) fn cylinder(&mut self, center: [f32; 2], y: Span, radius: f32, sides: usize, paint: Paint) {
        self.lathe(center, &[[radius, y[0]], [radius, y[1]]], sides, paint);
    }

    /// A straight round bar between two points, without end faces.
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

    /// A pointed leaf from `base` to `tip`, seen from above.
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

/// Corners of a turned shape.
struct Ring {
    center: [f32; 2],
    stretch: [f32; 2],
    sides: usize,
}

impl Ring {
    /// The corner number `side`; `tilt` is the normal's outward and upward part.
    fn corner(&self, side: usize, radius: f32, y: f32, tilt: [f32; 2], paint: Paint) -> Corner {
        // Half a step of turn puts flat sides, not edges, towards the axes.
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
