//! Boards and clocks; the lower edge is on y = 0, the back on z = 0.

use super::parts::*;
use super::*;
use Substance::*;

/// A board to write or pin on.
pub(crate) const BOARD: Make = Make {
    category: "board_panel",
    noun: "board",
    styles: 8,
    substances: &[Fabric, Wood, Metal, Plastic, Glass, Paper],
    colors: taste::CLOTH,
    draw: board,
};

/// A clock for a wall.
pub(crate) const CLOCK: Make = Make {
    category: "clock",
    noun: "",
    styles: 8,
    substances: &[Plastic, Metal, Wood, Ceramic, Glass, Bamboo],
    colors: taste::CLOTH,
    draw: clock,
};

fn board(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.6, 1.3), k.height(0.45, 0.9));
    let p = k.p;
    let z = [0.0, 0.02];
    let outline = match k.style {
        2 => arch(w, 0.0, h),
        6 => circle([0.0, h / 2.0], h / 2.0, 6),
        7 => oval([0.0, h / 2.0], [w / 2.0, h / 2.0], 14),
        _ => rectangle(w, h, h / 2.0),
    };
    k.m.prism_z(&outline, z, p);
    match k.style {
        0 | 3 => {
            let bar = k.trim;
            k.m.pair([w / 2.0 - 0.025, w / 2.0 + 0.002], [0.0, h], [0.0, 0.03], bar);
            for y in [[0.0, 0.025], [h - 0.025, h]] {
                k.m.lid(about(0.0, w), y, [0.0, 0.03], bar);
            }
        }
        1 => {
            k.m.lid(about(0.0, w * 0.6), [0.0, 0.02], [0.02, 0.07], Paint::STEEL);
        }
        4 => k.m.lid(about(0.0, w), [h - 0.08, h], [0.02, 0.028], p.times(0.8)),
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
        k.m.lid(about(x, 0.07), about(y, 0.09), [0.02, 0.023], tone);
    }
    let shape = ["framed", "plain", "arched", "framed", "plain", "plain", "hexagonal", "oval"][k.style];
    [size_word(w, 0.8, 1.1, ["small", "large"]), shape]
}

fn clock(k: &mut Draft) -> Words {
    let size = k.len(0.22, 0.42);
    let (r, p) = (size / 2.0, k.p);
    let face = match p.brightness() {
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
    k.m.prism_z(&outline, [0.0, 0.035], p);
    let center = if k.style == 5 { [0.0, size * 1.15] } else { [0.0, r] };
    if k.style == 7 {
        for i in 0..12 {
            let (sin, cos) = angle::sin_cos(i as f32 * std::f32::consts::TAU / 12.0);
            let at = |share: f32| Point3::new(sin * r * share, r + cos * r * share, 0.02);
            k.m.rod(at(0.95), at(1.35), 0.01, p);
        }
    }
    for i in 0..12 {
        let (sin, cos) = angle::sin_cos(i as f32 * std::f32::consts::TAU / 12.0);
        let at = [center[0] + sin * r * 0.7, center[1] + cos * r * 0.7];
        k.m.lid(about(at[0], 0.02), about(at[1], 0.02), [0.035, 0.038], face);
    }
    let hand = |k: &mut Draft, turn: f32, length: f32| {
        let (sin, cos) = angle::sin_cos(turn);
        let from = Point3::new(center[0], center[1], 0.042);
        let tip = Point3::new(center[0] + sin * length, center[1] + cos * length, 0.042);
        k.m.rod(from, tip, 0.007, face);
    };
    let hour = k.rng.range(0.0, std::f32::consts::TAU);
    hand(k, hour, r * 0.4);
    hand(k, hour * 12.0, r * 0.6);
    let shape =
        ["round", "square", "octagonal", "hexagonal", "arched", "upright", "oval", "star-shaped"][k.style];
    [size_word(size, 0.28, 0.36, ["small", "large"]), shape]
}
