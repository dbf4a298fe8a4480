//! Curtains and blinds; the lower edge is on y = 0, the back on z = 0.

use super::*;
use Substance::*;

/// Half of a pair of curtains of a given width and height.
pub(crate) const CURTAIN: Make = Make {
    category: "curtain",
    noun: "",
    styles: 8,
    substances: &[Fabric, Velvet, Striped, Checked, Dotted, Knit, Corduroy],
    colors: taste::CLOTH,
    draw: curtain,
};

/// A blind over the upper part of a window.
pub(crate) const BLIND: Make = Make {
    category: "blinds",
    noun: "",
    styles: 8,
    substances: &[Fabric, Wood, Bamboo, Metal, Plastic, Paper, Striped],
    colors: &[
        "white", "brown", "grey", "blue", "green", "teal", "yellow", "red", "black", "orange", "pink",
        "purple",
    ],
    draw: blind,
};

/// A wavy sheet between two heights; `width_at` returns the width at a relative height.
fn folds(k: &mut Draft, count: usize, [low, high]: Span, width_at: impl Fn(f32) -> f32) {
    const ROWS: usize = 2;
    let point = |i: usize, row: usize| {
        let share = row as f32 / ROWS as f32;
        let x = width_at(share) * (i as f32 / count as f32 - 0.5);
        let z = if i.is_multiple_of(2) { 0.03 } else { 0.08 };
        Point3::new(x, low + share * (high - low), z)
    };
    for i in 0..count {
        for row in 0..ROWS {
            let corners = [point(i, row), point(i + 1, row), point(i + 1, row + 1), point(i, row + 1)];
            k.m.quad(corners, k.p);
        }
    }
}

fn curtain(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.24, 0.5), k.height(1.0, 2.2));
    let rod = k.trim;
    k.m.block(about(0.0, w + 0.04), [h, h + 0.025], [0.0, 0.06], rod);
    let p = k.p;
    let span = [0.0, h];
    let shape = match k.style {
        0 => {
            folds(k, 8, span, |_| w);
            "straight"
        }
        1 => {
            folds(k, 8, span, |share| w * if share == 0.5 { 0.5 } else { 1.0 });
            k.m.block(about(0.0, w * 0.56), about(h * 0.5, 0.05), [0.02, 0.09], p.times(0.8));
            "tied"
        }
        2 => {
            folds(k, 6, span, |_| w);
            k.m.block(about(0.0, w), [0.0, 0.08], [0.025, 0.085], p.times(0.85));
            "hemmed"
        }
        3 => {
            folds(k, 12, span, |_| w);
            "pleated"
        }
        4 => {
            folds(k, 8, span, |share| w * (1.1 - 0.3 * share));
            "flared"
        }
        5 => {
            folds(k, 8, span, |_| w);
            k.m.block(about(0.0, w + 0.04), [h - 0.14, h], [0.08, 0.1], p.times(0.9));
            "valanced"
        }
        6 => {
            folds(k, 4, span, |_| w);
            "loose"
        }
        _ => {
            folds(k, 8, [0.0, h * 0.45], |_| w);
            folds(k, 8, [h * 0.5, h], |_| w);
            "two-tiered"
        }
    };
    [size_word(h, 1.25, 1.9, ["short", "long"]), shape]
}

fn blind(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.6, 1.6), k.height(0.3, 0.9));
    let p = k.p;
    k.m.block(about(0.0, w), [h - 0.05, h], [0.0, 0.06], p.times(0.95));
    let slats = |k: &mut Draft, count: usize| {
        for i in 0..count {
            let y = (h - 0.06) * i as f32 / count as f32;
            k.m.block(about(0.0, w - 0.02), [y, y + (h - 0.06) / count as f32 * 0.8], [0.015, 0.03], p);
        }
    };
    let shape = match k.style {
        0 => {
            slats(k, 10);
            "slatted"
        }
        1 => {
            slats(k, 5);
            "slatted"
        }
        2 => {
            k.m.block(about(0.0, w - 0.02), [0.0, h - 0.05], [0.02, 0.03], p);
            k.m.block(about(0.0, w), [0.0, 0.03], [0.015, 0.04], p.times(0.85));
            "rolled"
        }
        3 => {
            for i in 0..4 {
                let y = (h - 0.05) * i as f32 / 4.0;
                k.m.soft(about(0.0, w - 0.02), [y, y + (h - 0.05) / 4.0], [0.012, 0.05], 0.015, p);
            }
            "folded"
        }
        4 => {
            for i in 0..8 {
                let x = ((i as f32 + 0.5) / 8.0 - 0.5) * w;
                k.m.block(about(x, w / 9.0), [0.0, h - 0.05], [0.015, 0.025], p);
            }
            "vertical"
        }
        5 => {
            slats(k, 14);
            "pleated"
        }
        6 => {
            k.m.pair([w * 0.02, w / 2.0], [0.0, h - 0.05], [0.012, 0.03], p);
            for i in 0..4 {
                let y = 0.04 + (h - 0.13) * i as f32 / 4.0;
                k.m.pair([w * 0.06, w * 0.46], [y, y + (h - 0.13) / 5.0], [0.03, 0.04], p.times(0.93));
            }
            "shuttered"
        }
        _ => {
            k.m.block(about(0.0, w - 0.02), [0.08, h - 0.05], [0.015, 0.025], p);
            for i in 0..6 {
                let x = ((i as f32 + 0.5) / 6.0 - 0.5) * w;
                k.m.prism_z(&[[x - w / 13.0, 0.08], [x, 0.0], [x + w / 13.0, 0.08]], [0.015, 0.025], p);
            }
            "scalloped"
        }
    };
    [size_word(w, 0.8, 1.2, ["narrow", "wide"]), shape]
}
