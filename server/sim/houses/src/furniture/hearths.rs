//! Fireplaces and radiators.

use super::*;

pub(crate) const FIREPLACE: FurnitureKind = FurnitureKind::new("fireplace", "", 8, fireplace).made_of(
    &[Brick, Marble, Wood, Concrete, Tile, Metal, Terrazzo],
    "red white grey brown black green teal yellow blue orange pink purple",
);
pub(crate) const RADIATOR: FurnitureKind = FurnitureKind::new("radiator", "", 8, radiator)
    .made_of(&[Metal, Metal, Metal, Ceramic, Plastic, Wood, Glass, Marble], styles::SANITARY);

/// Logs and flames in a dark hole between `-half` and `half`, `high` up.
fn fire(k: &mut Draft, half: f32, high: f32, back: f32) {
    let soot = Paint::plain("brick", [44, 38, 36]).with(Pattern::Brick);
    k.model.block(about(0.0, 2.0 * half), [0.0, high], [back, back + 0.05], soot);
    for (x, y) in [(-0.06, 0.06), (0.08, 0.06), (0.0, 0.14)] {
        let z = back + 0.15 + x * 0.4;
        let (from, to) = (point(-half * 0.7, y, z), point(half * 0.7, y + x * 0.2, z + 0.03));
        k.model.rod(from, to, 0.05, Paint::WALNUT);
    }
    for flame in 0..3 {
        let x = (flame as f32 - 1.0) * half * 0.4;
        let paint = Paint::plain("fire", if flame == 1 { [250, 200, 70] } else { [240, 130, 40] });
        k.model.lathe([x, back + 0.17], &[[0.04, 0.14], [0.06, 0.2], [0.0, 0.36]], 6, paint);
    }
}

fn fireplace(k: &mut Draft) -> Words {
    let (w, h, d) = (k.len(1.15, 1.55), k.len(0.95, 1.25), 0.34);
    let (half, hole, p) = (w / 2.0, w * 0.28, k.paint);
    let (back, front) = (-d / 2.0, d / 2.0);
    if k.style == 6 {
        k.model.lathe([0.0, 0.0], &[[0.3, 0.0], [0.3, 0.7], [0.1, 0.95], [0.09, 1.9]], 14, p);
        k.model.prism_z(&arch(0.36, 0.15, 0.55), [0.27, 0.31], Paint::SCREEN);
        k.model.lid(about(0.0, 0.2), [0.2, 0.38], [0.31, 0.315], Paint::plain("fire", [240, 130, 40]));
        return ["tall", "round"];
    }
    k.model.pair([hole, half], [0.0, h - 0.06], [back, front], p);
    k.model.block(about(0.0, 2.0 * hole), [0.62, h - 0.06], [back, front], p);
    fire(k, hole, 0.62, back);
    let shelf = if k.style == 2 { Paint::WALNUT } else { p.times(0.95) };
    match k.style {
        2 => k.model.block(about(0.0, w), [h - 0.14, h - 0.06], [front, front + 0.04], shelf),
        1 => k.model.block(about(0.0, w * 0.7), [h - 0.06, 2.3], [back, front - 0.08], p),
        3 => k.model.pair([half - 0.1, half], [0.0, h - 0.06], [front, front + 0.05], p.times(1.03)),
        4 => k.model.soft(about(0.0, w), [0.0, 0.05], [front, front + 0.2], 0.01, p),
        5 => {
            let crown = [[-half, h - 0.06], [half, h - 0.06], [0.0, h + 0.28]];
            k.model.prism_z(&crown, [back, back + 0.1], p);
        }
        7 => k.model.prism_z(&arch(w, h - 0.06, h + 0.3), [back, back + 0.12], p),
        _ => {}
    }
    let shape = k.by_style("plain|chimneyed|beamed|pillared|hearthed|gabled|plain|arched");
    k.model.soft(about(0.0, w + 0.14), [h - 0.06, h], [back, front + 0.06], 0.012, shelf);
    [size_word(w, 1.25, 1.42, ["small", "large"]), shape]
}

fn radiator(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.6, 1.2), k.height(0.5, 0.66));
    let size = size_word(w, 0.75, 1.0, ["short", "long"]);
    match k.style {
        0 | 1 => {
            let count =
                if k.style == 0 { ((w / 0.08) as usize).min(14) } else { ((w / 0.12) as usize).min(10) };
            for i in 0..count {
                let x = ((i as f32 + 0.5) / count as f32 - 0.5) * w;
                k.model.block(about(x, w / count as f32 * 0.7), [0.1, 0.1 + h], about(0.0, 0.11), k.paint);
            }
            k.model.block(about(0.0, w), [0.14, 0.18], about(0.0, 0.06), k.paint);
            k.model.pair([w * 0.4, w * 0.44], [0.0, 0.12], about(0.0, 0.06), k.paint);
        }
        2 | 3 => {
            k.model.soft(about(0.0, w), [0.1, 0.1 + h], about(0.0, 0.1), 0.012, k.paint);
            k.model.pair([w * 0.4, w * 0.43], [0.0, 0.1], about(0.0, 0.04), Paint::CHROME);
            let slot = [0.1 + h - 0.04, 0.1 + h - 0.02];
            k.model.lid(about(0.0, w - 0.06), slot, [0.05, 0.055], k.paint.times(0.8));
            if k.style == 3 {
                k.model.lid(about(0.0, w * 0.9), [0.16, h - 0.02], [0.05, 0.065], k.paint);
            }
        }
        4 => {
            for i in 0..6 {
                let y = 0.12 + h * i as f32 / 6.0;
                k.model.soft(about(0.0, w), [y, y + h * 0.11], about(0.0, 0.06), 0.01, k.paint);
            }
            k.model.pair([w / 2.0 - 0.05, w / 2.0 - 0.02], [0.0, 0.1 + h], [-0.04, -0.02], k.paint);
        }
        5 => {
            k.model.block(about(0.0, w + 0.06), [0.0, h + 0.14], about(-0.01, 0.1), k.paint);
            for i in 0..6 {
                let x = (i as f32 - 2.5) * w / 6.5;
                k.model.lid(about(x, w * 0.07), [0.08, h + 0.06], [0.04, 0.06], k.paint.times(0.9));
            }
        }
        6 => {
            for i in 0..6 {
                let x = ((i as f32 + 0.5) / 6.0 - 0.5) * w;
                k.model.lathe([x, 0.0], &[[0.045, 0.08], [0.045, 0.1 + h]], 8, k.paint);
            }
            k.model.pair([w * 0.38, w * 0.42], [0.0, 0.1], about(0.0, 0.05), k.paint);
        }
        _ => {
            k.model.soft(about(0.0, w), [0.12, 0.1 + h], about(0.0, 0.12), 0.05, k.paint);
            k.model.pair([w * 0.36, w * 0.42], [0.0, 0.14], about(0.0, 0.2), Paint::DARK_METAL);
        }
    }
    [size, k.by_style("ribbed|ribbed|flat|flat|barred|covered|tubular|rounded")]
}
