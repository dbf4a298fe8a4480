//! Tables and desks.

use super::*;

const TOPS: &[Substance] = &[Wood, Glass, Metal, Marble, Plastic, Bamboo, Wicker, Concrete];

pub(crate) const DINING_TABLE: FurnitureKind = FurnitureKind::new("table", "dining table", 8, dining_table)
    .made_of(&[Wood, Wood, Glass, Marble, Metal, Plastic, Bamboo], styles::WOOD);
pub(crate) const COFFEE_TABLE: FurnitureKind =
    FurnitureKind::new("table", "coffee table", 8, coffee_table).made_of(TOPS, styles::WOOD);
pub(crate) const SIDE_TABLE: FurnitureKind =
    FurnitureKind::new("table", "side table", 5, side_table).made_of(TOPS, styles::WOOD);

/// A narrow table for a hallway.
pub(crate) const CONSOLE: FurnitureKind =
    FurnitureKind::new("table", "console table", 4, console).made_of(TOPS, styles::WOOD);
pub(crate) const DESK: FurnitureKind = FurnitureKind::new("table", "desk", 5, desk)
    .made_of(&[Wood, Metal, Glass, Plastic, Bamboo, Leather], styles::WOOD);

/// Returns true for dining tables with chairs all around.
fn is_round(style: usize) -> bool {
    matches!(style, 3 | 4)
}

fn dining_table(k: &mut Draft) -> Words {
    let (w, d, h) = (k.width(1.1, 1.8), k.depth(0.75, 0.95), k.len(0.72, 0.78));
    let round = is_round(k.style) && (w - d).abs() < 0.3;
    let size = size_word(w, 1.1, 1.6, ["small", "large"]);
    if round {
        let r = w.min(d) / 2.0;
        k.round_pad(r, [h - 0.05, h], 20, k.paint);
        let foot = [[0.3, 0.0], [0.27, 0.03], [0.07, 0.1], [0.05, h - 0.04]];
        match k.style {
            3 => k.model.lathe([0.0, 0.0], &foot, 12, k.paint),
            _ => k.splayed_legs([w * 0.75, w * 0.75], h - 0.05, 0.03, k.paint),
        }
        return [size, "round"];
    }
    if is_round(k.style) {
        k.model.prism_y(&oval([0.0, 0.0], [w / 2.0, d / 2.0], 20), [h - 0.04, h], k.paint);
        k.legs([w * 0.66, d * 0.66], h - 0.04, 0.06 + 0.02 * (k.style - 3) as f32, 0.0, k.paint);
        return [size, "oval"];
    }
    k.model.soft(about(0.0, w), [h - 0.04, h], about(0.0, d), 0.008, k.paint);
    match k.style {
        0 => {
            k.board(about(0.0, w - 0.16), [h - 0.12, h - 0.04], about(0.0, d - 0.16));
            k.legs([w, d], h - 0.04, 0.07, 0.03, k.paint);
        }
        1 => k.splayed_legs([w - 0.08, d - 0.08], h - 0.04, 0.035, k.paint),
        2 => trestle(k, [w, d], h - 0.04),
        5 => k.crossed_legs([w - 0.2, d - 0.1], h - 0.04, 0.03, k.trim),
        6 => {
            k.model.pair([w / 2.0 - 0.3, w / 2.0 - 0.22], [0.0, h - 0.04], about(0.0, d * 0.6), k.paint);
            k.board(about(0.0, w - 0.6), [0.3, 0.36], about(0.0, 0.08));
        }
        _ => k.sled([w - 0.1, d - 0.1], h - 0.04, Paint::DARK_METAL),
    }
    [size, if w - d < 0.12 { "square" } else { "rectangular" }]
}

fn trestle(k: &mut Draft, [w, d]: [f32; 2], height: f32) {
    let x = [w / 2.0 - 0.3, w / 2.0 - 0.22];
    k.model.pair(x, [0.0, 0.06], about(0.0, d - 0.1), k.paint);
    k.model.pair(x, [0.06, height], about(0.0, 0.16), k.paint);
    k.board(about(0.0, w - 0.5), [0.2, 0.3], about(0.0, 0.05));
}

fn coffee_table(k: &mut Draft) -> Words {
    let (w, d, h) = (k.width(0.8, 1.2), k.len(0.5, 0.68), k.len(0.36, 0.46));
    let top = |k: &mut Draft, low: f32| k.model.soft(about(0.0, w), [low, h], about(0.0, d), 0.008, k.paint);
    let r = d * 0.6;
    match k.style {
        0 => {
            top(k, h - 0.04);
            k.board(about(0.0, w - 0.1), [0.12, 0.14], about(0.0, d - 0.1));
            k.legs([w, d], h - 0.04, 0.05, 0.01, k.paint);
        }
        1 => {
            k.round_pad(r, [h - 0.05, h], 20, k.paint);
            k.splayed_legs([r * 1.7, r * 1.7], h - 0.04, 0.02, k.trim);
        }
        2 => {
            top(k, h - 0.12);
            k.model.pair([w / 2.0 - 0.06, w / 2.0], [0.0, h - 0.12], about(0.0, d), k.paint);
        }
        3 => {
            k.model.prism_y(&oval([0.0, 0.0], [w / 2.0, d / 2.0], 20), [h - 0.04, h], k.paint);
            k.legs([w * 0.62, d * 0.7], h - 0.04, 0.04, 0.0, k.trim);
        }
        4 => {
            k.model.soft(about(0.0, w), [0.0, h], about(0.0, d), 0.02, k.paint);
            k.noun = "chest table";
        }
        5 => {
            k.model.prism_y(&circle([0.0, 0.0], r, 6), [h - 0.05, h], k.paint);
            k.crossed_legs([r, r], h - 0.05, 0.02, Paint::DARK_METAL);
        }
        6 => k.turned(&[[0.9, 0.0], [1.0, 0.4], [1.0, 0.8], [0.95, 1.0]], r, h, 18),
        _ => {
            k.model.soft(about(0.0, d * 1.2), [h - 0.05, h], about(0.0, d * 1.2), 0.01, k.paint);
            k.sled([d, d], h - 0.05, Paint::DARK_METAL);
        }
    }
    let shape =
        ["rectangular", "round", "rectangular", "oval", "box-shaped", "hexagonal", "drum-shaped", "square"]
            [k.style];
    [size_word(w, 0.92, 1.08, ["small", "large"]), shape]
}

fn side_table(k: &mut Draft) -> Words {
    let (size, h) = (k.len(0.38, 0.52), k.len(0.48, 0.64));
    let r = size / 2.0;
    match k.style {
        0 => {
            k.round_pad(r, [h - 0.03, h], 16, k.paint);
            k.pedestal(r * 0.7, h - 0.02, k.trim);
        }
        1 => {
            k.model.soft(about(0.0, size), [h - 0.03, h], about(0.0, size), 0.006, k.paint);
            k.board(about(0.0, size - 0.06), [0.16, 0.18], about(0.0, size - 0.06));
            k.legs([size, size], h - 0.03, 0.04, 0.0, k.paint);
        }
        2 => {
            k.round_pad(r, [h - 0.04, h], 16, k.paint);
            k.splayed_legs([size * 0.9, size * 0.9], h - 0.04, 0.016, k.paint);
        }
        3 => {
            k.model.prism_y(&circle([0.0, 0.0], r, 8), [h - 0.03, h], k.paint);
            k.crossed_legs([r, r], h - 0.03, 0.016, k.trim);
        }
        _ => k.model.soft(about(0.0, size), [0.0, h], about(0.0, size), 0.012, k.paint),
    }
    [size_word(h, 0.53, 0.6, ["low", "tall"]), k.by_style("round|square|round|octagonal|cube-shaped")]
}

fn console(k: &mut Draft) -> Words {
    let (w, d, h) = (k.width(0.8, 1.25), k.depth(0.26, 0.36), k.len(0.74, 0.86));
    match k.style {
        3 => k.model.prism_y(&oval([0.0, 0.0], [w / 2.0, d / 2.0], 18), [h - 0.04, h], k.paint),
        _ => k.model.soft(about(0.0, w), [h - 0.04, h], about(0.0, d), 0.006, k.paint),
    }
    match k.style {
        0 => {
            k.legs([w, d], h - 0.04, 0.045, 0.0, k.paint);
            k.board(about(0.0, w - 0.04), [0.18, 0.21], about(0.0, d - 0.04));
        }
        1 => {
            k.legs([w, d], h - 0.04, 0.04, 0.0, k.paint);
            k.board(about(0.0, w - 0.06), [h - 0.16, h - 0.04], about(0.0, d - 0.03));
            let looks = Fronts { panel: k.paint.times(1.04), handle: Paint::BRASS, doors: false };
            fronts(&mut k.model, about(0.0, w - 0.1), [h - 0.15, h - 0.05], d / 2.0 - 0.015, [2, 1], &looks);
        }
        2 => k.sled([w - 0.04, d], h - 0.04, Paint::DARK_METAL),
        _ => k.splayed_legs([w * 0.8, d], h - 0.04, 0.02, k.trim),
    }
    [size_word(w, 0.9, 1.1, ["small", "long"]), if k.style == 3 { "oval" } else { "narrow" }]
}

fn desk(k: &mut Draft) -> Words {
    let (w, d, h) = (k.width(1.1, 1.55), k.depth(0.56, 0.7), k.len(0.72, 0.76));
    k.model.soft(about(0.0, w), [h - 0.035, h], about(0.0, d), 0.006, k.paint);
    let back = [-d / 2.0 + 0.02, -d / 2.0 + 0.04];
    let side = if k.rng.chance(0.5) { 1.0 } else { -1.0 };
    let drawers = |k: &mut Draft, side: f32| {
        let x = about(side * (w / 2.0 - 0.2), 0.38);
        k.board(x, [0.05, h - 0.035], [-d / 2.0 + 0.02, d / 2.0 - 0.04]);
        let looks = Fronts { panel: k.paint.times(1.05), handle: Paint::STEEL, doors: false };
        fronts(&mut k.model, x, [0.06, h - 0.04], d / 2.0 - 0.04, [1, 3], &looks);
    };
    match k.style {
        0 => {
            drawers(k, side);
            k.board(about(-side * (w / 2.0 - 0.03), 0.05), [0.0, h - 0.035], about(0.0, d - 0.06));
            k.board(about(0.0, w - 0.1), [h - 0.3, h - 0.035], back);
        }
        1 => {
            drawers(k, 1.0);
            drawers(k, -1.0);
        }
        2 => {
            k.crossed_legs([w - 0.2, d - 0.06], h - 0.035, 0.025, k.trim);
            k.board(about(0.0, w - 0.3), [h - 0.14, h - 0.035], about(0.0, d - 0.16));
        }
        3 => {
            k.sled([w - 0.06, d - 0.04], h - 0.035, Paint::DARK_METAL);
            k.board(about(0.0, w - 0.1), [h - 0.24, h - 0.035], back);
        }
        _ => {
            k.model.pair([w / 2.0 - 0.05, w / 2.0], [0.0, h - 0.035], about(0.0, d), k.paint);
            k.board(about(0.0, w - 0.1), [0.3, h - 0.035], back);
        }
    }
    [size_word(w, 1.22, 1.42, ["small", "large"]), "rectangular"]
}
