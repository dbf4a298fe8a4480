//! Wash basins and kitchen sinks.

use super::counters::HOLE_M;
use super::parts::*;
use super::*;
use Substance::*;

const BOWLS: &[Substance] = &[Ceramic, Ceramic, Marble, Metal, Glass, Concrete, Wood];

/// A wash basin on a pedestal.
pub(crate) const PEDESTAL_SINK: Make = Make {
    category: "sink",
    noun: "",
    styles: 5,
    substances: BOWLS,
    colors: taste::SANITARY,
    draw: pedestal_sink,
};

/// A basin on top of a cabinet.
pub(crate) const VESSEL_SINK: Make = Make {
    category: "sink",
    noun: "",
    styles: 5,
    substances: BOWLS,
    colors: taste::SANITARY,
    draw: vessel_sink,
};

/// A sink for the hole of a counter; y = 0 is the top of the counter.
pub(crate) const KITCHEN_SINK: Make = Make {
    category: "sink",
    noun: "kitchen sink",
    styles: 3,
    substances: &[Metal, Metal, Ceramic, Concrete, Marble],
    colors: taste::MACHINE,
    draw: kitchen_sink,
};

fn pedestal_sink(k: &mut Draft) -> Words {
    let p = k.p;
    let (w, h) = (k.len(0.5, 0.66), 0.84);
    let size = size_word(w, 0.55, 0.61, ["small", "wide"]);
    let back = -0.06;
    let metal = k.metal();
    match k.style {
        0 | 1 => k.m.lathe([0.0, back], &[[0.13, 0.0], [0.09, 0.1], [0.08, 0.55], [0.14, 0.68]], 12, p),
        2 => k.m.block(about(0.0, 0.26), [0.0, 0.68], about(back, 0.22), p),
        3 => legs(&mut k.m, [w - 0.04, 0.4], 0.68, 0.03, 0.02, metal),
        _ => k.m.lathe([0.0, back], &[[0.2, 0.0], [0.16, 0.3], [0.2, 0.68]], 14, p),
    }
    let round = matches!(k.style, 0 | 4);
    basin(k, [w, 0.46], [0.66, h], round);
    [size, ["round", "square", "square", "square", "round"][k.style]]
}

fn vessel_sink(k: &mut Draft) -> Words {
    let (w, h) = (k.len(0.4, 0.54), k.len(0.12, 0.17));
    let size = size_word(w, 0.44, 0.5, ["small", "wide"]);
    match k.style {
        0 => basin(k, [w, 0.4], [0.0, h], true),
        1 => basin(k, [w, 0.4], [0.0, h], false),
        2 => basin(k, [0.38, 0.38], [0.0, h], true),
        3 => basin(k, [w + 0.08, 0.36], [0.0, 0.1], false),
        _ => {
            let p = k.p;
            let bowl = [[0.45, 0.0], [1.0, 1.0], [0.92, 1.0], [0.3, 0.25], [0.0, 0.2]];
            k.m.lathe([0.0, 0.02], &bowl.map(|[s, y]| [s * 0.19, y * h]), 16, p);
            tap(k, [0.0, -0.19], h);
        }
    }
    [size, ["oval", "square", "round", "rectangular", "conical"][k.style]]
}

/// A hollow basin between two heights, with a tap at the back.
fn basin(k: &mut Draft, [w, d]: [f32; 2], [low, high]: Span, round: bool) {
    let p = k.p;
    let m = &mut k.m;
    if round {
        let r = d / 2.0;
        let middle = (low + high) / 2.0;
        let floor = high - (high - low).min(0.1) * 0.9;
        let profile =
            [[0.6, low], [0.95, middle], [1.0, high], [0.88, high], [0.7, floor + 0.01], [0.0, floor]];
        m.oval([0.0, 0.0], [w / d, 1.0], &profile.map(|[s, y]| [s * r, y]), 16, p);
    } else {
        let floor = high - (high - low).min(0.1) * 0.8;
        m.block(about(0.0, w), [low, floor], about(0.0, d), p);
        m.pair([w / 2.0 - 0.03, w / 2.0], [floor, high], about(0.0, d), p);
        m.block(about(0.0, w - 0.06), [floor, high], [d / 2.0 - 0.03, d / 2.0], p);
        m.block(about(0.0, w - 0.06), [floor, high], [-d / 2.0, -d / 2.0 + 0.09], p);
    }
    tap(k, [0.0, -d / 2.0 + 0.04], high);
}

/// A tap that leans over towards +z.
fn tap(k: &mut Draft, [x, z]: [f32; 2], base: f32) {
    let metal = k.metal();
    let m = &mut k.m;
    m.cylinder([x, z], [base - 0.02, base + 0.14], 0.016, 8, metal);
    m.rod(Point3::new(x, base + 0.13, z), Point3::new(x, base + 0.11, z + 0.13), 0.014, metal);
    m.block(about(x, 0.09), [base + 0.02, base + 0.04], about(z, 0.02), metal);
}

fn kitchen_sink(k: &mut Draft) -> Words {
    let p = k.p;
    let [x, z] = HOLE_M;
    let m = &mut k.m;
    m.block(about(0.0, 2.0 * x), [-0.17, -0.15], about(0.0, 2.0 * z), p);
    m.pair([x - 0.012, x], [-0.15, 0.01], about(0.0, 2.0 * z), p);
    m.block(about(0.0, 2.0 * x), [-0.15, 0.01], [z - 0.012, z], p);
    m.block(about(0.0, 2.0 * x), [-0.15, 0.01], [-z, -z + 0.012], p);
    let rim = if k.style == 1 { 0.03 } else { 0.012 };
    m.pair([x, x + 0.03], [0.0, rim], about(0.0, 2.0 * z + 0.06), p);
    m.block(about(0.0, 2.0 * x), [0.0, rim], [z, z + 0.03], p);
    m.block(about(0.0, 2.0 * x), [0.0, rim], [-z - 0.06, -z], p);
    if k.style == 2 {
        m.block(about(0.0, 0.02), [-0.15, 0.0], about(0.0, 2.0 * z), p);
    }
    tap(k, [0.0, -z - 0.03], 0.03);
    ["", ["rectangular", "rectangular", "double"][k.style]]
}
