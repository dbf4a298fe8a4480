//! Clothes.

use super::*;
use Substance::*;

const CLOTHS: &[Substance] = &[Fabric, Denim, Knit, Checked, Striped, Leather, Velvet, Dotted];

/// Clothing on a hook; hem at y = 0.
pub(crate) const HANGING: Make = Make {
    category: "clothes",
    noun: "coat",
    styles: 8,
    substances: CLOTHS,
    colors: taste::CLOTH,
    draw: hanging,
};

/// Folded or heaped clothes.
pub(crate) const FOLDED: Make =
    Make { category: "clothes", noun: "", styles: 4, substances: CLOTHS, colors: taste::CLOTH, draw: folded };

/// A body as an oval with shoulders, from the hem to `length`.
fn body(k: &mut Draft, length: f32, hem: f32, waist: f32) {
    let profile = [[hem, 0.0], [waist, length * 0.55], [0.21, length - 0.1], [0.07, length]];
    k.m.oval([0.0, 0.08], [1.0, 0.34], &profile, 12, k.p);
}

fn sleeves(k: &mut Draft, length: f32, share: f32) {
    for side in [-1.0, 1.0] {
        let shoulder = Point3::new(side * 0.19, length - 0.1, 0.08);
        let cuff = Point3::new(side * 0.27, length - 0.1 - share, 0.09);
        k.m.rod(shoulder, cuff, 0.045, k.p.times(0.95));
    }
}

fn hanging(k: &mut Draft) -> Words {
    let p = k.p;
    let words: ([&str; 2], f32) = match k.style {
        0 => {
            let l = k.len(0.85, 1.05);
            body(k, l, 0.24, 0.2);
            sleeves(k, l, 0.52);
            k.m.block(about(0.0, 0.012), [0.06, l - 0.06], [0.145, 0.165], p.times(0.75));
            (["", "long-sleeved"], l)
        }
        1 => {
            k.noun = "jacket";
            let l = k.len(0.62, 0.74);
            body(k, l, 0.2, 0.19);
            sleeves(k, l, 0.48);
            k.m.block(about(0.0, 0.36), [0.0, 0.06], [0.03, 0.13], p.times(0.85));
            (["", "long-sleeved"], l)
        }
        2 => {
            k.noun = "dress";
            let l = k.len(0.95, 1.15);
            body(k, l, 0.3, 0.13);
            (["", "sleeveless"], l)
        }
        3 => {
            k.noun = "bathrobe";
            let l = k.len(0.95, 1.15);
            body(k, l, 0.23, 0.2);
            sleeves(k, l, 0.44);
            k.m.block(about(0.0, 0.4), [l * 0.5, l * 0.55], [0.005, 0.155], p.times(0.85));
            (["", "belted"], l)
        }
        4 => {
            k.noun = "shirt";
            let l = k.len(0.6, 0.72);
            body(k, l, 0.19, 0.19);
            sleeves(k, l, 0.2);
            (["", "short-sleeved"], l)
        }
        5 => {
            k.noun = "trousers";
            let l = k.len(0.85, 1.02);
            for side in [-1.0, 1.0] {
                let leg = [[0.07, 0.0], [0.08, l * 0.6], [0.1, l - 0.05]];
                k.m.oval([side * 0.085, 0.06], [1.0, 0.5], &leg, 8, p);
            }
            k.m.soft(about(0.0, 0.36), [l - 0.12, l], [0.01, 0.11], 0.02, p.times(0.97));
            (["", "two-legged"], l)
        }
        6 => {
            k.noun = "scarf";
            let l = k.len(0.75, 0.95);
            k.m.soft(about(-0.06, 0.14), [0.0, l], [0.02, 0.06], 0.015, p);
            k.m.soft(about(0.07, 0.14), [l * 0.25, l], [0.03, 0.07], 0.015, p.times(0.96));
            (["", "narrow"], l)
        }
        _ => {
            k.noun = "hat";
            let cone = [[0.2, 0.1], [0.2, 0.12], [0.11, 0.13], [0.1, 0.26], [0.04, 0.28]];
            k.m.lathe([0.0, 0.21], &cone, 14, p);
            k.m.rod(Point3::new(0.0, 0.18, 0.0), Point3::new(0.0, 0.2, 0.2), 0.015, Paint::WALNUT);
            (["", "brimmed"], 0.24)
        }
    };
    let ([_, shape], l) = words;
    k.m.block(about(0.0, 0.3), [l + 0.02, l + 0.08], [0.0, 0.02], Paint::WALNUT);
    k.m.rod(Point3::new(0.0, l - 0.02, 0.06), Point3::new(0.0, l + 0.05, 0.015), 0.012, Paint::STEEL);
    [size_word(l, 0.66, 0.98, ["short", "long"]), shape]
}

fn folded(k: &mut Draft) -> Words {
    let p = k.p;
    match k.style {
        0 | 1 => {
            let layers = 2 + k.rng.below(3);
            for layer in 0..layers {
                let y = 0.05 * layer as f32;
                let shade = if layer % 2 == 0 { 1.0 } else { 0.93 };
                let (x, z) = (k.rng.range(-0.02, 0.02), k.rng.range(-0.02, 0.02));
                let size = [0.36, 0.26][k.style];
                k.m.soft(about(x, size), [y, y + 0.05], about(z, 0.27), 0.018, p.times(shade));
            }
            [["large", "small"][k.style], "folded"]
        }
        2 => {
            let heap = [[0.24, 0.0], [0.22, 0.07], [0.12, 0.15], [0.0, 0.17]];
            k.m.oval([0.0, 0.0], [1.0, 0.8], &heap, 10, p);
            k.m.oval([0.1, 0.05], [1.0, 0.7], &[[0.12, 0.0], [0.11, 0.13], [0.0, 0.2]], 8, p.times(0.94));
            ["", "heaped"]
        }
        _ => {
            k.m.soft(about(0.0, 0.34), [0.0, 0.04], about(0.0, 0.44), 0.018, p);
            for side in [-1.0, 1.0] {
                k.m.soft(about(side * 0.2, 0.1), [0.0, 0.035], [-0.2, 0.12], 0.015, p.times(0.96));
            }
            ["", "spread"]
        }
    }
}
