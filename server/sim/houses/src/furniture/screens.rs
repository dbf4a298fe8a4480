//! Televisions and monitors.

use super::*;

const CASES: &[Substance] = &[Plastic, Plastic, Metal, Glass, Wood, Ceramic, Bamboo];

/// A television on a foot.
pub(crate) const TV: FurnitureKind =
    FurnitureKind::new("tv_monitor", "television", 5, tv).made_of(CASES, styles::DARK);

/// A wall television; lower edge at y = 0, back at z = 0.
pub(crate) const WALL_TV: FurnitureKind =
    FurnitureKind::new("tv_monitor", "television", 3, wall_tv).made_of(CASES, styles::DARK);
pub(crate) const MONITOR: FurnitureKind =
    FurnitureKind::new("tv_monitor", "monitor", 5, monitor).made_of(CASES, styles::DARK);

/// Adds a case with a screen; `bar` is the frame width.
fn screen(k: &mut Draft, w: f32, y: Span, z: Span, bar: f32) {
    k.model.soft(about(0.0, w), y, z, 0.008, k.paint);
    let (x, inner) = (about(0.0, w - 2.0 * bar), [y[0] + 1.4 * bar, y[1] - bar]);
    k.model.lid(x, inner, [z[1], z[1] + 0.003], Paint::SCREEN);
    let glow = Paint::plain("glass", [44, 50, 66]);
    let (left, top) = (x[0] + 0.02, inner[1] - 0.02);
    let at = |right: f32, down: f32| point(left + right, top - down, z[1] + 0.005);
    let long = (y[1] - y[0]) * 0.3;
    k.model.quad([at(0.0, long), at(long * 2.0, 0.0), at(long * 1.4, 0.0), at(0.0, long * 0.7)], glow);
}

fn size(w: f32) -> &'static str {
    size_word(w, 0.72, 1.05, ["small", "large"])
}

fn tv(k: &mut Draft) -> Words {
    let w = k.width(0.8, 1.35);
    let h = w * 0.58;
    let feet = Paint::DARK_METAL;
    match k.style {
        0 => {
            k.model.block(about(0.0, w * 0.4), [0.0, 0.015], about(0.0, 0.2), feet);
            k.model.block(about(0.0, 0.08), [0.015, 0.09], about(-0.01, 0.03), feet);
        }
        1 => k.model.pair([w * 0.3, w * 0.34], [0.0, 0.07], about(0.0, 0.22), feet),
        2 => k.model.prism_y(&oval([0.0, 0.0], [w * 0.2, 0.1], 12), [0.0, 0.07], feet),
        3 => {
            let (w, h) = (w.min(0.75), w.min(0.75) * 0.8);
            k.model.soft(about(0.0, w * 0.8), [0.04, h - 0.04], [-0.2, -0.05], 0.05, k.paint);
            screen(k, w, [0.0, h], [-0.06, 0.14], 0.06);
            return [size(w), "boxy"];
        }
        _ => {
            for x in [-w * 0.25, w * 0.25] {
                k.model.prism_x(&[[-0.1, 0.0], [0.1, 0.0], [0.0, 0.07]], about(x, 0.03), feet);
            }
        }
    }
    screen(k, w, [0.07, 0.07 + h], [-0.025, 0.025], 0.03);
    [size(w), "flat"]
}

fn wall_tv(k: &mut Draft) -> Words {
    let w = k.width(0.8, 1.4);
    k.model.block(about(0.0, 0.3), [0.1, 0.3], [0.0, 0.03], Paint::DARK_METAL);
    screen(k, w, [0.0, w * 0.58], [0.03, 0.07], [0.02, 0.04, 0.03][k.style]);
    if k.style == 2 {
        k.model.soft(about(0.0, w * 0.7), [-0.11, -0.03], [0.0, 0.07], 0.02, Paint::DARK_METAL);
    }
    [size(w), k.by_style("flat|framed|flat")]
}

fn monitor(k: &mut Draft) -> Words {
    let w = k.width(0.42, 0.72);
    let h = w * if k.style == 3 { 0.8 } else { 0.58 };
    let foot = [[0.12, 0.0], [0.12, 0.012], [0.025, 0.02], [0.025, 0.12]];
    match k.style {
        0 | 3 => k.model.lathe([0.0, 0.0], &foot, 10, k.paint),
        1 => {
            k.model.block(about(0.0, 0.24), [0.0, 0.012], about(0.0, 0.18), k.paint);
            k.model.block(about(0.0, 0.05), [0.012, 0.12], about(-0.03, 0.02), k.paint);
        }
        2 => {
            for x in [-0.12, 0.12] {
                k.model.rod(point(x, 0.0, 0.08), point(0.0, 0.14, -0.03), 0.012, k.paint);
            }
            k.model.rod(point(0.0, 0.0, -0.1), point(0.0, 0.14, -0.03), 0.012, k.paint);
        }
        _ => k.model.block(about(0.0, w * 0.6), [0.0, 0.1], about(-0.01, 0.06), k.paint),
    }
    screen(k, w, [0.1, 0.1 + h], [-0.025, 0.02], 0.03);
    [size_word(w, 0.5, 0.62, ["small", "large"]), k.by_style("round-footed||three-legged|square|low")]
}
