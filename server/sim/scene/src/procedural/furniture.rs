//! Furniture: each function draws one piece, in its own frame (base on y = 0 unless it hangs, front towards +z),
//! with words that fit what it looks like.

pub(super) mod baths;
pub(super) mod beds;
pub(super) mod decor;
pub(super) mod kitchen;
pub(super) mod lights;
pub(super) mod living;
pub(super) mod openings;
pub(super) mod seats;
pub(super) mod sports;
pub(super) mod storage;
pub(super) mod tables;

use super::assembly::Piece;
use super::model::{Model, Span, about};
use super::paint::{Paint, Tint};
use super::taste::{CLOTH, Taste, WOOD, said, size_word};
use super::texture::{Art, Pattern};
use avln_geom::{Point3, Vector3, angle};

/// Four square legs under a top of the given size, `inset` from its edges.
fn legs(model: &mut Model, [width, depth]: [f32; 2], height: f32, thick: f32, inset: f32, paint: Paint) {
    let (x, z) = (width / 2.0 - inset - thick / 2.0, depth / 2.0 - inset - thick / 2.0);
    for side in [-1.0, 1.0] {
        model.pair(about(x, thick), [0.0, height], about(z * side, thick), paint);
    }
}

/// Four round legs that spread outwards.
fn splayed_legs(model: &mut Model, [width, depth]: [f32; 2], height: f32, radius: f32, paint: Paint) {
    let (x, z) = (width / 2.0 - radius, depth / 2.0 - radius);
    for (sx, sz) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        let foot = Point3::new(sx * x, 0.0, sz * z);
        let top = Point3::new(sx * x * 0.72, height, sz * z * 0.72);
        model.rod(foot, top, radius, paint);
    }
}

/// A front with `rows` by `columns` doors or drawers, each with a handle, on the plane z.
fn fronts(model: &mut Model, x: Span, y: Span, z: f32, [columns, rows]: [usize; 2], looks: &Fronts) {
    let part = |span: Span, count: usize, i: usize| {
        let step = (span[1] - span[0]) / count as f32;
        [span[0] + step * i as f32 + 0.008, span[0] + step * (i + 1) as f32 - 0.008]
    };
    for column in 0..columns {
        for row in 0..rows {
            let (dx, dy) = (part(x, columns, column), part(y, rows, row));
            model.block(dx, dy, [z, z + 0.018], looks.panel);
            let (hx, hy) = looks.handle_at(dx, dy, column % 2 == 0);
            model.block(hx, hy, [z + 0.018, z + 0.04], looks.handle);
        }
    }
}

/// How doors and drawers look.
struct Fronts {
    panel: Paint,
    handle: Paint,
    /// Doors have an upright handle at one side, drawers a level one in the middle.
    doors: bool,
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
