//! Stools and benches.

use super::*;

pub(crate) const STOOL: FurnitureKind = FurnitureKind::new("stool", "", 8, stool)
    .made_of(&[Wood, Metal, Plastic, Wicker, Bamboo, Leather, Fabric], styles::WOOD);
pub(crate) const BAR_STOOL: FurnitureKind = FurnitureKind::new("stool", "bar stool", 5, bar_stool)
    .made_of(&[Wood, Leather, Metal, Fabric, Plastic, Velvet], styles::DARK);
pub(crate) const FOOTSTOOL: FurnitureKind = FurnitureKind::new("stool", "footstool", 5, footstool)
    .made_of(&[Fabric, Velvet, Leather, Knit, Corduroy, Quilt, Checked], styles::CLOTH);

/// A bench, pouf or similar seat.
pub(crate) const SEATING: FurnitureKind = FurnitureKind::new("seating", "bench", 8, seating)
    .made_of(&[Wood, Fabric, Leather, Wicker, Velvet, Metal, Striped], styles::WOOD);

fn stool(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.4, 0.5), k.len(0.16, 0.2));
    let size = size_word(h, 0.43, 0.47, ["low", "tall"]);
    let square = |k: &mut Draft, low: f32| k.pad(about(0.0, 1.9 * r), [low, h], about(0.0, 1.9 * r));
    match k.style {
        0 => {
            k.splayed_legs([0.38, 0.38], h - 0.04, 0.022, k.paint);
            k.round_pad(r, [h - 0.05, h], 14, k.paint);
        }
        1 => {
            k.legs([1.9 * r, 1.9 * r], h - 0.05, 0.04, 0.0, k.paint);
            square(k, h - 0.06);
        }
        2 => {
            k.pedestal(r, h - 0.05, Paint::DARK_METAL);
            k.round_pad(r, [h - 0.08, h], 14, k.paint);
        }
        3 => k.turned(&[[0.75, 0.0], [1.0, 0.3], [1.0, 0.7], [0.75, 0.97], [0.7, 1.0]], r + 0.03, h, 16),
        4 => {
            k.crossed_legs([2.0 * r, 2.0 * r], h - 0.04, 0.018, k.trim);
            square(k, h - 0.06);
        }
        5 => {
            k.model.prism_y(&circle([0.0, 0.0], r + 0.02, 6), [h - 0.06, h], k.paint);
            k.splayed_legs([0.36, 0.36], h - 0.05, 0.02, k.trim);
        }
        6 => {
            k.model.pair([r - 0.03, r], [0.0, h - 0.04], about(0.0, 1.6 * r), k.paint);
            k.pad(about(0.0, 2.2 * r), [h - 0.05, h], about(0.0, 1.7 * r));
            k.model.block(about(0.0, 2.0 * r - 0.06), [0.14, 0.17], about(0.0, 0.06), k.paint);
        }
        _ => k.turned(&[[1.0, 0.0], [0.55, 0.5], [1.0, 1.0]], r, h, 16),
    }
    let shape = ["round", "square", "round", "drum-shaped", "folding", "hexagonal", "rectangular", "waisted"]
        [k.style];
    [size, shape]
}

fn bar_stool(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.62, 0.76), 0.18);
    let ring = |k: &mut Draft, paint: Paint| {
        for side in [-1.0, 1.0] {
            let at = |x: f32| point(x, 0.24, side * 0.15);
            k.model.rod(at(-0.15), at(0.15), 0.014, paint);
        }
    };
    match k.style {
        0 => {
            k.splayed_legs([0.4, 0.4], h - 0.04, 0.022, k.paint);
            ring(k, k.paint);
            k.round_pad(r, [h - 0.06, h], 14, k.paint);
        }
        1 => {
            k.legs([0.36, 0.36], h - 0.04, 0.035, 0.0, k.paint);
            ring(k, k.paint);
            k.pad(about(0.0, 0.36), [h - 0.06, h], about(0.0, 0.36));
        }
        2 => {
            k.pedestal(0.21, h - 0.05, Paint::DARK_METAL);
            k.round_pad(r, [h - 0.09, h], 14, k.paint);
        }
        3 => {
            k.sled([0.4, 0.38], h - 0.04, Paint::DARK_METAL);
            k.pad(about(0.0, 0.4), [h - 0.07, h], about(0.0, 0.38));
            k.pad(about(0.0, 0.4), [h, h + 0.24], [-0.19, -0.15]);
        }
        _ => {
            k.splayed_legs([0.42, 0.42], h - 0.04, 0.02, Paint::DARK_METAL);
            k.model.prism_y(&circle([0.0, 0.0], 0.2, 8), [h - 0.06, h], k.paint);
        }
    }
    [size_word(h, 0.66, 0.72, ["low", "tall"]), k.by_style("round|square|round|low-backed|octagonal")]
}

fn footstool(k: &mut Draft) -> Words {
    let (size, h) = (k.len(0.4, 0.62), k.len(0.34, 0.45));
    let r = size / 2.0;
    match k.style {
        0 => {
            k.splayed_legs([size * 0.8, size * 0.8], 0.14, 0.02, k.trim);
            k.round_pad(r, [0.12, h], 16, k.paint);
        }
        1 => {
            k.legs([size, size], 0.12, 0.04, 0.03, k.trim);
            k.model.soft(about(0.0, size), [0.12, h], about(0.0, size), 0.04, k.paint);
        }
        2 => k.turned(&[[0.5, 0.0], [0.92, 0.2], [1.0, 0.5], [0.85, 0.85], [0.4, 1.0]], r, h, 16),
        3 => k.model.soft(about(0.0, size * 1.4), [0.0, h], about(0.0, size * 0.8), 0.05, k.paint),
        _ => {
            k.model.prism_y(&circle([0.0, 0.0], r, 6), [0.06, h], k.paint);
            k.legs([size * 0.7, size * 0.7], 0.06, 0.04, 0.0, k.trim);
        }
    }
    [size_word(size, 0.46, 0.55, ["small", "large"]), k.by_style("round|square|round|rectangular|hexagonal")]
}

fn seating(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.9, 1.45), k.len(0.42, 0.48));
    let d = k.depth(0.36, 0.46);
    match k.style {
        0 => {
            k.legs([w, d], h - 0.04, 0.06, 0.02, k.paint);
            let slat = d / 4.0;
            for i in 0..4 {
                let z = -d / 2.0 + slat * (i as f32 + 0.5);
                k.board(about(0.0, w), [h - 0.04, h], about(z, slat - 0.015));
            }
        }
        1 => {
            k.board(about(0.0, w), [0.0, h - 0.12], about(0.0, d));
            k.model.soft(about(0.0, w), [h - 0.12, h], about(0.0, d), 0.03, k.paint.times(1.03));
            k.noun = "storage bench";
        }
        2 => {
            k.sled([w, d], h - 0.12, Paint::DARK_METAL);
            k.pad(about(0.0, w), [h - 0.14, h], about(0.0, d));
        }
        3 => {
            k.model.soft(about(0.0, w), [0.0, h], about(0.0, d), 0.1, k.paint);
            k.noun = "pouf";
        }
        4 => {
            k.crossed_legs([w - 0.2, d], h - 0.1, 0.025, k.trim);
            k.pad(about(0.0, w), [h - 0.12, h], about(0.0, d));
        }
        5 => {
            k.model.pair([w / 2.0 - 0.05, w / 2.0], [0.0, h], about(0.0, d), k.paint);
            k.pad(about(0.0, w - 0.1), [h - 0.08, h - 0.01], about(0.0, d));
            k.board(about(0.0, w - 0.1), [0.12, 0.15], about(0.0, d - 0.04));
        }
        6 => {
            k.legs([w, d], h - 0.06, 0.05, 0.02, k.trim);
            k.pad(about(0.0, w), [h - 0.1, h], about(0.0, d));
            for side in [-1.0, 1.0] {
                let x = side * (w / 2.0 - 0.05);
                k.model.prism_z(&circle([x, h + 0.05], 0.07, 8), about(0.0, d), k.paint);
            }
        }
        _ => {
            k.model.prism_y(&oval([0.0, 0.0], [w / 2.0, d / 2.0], 16), [h - 0.1, h], k.paint);
            k.splayed_legs([w * 0.8, d * 0.9], h - 0.1, 0.025, k.trim);
        }
    }
    let shape = k.by_style("slatted|box-shaped||rounded|folding|rectangular|scrolled|oval");
    [size_word(w, 1.05, 1.28, ["short", "long"]), shape]
}
