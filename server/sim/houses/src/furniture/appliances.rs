//! Kitchen machines.

use super::counters::COUNTER_M;
use super::parts::*;
use super::*;
use Substance::*;

const CASES: &[Substance] = &[Metal, Plastic, Metal, Ceramic, Glass, Wood];

/// A refrigerator.
pub(crate) const FRIDGE: Make = Make {
    category: "appliances",
    noun: "refrigerator",
    styles: 5,
    substances: CASES,
    colors: taste::MACHINE,
    draw: fridge,
};

/// A cooker with an oven, as high as a counter.
pub(crate) const COOKER: Make = Make {
    category: "appliances",
    noun: "oven",
    styles: 4,
    substances: &[Metal, Metal, Ceramic, Plastic],
    colors: taste::MACHINE,
    draw: cooker,
};

/// A microwave oven, a coffee machine, a kettle or a toaster for a counter.
pub(crate) const SMALL: Make = Make {
    category: "appliances",
    noun: "microwave",
    styles: 5,
    substances: &[Metal, Plastic, Ceramic, Glass, Bamboo],
    colors: taste::MACHINE,
    draw: small,
};

/// A cooker hood; base at y = 0, back at the wall.
pub(crate) const HOOD: Make = Make {
    category: "appliances",
    noun: "range hood",
    styles: 3,
    substances: &[Metal, Glass, Plastic, Wood],
    colors: taste::MACHINE,
    draw: hood,
};

fn fridge(k: &mut Draft) -> Words {
    let (w, d) = (if k.style == 2 { 0.88 } else { k.len(0.6, 0.7) }, 0.62);
    let h = if k.style == 3 { k.len(0.86, 1.2) } else { k.len(1.6, 1.92) };
    let p = k.p;
    let z = [d / 2.0 - 0.03, d / 2.0 + 0.02];
    k.m.block(about(0.0, w), [0.04, h], about(-0.02, d - 0.04), p);
    k.m.block(about(0.0, w - 0.06), [0.0, 0.04], about(0.0, d - 0.1), Paint::DARK_METAL);
    let bevel = if k.style == 4 { 0.045 } else { 0.012 };
    let split = match k.style {
        0 => h * 0.62,
        1 => h * 0.38,
        _ => h,
    };
    let metal = k.metal();
    let mut door = |x: Span, y: Span, handle_x: f32| {
        k.m.soft(x, y, z, bevel, p.times(1.02));
        let grip = [y[0] + (y[1] - y[0]) * 0.3, y[0] + (y[1] - y[0]) * 0.75];
        k.m.lid(about(handle_x, 0.025), grip, [z[1], z[1] + 0.03], metal);
    };
    match k.style {
        2 => {
            door([-w / 2.0, -0.005], [0.06, h], -0.05);
            door([0.005, w / 2.0], [0.06, h], 0.05);
        }
        0 | 1 => {
            door(about(0.0, w), [0.06, split], w / 2.0 - 0.06);
            door(about(0.0, w), [split + 0.015, h], w / 2.0 - 0.06);
        }
        _ => door(about(0.0, w), [0.06, h], w / 2.0 - 0.06),
    }
    let shape = ["", "", "double", "low", "rounded"][k.style];
    [size_word(h, 1.3, 1.74, ["small", "tall"]), shape]
}

fn cooker(k: &mut Draft) -> Words {
    let (p, d) = (k.p, 0.6);
    k.m.block(about(0.0, 0.6), [0.04, COUNTER_M], about(-0.01, d - 0.02), p);
    k.m.block(about(0.0, 0.54), [0.0, 0.04], about(0.0, 0.5), Paint::DARK_METAL);
    let z = d / 2.0 - 0.02;
    let windows: &[Span] = if k.style == 1 { &[[0.12, 0.36], [0.42, 0.66]] } else { &[[0.24, 0.6]] };
    for y in windows {
        k.m.lid(about(0.0, 0.46), *y, [z, z + 0.015], Paint::SCREEN);
        k.m.lid(about(0.0, 0.46), [y[1] + 0.02, y[1] + 0.04], [z, z + 0.05], k.metal());
    }
    for i in 0..4 {
        let x = (i as f32 - 1.5) * 0.12;
        k.m.prism_z(&circle([x, 0.8], 0.024, 6), [z, z + 0.03], Paint::DARK_METAL);
    }
    let plates = [(-0.14, -0.13), (0.14, -0.13), (-0.14, 0.13), (0.14, 0.13)];
    if k.style == 2 {
        k.m.block(about(0.0, 0.58), [COUNTER_M, COUNTER_M + 0.006], about(0.0, 0.52), Paint::SCREEN);
    } else {
        for (x, z) in plates {
            k.m.cylinder([x, z], [COUNTER_M, COUNTER_M + 0.012], 0.09, 8, Paint::DARK_METAL);
        }
    }
    if k.style == 3 {
        k.m.block(about(0.0, 0.6), [COUNTER_M, COUNTER_M + 0.14], [-d / 2.0, -d / 2.0 + 0.04], p);
    }
    ["", ["", "double", "flat-topped", "high-backed"][k.style]]
}

fn small(k: &mut Draft) -> Words {
    let p = k.p;
    match k.style {
        0 | 1 => {
            let (w, h) = (k.len(0.44, 0.54), k.len(0.26, 0.32));
            let bevel = [0.01, 0.04][k.style];
            k.m.soft(about(0.0, w), [0.0, h], about(0.0, 0.34), bevel, p);
            k.m.lid([-w / 2.0 + 0.03, w / 2.0 - 0.13], [0.04, h - 0.04], [0.17, 0.178], Paint::SCREEN);
            k.m.lid(about(w / 2.0 - 0.06, 0.07), [h - 0.1, h - 0.05], [0.17, 0.176], Paint::SCREEN);
            [size_word(w, 0.47, 0.51, ["small", "large"]), ["square", "rounded"][k.style]]
        }
        2 => {
            k.noun = "coffee machine";
            let h = k.len(0.32, 0.4);
            k.m.soft(about(0.0, 0.24), [0.0, 0.06], about(0.0, 0.3), 0.01, p);
            k.m.soft(about(0.0, 0.24), [0.06, h], [-0.15, -0.02], 0.01, p);
            k.m.soft(about(0.0, 0.24), [h - 0.1, h], [-0.02, 0.13], 0.01, p);
            k.m.lathe([0.0, 0.06], &[[0.05, 0.06], [0.06, 0.16], [0.04, 0.18]], 10, Paint::SCREEN);
            [size_word(h, 0.34, 0.38, ["low", "tall"]), ""]
        }
        3 => {
            k.noun = "kettle";
            let h = k.len(0.2, 0.27);
            let profile = [[1.0, 0.0], [1.05, 0.2], [0.7, 0.9], [0.2, 0.97], [0.15, 1.05]];
            k.m.lathe([0.0, 0.0], &profile.map(|[s, y]| [s * 0.09, y * h]), 12, p);
            k.m.rod(Point3::new(0.07, 0.8 * h, 0.0), Point3::new(0.14, 0.95 * h, 0.0), 0.02, p);
            k.m.rod(Point3::new(-0.08, 0.2 * h, 0.0), Point3::new(-0.13, h, 0.0), 0.014, Paint::DARK_METAL);
            ["small", "round"]
        }
        _ => {
            k.noun = "toaster";
            let (w, h) = (k.len(0.26, 0.32), 0.2);
            k.m.soft(about(0.0, w), [0.01, h], about(0.0, 0.18), 0.05, p);
            for z in [-0.035, 0.035] {
                k.m.block(about(0.0, w * 0.7), [h, h + 0.003], about(z, 0.025), Paint::SCREEN);
            }
            k.m.lid(about(0.0, 0.04), [0.12, 0.14], [0.09, 0.115], Paint::DARK_METAL);
            ["small", "rounded"]
        }
    }
}

fn hood(k: &mut Draft) -> Words {
    let (w, p) = (0.6, k.p);
    let h = k.len(0.55, 0.75);
    match k.style {
        0 => {
            k.m.block(about(0.0, w), [0.0, 0.06], about(0.0, 0.46), p);
            k.m.prism_x(&[[-0.23, 0.06], [0.23, 0.06], [0.23, 0.26], [0.0, 0.26]], about(0.0, w * 0.8), p);
            k.m.block(about(0.0, 0.26), [0.26, h], [-0.23, 0.03], p);
            ["", "tapered"]
        }
        1 => {
            k.m.soft(about(0.0, w), [0.0, 0.16], about(0.0, 0.46), 0.02, p);
            k.m.block(about(0.0, 0.24), [0.16, h], [-0.23, 0.01], p);
            k.m.lid(about(0.0, 0.2), [0.05, 0.09], [0.23, 0.236], Paint::SCREEN);
            ["", "square"]
        }
        _ => {
            let cone = [[1.0, 0.0], [1.0, 0.06], [0.4, 0.4], [0.4, 1.0]];
            k.m.lathe([0.0, 0.05], &cone.map(|[s, y]| [s * 0.27, y * h]), 14, p);
            ["", "round"]
        }
    }
}
