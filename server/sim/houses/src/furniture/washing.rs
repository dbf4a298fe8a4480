//! Washing machines, dryers and dishwashers.

use super::parts::*;
use super::*;
use Substance::*;

/// A machine with a round door.
pub(crate) const WASHER: Make = Make {
    category: "appliances",
    noun: "washing machine",
    styles: 4,
    substances: &[Metal, Plastic, Metal, Ceramic],
    colors: taste::MACHINE,
    draw: washer,
};

fn washer(k: &mut Draft) -> Words {
    let (w, h, d) = (k.len(0.58, 0.68), k.len(0.84, 1.02), 0.6);
    let p = k.p;
    k.m.soft(about(0.0, w), [0.0, h], about(-0.02, d - 0.04), 0.012, p);
    let z = d / 2.0 - 0.04;
    let size = size_word(h, 0.89, 0.97, ["low", "tall"]);
    let ring = |k: &mut Draft, radius: f32, glass: Paint| {
        k.m.prism_z(&circle([0.0, 0.42], radius, 16), [z, z + 0.03], k.metal());
        k.m.prism_z(&circle([0.0, 0.42], radius * 0.78, 14), [z + 0.03, z + 0.04], glass);
    };
    match k.style {
        0 => ring(k, 0.19, Paint::SCREEN),
        1 => {
            k.noun = "dryer";
            ring(k, 0.22, p.times(0.9));
        }
        2 => {
            ring(k, 0.17, Paint::SCREEN);
            k.m.block(about(0.0, w), [h, h + 0.12], [-d / 2.0, -d / 2.0 + 0.08], p);
        }
        _ => {
            k.noun = "dishwasher";
            k.m.lid(about(0.0, w - 0.04), [0.1, h - 0.16], [z, z + 0.02], p.times(1.03));
            k.m.lid(about(0.0, w * 0.7), [h - 0.2, h - 0.18], [z + 0.02, z + 0.045], k.metal());
        }
    }
    k.m.lid([-w / 2.0 + 0.04, -0.06], [h - 0.12, h - 0.05], [z, z + 0.01], Paint::STEEL);
    k.m.lid([0.08, w / 2.0 - 0.05], [h - 0.12, h - 0.05], [z, z + 0.01], Paint::SCREEN);
    [size, ["", "", "high-backed", "plain"][k.style]]
}
