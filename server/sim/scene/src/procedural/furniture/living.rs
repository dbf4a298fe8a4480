//! Televisions and fireplaces.

use super::*;

/// A television or monitor that stands on a foot.
pub(in crate::procedural) fn standing_tv(taste: &mut Taste, width: f32) -> Piece {
    let height = width * 0.58;
    let mut m = Model::new();
    m.block(about(0.0, width * 0.4), [0.0, 0.015], about(0.0, 0.2), Paint::DARK_METAL);
    m.block(about(0.0, 0.08), [0.015, 0.09], about(-0.01, 0.03), Paint::DARK_METAL);
    screen(&mut m, width, [0.07, 0.07 + height], [-0.025, 0.025]);
    tv(taste, m, width)
}

/// A flat television for a wall; its lower edge is on y = 0, its back on z = 0.
pub(in crate::procedural) fn wall_tv(taste: &mut Taste, width: f32) -> Piece {
    let mut m = Model::new();
    m.block(about(0.0, 0.3), [0.1, 0.3], [0.0, 0.03], Paint::DARK_METAL);
    screen(&mut m, width, [0.0, width * 0.58], [0.03, 0.07]);
    tv(taste, m, width)
}

fn tv(_: &mut Taste, model: Model, width: f32) -> Piece {
    let size = size_word(width, 0.75, 1.0, ["small", "large"]);
    Piece::new("tv_monitor", model, said(Tint::plain("black"), "plastic", size, "rectangular"))
}

fn screen(m: &mut Model, width: f32, y: Span, z: Span) {
    let bar = 0.02;
    m.block(about(0.0, width), y, z, Paint::plain("plastic", [34, 34, 37]));
    m.block(
        about(0.0, width - 2.0 * bar),
        [y[0] + 2.0 * bar, y[1] - bar],
        [z[1], z[1] + 0.004],
        Paint::SCREEN,
    );
    let glow = Paint::plain("glass", [44, 50, 66]);
    let (x, top) = (width / 2.0 - 2.0 * bar, y[1] - 2.0 * bar);
    let p = |x: f32, y: f32| Point3::new(x, y, z[1] + 0.006);
    m.quad([p(-x, top - 0.12), p(-x + 0.3, top), p(-x + 0.2, top), p(-x, top - 0.08)], glow);
}

/// A fireplace with a mantel; against a wall.
pub(in crate::procedural) fn fireplace(taste: &mut Taste) -> Piece {
    let style = taste.style(3);
    let tint = match style {
        0 => taste.tint("fireplace", &["red"]),
        1 => taste.tint("fireplace", &["grey", "black"]),
        _ => taste.tint("fireplace", &["brown", "white", "black"]),
    };
    let (paint, material) = match style {
        0 => (Paint::plain("brick", tint.rgb).with(Pattern::Brick), "brick"),
        1 => (Paint::plain("stone", tint.rgb).with(Pattern::Marble), "marble"),
        _ => (Paint::wood(tint), "wooden"),
    };
    let (width, height, depth) = (taste.length_m(1.2, 1.5), taste.length_m(1.0, 1.2), 0.34);
    let (half, hole) = (width / 2.0, width * 0.28);
    let (back, front) = (-depth / 2.0, depth / 2.0);
    let soot = Paint::plain("brick", [44, 38, 36]).with(Pattern::Brick);
    let mut m = Model::new();
    m.pair([hole, half], [0.0, height - 0.06], [back, front], paint);
    m.block(about(0.0, 2.0 * hole), [0.64, height - 0.06], [back, front], paint);
    m.block(about(0.0, 2.0 * hole), [0.0, 0.64], [back, back + 0.05], soot);
    m.block(about(0.0, width + 0.14), [height - 0.06, height], [back, front + 0.06], paint.times(0.93));
    m.pair([half - 0.02, half + 0.03], [0.0, 0.12], [back, front + 0.03], paint.times(0.93));
    let log = Paint::wood(Tint::plain("brown")).times(0.8);
    for (x, y) in [(-0.06, 0.06), (0.08, 0.06), (0.0, 0.14)] {
        let z = back + 0.15 + x * 0.4;
        m.rod(Point3::new(-hole * 0.7, y, z), Point3::new(hole * 0.7, y + x * 0.2, z + 0.03), 0.05, log);
    }
    for flame in 0..3 {
        let x = (flame as f32 - 1.0) * hole * 0.4;
        let paint = Paint::plain("fire", if flame == 1 { [250, 200, 70] } else { [240, 130, 40] });
        m.lathe([x, back + 0.17], &[[0.04, 0.14], [0.06, 0.2], [0.0, 0.36]], 6, paint);
    }
    Piece::new("fireplace", m, said(tint, material, "large", ""))
}
