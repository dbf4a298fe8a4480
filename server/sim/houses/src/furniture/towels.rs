//! Towels.

use super::parts::*;
use super::*;
use Substance::*;

/// A towel on a rail or hook; lower edge at y = 0.
pub(crate) const TOWEL: Make = Make {
    category: "towel",
    noun: "",
    styles: 8,
    substances: &[Fabric, Wool, Knit, Striped, Checked, Corduroy, Dotted],
    colors: taste::CLOTH,
    draw: towel,
};

/// A pile of folded towels.
pub(crate) const TOWEL_PILE: Make = Make {
    category: "towel",
    noun: "",
    styles: 3,
    substances: &[Fabric, Wool, Knit, Striped, Corduroy],
    colors: taste::CLOTH,
    draw: pile,
};

fn rail(k: &mut Draft, width: f32, y: f32, paint: Paint) {
    let half = width / 2.0 + 0.06;
    k.m.rod(Point3::new(-half, y, 0.038), Point3::new(half, y, 0.038), 0.01, paint);
    k.m.pair([half - 0.02, half], [y - 0.02, y + 0.02], [0.0, 0.05], paint);
}

/// A cloth over a rail: the front hangs lower than the back.
fn cloth(k: &mut Draft, x: Span, y: Span, front: f32) {
    let p = k.p;
    k.m.soft(x, y, [front - 0.03, front], 0.012, p);
    let low = y[0] + (y[1] - y[0]) * 0.25;
    k.m.soft(x, [low, y[1]], [0.012, 0.035], 0.01, p.times(0.94));
}

fn towel(k: &mut Draft) -> Words {
    let (w, h) = (k.len(0.3, 0.55), k.len(0.42, 0.72));
    let p = k.p;
    let shape = match k.style {
        0 => {
            cloth(k, about(0.0, w), [0.0, h], 0.065);
            k.m.lid(about(0.0, w + 0.002), [0.06, 0.09], [0.065, 0.067], p.times(0.85));
            rail(k, w, h - 0.02, k.metal());
            "bordered"
        }
        1 => {
            cloth(k, about(0.0, w), [0.0, h], 0.065);
            rail(k, w, h - 0.02, Paint::DARK_METAL);
            "plain"
        }
        2 => {
            cloth(k, about(-w * 0.27, w * 0.5), [0.0, h], 0.065);
            cloth(k, about(w * 0.27, w * 0.5), [h * 0.2, h], 0.065);
            rail(k, w * 1.05, h - 0.02, k.metal());
            "double"
        }
        3 => {
            let gather = [[0.05, 0.9], [0.12, 0.5], [0.16, 0.0]];
            let profile: Vec<[f32; 2]> = gather.iter().rev().map(|[r, y]| [*r, y * h]).collect();
            k.m.oval([0.0, 0.06], [1.0, 0.36], &profile, 10, p);
            k.m.cylinder([0.0, 0.03], [h * 0.86, h * 0.94], 0.03, 8, k.metal());
            k.m.block(about(0.0, 0.05), [h * 0.86, h * 0.96], [0.0, 0.02], k.metal());
            "gathered"
        }
        4 => {
            cloth(k, about(0.0, w), [0.0, h], 0.065);
            k.m.pair([w / 2.0 - 0.05, w / 2.0 + 0.002], [0.0, h], [0.065, 0.068], p.times(0.82));
            rail(k, w, h - 0.02, Paint::OAK);
            "edged"
        }
        5 => {
            cloth(k, about(0.0, w * 0.8), [0.0, h * 0.7], 0.06);
            k.m.prism_z(&circle([0.0, h * 0.72], 0.09, 10), [0.02, 0.045], k.metal());
            k.m.block(about(0.0, 0.06), [h * 0.76, h * 0.86], [0.0, 0.03], k.metal());
            "ring-hung"
        }
        6 => {
            for i in 0..3 {
                let y = h * (0.1 + 0.34 * i as f32);
                k.m.soft(about(0.0, w * 0.9), [y, y + h * 0.26], [0.03, 0.07], 0.015, p);
                rail(k, w, y + h * 0.25, k.metal());
            }
            "layered"
        }
        _ => {
            cloth(k, about(0.0, w), [0.05, h], 0.065);
            for i in 0..5 {
                k.m.block(about((i as f32 - 2.0) * w * 0.22, w * 0.08), [0.0, 0.05], [0.04, 0.06], p);
            }
            rail(k, w, h - 0.02, Paint::BRASS);
            "fringed"
        }
    };
    [size_word(w * h, 0.17, 0.29, ["small", "large"]), shape]
}

fn pile(k: &mut Draft) -> Words {
    let layers = 2 + k.rng.below(2);
    let p = k.p;
    for layer in 0..layers {
        let y = 0.06 * layer as f32;
        let shade = if layer % 2 == 0 { 1.0 } else { 0.94 };
        match k.style {
            1 => {
                let x = (layer as f32 - (layers - 1) as f32 / 2.0) * 0.13;
                k.m.prism_z(&circle([x, 0.06], 0.06, 10), about(0.0, 0.24), p.times(shade));
            }
            _ => k.m.soft(about(0.0, 0.3), [y, y + 0.06], about(0.0, 0.22), 0.025, p.times(shade)),
        }
    }
    if k.style == 2 {
        k.m.block(about(0.0, 0.04), [0.0, 0.06 * layers as f32 + 0.004], about(0.0, 0.224), p.times(0.8));
    }
    ["small", ["folded", "rolled", "tied"][k.style]]
}
