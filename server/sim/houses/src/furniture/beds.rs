//! Beds and cushions.

use super::*;

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
