//! Pictures, mirrors, plants, rugs, curtains, clothes on hooks and other small things.

use super::*;
use crate::colors::PALETTE;

/// A framed picture; its lower edge is on y = 0, its back on z = 0.
pub(in crate::procedural) fn picture(taste: &mut Taste, width: f32, height: f32) -> Piece {
    let tint = taste.tint("picture", CLOTH);
    let ground = PALETTE.iter().position(|(word, _)| *word == tint.word).expect("a colour word");
    let art = Art { ground: ground as u8, seed: taste.rng.next_u64() as u32 };
    let canvas = Paint::plain("fabric", [255; 3]).with(Pattern::Art(art));
    let frames =
        [Paint::wood(Tint::plain("brown")), Paint::DARK_METAL, Paint::plain("wood", [236, 234, 228])];
    let frame = *taste.rng.choose(&frames).expect("not empty");
    let (bar, half) = (taste.length_m(0.015, 0.022), width / 2.0);
    let mut m = Model::new();
    picture_frame(&mut m, [half, height], bar, frame);
    let p = |x: f32, y: f32| Point3::new(x, y, 0.018);
    let (x, y) = (half - bar, [bar, height - bar]);
    m.picture([p(-x, y[0]), p(x, y[0]), p(x, y[1]), p(-x, y[1])], canvas);
    let shape = size_word(width / height, 0.9, 1.15, ["upright", "wide"]);
    let shape = if shape.is_empty() { "square" } else { shape };
    Piece::new(
        "picture",
        m,
        said(tint, "painted", size_word(width * height, 0.25, 0.6, ["small", "large"]), shape),
    )
}

/// What one sees of a frame that lies on a wall: its front and its outer sides.
fn picture_frame(m: &mut Model, [half, height]: [f32; 2], bar: f32, paint: Paint) {
    let outer = [[-half, 0.0], [half, 0.0], [half, height], [-half, height]];
    let inner =
        [[bar - half, bar], [half - bar, bar], [half - bar, height - bar], [bar - half, height - bar]];
    let p = |[x, y]: [f32; 2], z: f32| Point3::new(x, y, z);
    for side in 0..4 {
        let next = (side + 1) % 4;
        let front = [outer[side], outer[next], inner[next], inner[side]];
        m.quad(front.map(|corner| p(corner, 0.02)), paint);
        let (a, b) = (outer[side], outer[next]);
        m.quad([p(a, 0.0), p(b, 0.0), p(b, 0.02), p(a, 0.02)], paint);
    }
}

/// A mirror for a wall; its lower edge is on y = 0.
pub(in crate::procedural) fn mirror(taste: &mut Taste, width: f32, height: f32) -> Piece {
    let frame = *taste
        .rng
        .choose(&[Paint::CHROME, Paint::wood(Tint::plain("brown")), Paint::DARK_METAL])
        .expect("one");
    let mut m = Model::new();
    m.block(about(0.0, width), [0.0, height], [0.0, 0.02], frame);
    m.block(about(0.0, width - 0.05), [0.025, height - 0.025], [0.02, 0.024], Paint::MIRROR);
    let words =
        said(Tint::plain("grey"), "glass", size_word(height, 0.7, 1.2, ["small", "tall"]), "rectangular");
    Piece::new("mirror", m, crate::Attributes { color: String::new(), ..words })
}

const POTS: &[&str] = &["white", "orange", "grey", "blue", "black", "teal", "red", "yellow"];

/// A plant in a pot: a bush, spears, or a small tree.
pub(in crate::procedural) fn plant(taste: &mut Taste, tall: bool) -> Piece {
    let pot_tint = taste.tint("pot", POTS);
    let scale = if tall { taste.length_m(0.9, 1.15) } else { taste.length_m(0.4, 0.5) };
    let pot = scale * 0.28;
    let mut m = Model::new();
    let r = pot * 0.55;
    m.lathe(
        [0.0, 0.0],
        &[[r * 0.75, 0.0], [r, pot], [r * 0.9, pot], [r * 0.88, pot * 0.9]],
        12,
        Paint::ceramic(pot_tint),
    );
    m.cylinder([0.0, 0.0], [pot * 0.6, pot * 0.91], r * 0.88, 12, Paint::SOIL);
    let leaf = Paint::LEAF.times(taste.rng.range(0.85, 1.12));
    let style = taste.style(3);
    match style {
        0 => crown(taste, &mut m, [pot, scale], 0.26 * scale, leaf),
        1 => spears(taste, &mut m, [pot * 0.9, scale], leaf),
        _ => fronds(taste, &mut m, [pot * 0.9, scale], leaf),
    }
    let shape = ["round", "spiky", "bushy"][style];
    let words = said(Tint::plain("green"), "", if tall { "tall" } else { "small" }, shape);
    Piece::new("plant", m, words)
}

/// A stem with three balls of leaves.
fn crown(taste: &mut Taste, m: &mut Model, [base, top]: Span, r: f32, leaf: Paint) {
    let stem = Paint::wood(Tint::plain("brown")).times(0.8);
    m.rod(Point3::new(0.0, base * 0.8, 0.0), Point3::new(0.0, top - r, 0.0), 0.02, stem);
    for ball in 0..4 {
        let (sin, cos) = angle::sin_cos(ball as f32 * 2.094 + taste.rng.range(0.0, 0.6));
        let (x, z) = if ball == 3 { (0.0, 0.0) } else { (sin * r * 0.55, cos * r * 0.55) };
        let y = if ball == 3 { top - r } else { top - r * taste.rng.range(1.4, 1.9) };
        let profile = [[0.0, -0.9], [0.7, -0.6], [1.0, 0.0], [0.75, 0.6], [0.0, 1.0]]
            .map(|[s, h]| [s * r * 0.8, y + h * r]);
        m.lathe([x, z], &profile, 9, leaf.times(taste.rng.range(0.92, 1.08)));
    }
}

/// Stiff upright leaves.
fn spears(taste: &mut Taste, m: &mut Model, [base, top]: Span, leaf: Paint) {
    for blade in 0..16 {
        let (sin, cos) = angle::sin_cos(blade as f32 * 2.4);
        let (spread, height) =
            (taste.rng.range(0.03, 0.2) * top, base + (top - base) * taste.rng.range(0.7, 1.0));
        let tip = Point3::new(sin * spread, height, cos * spread);
        let foot = Point3::new(sin * 0.02, base, cos * 0.02);
        let across = Vector3::new(cos, 0.0, -sin) * (0.035 * top);
        let middle = foot + (tip - foot) * 0.4;
        let shade = leaf.times(taste.rng.range(0.9, 1.1));
        m.quad([foot, middle + across, tip, middle - across], shade);
        m.quad([foot, middle - across, tip, middle + across], shade);
    }
}

/// Bowed leaves in all directions.
fn fronds(taste: &mut Taste, m: &mut Model, [base, top]: Span, leaf: Paint) {
    for frond in 0..18 {
        let (sin, cos) = angle::sin_cos(frond as f32 * 2.4);
        let lift = taste.rng.range(0.35, 0.8);
        let reach = top * 0.36 * taste.rng.range(0.7, 1.0);
        let point =
            |out: f32, up: f32| Point3::new(sin * reach * out, base + (top - base) * up, cos * reach * out);
        let knee = point(0.45, lift);
        let shade = leaf.times(taste.rng.range(0.88, 1.1));
        m.rod(point(0.02, 0.0), knee, 0.006 * top.max(0.5), shade);
        let tip = point(1.0, (lift + taste.rng.range(-0.1, 0.2)).min(1.0));
        m.leaf(knee, tip, 0.14 * top, shade);
    }
}

/// A flat rug.
pub(in crate::procedural) fn rug(taste: &mut Taste, size: [f32; 2]) -> Piece {
    let words = CLOTH.split_last().expect("there are colours").1;
    let tint = taste.tint("rug", words);
    let paint = Paint { material: "carpet", ..Paint::fabric(tint) }.with(Pattern::Carpet);
    let round = taste.rng.chance(0.25);
    let mut m = Model::new();
    if round {
        m.cylinder([0.0, 0.0], [0.0, 0.012], size[0].min(size[1]) / 2.0, 24, paint);
    } else {
        m.block(about(0.0, size[0]), [0.0, 0.01], about(0.0, size[1]), paint.times(0.96));
        m.block(about(0.0, size[0] - 0.2), [0.01, 0.014], about(0.0, size[1] - 0.2), paint);
    }
    Piece::new("rug", m, said(tint, "fabric", "", if round { "round" } else { "rectangular" }))
}

/// One half of a pair of curtains; its lower edge is on y = 0.
pub(in crate::procedural) fn curtain(tint: Tint, width: f32, height: f32) -> Piece {
    const FOLDS: usize = 8;
    let mut m = Model::new();
    let x = |i: usize| -width / 2.0 + width * i as f32 / FOLDS as f32;
    let z = |i: usize| if i.is_multiple_of(2) { 0.03 } else { 0.08 };
    for i in 0..FOLDS {
        let p = |j: usize, y: f32| Point3::new(x(j), y, z(j));
        m.quad([p(i, 0.0), p(i + 1, 0.0), p(i + 1, height), p(i, height)], Paint::fabric(tint));
    }
    m.block(about(0.0, width + 0.04), [height, height + 0.025], [0.0, 0.06], Paint::DARK_METAL);
    Piece::new("curtain", m, said(tint, "fabric", "long", ""))
}

/// A coat on a hook; its hem is on y = 0.
pub(in crate::procedural) fn coat(taste: &mut Taste) -> Piece {
    let tint = taste.tint("clothes", CLOTH);
    let paint = Paint::fabric(tint);
    let length = taste.length_m(0.7, 1.0);
    let mut m = Model::new();
    m.oval(
        [0.0, 0.08],
        [1.0, 0.32],
        &[[0.24, 0.0], [0.2, length * 0.6], [0.22, length - 0.1], [0.07, length]],
        12,
        paint,
    );
    for side in [-1.0, 1.0] {
        let shoulder = Point3::new(side * 0.19, length - 0.1, 0.08);
        m.rod(shoulder, Point3::new(side * 0.26, length * 0.35, 0.09), 0.045, paint.times(0.93));
    }
    m.block(about(0.0, 0.012), [0.06, length - 0.06], [0.14, 0.16], paint.times(0.75));
    m.block(about(0.0, 0.5), [length + 0.03, length + 0.09], [0.0, 0.02], Paint::wood(Tint::plain("brown")));
    m.rod(Point3::new(0.0, length - 0.02, 0.05), Point3::new(0.0, length + 0.05, 0.02), 0.012, Paint::STEEL);
    Piece::new("clothes", m, said(tint, "fabric", size_word(length, 0.8, 0.9, ["short", "long"]), "hanging"))
}

/// A vase.
pub(in crate::procedural) fn vase(taste: &mut Taste) -> Piece {
    let tint = taste.tint("vase", CLOTH);
    let (h, r) = (taste.length_m(0.2, 0.32), taste.length_m(0.06, 0.09));
    let profile =
        [[0.6, 0.0], [1.0, 0.35], [0.9, 0.6], [0.4, 0.85], [0.55, 1.0]].map(|[s, y]| [s * r, y * h]);
    let mut m = Model::new();
    m.lathe([0.0, 0.0], &profile, 12, Paint::ceramic(tint));
    Piece::new("vase", m, said(tint, "ceramic", "", "round"))
}

/// A waste bin.
pub(in crate::procedural) fn bin(taste: &mut Taste) -> Piece {
    let tint = taste.tint("bin", &["grey", "black", "white", "red", "blue", "green"]);
    let (h, r) = (taste.length_m(0.3, 0.5), taste.length_m(0.12, 0.16));
    let mut m = Model::new();
    m.lathe(
        [0.0, 0.0],
        &[[r * 0.85, 0.0], [r, h], [r * 0.92, h], [r * 0.85, h - 0.04]],
        12,
        Paint::plastic(tint),
    );
    Piece::new("bin", m, said(tint, "plastic", "small", "round"))
}
