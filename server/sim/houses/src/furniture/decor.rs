//! Small decoration: vases, figures, books, baskets, bins; plants in pots.

use super::*;

pub(crate) const VASE: FurnitureKind = FurnitureKind::new("vase", "", 8, vase)
    .made_of(&[Ceramic, Glass, Metal, Wood, Marble, Concrete, Terrazzo], styles::CLOTH);
pub(crate) const STATUE: FurnitureKind = FurnitureKind::new("statue", "", 8, statue)
    .made_of(&[Marble, Metal, Wood, Ceramic, Concrete, Plastic, Glass], styles::CLOTH);

/// A stack or row.
pub(crate) const BOOKS: FurnitureKind = FurnitureKind::new("books", "", 8, books)
    .made_of(&[Paper, Leather, Fabric, Striped, Checked, Dotted], styles::CLOTH);
pub(crate) const BASKET: FurnitureKind = FurnitureKind::new("basket", "", 8, basket)
    .made_of(&[Wicker, Fabric, Plastic, Metal, Knit, Bamboo], styles::WOOD);

pub(crate) const BIN: FurnitureKind = FurnitureKind::new("bin", "", 8, bin)
    .made_of(&[Plastic, Metal, Wicker, Wood, Rubber, Leather], styles::MACHINE);

fn vase(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.18, 0.36), k.len(0.06, 0.1));
    match k.style {
        0 => k.turned(&[[0.6, 0.0], [1.0, 0.35], [0.9, 0.6], [0.4, 0.85], [0.55, 1.0]], r, h, 12),
        1 => k.turned(&[[0.7, 0.0], [0.7, 1.0], [0.55, 1.0], [0.55, 0.8]], r, h, 12),
        2 => k.turned(&[[0.4, 0.0], [0.5, 0.5], [1.0, 1.0], [0.9, 1.0]], r, h, 12),
        3 => k.turned(&[[0.5, 0.0], [1.0, 0.3], [0.3, 0.55], [0.25, 1.0], [0.4, 1.05]], r, h, 12),
        4 => k.model.soft(about(0.0, r * 1.5), [0.0, h], about(0.0, r * 1.5), 0.012, k.paint),
        5 => k.turned(&[[0.5, 0.0], [1.1, 0.3], [1.1, 0.5], [0.8, 0.7]], r * 1.2, h, 12),
        6 => {
            k.turned(&[[0.7, 0.0], [0.4, 0.2], [0.9, 0.6], [0.5, 0.9], [0.7, 1.0]], r, h, 12);
            for side in [-1.0, 1.0] {
                let at = |s: f32, y: f32| point(side * s * r, y * h, 0.0);
                k.model.rod(at(0.5, 0.9), at(1.2, 0.75), 0.01, k.paint);
                k.model.rod(at(1.2, 0.77), at(0.85, 0.55), 0.01, k.paint);
            }
        }
        _ => k.model.prism_y(&circle([0.0, 0.0], r, 6), [0.0, h], k.paint),
    }
    let shape = k.by_style("bulbous|cylindrical|conical|bottle-shaped|square|bowl-shaped|handled|hexagonal");
    [size_word(k.model.bounds().size().y, 0.23, 0.3, ["small", "tall"]), shape]
}

fn statue(k: &mut Draft) -> Words {
    let h = k.len(0.2, 0.42);
    let plinth = about(0.0, h * 0.4);
    k.model.block(plinth, [0.0, h * 0.08], plinth, k.paint.times(0.95));
    let ball = |k: &mut Draft, [x, y]: [f32; 2], r: f32| {
        let profile = [[0.3, -0.95], [0.85, -0.5], [1.0, 0.0], [0.85, 0.5], [0.3, 0.95]];
        k.model.lathe([x, 0.0], &profile.map(|[s, up]| [s * r, y + up * r]), 9, k.paint);
    };
    match k.style {
        0 => {
            k.turned(&[[0.16, 0.08], [0.2, 0.3], [0.13, 0.62], [0.18, 0.72], [0.05, 0.8]], h, h, 12);
            ball(k, [0.0, h * 0.88], h * 0.1);
        }
        1 => ball(k, [0.0, h * 0.5], h * 0.36),
        2 => {
            k.model.prism_y(&circle([0.0, 0.0], h * 0.16, 4), [h * 0.08, h * 0.8], k.paint);
            k.model.lathe([0.0, 0.0], &[[h * 0.15, h * 0.8], [0.0, h]], 4, k.paint);
        }
        3 => {
            k.model.soft(about(0.0, h * 0.6), [h * 0.3, h * 0.6], about(0.0, h * 0.22), 0.02, k.paint);
            k.legs([h * 0.56, h * 0.2], h * 0.34, h * 0.08, 0.0, k.paint);
            k.model.rod(point(h * 0.22, h * 0.5, 0.0), point(h * 0.34, h * 0.85, 0.0), h * 0.07, k.paint);
            ball(k, [h * 0.38, h * 0.88], h * 0.1);
        }
        4 => k.model.lathe([0.0, 0.0], &[[h * 0.26, h * 0.08], [0.0, h]], 14, k.paint),
        5 => {
            for i in 0..3 {
                let y = h * (0.22 + 0.26 * i as f32);
                ball(k, [0.0, y], h * (0.2 - 0.05 * i as f32));
            }
        }
        6 => {
            let points = [[0.0, 0.1], [0.3, 0.4], [0.2, 0.75], [0.0, 1.0], [-0.2, 0.75], [-0.3, 0.4]];
            k.model.prism_z(&points.map(|[x, y]| [x * h, y * h]), about(0.0, h * 0.14), k.paint);
        }
        _ => {
            let outer = circle([0.0, h * 0.55], h * 0.42, 12);
            for i in 0..12 {
                let (a, b) = (outer[i], outer[(i + 1) % 12]);
                k.model.rod(point(a[0], a[1], 0.0), point(b[0], b[1], 0.0), h * 0.06, k.paint);
            }
        }
    }
    let shape =
        k.by_style("human|spherical|obelisk-shaped|four-legged|conical|stacked|leaf-shaped|ring-shaped");
    [size_word(h, 0.27, 0.35, ["small", "tall"]), shape]
}

fn books(k: &mut Draft) -> Words {
    let pages = Paint::plain("paper", [176, 170, 152]);
    let pages = if k.dark() { pages.times(0.4) } else { pages };
    let flat = |k: &mut Draft, x: f32, y: f32, size: [f32; 2], thick: f32, shade: f32| {
        k.model.block(about(x, size[0]), [y, y + thick * 0.2], about(0.0, size[1]), k.paint.times(shade));
        let inside = [y + thick * 0.2, y + thick * 0.8];
        k.model.block(about(x, size[0] - 0.012), inside, about(0.0, size[1] - 0.012), pages);
        let cover = [y + thick * 0.8, y + thick];
        k.model.block(about(x, size[0]), cover, about(0.0, size[1]), k.paint.times(shade));
    };
    let upright = |k: &mut Draft, count: usize, lean: bool| {
        for i in 0..count {
            let shade = [1.0, 0.92, 1.05][i % 3];
            let h = k.len(0.18, 0.26);
            let x = (i as f32 - count as f32 / 2.0) * 0.042;
            let depth = if lean { 0.13 } else { 0.16 };
            k.model.block([x, x + 0.038], [0.0, h], about(0.0, depth), k.paint.times(shade));
        }
    };
    match k.style {
        0 | 1 => {
            let count = [2, 4][k.style];
            for i in 0..count {
                let (w, d) = (k.len(0.2, 0.26), k.len(0.15, 0.19));
                flat(k, 0.0, 0.036 * i as f32, [w, d], 0.035, [1.0, 0.94][i % 2]);
            }
            [k.by_style("low|tall"), "stacked"]
        }
        2 | 3 => {
            let count = [4, 7][k.style - 2];
            upright(k, count, false);
            [["short", "long"][k.style - 2], "upright"]
        }
        4 => {
            flat(k, 0.0, 0.0, [0.3, 0.22], 0.04, 1.0);
            flat(k, 0.02, 0.04, [0.22, 0.16], 0.03, 0.95);
            ["large", "stacked"]
        }
        5 => {
            let half = [[0.0, 0.0], [0.18, 0.0], [0.17, 0.04], [0.0, 0.015]];
            k.model.prism_z(&half, about(0.0, 0.22), k.paint);
            let other = [half[1], half[0], half[3], half[2]].map(|[x, y]| [-x, y]);
            k.model.prism_z(&other, about(0.0, 0.22), k.paint);
            k.model.block(about(0.0, 0.03), [0.0, 0.02], about(0.0, 0.22), k.paint);
            ["", "open"]
        }
        6 => {
            upright(k, 5, true);
            k.model.pair([0.12, 0.15], [0.0, 0.16], about(0.0, 0.12), Paint::DARK_METAL);
            ["", "propped"]
        }
        _ => {
            k.model.soft(about(0.0, 0.26), [0.0, 0.16], about(0.0, 0.2), 0.01, k.paint);
            ["", "boxed"]
        }
    }
}

fn basket(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.24, 0.55), k.len(0.17, 0.24));
    let shape = match k.style {
        0 | 1 => {
            let low = [0.8, 0.95][k.style];
            k.turned(&[[low, 0.0], [1.0, 1.0], [0.92, 1.0], [0.85, 0.7], [0.0, 0.65]], r, h, 12);
            k.by_style("round|cylindrical")
        }
        2 | 3 => {
            let w = [2.0, 2.6][k.style - 2] * r;
            let d = 1.8 * r;
            k.board(about(0.0, w - 0.03), [0.0, h * 0.7], about(0.0, d - 0.03));
            k.model.pair([w / 2.0 - 0.02, w / 2.0], [0.0, h], about(0.0, d), k.paint);
            k.board(about(0.0, w - 0.04), [0.0, h], [d / 2.0 - 0.02, d / 2.0]);
            k.board(about(0.0, w - 0.04), [0.0, h], [-d / 2.0, -d / 2.0 + 0.02]);
            ["square", "rectangular"][k.style - 2]
        }
        4 => {
            k.turned(&[[0.7, 0.0], [1.1, 0.5], [0.85, 1.0], [0.75, 0.9]], r, h, 12);
            "bulging"
        }
        5 => {
            k.turned(&[[0.8, 0.0], [1.0, 1.0], [0.9, 1.0], [0.8, 0.7]], r, h * 0.7, 12);
            for (a, b) in [(0, 1), (1, 2), (2, 3)] {
                let arc = circle([0.0, h * 0.7], r * 0.9, 8);
                let at = |i: usize| point(arc[2 + i][0], arc[2 + i][1], 0.0);
                k.model.rod(at(a), at(b), 0.014, k.paint);
            }
            "handled"
        }
        6 => {
            k.turned(&[[0.9, 0.0], [1.0, 0.9], [0.98, 0.9], [0.9, 1.0], [0.0, 1.06]], r, h, 12);
            "lidded"
        }
        _ => {
            let outline = oval([0.0, 0.0], [r * 1.3, r * 0.8], 14);
            k.model.prism_y(&outline, [0.0, h * 0.9], k.paint);
            let rim = oval([0.0, 0.0], [r * 1.36, r * 0.86], 14);
            k.model.prism_y(&rim, [h * 0.9, h], k.paint.times(0.93));
            "oval"
        }
    };
    k.noun = if h > 0.42 { "laundry basket" } else { "" };
    [size_word(h, 0.32, 0.46, ["low", "tall"]), shape]
}

fn bin(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.28, 0.6), k.len(0.12, 0.18));
    let p = k.paint;
    match k.style {
        0 => k.turned(&[[0.8, 0.0], [1.0, 1.0], [0.9, 1.0], [0.84, 0.9]], r, h, 12),
        1 => k.turned(&[[0.95, 0.0], [0.95, 0.85], [0.7, 0.98], [0.2, 1.0]], r, h, 12),
        2 => {
            k.model.soft(about(0.0, 2.0 * r), [0.0, h * 0.9], about(0.0, 1.7 * r), 0.012, p);
            k.model.soft(about(0.0, 2.06 * r), [h * 0.9, h], about(0.0, 1.76 * r), 0.015, p.times(0.92));
        }
        3 => k.model.prism_y(&circle([0.0, 0.0], r, 6), [0.0, h], p),
        4 => {
            k.turned(&[[0.9, 0.03], [0.9, 0.92], [0.8, 1.0]], r, h, 12);
            k.model.block(about(0.0, 0.1), [0.0, 0.025], [r * 0.7, r * 1.2], Paint::DARK_METAL);
        }
        5 => k.model.prism_y(&oval([0.0, 0.0], [r * 1.3, r * 0.8], 14), [0.0, h], p),
        6 => k.turned(&[[1.0, 0.0], [0.75, 0.5], [1.0, 1.0], [0.9, 1.0]], r, h, 12),
        _ => {
            k.model.soft(about(0.0, 1.5 * r), [0.0, h * 0.85], about(0.0, 1.5 * r), 0.01, p);
            k.model.prism_z(&arch(1.5 * r, h * 0.84, h), about(0.0, 1.5 * r), p.times(0.95));
        }
    }
    let shape = k.by_style("round|domed|square|hexagonal|pedalled|oval|waisted|arched");
    [size_word(h, 0.38, 0.5, ["small", "tall"]), shape]
}

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
