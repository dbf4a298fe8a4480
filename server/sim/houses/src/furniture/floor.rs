//! Rugs.

use super::parts::*;
use super::*;
use Substance::*;

/// A rug of the wished width and depth.
pub(crate) const RUG: Make = Make {
    category: "rug",
    noun: "",
    styles: 8,
    substances: &[Wool, Fabric, Knit, Striped, Checked, Dotted, Denim, Wicker],
    colors: &[
        "red", "blue", "grey", "brown", "green", "teal", "purple", "orange", "pink", "yellow", "black",
        "white",
    ],
    draw: rug,
};

fn rug(k: &mut Draft) -> Words {
    let (w, d) = (k.width(0.8, 2.2), k.depth(0.5, 1.6));
    let p = k.p;
    let size = size_word(w * d, 0.9, 2.4, ["small", "large"]);
    let r = w.min(d) / 2.0;
    let low = [0.0, 0.01];
    let shape = match k.style {
        0 => {
            k.m.block(about(0.0, w), low, about(0.0, d), p.times(0.93));
            k.m.block(about(0.0, w - 0.2), [0.01, 0.014], about(0.0, d - 0.2), p);
            "bordered"
        }
        1 => {
            k.m.prism_y(&circle([0.0, 0.0], r, 22), [0.0, 0.012], p);
            "round"
        }
        2 => {
            k.m.prism_y(&oval([0.0, 0.0], [w / 2.0, d / 2.0], 22), [0.0, 0.012], p);
            "oval"
        }
        3 => {
            k.m.block(about(0.0, w - 0.12), low, about(0.0, d), p);
            for i in 0..10 {
                let z = (i as f32 - 4.5) * d * 0.1;
                k.m.pair([w / 2.0 - 0.06, w / 2.0], [0.0, 0.006], about(z, d * 0.04), Paint::LINEN);
            }
            "fringed"
        }
        4 => {
            k.m.block(about(0.0, w), low, about(0.0, d), p);
            for x in [-0.3, 0.0, 0.3] {
                k.m.block(about(x * w, w * 0.06), [0.01, 0.013], about(0.0, d - 0.08), p.times(0.8));
            }
            "banded"
        }
        5 => {
            k.m.soft(about(0.0, w), [0.0, 0.03], about(0.0, d), 0.012, p);
            "shaggy"
        }
        6 => {
            k.m.prism_y(&circle([0.0, 0.0], r, 8), [0.0, 0.012], p);
            k.m.prism_y(&circle([0.0, 0.0], r * 0.6, 8), [0.012, 0.015], p.times(0.9));
            "octagonal"
        }
        _ => {
            k.m.block(about(0.0, w), low, about(0.0, d), p);
            let diamond = [[0.0, -0.4], [0.4, 0.0], [0.0, 0.4], [-0.4, 0.0]].map(|[x, z]| [x * w, z * d]);
            k.m.prism_y(&diamond, [0.01, 0.014], p.times(0.84));
            "diamond-patterned"
        }
    };
    [size, shape]
}
