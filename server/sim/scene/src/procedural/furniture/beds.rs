//! Beds and what lies on them.

use super::*;

/// A bed, its head towards -z.
pub(in crate::procedural) fn bed(taste: &mut Taste, width: f32) -> Piece {
    let tint = taste.tint("bed", CLOTH);
    let cloth = Paint::fabric(tint);
    let dark = taste.style(3) == 0;
    let frame_tint = Tint::shade(&mut taste.rng, if dark { "black" } else { "brown" });
    let (frame, length) = (Paint::wood(frame_tint), 2.08);
    let head = -length / 2.0;
    let mut m = Model::new();
    legs(&mut m, [width, length], 0.14, 0.07, 0.02, frame);
    m.block(about(0.0, width - 0.06), [0.14, 0.3], [-head - 0.03, -head], frame);
    let sheet = Paint::fabric(Tint::plain("white"));
    m.soft(about(0.0, width - 0.04), [0.3, 0.5], [head + 0.06, head + 0.56], 0.04, sheet);
    m.soft(about(0.0, width + 0.03), [0.14, 0.55], [head + 0.44, -head + 0.02], 0.05, cloth);
    headboard(taste, &mut m, width, head, frame, cloth);
    if taste.rng.chance(0.3) {
        m.block(about(0.0, width), [0.2, 0.62], [-head + 0.02, -head + 0.05], frame);
    }
    let pillows = if width > 1.2 { 2 } else { 1 };
    for i in 0..pillows {
        let x = (i as f32 - (pillows - 1) as f32 / 2.0) * width * 0.46;
        m.pillow(about(x, 0.58), [0.49, 0.63], [head + 0.1, head + 0.5], sheet);
    }
    Piece::new("bed", m, said(tint, "fabric", if width > 1.2 { "large" } else { "narrow" }, ""))
}

fn headboard(taste: &mut Taste, m: &mut Model, width: f32, head: f32, frame: Paint, cloth: Paint) {
    let top = taste.length_m(0.85, 1.1);
    match taste.style(3) {
        0 => m.block(about(0.0, width), [0.42, top], [head - 0.02, head + 0.04], frame),
        1 => {
            m.soft(about(0.0, width + 0.04), [0.2, top], [head - 0.04, head + 0.06], 0.04, cloth.times(0.95))
        }
        _ => {
            m.pair([width / 2.0 - 0.07, width / 2.0], [0.0, top], [head - 0.03, head + 0.04], frame);
            for y in [top - 0.1, top - 0.34] {
                m.block(about(0.0, width - 0.14), [y, y + 0.08], [head - 0.01, head + 0.02], frame);
            }
        }
    }
}

/// A cushion that lies flat.
pub(in crate::procedural) fn cushion(taste: &mut Taste, unlike: &str) -> Piece {
    let words: Vec<_> = CLOTH.iter().copied().filter(|word| *word != unlike).collect();
    let tint = taste.tint("cushion", &words);
    let (width, depth) = (taste.length_m(0.36, 0.46), taste.length_m(0.34, 0.42));
    let height = taste.length_m(0.12, 0.16);
    let mut m = Model::new();
    let round = taste.rng.chance(0.2);
    if round {
        let r = depth / 2.0;
        let profile =
            [[r * 0.8, 0.0], [r, height * 0.35], [r, height * 0.65], [r * 0.7, height], [0.0, height]];
        m.lathe([0.0, 0.0], &profile, 14, Paint::fabric(tint));
    } else {
        m.pillow(about(0.0, width), [0.0, height], about(0.0, depth), Paint::fabric(tint));
    }
    Piece::new("cushion", m, said(tint, "fabric", "", if round { "round" } else { "square" }))
}

/// Folded clothes in a pile.
pub(in crate::procedural) fn folded_clothes(taste: &mut Taste) -> Piece {
    let tint = taste.tint("clothes", CLOTH);
    let layers = 2 + taste.style(3);
    let mut m = Model::new();
    for layer in 0..layers {
        let y = 0.05 * layer as f32;
        let shade = if layer % 2 == 0 { 1.0 } else { 0.9 };
        let x = about(taste.rng.range(-0.02, 0.02), 0.36);
        m.soft(
            x,
            [y, y + 0.05],
            about(taste.rng.range(-0.02, 0.02), 0.27),
            0.018,
            Paint::fabric(tint).times(shade),
        );
    }
    Piece::new("clothes", m, said(tint, "fabric", "small", "folded"))
}
