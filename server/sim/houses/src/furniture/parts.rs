//! Shared parts: legs, fronts with doors and drawers, wheels.

use super::*;

/// A point in the piece frame, metres.
pub(super) fn point(x: f32, y: f32, z: f32) -> Point3<f32> {
    Point3::new(x, y, z)
}

impl Draft {
    /// Adds four square legs under a top, `inset` from the edges.
    pub(super) fn legs(
        &mut self,
        [width, depth]: [f32; 2],
        height: f32,
        thick: f32,
        inset: f32,
        paint: Paint,
    ) {
        let (x, z) = (width / 2.0 - inset - thick / 2.0, depth / 2.0 - inset - thick / 2.0);
        for (sx, sz) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            self.model.rim(about(sx * x, thick), [0.0, height], about(sz * z, thick), paint);
        }
    }

    /// Adds four round legs that spread outwards.
    pub(super) fn splayed_legs(&mut self, [width, depth]: [f32; 2], height: f32, radius: f32, paint: Paint) {
        let (x, z) = (width / 2.0 - radius, depth / 2.0 - radius);
        for (sx, sz) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let foot = point(sx * x, 0.0, sz * z);
            let top = point(sx * x * 0.72, height, sz * z * 0.72);
            self.model.rod(foot, top, radius, paint);
        }
    }

    /// Adds two runners with uprights.
    pub(super) fn sled(&mut self, [w, d]: [f32; 2], height: f32, paint: Paint) {
        let x = [w / 2.0 - 0.025, w / 2.0];
        self.model.pair(x, [0.0, 0.025], about(0.0, d), paint);
        self.model.pair(x, [0.025, height], [-d / 2.0, -d / 2.0 + 0.025], paint);
        self.model.pair(x, [0.025, height], [d / 2.0 - 0.025, d / 2.0], paint);
    }

    /// Adds a round foot with a column.
    pub(super) fn pedestal(&mut self, radius: f32, height: f32, paint: Paint) {
        let profile = [[radius, 0.0], [radius, 0.02], [0.035, 0.05], [0.035, height]];
        self.model.lathe([0.0, 0.0], &profile, 12, paint);
    }

    /// Adds two crossed bars at both ends in x.
    pub(super) fn crossed_legs(&mut self, [w, d]: [f32; 2], height: f32, radius: f32, paint: Paint) {
        for x in [-w / 2.0 + radius, w / 2.0 - radius] {
            let z = d / 2.0 - radius;
            self.model.rod(point(x, 0.0, -z), point(x, height, z), radius, paint);
            self.model.rod(point(x, 0.0, z), point(x, height, -z), radius, paint);
        }
    }

    /// Adds a round pad or top with a rounded edge between two heights.
    pub(super) fn round_pad(&mut self, radius: f32, [low, high]: Span, sides: usize, paint: Paint) {
        let edge = ((high - low) * 0.3).min(0.03);
        let profile =
            [[radius - edge, low], [radius, low + edge], [radius, high - edge], [radius - edge, high]];
        self.model.lathe([0.0, 0.0], &profile, sides, paint);
    }

    /// Adds a disc across x around (y, z): a wheel, a weight.
    pub(super) fn wheel(&mut self, x: Span, [y, z]: [f32; 2], radius: f32, paint: Paint) {
        self.model.prism_x(&circle([-z, y], radius, 14), x, paint);
    }
}

#[derive(Clone, Copy)]
pub(super) struct Fronts {
    pub(super) panel: Paint,
    pub(super) handle: Paint,
    /// Doors have a vertical handle at a side, drawers a horizontal handle in the centre.
    pub(super) doors: bool,
}

impl Fronts {
    fn handle_at(&self, x: Span, y: Span, left: bool) -> (Span, Span) {
        let (cx, cy) = ((x[0] + x[1]) / 2.0, (y[0] + y[1]) / 2.0);
        if !self.doors {
            return (about(cx, (x[1] - x[0]) * 0.3), about(cy, 0.02));
        }
        let side = if left { x[1] - 0.05 } else { x[0] + 0.05 };
        (about(side, 0.02), about(cy, 0.14_f32.min((y[1] - y[0]) * 0.5)))
    }
}

/// Adds `columns` by `rows` doors or drawers with handles on the plane z.
pub(super) fn fronts(m: &mut Model, x: Span, y: Span, z: f32, [columns, rows]: [usize; 2], looks: &Fronts) {
    let part = |span: Span, count: usize, i: usize| {
        let step = (span[1] - span[0]) / count as f32;
        [span[0] + step * i as f32 + 0.008, span[0] + step * (i + 1) as f32 - 0.008]
    };
    for column in 0..columns {
        for row in 0..rows {
            let (dx, dy) = (part(x, columns, column), part(y, rows, row));
            m.lid(dx, dy, [z, z + 0.018], looks.panel);
            let (hx, hy) = looks.handle_at(dx, dy, column % 2 == 0);
            m.lid(hx, hy, [z + 0.018, z + 0.04], looks.handle);
        }
    }
}

/// A box with doors or drawers.
pub(super) struct Carcass {
    /// Width, height, depth; the front reaches 4 cm farther.
    pub(super) size: [f32; 3],
    /// Height of legs above 9 cm, of a plinth below.
    pub(super) feet: f32,
    /// Columns and rows.
    pub(super) cells: [usize; 2],
    pub(super) doors: bool,
}

/// Adds a carcass in the main paint.
pub(super) fn carcass(k: &mut Draft, body: &Carcass) {
    let [width, height, depth] = body.size;
    let paint = k.paint;
    match body.feet {
        feet if feet > 0.09 => k.legs([width, depth], feet, 0.05, 0.02, paint.times(0.85)),
        feet => {
            k.model.block(about(0.0, width - 0.06), [0.0, feet], about(-0.02, depth - 0.08), paint.times(0.7))
        }
    }
    k.model.block(about(0.0, width), [body.feet, height - 0.025], about(0.0, depth), paint);
    let top = about(0.005, depth + 0.03);
    k.model.soft(about(0.0, width + 0.02), [height - 0.025, height], top, 0.008, paint.times(0.96));
    let looks = Fronts { panel: paint.times(1.04), handle: handle(k), doors: body.doors };
    let (x, y) = (about(0.0, width - 0.04), [body.feet + 0.02, height - 0.045]);
    fronts(&mut k.model, x, y, depth / 2.0, body.cells, &looks);
}

pub(super) fn handle(k: &mut Draft) -> Paint {
    let paints = [Paint::STEEL, Paint::DARK_METAL, Paint::BRASS];
    let some = *k.rng.choose(&paints).expect("the list is not empty");
    if k.dark() { some.times(0.7) } else { some }
}

/// Corners of a regular polygon, counter-clockwise.
pub(super) fn circle([cx, cy]: [f32; 2], radius: f32, sides: usize) -> Vec<[f32; 2]> {
    oval([cx, cy], [radius, radius], sides)
}

/// Corners of an ellipse, counter-clockwise; flat at the bottom.
pub(super) fn oval([cx, cy]: [f32; 2], [rx, ry]: [f32; 2], sides: usize) -> Vec<[f32; 2]> {
    let corner = |i: usize| {
        let (sin, cos) = angle::sin_cos(std::f32::consts::TAU * (i as f32 + 0.5) / sides as f32);
        [cx + rx * sin, cy - ry * cos]
    };
    (0..sides).map(corner).collect()
}

/// A rectangle up to `base` with a semicircular top, counter-clockwise.
pub(super) fn arch(width: f32, base: f32, height: f32) -> Vec<[f32; 2]> {
    let radius = width / 2.0;
    let rise = (height - base).min(radius);
    let mut outline = vec![[-radius, base], [radius, base]];
    outline.extend((0..=8).map(|i| {
        let (sin, cos) = angle::sin_cos(std::f32::consts::PI * i as f32 / 8.0);
        [radius * cos, height - rise + rise * sin]
    }));
    outline
}

/// A rectangle around (0, `middle`), counter-clockwise.
pub(super) fn rectangle(width: f32, height: f32, middle: f32) -> Vec<[f32; 2]> {
    let (x, y) = (width / 2.0, height / 2.0);
    vec![[-x, middle - y], [x, middle - y], [x, middle + y], [-x, middle + y]]
}
