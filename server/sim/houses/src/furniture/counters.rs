//! Kitchen counters, islands and bars.

use super::parts::*;
use super::*;
use Substance::*;

/// Height of a kitchen counter, metres.
pub(crate) const COUNTER_M: f32 = 0.9;

/// Depth of a kitchen counter, metres.
pub(crate) const COUNTER_DEPTH_M: f32 = 0.62;

const FACES: &[Substance] = &[Wood, Wood, Plastic, Metal, Bamboo, Concrete, Marble];

/// A counter of a given width; depth 1 requests a sink cut-out.
pub(crate) const COUNTER: Make =
    Make { category: "counter", noun: "", styles: 8, substances: FACES, colors: taste::WOOD, draw: counter };

/// An island in the middle of a kitchen.
pub(crate) const ISLAND: Make = Make {
    category: "counter",
    noun: "kitchen island",
    styles: 5,
    substances: FACES,
    colors: taste::WOOD,
    draw: island,
};

/// A top of stone or wood.
fn worktop(k: &mut Draft) -> Paint {
    const TOPS: [Paint; 6] = [
        Paint::plain("stone", [150, 148, 142]).with(Pattern::Marble),
        Paint::plain("stone", [70, 70, 74]).with(Pattern::Marble),
        Paint::plain("stone", [124, 118, 110]).with(Pattern::Concrete),
        Paint::plain("stone", [140, 130, 118]).with(Pattern::Terrazzo),
        Paint::OAK,
        Paint::plain("metal", [120, 123, 127]).with(Pattern::Brushed),
    ];
    let top = *k.rng.choose(&TOPS).expect("there are tops");
    if k.p.brightness() < 0.5 { top.times(0.6) } else { top }
}

fn counter(k: &mut Draft) -> Words {
    let (w, depth) = (k.width(0.8, 2.2), COUNTER_DEPTH_M - 0.04);
    let (p, top) = (k.p, worktop(k));
    let size = size_word(w, 1.0, 1.8, ["short", "long"]);
    k.m.block(about(0.0, w), [0.1, COUNTER_M - 0.2], about(0.0, depth), p);
    k.m.block(about(0.0, w - 0.02), [0.0, 0.1], about(-0.03, depth - 0.06), p.times(0.7));
    let upper = [COUNTER_M - 0.2, COUNTER_M - 0.04];
    k.m.block(about(0.0, w), upper, [depth / 2.0 - 0.02, depth / 2.0], p);
    k.m.pair([w / 2.0 - 0.02, w / 2.0], upper, about(-0.01, depth - 0.02), p);
    let columns = ((w / 0.55).round() as usize).clamp(1, 4);
    let columns = if matches!(k.style, 3 | 5 | 7) { columns % 4 + 1 } else { columns };
    let rows = [1, 3, 2, 1, 1, 2, 1, 3][k.style];
    let handle = if k.style == 3 { p.times(0.8) } else { handle(k) };
    let looks = Fronts { panel: p.times(1.04), handle, doors: rows == 1 };
    let face = [0.12, COUNTER_M - 0.05];
    match k.style {
        4 => {
            fronts(&mut k.m, about(0.0, w), [0.12, 0.66], depth / 2.0, [columns, 1], &looks);
            let drawers = Fronts { doors: false, ..looks };
            fronts(&mut k.m, about(0.0, w), [0.67, COUNTER_M - 0.05], depth / 2.0, [columns, 1], &drawers);
        }
        6 => {
            k.m.lid(about(0.0, w - 0.02), face, [depth / 2.0, depth / 2.0 + 0.012], p.times(0.97));
            let strip = [COUNTER_M - 0.09, COUNTER_M - 0.07];
            k.m.lid(about(0.0, w - 0.04), strip, [depth / 2.0 + 0.012, depth / 2.0 + 0.03], handle);
        }
        _ => fronts(&mut k.m, about(0.0, w), face, depth / 2.0, [columns, rows], &looks),
    }
    let (y, z) = ([COUNTER_M - 0.04, COUNTER_M], about(0.01, COUNTER_DEPTH_M));
    if k.wish[2] > 0.0 {
        holed_top(&mut k.m, w, y, z, top);
    } else {
        k.m.slab(about(0.0, w), y, z, top);
    }
    [size, ["", "drawered", "drawered", "", "panelled", "drawered", "plain", "drawered"][k.style]]
}

/// Half the size of the hole for a kitchen sink, x and z.
pub(super) const HOLE_M: [f32; 2] = [0.26, 0.19];

fn holed_top(m: &mut Model, w: f32, y: Span, z: Span, top: Paint) {
    let (left, right) = (-HOLE_M[0], HOLE_M[0]);
    m.slab([-w / 2.0, left], y, z, top);
    m.slab([right, w / 2.0], y, z, top);
    m.slab([left, right], y, [z[0], -HOLE_M[1]], top);
    m.slab([left, right], y, [HOLE_M[1], z[1]], top);
}

fn island(k: &mut Draft) -> Words {
    let (w, d) = (k.width(1.1, 1.7), 0.72);
    let (p, top) = (k.p, worktop(k));
    let size = size_word(w, 1.2, 1.5, ["small", "large"]);
    let body = [0.08, COUNTER_M - 0.05];
    let looks = Fronts { panel: p.times(1.04), handle: handle(k), doors: k.style != 1 };
    let shape = match k.style {
        3 => {
            k.m.prism_y(&oval([0.0, 0.0], [w / 2.0, d / 2.0], 16), [COUNTER_M - 0.05, COUNTER_M], top);
            k.m.prism_y(&oval([0.0, 0.04], [w / 2.0 - 0.06, d / 2.0 - 0.1], 16), [0.0, COUNTER_M - 0.05], p);
            return [size, "oval"];
        }
        4 => {
            legs(&mut k.m, [w, d], COUNTER_M - 0.05, 0.07, 0.02, p);
            k.board(about(0.0, w - 0.06), [COUNTER_M - 0.25, COUNTER_M - 0.05], about(0.0, d - 0.06));
            k.board(about(0.0, w - 0.06), [0.2, 0.24], about(0.0, d - 0.06));
            "open"
        }
        _ => {
            k.m.block(about(0.0, w - 0.1), [0.0, 0.08], about(-0.04, d - 0.24), p.times(0.7));
            k.m.block(about(0.0, w - 0.04), body, about(-0.06, d - 0.16), p);
            let mut back = Model::new();
            let columns = [2, 2, 3, 2, 2][k.style];
            let rows = if looks.doors { 1 } else { 3 };
            let z = d / 2.0 - 0.02;
            fronts(&mut back, about(0.0, w - 0.04), [0.1, COUNTER_M - 0.06], z, [columns, rows], &looks);
            k.m.add(&back, 2, Vector3::zeros());
            "rectangular"
        }
    };
    k.m.slab(about(0.0, w), [COUNTER_M - 0.05, COUNTER_M], about(0.0, d), top);
    [size, shape]
}
