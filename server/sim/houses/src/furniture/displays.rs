//! Pictures, mirrors, boards, clocks, televisions and monitors. Pieces on walls: lower edge at y = 0, back at z = 0.

use super::super::texture::{Art, Medium, Motif};
use super::*;

/// A framed picture with the requested width and height.
pub(crate) const PICTURE: FurnitureKind =
    FurnitureKind::new("picture", "", 8, picture).made_of(&[Paper], styles::CLOTH);

/// A mirror; colour and material are the frame's.
pub(crate) const MIRROR: FurnitureKind = FurnitureKind::new("mirror", "", 8, mirror).made_of(
    &[Wood, Metal, Plastic, Bamboo, Wicker, Marble],
    "brown black white grey yellow red blue green teal orange pink purple",
);

/// Adds a frame with width `bar` around an outline, between the wall and `front`.
fn frame(m: &mut Model, outline: &[[f32; 2]], bar: f32, front: f32, paint: Paint) {
    let count = outline.len();
    let middle = outline.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
    let middle = middle.map(|sum| sum / count as f32);
    let inner = |[x, y]: [f32; 2]| {
        let offset = [x - middle[0], y - middle[1]];
        let shrink = |d: f32| d - d.signum() * bar.min(d.abs());
        if count == 4 {
            return [middle[0] + shrink(offset[0]), middle[1] + shrink(offset[1])];
        }
        let length = (offset[0] * offset[0] + offset[1] * offset[1]).sqrt().max(1e-3);
        let share = 1.0 - bar / length;
        [middle[0] + offset[0] * share, middle[1] + offset[1] * share]
    };
    let at = |[x, y]: [f32; 2], z: f32| point(x, y, z);
    for i in 0..count {
        let (a, b) = (outline[i], outline[(i + 1) % count]);
        m.quad([at(a, front), at(b, front), at(inner(b), front), at(inner(a), front)], paint);
        m.quad([at(a, 0.0), at(b, 0.0), at(b, front), at(a, front)], paint);
        m.quad([at(inner(b), 0.005), at(inner(a), 0.005), at(inner(a), front), at(inner(b), front)], paint);
    }
}

fn picture(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.4, 1.0), k.height(0.4, 0.8));
    let medium = *k.rng.choose(&Medium::ALL).expect("the list is not empty");
    let motif = Motif::ALL[(k.style + k.rng.below(2) * 4) % 8];
    k.material = medium.word();
    let art = Art { ground: k.tint.rgb, motif, medium, seed: k.rng.next_u64() as u32 };
    let canvas = Paint::plain(medium.surface(), [255; 3]).with(Pattern::Art(art));
    let thin = [Paint::WALNUT, Paint::DARK_METAL];
    let paint =
        if k.rng.chance(0.75) { *k.rng.choose(&thin).expect("the list is not empty") } else { k.trim };
    let round = matches!(k.style, 6 | 7);
    let outline = match k.style {
        6 => oval([0.0, h / 2.0], [w / 2.0, h / 2.0], 16),
        7 => circle([0.0, w.min(h) / 2.0], w.min(h) / 2.0, 8),
        _ => rectangle(w, h, h / 2.0),
    };
    let bar = [0.015, 0.022, 0.006, 0.026, 0.034, 0.012, 0.02, 0.018][k.style];
    let front = [0.018, 0.02, 0.025, 0.02, 0.026, 0.03, 0.02, 0.02][k.style];
    frame(&mut k.model, &outline, bar, front, paint);
    k.model.pictured(&outline, front - 0.006, canvas);
    if k.style == 3 {
        let mat = Paint::plain("paper", k.tint.rgb);
        frame(&mut k.model, &rectangle(w - 0.08, h - 0.08, h / 2.0), 0.05, front - 0.003, mat);
    }
    let ratio = w / h;
    let shape = match k.style {
        6 => "oval",
        7 => "octagonal",
        _ if ratio < 0.87 => "upright",
        _ if ratio > 1.15 => "wide",
        _ => "square",
    };
    let area = if round { w * h * 0.8 } else { w * h };
    [size_word(area, 0.25, 0.5, ["small", "large"]), shape]
}

fn mirror(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.45, 0.8), k.height(0.5, 1.3));
    let side = w.min(h);
    let outline = match k.style {
        0 => rectangle(w, h, h / 2.0),
        1 => circle([0.0, side / 2.0], side / 2.0, 20),
        2 => oval([0.0, h / 2.0], [w / 2.0, h / 2.0], 18),
        3 => arch(w, 0.0, h),
        4 => circle([0.0, side / 2.0], side / 2.0, 8),
        5 => circle([0.0, side / 2.0], side / 2.0, 6),
        6 => rectangle(w, h, h / 2.0),
        _ => circle([0.0, side / 2.0], side * 0.3, 16),
    };
    let bar = [0.04, 0.05, 0.05, 0.045, 0.05, 0.05, 0.1, 0.04][k.style];
    frame(&mut k.model, &outline, bar, 0.025, k.paint);
    k.model.pictured(&outline, 0.012, Paint::MIRROR.with(Pattern::Sheen));
    if k.style == 7 {
        for i in 0..16 {
            let (sin, cos) = angle::sin_cos(i as f32 * std::f32::consts::TAU / 16.0);
            let at = |r: f32| point(sin * r, side / 2.0 + cos * r, 0.015);
            k.model.rod(at(side * 0.29), at(side * 0.49), 0.012, k.paint);
        }
    }
    let shape = k.by_style("rectangular|round|oval|arched|octagonal|hexagonal|broad-framed|sunburst");
    [size_word(h.max(w), 0.62, 1.0, ["small", "tall"]), shape]
}

pub(crate) const BOARD: FurnitureKind = FurnitureKind::new("board_panel", "board", 8, board)
    .made_of(&[Fabric, Wood, Metal, Plastic, Glass, Paper], styles::CLOTH);
pub(crate) const CLOCK: FurnitureKind = FurnitureKind::new("clock", "", 8, clock)
    .made_of(&[Plastic, Metal, Wood, Ceramic, Glass, Bamboo], styles::CLOTH);

fn board(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.6, 1.3), k.height(0.45, 0.9));
    let p = k.paint;
    let z = [0.0, 0.02];
    let outline = match k.style {
        2 => arch(w, 0.0, h),
        6 => circle([0.0, h / 2.0], h / 2.0, 6),
        7 => oval([0.0, h / 2.0], [w / 2.0, h / 2.0], 14),
        _ => rectangle(w, h, h / 2.0),
    };
    k.model.prism_z(&outline, z, p);
    match k.style {
        0 | 3 => {
            let bar = k.trim;
            k.model.pair([w / 2.0 - 0.025, w / 2.0 + 0.002], [0.0, h], [0.0, 0.03], bar);
            for y in [[0.0, 0.025], [h - 0.025, h]] {
                k.model.lid(about(0.0, w), y, [0.0, 0.03], bar);
            }
        }
        1 => k.model.lid(about(0.0, w * 0.6), [0.0, 0.02], [0.02, 0.07], Paint::STEEL),
        4 => k.model.lid(about(0.0, w), [h - 0.08, h], [0.02, 0.028], p.times(0.8)),
        _ => {}
    }
    let notes = if k.style == 3 { 0 } else { 3 + k.rng.below(3) };
    for _ in 0..notes {
        let (x, y) = (k.rng.range(-0.28, 0.28) * w, k.rng.range(0.3, 0.66) * h);
        let tone = if k.style == 5 {
            p.times(0.7)
        } else if k.dark() {
            p.times(1.7)
        } else {
            Paint::plain("paper", [244, 242, 230])
        };
        k.model.lid(about(x, 0.07), about(y, 0.09), [0.02, 0.023], tone);
    }
    let shape = k.by_style("framed|plain|arched|framed|plain|plain|hexagonal|oval");
    [size_word(w, 0.8, 1.1, ["small", "large"]), shape]
}

fn clock(k: &mut Draft) -> Words {
    let size = k.len(0.22, 0.42);
    let r = size / 2.0;
    let face = match k.paint.brightness() {
        bright if bright > 0.4 => Paint::SCREEN,
        _ if k.dark() => Paint::STEEL.times(0.7),
        _ => Paint::CHROME,
    };
    let outline = match k.style {
        1 => rectangle(size, size, r),
        2 => circle([0.0, r], r, 8),
        3 => circle([0.0, r], r, 6),
        4 => arch(size, 0.0, size * 1.3),
        5 => rectangle(size * 0.8, size * 1.6, size * 0.8),
        6 => oval([0.0, r], [r * 1.3, r], 18),
        _ => circle([0.0, r], r, 20),
    };
    k.model.prism_z(&outline, [0.0, 0.035], k.paint);
    let center = if k.style == 5 { [0.0, size * 1.15] } else { [0.0, r] };
    if k.style == 7 {
        for i in 0..12 {
            let (sin, cos) = angle::sin_cos(i as f32 * std::f32::consts::TAU / 12.0);
            let at = |share: f32| point(sin * r * share, r + cos * r * share, 0.02);
            k.model.rod(at(0.95), at(1.35), 0.01, k.paint);
        }
    }
    for i in 0..12 {
        let (sin, cos) = angle::sin_cos(i as f32 * std::f32::consts::TAU / 12.0);
        let at = [center[0] + sin * r * 0.7, center[1] + cos * r * 0.7];
        k.model.lid(about(at[0], 0.02), about(at[1], 0.02), [0.035, 0.038], face);
    }
    let hand = |k: &mut Draft, turn: f32, length: f32| {
        let (sin, cos) = angle::sin_cos(turn);
        let from = point(center[0], center[1], 0.042);
        let tip = point(center[0] + sin * length, center[1] + cos * length, 0.042);
        k.model.rod(from, tip, 0.007, face);
    };
    let hour = k.rng.range(0.0, std::f32::consts::TAU);
    hand(k, hour, r * 0.4);
    hand(k, hour * 12.0, r * 0.6);
    let shape = k.by_style("round|square|octagonal|hexagonal|arched|upright|oval|star-shaped");
    [size_word(size, 0.28, 0.36, ["small", "large"]), shape]
}

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
