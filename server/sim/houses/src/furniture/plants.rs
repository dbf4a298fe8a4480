//! Plants in pots.

use super::*;

const POTS: &[Substance] = &[Ceramic, Wicker, Concrete, Plastic, Metal, Wood, Terrazzo];

/// Colour words describe the leaves, material words the pot.
pub(crate) const FLOOR_PLANT: FurnitureKind =
    FurnitureKind::new("plant", "", 8, floor_plant).made_of(POTS, styles::GREENERY);
pub(crate) const SMALL_PLANT: FurnitureKind =
    FurnitureKind::new("plant", "", 8, small_plant).made_of(POTS, styles::GREENERY);

fn floor_plant(k: &mut Draft) -> Words {
    let scale = k.len(0.75, 1.35);
    let shape = plant(k, scale);
    [size_word(scale, 0.92, 1.15, ["low", "tall"]), shape]
}

fn small_plant(k: &mut Draft) -> Words {
    let scale = k.len(0.3, 0.5);
    ["small", plant(k, scale)]
}

fn plant(k: &mut Draft, scale: f32) -> &'static str {
    let pot = (scale * 0.27).max(0.1);
    let leaf = Paint::plain("plant", k.tint.rgb);
    planter(k, pot, scale);
    let span = [pot * 0.88, scale];
    match k.style {
        0 => crown(k, span, 0.26 * scale, leaf),
        1 => spears(k, span, leaf),
        2 => fronds(k, span, leaf, 0.36),
        3 => columns(k, span, leaf),
        4 => fronds(k, [pot * 0.88, scale * 0.75], leaf, 0.5),
        5 => blossoms(k, span, leaf),
        6 => broad(k, span, leaf),
        _ => palm(k, span, leaf),
    }
    k.by_style("round|spiky|bushy|columnar|drooping|flowering|broad-leaved|feathery")
}

/// Adds a pot in a neutral colour, so that the leaves determine the colour word.
fn planter(k: &mut Draft, pot: f32, scale: f32) {
    const TONES: [[u8; 3]; 5] = [[150, 148, 144], [140, 84, 58], [96, 98, 100], [60, 62, 66], [122, 104, 82]];
    let tone = *k.rng.choose(&TONES).expect("the list is not empty");
    let paint = k.substance.paint(Tint { word: "", rgb: tone });
    let paint = if k.dark() { paint.times(0.5) } else { paint.times(0.85) };
    let r = pot * 0.44 * (1.25 - 0.25 * scale.min(1.0));
    let m = &mut k.model;
    match k.style % 4 {
        0 => m.lathe([0.0, 0.0], &[[r * 0.75, 0.0], [r, pot], [r * 0.88, pot]], 12, paint),
        1 => m.lathe([0.0, 0.0], &[[r * 0.95, 0.0], [r * 0.95, pot], [r * 0.8, pot]], 14, paint),
        2 => m.lathe([0.0, 0.0], &[[r * 0.6, 0.0], [r * 1.05, pot * 0.55], [r * 0.85, pot]], 12, paint),
        _ => m.soft(about(0.0, 1.7 * r), [0.0, pot], about(0.0, 1.7 * r), 0.01, paint),
    }
    m.lathe([0.0, 0.0], &[[r * 0.8, pot], [r * 0.7, pot + 0.01]], 10, Paint::SOIL);
}

/// A stem with balls of leaves.
fn crown(k: &mut Draft, [base, top]: Span, r: f32, leaf: Paint) {
    let foot = point(0.0, base * 0.8, 0.0);
    k.model.rod(foot, point(0.0, top - r, 0.0), 0.012 + 0.01 * top, Paint::WALNUT);
    for ball in 0..4 {
        let (sin, cos) = angle::sin_cos(ball as f32 * 2.094 + k.rng.range(0.0, 0.6));
        let (x, z) = if ball == 3 { (0.0, 0.0) } else { (sin * r * 0.55, cos * r * 0.55) };
        let y = if ball == 3 { top - r } else { top - r * k.rng.range(1.4, 1.9) };
        let profile = [[0.0, -0.9], [0.7, -0.6], [1.0, 0.0], [0.75, 0.6], [0.0, 1.0]]
            .map(|[s, h]| [s * r * 0.8, y + h * r]);
        let shade = leaf.times(k.rng.range(0.94, 1.06));
        k.model.lathe([x, z], &profile, 8, shade);
    }
}

/// A two-sided leaf as a kite in a vertical plane.
fn blade(k: &mut Draft, foot: Point3<f32>, tip: Point3<f32>, across: Vector3<f32>, leaf: Paint) {
    let middle = foot + (tip - foot) * 0.4;
    k.model.quad([foot, middle + across, tip, middle - across], leaf);
    k.model.quad([foot, middle - across, tip, middle + across], leaf);
}

/// Stiff upright leaves.
fn spears(k: &mut Draft, [base, top]: Span, leaf: Paint) {
    for i in 0..16 {
        let (sin, cos) = angle::sin_cos(i as f32 * 2.4);
        let spread = k.rng.range(0.03, 0.2) * top;
        let height = base + (top - base) * k.rng.range(0.7, 1.0);
        let tip = point(sin * spread, height, cos * spread);
        let foot = point(sin * 0.02, base, cos * 0.02);
        let across = Vector3::new(cos, 0.0, -sin) * (0.04 * top);
        let shade = leaf.times(k.rng.range(0.93, 1.06));
        blade(k, foot, tip, across, shade);
    }
}

/// Bowed leaves in all directions.
fn fronds(k: &mut Draft, [base, top]: Span, leaf: Paint, reach: f32) {
    for frond in 0..18 {
        let (sin, cos) = angle::sin_cos(frond as f32 * 2.4);
        let lift = k.rng.range(0.35, 0.8);
        let reach = top * reach * k.rng.range(0.7, 1.0);
        let point = |out: f32, up: f32| point(sin * reach * out, base + (top - base) * up, cos * reach * out);
        let knee = point(0.45, lift);
        let shade = leaf.times(k.rng.range(0.93, 1.06));
        k.model.rod(point(0.02, 0.0), knee, 0.006 * top.max(0.5), shade);
        let droop = if k.style == 4 { -0.25 } else { 0.1 };
        let tip = point(1.0, (lift + droop + k.rng.range(-0.1, 0.1)).clamp(0.02, 1.0));
        k.model.leaf(knee, tip, 0.15 * top, shade);
    }
}

/// A cactus: a ribbed column with two arms.
fn columns(k: &mut Draft, [base, top]: Span, leaf: Paint) {
    let r = 0.08 * top + 0.015;
    let trunk = [[0.8, 0.0], [1.0, 0.3], [1.0, 0.85], [0.6, 0.97], [0.0, 1.0]];
    k.model.lathe([0.0, 0.0], &trunk.map(|[s, y]| [s * r, base + y * (top - base)]), 8, leaf);
    for (side, low) in [(-1.0, 0.3), (1.0, 0.45)] {
        let y = base + low * (top - base);
        let x = side * r * 2.2;
        k.model.rod(point(side * r * 0.8, y, 0.0), point(x, y + r, 0.0), r * 0.55, leaf);
        let arm = [[0.5, 0.0], [0.6, 0.2], [0.6, 0.8], [0.0, 1.0]];
        let height = (top - base) * 0.34;
        k.model.lathe([x, 0.0], &arm.map(|[s, up]| [s * r, y + r * 0.6 + up * height]), 8, leaf.times(1.04));
    }
}

/// Stems with a petal ball each.
fn blossoms(k: &mut Draft, [base, top]: Span, leaf: Paint) {
    let stem = leaf.times(0.85);
    for i in 0..5 {
        let (sin, cos) = angle::sin_cos(i as f32 * 2.4);
        let out = if i == 0 { 0.0 } else { top * k.rng.range(0.08, 0.2) };
        let y = base + (top - base) * k.rng.range(0.6, 0.88);
        let head = [sin * out, cos * out];
        k.model.rod(point(0.0, base, 0.0), point(head[0], y, head[1]), 0.007 + 0.004 * top, stem);
        let r = 0.055 * top + 0.02;
        let bloom = [[0.3, -0.7], [1.0, 0.0], [0.7, 0.7], [0.0, 0.9]];
        k.model.lathe(head, &bloom.map(|[s, up]| [s * r, y + up * r]), 6, leaf);
    }
}

/// A few wide leaves on stalks.
fn broad(k: &mut Draft, [base, top]: Span, leaf: Paint) {
    let stem = leaf.times(0.85);
    for i in 0..9 {
        let (sin, cos) = angle::sin_cos(i as f32 * 2.4);
        let height = base + (top - base) * (0.35 + 0.65 * i as f32 / 8.0);
        let reach = top * k.rng.range(0.12, 0.26);
        let stalk = point(sin * reach * 0.5, height * 0.86, cos * reach * 0.5);
        let shade = leaf.times(k.rng.range(0.94, 1.06));
        k.model.rod(point(0.0, base, 0.0), stalk, 0.007 * top.max(0.5), stem);
        let tip = point(sin * (reach + 0.1 * top), height, cos * (reach + 0.1 * top));
        let across = Vector3::new(cos, 0.0, -sin) * (0.09 * top);
        blade(k, stalk, tip, across, shade);
    }
}

/// A trunk with a tuft of long leaves.
fn palm(k: &mut Draft, [base, top]: Span, leaf: Paint) {
    let neck = base + (top - base) * 0.55;
    k.model.rod(point(0.0, base, 0.0), point(0.02, neck, 0.0), 0.018 * top + 0.008, Paint::WALNUT);
    for i in 0..14 {
        let (sin, cos) = angle::sin_cos(i as f32 * 2.4);
        let up = k.rng.range(0.3, 1.0);
        let reach = top * 0.34 * (1.2 - 0.6 * up);
        let knee = point(sin * reach * 0.6, neck + (top - neck) * up, cos * reach * 0.6);
        let shade = leaf.times(k.rng.range(0.94, 1.06));
        let across = Vector3::new(cos, 0.0, -sin) * (0.03 * top);
        blade(k, point(0.02, neck, 0.0), knee, across, shade);
        let tip = point(sin * reach * 1.2, knee.y - 0.12 * top, cos * reach * 1.2);
        k.model.leaf(knee, tip, 0.07 * top, shade);
    }
}
