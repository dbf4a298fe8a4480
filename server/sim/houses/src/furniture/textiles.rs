//! Beds and textiles: cushions, towels, clothes and rugs.

use super::*;

/// A towel on a rail or hook; lower edge at y = 0.
pub(crate) const TOWEL: FurnitureKind = FurnitureKind::new("towel", "", 8, towel)
    .made_of(&[Fabric, Wool, Knit, Striped, Checked, Corduroy, Dotted], styles::CLOTH);
pub(crate) const TOWEL_PILE: FurnitureKind =
    FurnitureKind::new("towel", "", 3, pile).made_of(&[Fabric, Wool, Knit, Striped, Corduroy], styles::CLOTH);

fn rail(k: &mut Draft, width: f32, y: f32, paint: Paint) {
    let half = width / 2.0 + 0.06;
    k.model.rod(point(-half, y, 0.038), point(half, y, 0.038), 0.01, paint);
    k.model.pair([half - 0.02, half], [y - 0.02, y + 0.02], [0.0, 0.05], paint);
}

/// Adds a cloth over a rail: the front hangs lower than the back.
fn cloth(k: &mut Draft, x: Span, y: Span, front: f32) {
    k.model.soft(x, y, [front - 0.03, front], 0.012, k.paint);
    let low = y[0] + (y[1] - y[0]) * 0.25;
    k.model.soft(x, [low, y[1]], [0.012, 0.035], 0.01, k.paint.times(0.94));
}

fn towel(k: &mut Draft) -> Words {
    let (w, h) = (k.len(0.3, 0.55), k.len(0.42, 0.72));
    let p = k.paint;
    match k.style {
        0 => {
            cloth(k, about(0.0, w), [0.0, h], 0.065);
            k.model.lid(about(0.0, w + 0.002), [0.06, 0.09], [0.065, 0.067], p.times(0.85));
            rail(k, w, h - 0.02, k.metal());
        }
        1 => {
            cloth(k, about(0.0, w), [0.0, h], 0.065);
            rail(k, w, h - 0.02, Paint::DARK_METAL);
        }
        2 => {
            cloth(k, about(-w * 0.27, w * 0.5), [0.0, h], 0.065);
            cloth(k, about(w * 0.27, w * 0.5), [h * 0.2, h], 0.065);
            rail(k, w * 1.05, h - 0.02, k.metal());
        }
        3 => {
            let gather = [[0.05, 0.9], [0.12, 0.5], [0.16, 0.0]];
            let profile: Vec<[f32; 2]> = gather.iter().rev().map(|[r, y]| [*r, y * h]).collect();
            k.model.oval([0.0, 0.06], [1.0, 0.36], &profile, 10, p);
            k.model.cylinder([0.0, 0.03], [h * 0.86, h * 0.94], 0.03, 8, k.metal());
            k.model.block(about(0.0, 0.05), [h * 0.86, h * 0.96], [0.0, 0.02], k.metal());
        }
        4 => {
            cloth(k, about(0.0, w), [0.0, h], 0.065);
            k.model.pair([w / 2.0 - 0.05, w / 2.0 + 0.002], [0.0, h], [0.065, 0.068], p.times(0.82));
            rail(k, w, h - 0.02, Paint::OAK);
        }
        5 => {
            cloth(k, about(0.0, w * 0.8), [0.0, h * 0.7], 0.06);
            k.model.prism_z(&circle([0.0, h * 0.72], 0.09, 10), [0.02, 0.045], k.metal());
            k.model.block(about(0.0, 0.06), [h * 0.76, h * 0.86], [0.0, 0.03], k.metal());
        }
        6 => {
            for i in 0..3 {
                let y = h * (0.1 + 0.34 * i as f32);
                k.model.soft(about(0.0, w * 0.9), [y, y + h * 0.26], [0.03, 0.07], 0.015, p);
                rail(k, w, y + h * 0.25, k.metal());
            }
        }
        _ => {
            cloth(k, about(0.0, w), [0.05, h], 0.065);
            for i in 0..5 {
                k.model.block(about((i as f32 - 2.0) * w * 0.22, w * 0.08), [0.0, 0.05], [0.04, 0.06], p);
            }
            rail(k, w, h - 0.02, Paint::BRASS);
        }
    }
    let shape = k.by_style("bordered|plain|double|gathered|edged|ring-hung|layered|fringed");
    [size_word(w * h, 0.17, 0.29, ["small", "large"]), shape]
}

fn pile(k: &mut Draft) -> Words {
    let layers = 2 + k.rng.below(2);
    for layer in 0..layers {
        let y = 0.06 * layer as f32;
        let shade = if layer % 2 == 0 { 1.0 } else { 0.94 };
        match k.style {
            1 => {
                let x = (layer as f32 - (layers - 1) as f32 / 2.0) * 0.13;
                k.model.prism_z(&circle([x, 0.06], 0.06, 10), about(0.0, 0.24), k.paint.times(shade));
            }
            _ => k.model.soft(about(0.0, 0.3), [y, y + 0.06], about(0.0, 0.22), 0.025, k.paint.times(shade)),
        }
    }
    if k.style == 2 {
        let y = [0.0, 0.06 * layers as f32 + 0.004];
        k.model.block(about(0.0, 0.04), y, about(0.0, 0.224), k.paint.times(0.8));
    }
    ["small", k.by_style("folded|rolled|tied")]
}

const CLOTHS: &[Substance] = &[Fabric, Denim, Knit, Checked, Striped, Leather, Velvet, Dotted];

/// Clothing on a hook; hem at y = 0.
pub(crate) const HANGING: FurnitureKind =
    FurnitureKind::new("clothes", "coat", 8, hanging).made_of(CLOTHS, styles::CLOTH);

/// Folded or heaped clothes.
pub(crate) const FOLDED: FurnitureKind =
    FurnitureKind::new("clothes", "", 4, folded).made_of(CLOTHS, styles::CLOTH);

/// Adds a body as an oval with shoulders, from the hem to `length`.
fn body(k: &mut Draft, length: f32, hem: f32, waist: f32) {
    let profile = [[hem, 0.0], [waist, length * 0.55], [0.21, length - 0.1], [0.07, length]];
    k.model.oval([0.0, 0.08], [1.0, 0.34], &profile, 12, k.paint);
}

fn sleeves(k: &mut Draft, length: f32, share: f32) {
    for side in [-1.0, 1.0] {
        let shoulder = point(side * 0.19, length - 0.1, 0.08);
        let cuff = point(side * 0.27, length - 0.1 - share, 0.09);
        k.model.rod(shoulder, cuff, 0.045, k.paint.times(0.95));
    }
}

fn hanging(k: &mut Draft) -> Words {
    k.noun = k.by_style("coat|jacket|dress|bathrobe|shirt|trousers|scarf|hat");
    let l = match k.style {
        0 => k.len(0.85, 1.05),
        1 => k.len(0.62, 0.74),
        2 | 3 => k.len(0.95, 1.15),
        4 => k.len(0.6, 0.72),
        5 => k.len(0.85, 1.02),
        6 => k.len(0.75, 0.95),
        _ => 0.24,
    };
    match k.style {
        0 => {
            body(k, l, 0.24, 0.2);
            sleeves(k, l, 0.52);
            k.model.block(about(0.0, 0.012), [0.06, l - 0.06], [0.145, 0.165], k.paint.times(0.75));
        }
        1 => {
            body(k, l, 0.2, 0.19);
            sleeves(k, l, 0.48);
            k.model.block(about(0.0, 0.36), [0.0, 0.06], [0.03, 0.13], k.paint.times(0.85));
        }
        2 => body(k, l, 0.3, 0.13),
        3 => {
            body(k, l, 0.23, 0.2);
            sleeves(k, l, 0.44);
            k.model.block(about(0.0, 0.4), [l * 0.5, l * 0.55], [0.005, 0.155], k.paint.times(0.85));
        }
        4 => {
            body(k, l, 0.19, 0.19);
            sleeves(k, l, 0.2);
        }
        5 => {
            for side in [-1.0, 1.0] {
                let leg = [[0.07, 0.0], [0.08, l * 0.6], [0.1, l - 0.05]];
                k.model.oval([side * 0.085, 0.06], [1.0, 0.5], &leg, 8, k.paint);
            }
            k.model.soft(about(0.0, 0.36), [l - 0.12, l], [0.01, 0.11], 0.02, k.paint.times(0.97));
        }
        6 => {
            k.model.soft(about(-0.06, 0.14), [0.0, l], [0.02, 0.06], 0.015, k.paint);
            k.model.soft(about(0.07, 0.14), [l * 0.25, l], [0.03, 0.07], 0.015, k.paint.times(0.96));
        }
        _ => {
            let cone = [[0.2, 0.1], [0.2, 0.12], [0.11, 0.13], [0.1, 0.26], [0.04, 0.28]];
            k.model.lathe([0.0, 0.21], &cone, 14, k.paint);
            k.model.rod(point(0.0, 0.18, 0.0), point(0.0, 0.2, 0.2), 0.015, Paint::WALNUT);
        }
    }
    k.model.block(about(0.0, 0.3), [l + 0.02, l + 0.08], [0.0, 0.02], Paint::WALNUT);
    k.model.rod(point(0.0, l - 0.02, 0.06), point(0.0, l + 0.05, 0.015), 0.012, Paint::STEEL);
    let shapes = "long-sleeved|long-sleeved|sleeveless|belted|short-sleeved|two-legged|narrow|brimmed";
    [size_word(l, 0.66, 0.98, ["short", "long"]), k.by_style(shapes)]
}

fn folded(k: &mut Draft) -> Words {
    match k.style {
        0 | 1 => {
            let layers = 2 + k.rng.below(3);
            for layer in 0..layers {
                let y = 0.05 * layer as f32;
                let shade = if layer % 2 == 0 { 1.0 } else { 0.93 };
                let (x, z) = (k.rng.range(-0.02, 0.02), k.rng.range(-0.02, 0.02));
                let size = [0.36, 0.26][k.style];
                k.model.soft(about(x, size), [y, y + 0.05], about(z, 0.27), 0.018, k.paint.times(shade));
            }
            [k.by_style("large|small"), "folded"]
        }
        2 => {
            let heap = [[0.24, 0.0], [0.22, 0.07], [0.12, 0.15], [0.0, 0.17]];
            k.model.oval([0.0, 0.0], [1.0, 0.8], &heap, 10, k.paint);
            let peak = [[0.12, 0.0], [0.11, 0.13], [0.0, 0.2]];
            k.model.oval([0.1, 0.05], [1.0, 0.7], &peak, 8, k.paint.times(0.94));
            ["", "heaped"]
        }
        _ => {
            k.model.soft(about(0.0, 0.34), [0.0, 0.04], about(0.0, 0.44), 0.018, k.paint);
            for side in [-1.0, 1.0] {
                k.model.soft(about(side * 0.2, 0.1), [0.0, 0.035], [-0.2, 0.12], 0.015, k.paint.times(0.96));
            }
            ["", "spread"]
        }
    }
}

pub(crate) const RUG: FurnitureKind = FurnitureKind::new("rug", "", 8, rug).made_of(
    &[Wool, Fabric, Knit, Striped, Checked, Dotted, Denim, Wicker],
    "red blue grey brown green teal purple orange pink yellow black white",
);

fn rug(k: &mut Draft) -> Words {
    let (w, d) = (k.width(0.8, 2.2), k.depth(0.5, 1.6));
    let size = size_word(w * d, 0.9, 2.4, ["small", "large"]);
    let r = w.min(d) / 2.0;
    let low = [0.0, 0.01];
    match k.style {
        0 => {
            k.model.block(about(0.0, w), low, about(0.0, d), k.paint.times(0.93));
            k.model.block(about(0.0, w - 0.2), [0.01, 0.014], about(0.0, d - 0.2), k.paint);
        }
        1 => k.model.prism_y(&circle([0.0, 0.0], r, 22), [0.0, 0.012], k.paint),
        2 => k.model.prism_y(&oval([0.0, 0.0], [w / 2.0, d / 2.0], 22), [0.0, 0.012], k.paint),
        3 => {
            k.model.block(about(0.0, w - 0.12), low, about(0.0, d), k.paint);
            for i in 0..10 {
                let z = (i as f32 - 4.5) * d * 0.1;
                k.model.pair([w / 2.0 - 0.06, w / 2.0], [0.0, 0.006], about(z, d * 0.04), Paint::LINEN);
            }
        }
        4 => {
            k.model.block(about(0.0, w), low, about(0.0, d), k.paint);
            for x in [-0.3, 0.0, 0.3] {
                let band = about(x * w, w * 0.06);
                k.model.block(band, [0.01, 0.013], about(0.0, d - 0.08), k.paint.times(0.8));
            }
        }
        5 => k.model.soft(about(0.0, w), [0.0, 0.03], about(0.0, d), 0.012, k.paint),
        6 => {
            k.model.prism_y(&circle([0.0, 0.0], r, 8), [0.0, 0.012], k.paint);
            k.model.prism_y(&circle([0.0, 0.0], r * 0.6, 8), [0.012, 0.015], k.paint.times(0.9));
        }
        _ => {
            k.model.block(about(0.0, w), low, about(0.0, d), k.paint);
            let diamond = [[0.0, -0.4], [0.4, 0.0], [0.0, 0.4], [-0.4, 0.0]].map(|[x, z]| [x * w, z * d]);
            k.model.prism_y(&diamond, [0.01, 0.014], k.paint.times(0.84));
        }
    }
    [size, k.by_style("bordered|round|oval|fringed|banded|shaggy|octagonal|diamond-patterned")]
}

/// A bed; the head is towards -z.
pub(crate) const BED: FurnitureKind = FurnitureKind::new("bed", "", 8, bed)
    .made_of(&[Fabric, Quilt, Striped, Velvet, Checked, Knit, Denim, Dotted], styles::CLOTH);

pub(crate) const CUSHION: FurnitureKind = FurnitureKind::new("cushion", "", 8, cushion)
    .made_of(&[Fabric, Velvet, Striped, Knit, Leather, Checked, Dotted, Corduroy, Denim], styles::CLOTH);

/// Height of objects on a bed, metres.
pub(crate) const COVER_M: f32 = 0.55;

fn bed(k: &mut Draft) -> Words {
    let (w, l) = (k.width(0.95, 1.75), k.len(2.0, 2.16));
    let head = -l / 2.0;
    let frame = k.trim;
    let sheet = k.paint.times(1.1);
    k.model.soft(about(0.0, w - 0.04), [0.3, 0.5], [head + 0.06, head + 0.6], 0.04, sheet);
    k.model.soft(about(0.0, w + 0.03), [0.16, COVER_M], [head + 0.46, -head + 0.02], 0.05, k.paint);
    match k.style {
        0 => {
            base(k, [w, l], frame);
            k.model.block(about(0.0, w), [0.3, 0.95], [head - 0.02, head + 0.04], frame);
        }
        1 => {
            base(k, [w, l], frame);
            let top = k.len(0.95, 1.2);
            let z = [head - 0.04, head + 0.06];
            k.model.soft(about(0.0, w + 0.06), [0.1, top], z, 0.04, k.paint.times(0.97));
        }
        2 => {
            base(k, [w, l], frame);
            k.model.pair([w / 2.0 - 0.07, w / 2.0], [0.0, 1.0], [head - 0.03, head + 0.04], frame);
            for y in [0.88, 0.62] {
                k.model.block(about(0.0, w - 0.14), [y, y + 0.1], [head - 0.01, head + 0.02], frame);
            }
            k.model.block(about(0.0, w), [0.1, 0.62], [-head + 0.02, -head + 0.05], frame);
        }
        3 => {
            base(k, [w, l], frame);
            let outline = arch(w, 0.3, 1.25);
            k.model.prism_z(&outline, [head - 0.03, head + 0.04], frame);
        }
        4 => canopy(k, [w, l], frame),
        5 => k.model.rim(about(0.0, w), [0.0, 0.3], about(0.0, l), frame),
        6 => {
            base(k, [w, l], frame);
            let quilt = k.paint.with(Pattern::Quilt);
            k.model.soft(about(0.0, w + 0.04), [0.2, 1.15], [head - 0.05, head + 0.07], 0.05, quilt);
        }
        _ => {
            base(k, [w, l], Paint::DARK_METAL);
            for i in 0..4 {
                let x = (i as f32 / 3.0 - 0.5) * (w - 0.06);
                k.model.rod(point(x, 0.2, head), point(x, 1.05, head), 0.013, Paint::DARK_METAL);
            }
            let rail = |y: f32| [point(-w / 2.0, y, head), point(w / 2.0, y, head)];
            k.model.rod(rail(1.05)[0], rail(1.05)[1], 0.02, Paint::DARK_METAL);
        }
    }
    let shape = k.by_style("straight|upholstered|railed|arched|canopied|low|tufted|barred");
    pillows(k, w, head);
    [size_word(w, 1.15, 1.55, ["narrow", "wide"]), shape]
}

fn base(k: &mut Draft, [w, l]: [f32; 2], frame: Paint) {
    k.legs([w, l], 0.16, 0.07, 0.02, frame);
    k.model.rim(about(0.0, w - 0.06), [0.16, 0.3], [-l / 2.0, l / 2.0 - 0.02], frame);
}

fn canopy(k: &mut Draft, [w, l]: [f32; 2], frame: Paint) {
    let (x, z) = (w / 2.0 + 0.02, l / 2.0);
    for side in [-1.0, 1.0] {
        k.model.pair([x, x + 0.06], [0.0, 2.05], about(side * z, 0.06), frame);
        k.model.block(about(0.0, 2.0 * x + 0.12), [2.0, 2.05], about(side * z, 0.05), frame);
    }
    k.model.pair([x, x + 0.05], [2.0, 2.05], about(0.0, 2.0 * z), frame);
    k.model.block(about(0.0, 2.0 * x), [0.5, 1.0], about(-z, 0.04), frame);
}

fn pillows(k: &mut Draft, w: f32, head: f32) {
    let p = k.paint.times(1.05);
    let count = if w > 1.2 { 2 } else { 1 };
    for i in 0..count {
        let x = (i as f32 - (count - 1) as f32 / 2.0) * w * 0.46;
        let (x, y, z) = (about(x, 0.58), [0.49, 0.62], [head + 0.1, head + 0.48]);
        if k.style == 4 {
            k.model.soft(x, y, z, 0.05, p);
        } else {
            k.model.pillow(x, y, z, p);
        }
    }
}

fn cushion(k: &mut Draft) -> Words {
    let (w, d, h) = (k.len(0.34, 0.52), k.len(0.34, 0.44), k.len(0.11, 0.16));
    let r = w / 2.0;
    match k.style {
        0 => k.model.pillow(about(0.0, w), [0.0, h], about(0.0, w), k.paint),
        1 => {
            let round = [[r * 0.8, 0.0], [r, h * 0.35], [r, h * 0.65], [r * 0.7, h], [0.0, h]];
            k.model.lathe([0.0, 0.0], &round, 14, k.paint);
        }
        2 => k.model.pillow(about(0.0, w * 1.25), [0.0, h], about(0.0, d * 0.8), k.paint),
        3 => k.model.prism_x(&circle([0.0, 0.09], 0.09, 12), about(0.0, w * 1.1), k.paint),
        4 => k.model.soft(about(0.0, w), [0.0, h * 0.7], about(0.0, w), 0.03, k.paint),
        5 => {
            k.model.pillow(about(0.0, w), [0.0, h], about(0.0, w), k.paint);
            k.model.lathe([0.0, 0.0], &[[0.03, h - 0.004], [0.02, h + 0.01]], 8, k.paint.times(0.8));
        }
        6 => {
            let heart =
                [[0.0, -0.5], [0.5, 0.1], [0.42, 0.4], [0.2, 0.5], [-0.2, 0.5], [-0.42, 0.4], [-0.5, 0.1]];
            k.model.prism_y(&heart.map(|[x, y]| [x * w, y * w]), [0.0, h * 0.7], k.paint);
        }
        _ => k.model.prism_y(&circle([0.0, 0.0], r, 6), [0.0, h * 0.8], k.paint),
    }
    let shape = k.by_style("square|round|rectangular|cylindrical|boxy|buttoned|heart-shaped|hexagonal");
    [size_word(w, 0.39, 0.46, ["small", "large"]), shape]
}
