//! Kitchens.

use super::baths::tap;
use super::*;

/// Height of a kitchen counter, metres.
pub(in crate::procedural) const COUNTER_M: f32 = 0.9;

/// Depth of a kitchen counter, metres.
pub(in crate::procedural) const COUNTER_DEPTH_M: f32 = 0.62;

/// A length of counter, with a hole for a sink around x = `sink` where there is one.
pub(in crate::procedural) fn counter(taste: &mut Taste, tint: Tint, width: f32, sink: Option<f32>) -> Piece {
    let (paint, depth) = (Paint::wood(tint), COUNTER_DEPTH_M - 0.04);
    let top = worktop(taste);
    let mut m = Model::new();
    m.block(about(0.0, width), [0.1, COUNTER_M - 0.2], about(0.0, depth), paint);
    m.block(about(0.0, width - 0.02), [0.0, 0.1], about(-0.03, depth - 0.06), paint.times(0.6));
    m.block(about(0.0, width), [COUNTER_M - 0.2, COUNTER_M - 0.04], [depth / 2.0 - 0.02, depth / 2.0], paint);
    m.pair(
        [width / 2.0 - 0.02, width / 2.0],
        [COUNTER_M - 0.2, COUNTER_M - 0.04],
        about(-0.01, depth - 0.02),
        paint,
    );
    let looks = Fronts { panel: paint.times(1.04), handle: Paint::STEEL, doors: taste.rng.chance(0.6) };
    let columns = ((width / 0.55).round() as usize).max(1);
    let rows = if looks.doors { 1 } else { 3 };
    fronts(&mut m, about(0.0, width), [0.12, COUNTER_M - 0.05], depth / 2.0, [columns, rows], &looks);
    let (y, z) = ([COUNTER_M - 0.04, COUNTER_M], about(0.01, COUNTER_DEPTH_M));
    match sink {
        None => m.block(about(0.0, width), y, z, top),
        Some(x) => holed_top(&mut m, width, x, y, z, top),
    }
    Piece::new("counter", m, said(tint, "wooden", size_word(width, 1.2, 1.9, ["short", "long"]), ""))
}

fn worktop(taste: &mut Taste) -> Paint {
    const STONES: [[u8; 3]; 4] = [[226, 222, 214], [70, 70, 74], [170, 158, 146], [206, 190, 170]];
    let rgb = *taste.rng.choose(&STONES).expect("there are stones");
    Paint::plain("stone", rgb).with(Pattern::Marble)
}

/// Half the size of the hole for a kitchen sink, x and z.
const HOLE_M: [f32; 2] = [0.26, 0.19];

fn holed_top(m: &mut Model, width: f32, x: f32, y: Span, z: Span, top: Paint) {
    let (left, right) = (x - HOLE_M[0], x + HOLE_M[0]);
    m.block([-width / 2.0, left], y, z, top);
    m.block([right, width / 2.0], y, z, top);
    m.block([left, right], y, [z[0], -HOLE_M[1]], top);
    m.block([left, right], y, [HOLE_M[1], z[1]], top);
}

/// A sink for the hole of a counter; y = 0 is the top of the counter.
pub(in crate::procedural) fn kitchen_sink(taste: &mut Taste) -> Piece {
    let tint = taste.tint("sink", &["grey", "white", "black"]);
    let (paint, material) =
        if tint.word == "grey" { (Paint::metal(tint), "metal") } else { (Paint::ceramic(tint), "ceramic") };
    let [x, z] = HOLE_M;
    let mut m = Model::new();
    m.block(about(0.0, 2.0 * x), [-0.17, -0.15], about(0.0, 2.0 * z), paint);
    m.pair([x - 0.012, x], [-0.15, 0.01], about(0.0, 2.0 * z), paint);
    m.block(about(0.0, 2.0 * x), [-0.15, 0.01], [z - 0.012, z], paint);
    m.block(about(0.0, 2.0 * x), [-0.15, 0.01], [-z, -z + 0.012], paint);
    m.pair([x, x + 0.03], [0.0, 0.012], about(0.0, 2.0 * z + 0.06), paint);
    m.block(about(0.0, 2.0 * x), [0.0, 0.012], [z, z + 0.03], paint);
    m.block(about(0.0, 2.0 * x), [0.0, 0.012], [-z - 0.06, -z], paint);
    tap(&mut m, [0.0, -z - 0.03], 0.03);
    Piece::new("sink", m, said(tint, material, "", "rectangular"))
}

/// A kitchen island.
pub(in crate::procedural) fn island(taste: &mut Taste, width: f32) -> Piece {
    let tint = taste.tint("counter", WOOD);
    let paint = Paint::wood(tint);
    let depth = 0.7;
    let top = worktop(taste);
    let mut m = Model::new();
    m.block(about(0.0, width - 0.1), [0.0, 0.08], about(-0.02, depth - 0.2), paint.times(0.6));
    m.block(about(0.0, width - 0.04), [0.08, COUNTER_M - 0.05], about(-0.06, depth - 0.16), paint);
    let looks = Fronts { panel: paint.times(1.04), handle: Paint::STEEL, doors: true };
    let mut back = Model::new();
    fronts(&mut back, about(0.0, width - 0.04), [0.1, COUNTER_M - 0.06], depth / 2.0 - 0.02, [2, 1], &looks);
    m.add(&back, 2, Vector3::zeros());
    m.block(about(0.0, width), [COUNTER_M - 0.05, COUNTER_M], about(0.0, depth), top);
    Piece::new("counter", m, said(tint, "wooden", "", "rectangular"))
}

/// A fridge with a freezer.
pub(in crate::procedural) fn fridge(taste: &mut Taste) -> Piece {
    let tint = taste.tint("appliances", &["white", "grey", "black", "red", "teal"]);
    let (height, paint) = (taste.length_m(1.6, 1.9), Paint::metal(tint));
    let mut m = Model::new();
    m.block(about(0.0, 0.62), [0.04, height], about(0.0, 0.6), paint);
    m.block(about(0.0, 0.56), [0.0, 0.04], about(0.0, 0.5), Paint::DARK_METAL);
    for y in [[0.06, height * 0.62], [height * 0.62 + 0.015, height - 0.01]] {
        m.soft(about(0.0, 0.62), y, [0.3, 0.35], 0.015, paint.times(1.03));
        m.block([0.24, 0.265], [y[0] + 0.1, y[1] - 0.1], [0.35, 0.38], Paint::CHROME);
    }
    Piece::new("appliances", m, said(tint, "metal", "tall", ""))
}

/// A cooker with an oven and four plates.
pub(in crate::procedural) fn cooker(taste: &mut Taste) -> Piece {
    let tint = taste.tint("appliances", &["white", "grey", "black"]);
    let paint = Paint::metal(tint);
    let mut m = Model::new();
    m.block(about(0.0, 0.6), [0.04, COUNTER_M], about(0.0, 0.58), paint);
    m.block(about(0.0, 0.54), [0.0, 0.04], about(0.0, 0.5), Paint::DARK_METAL);
    m.block(about(0.0, 0.48), [0.3, 0.64], [0.29, 0.305], Paint::SCREEN);
    m.block(about(0.0, 0.46), [0.68, 0.7], [0.29, 0.34], Paint::CHROME);
    for i in 0..4 {
        let x = (i as f32 - 1.5) * 0.12;
        m.block(about(x, 0.04), [0.79, 0.83], [0.29, 0.315], Paint::DARK_METAL);
    }
    for (x, z) in [(-0.14, -0.13), (0.14, -0.13), (-0.14, 0.13), (0.14, 0.13)] {
        m.cylinder([x, z], [COUNTER_M, COUNTER_M + 0.012], 0.1, 12, Paint::DARK_METAL);
    }
    Piece::new("appliances", m, said(tint, "metal", "", ""))
}

/// A washing machine.
pub(in crate::procedural) fn washing_machine(taste: &mut Taste) -> Piece {
    let tint = taste.tint("appliances", &["white", "grey"]);
    let mut m = Model::new();
    m.soft(about(0.0, 0.6), [0.0, 0.85], about(0.0, 0.58), 0.01, Paint::metal(tint));
    let mut door = Model::new();
    door.lathe([0.0, 0.0], &[[0.19, 0.0], [0.19, 0.02], [0.15, 0.035]], 16, Paint::CHROME);
    door.lathe([0.0, 0.0], &[[0.15, 0.035], [0.0, 0.05]], 16, Paint::SCREEN);
    for corner in &mut door.corners {
        let p = corner.position;
        corner.position = Point3::new(p.x, 0.42 - p.z, 0.29 + p.y);
        corner.normal = Vector3::new(corner.normal.x, -corner.normal.z, corner.normal.y);
    }
    m.add(&door, 0, Vector3::zeros());
    m.block([-0.26, -0.06], [0.73, 0.8], [0.29, 0.3], Paint::STEEL);
    m.block([0.1, 0.24], [0.73, 0.8], [0.29, 0.3], Paint::SCREEN);
    Piece::new("appliances", m, said(tint, "metal", "", ""))
}
