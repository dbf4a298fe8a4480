//! Kitchen counters, kitchen appliances and washing machines.

use super::*;

/// Counter height, metres.
pub(crate) const COUNTER_M: f32 = 0.9;

/// Counter depth, metres.
pub(crate) const COUNTER_DEPTH_M: f32 = 0.62;

const FACES: &[Substance] = &[Wood, Wood, Plastic, Metal, Bamboo, Concrete, Marble];

/// A counter; depth 1 requests a sink cut-out.
pub(crate) const COUNTER: FurnitureKind =
    FurnitureKind::new("counter", "", 8, counter).made_of(FACES, styles::WOOD);
pub(crate) const ISLAND: FurnitureKind =
    FurnitureKind::new("counter", "kitchen island", 5, island).made_of(FACES, styles::WOOD);

/// Draws a stone or wood top.
fn worktop(k: &mut Draft) -> Paint {
    const TOPS: [Paint; 6] = [
        Paint::plain("stone", [150, 148, 142]).with(Pattern::Marble),
        Paint::plain("stone", [70, 70, 74]).with(Pattern::Marble),
        Paint::plain("stone", [124, 118, 110]).with(Pattern::Concrete),
        Paint::plain("stone", [140, 130, 118]).with(Pattern::Terrazzo),
        Paint::OAK,
        Paint::plain("metal", [120, 123, 127]).with(Pattern::Brushed),
    ];
    let top = *k.rng.choose(&TOPS).expect("the list is not empty");
    if k.paint.brightness() < 0.5 { top.times(0.6) } else { top }
}

fn counter(k: &mut Draft) -> Words {
    let (w, depth) = (k.width(0.8, 2.2), COUNTER_DEPTH_M - 0.04);
    let (p, top) = (k.paint, worktop(k));
    let size = size_word(w, 1.0, 1.8, ["short", "long"]);
    k.model.block(about(0.0, w), [0.1, COUNTER_M - 0.2], about(0.0, depth), p);
    k.model.block(about(0.0, w - 0.02), [0.0, 0.1], about(-0.03, depth - 0.06), p.times(0.7));
    let upper = [COUNTER_M - 0.2, COUNTER_M - 0.04];
    k.model.block(about(0.0, w), upper, [depth / 2.0 - 0.02, depth / 2.0], p);
    k.model.pair([w / 2.0 - 0.02, w / 2.0], upper, about(-0.01, depth - 0.02), p);
    let columns = ((w / 0.55).round() as usize).clamp(1, 4);
    let columns = if matches!(k.style, 3 | 5 | 7) { columns % 4 + 1 } else { columns };
    let rows = [1, 3, 2, 1, 1, 2, 1, 3][k.style];
    let handle = if k.style == 3 { p.times(0.8) } else { handle(k) };
    let looks = Fronts { panel: p.times(1.04), handle, doors: rows == 1 };
    let face = [0.12, COUNTER_M - 0.05];
    match k.style {
        4 => {
            fronts(&mut k.model, about(0.0, w), [0.12, 0.66], depth / 2.0, [columns, 1], &looks);
            let drawers = Fronts { doors: false, ..looks };
            let y = [0.67, COUNTER_M - 0.05];
            fronts(&mut k.model, about(0.0, w), y, depth / 2.0, [columns, 1], &drawers);
        }
        6 => {
            k.model.lid(about(0.0, w - 0.02), face, [depth / 2.0, depth / 2.0 + 0.012], p.times(0.97));
            let strip = [COUNTER_M - 0.09, COUNTER_M - 0.07];
            k.model.lid(about(0.0, w - 0.04), strip, [depth / 2.0 + 0.012, depth / 2.0 + 0.03], handle);
        }
        _ => fronts(&mut k.model, about(0.0, w), face, depth / 2.0, [columns, rows], &looks),
    }
    let (y, z) = ([COUNTER_M - 0.04, COUNTER_M], about(0.01, COUNTER_DEPTH_M));
    if k.wish[2] > 0.0 {
        holed_top(&mut k.model, w, y, z, top);
    } else {
        k.model.slab(about(0.0, w), y, z, top);
    }
    [size, k.by_style("|drawered|drawered||panelled|drawered|plain|drawered")]
}

/// Half the sink hole, x and z.
pub(super) const HOLE_M: [f32; 2] = [0.26, 0.19];

fn holed_top(m: &mut Model, w: f32, y: Span, z: Span, top: Paint) {
    // Four slabs around the hole; the sink is a separate object.
    let (left, right) = (-HOLE_M[0], HOLE_M[0]);
    m.slab([-w / 2.0, left], y, z, top);
    m.slab([right, w / 2.0], y, z, top);
    m.slab([left, right], y, [z[0], -HOLE_M[1]], top);
    m.slab([left, right], y, [HOLE_M[1], z[1]], top);
}

fn island(k: &mut Draft) -> Words {
    let (w, d) = (k.width(1.1, 1.7), 0.72);
    let top = worktop(k);
    let size = size_word(w, 1.2, 1.5, ["small", "large"]);
    let body = [0.08, COUNTER_M - 0.05];
    let looks = Fronts { panel: k.paint.times(1.04), handle: handle(k), doors: k.style != 1 };
    let shape = match k.style {
        3 => {
            k.model.prism_y(&oval([0.0, 0.0], [w / 2.0, d / 2.0], 16), [COUNTER_M - 0.05, COUNTER_M], top);
            let base = oval([0.0, 0.04], [w / 2.0 - 0.06, d / 2.0 - 0.1], 16);
            k.model.prism_y(&base, [0.0, COUNTER_M - 0.05], k.paint);
            return [size, "oval"];
        }
        4 => {
            k.legs([w, d], COUNTER_M - 0.05, 0.07, 0.02, k.paint);
            k.board(about(0.0, w - 0.06), [COUNTER_M - 0.25, COUNTER_M - 0.05], about(0.0, d - 0.06));
            k.board(about(0.0, w - 0.06), [0.2, 0.24], about(0.0, d - 0.06));
            "open"
        }
        _ => {
            k.model.block(about(0.0, w - 0.1), [0.0, 0.08], about(-0.04, d - 0.24), k.paint.times(0.7));
            k.model.block(about(0.0, w - 0.04), body, about(-0.06, d - 0.16), k.paint);
            let mut back = Model::new();
            let columns = [2, 2, 3, 2, 2][k.style];
            let rows = if looks.doors { 1 } else { 3 };
            let z = d / 2.0 - 0.02;
            fronts(&mut back, about(0.0, w - 0.04), [0.1, COUNTER_M - 0.06], z, [columns, rows], &looks);
            k.model.add(&back, 2, Vector3::zeros());
            "rectangular"
        }
    };
    k.model.slab(about(0.0, w), [COUNTER_M - 0.05, COUNTER_M], about(0.0, d), top);
    [size, shape]
}

const CASES: &[Substance] = &[Metal, Plastic, Metal, Ceramic, Glass, Wood];

pub(crate) const FRIDGE: FurnitureKind =
    FurnitureKind::new("appliances", "refrigerator", 5, fridge).made_of(CASES, styles::MACHINE);

/// An oven as high as a counter.
pub(crate) const COOKER: FurnitureKind = FurnitureKind::new("appliances", "oven", 4, cooker)
    .made_of(&[Metal, Metal, Ceramic, Plastic], styles::MACHINE);

/// A microwave oven, coffee machine, kettle or toaster.
pub(crate) const SMALL: FurnitureKind = FurnitureKind::new("appliances", "microwave", 5, small)
    .made_of(&[Metal, Plastic, Ceramic, Glass, Bamboo], styles::MACHINE);

/// A cooker hood; base at y = 0, back at the wall.
pub(crate) const HOOD: FurnitureKind = FurnitureKind::new("appliances", "range hood", 3, hood)
    .made_of(&[Metal, Glass, Plastic, Wood], styles::MACHINE);

fn fridge(k: &mut Draft) -> Words {
    let (w, d) = (if k.style == 2 { 0.88 } else { k.len(0.6, 0.7) }, 0.62);
    let h = if k.style == 3 { k.len(0.86, 1.2) } else { k.len(1.6, 1.92) };
    let z = [d / 2.0 - 0.03, d / 2.0 + 0.02];
    k.model.block(about(0.0, w), [0.04, h], about(-0.02, d - 0.04), k.paint);
    k.model.block(about(0.0, w - 0.06), [0.0, 0.04], about(0.0, d - 0.1), Paint::DARK_METAL);
    let bevel = if k.style == 4 { 0.045 } else { 0.012 };
    let split = match k.style {
        0 => h * 0.62,
        1 => h * 0.38,
        _ => h,
    };
    let metal = k.metal();
    let mut door = |x: Span, y: Span, handle_x: f32| {
        k.model.soft(x, y, z, bevel, k.paint.times(1.02));
        let grip = [y[0] + (y[1] - y[0]) * 0.3, y[0] + (y[1] - y[0]) * 0.75];
        k.model.lid(about(handle_x, 0.025), grip, [z[1], z[1] + 0.03], metal);
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
    [size_word(h, 1.3, 1.74, ["small", "tall"]), k.by_style("||double|low|rounded")]
}

fn cooker(k: &mut Draft) -> Words {
    let d = 0.6;
    k.model.block(about(0.0, 0.6), [0.04, COUNTER_M], about(-0.01, d - 0.02), k.paint);
    k.model.block(about(0.0, 0.54), [0.0, 0.04], about(0.0, 0.5), Paint::DARK_METAL);
    let z = d / 2.0 - 0.02;
    let windows: &[Span] = if k.style == 1 { &[[0.12, 0.36], [0.42, 0.66]] } else { &[[0.24, 0.6]] };
    for y in windows {
        k.model.lid(about(0.0, 0.46), *y, [z, z + 0.015], Paint::SCREEN);
        k.model.lid(about(0.0, 0.46), [y[1] + 0.02, y[1] + 0.04], [z, z + 0.05], k.metal());
    }
    for i in 0..4 {
        let x = (i as f32 - 1.5) * 0.12;
        k.model.prism_z(&circle([x, 0.8], 0.024, 6), [z, z + 0.03], Paint::DARK_METAL);
    }
    let plates = [(-0.14, -0.13), (0.14, -0.13), (-0.14, 0.13), (0.14, 0.13)];
    if k.style == 2 {
        k.model.block(about(0.0, 0.58), [COUNTER_M, COUNTER_M + 0.006], about(0.0, 0.52), Paint::SCREEN);
    } else {
        for (x, z) in plates {
            k.model.cylinder([x, z], [COUNTER_M, COUNTER_M + 0.012], 0.09, 8, Paint::DARK_METAL);
        }
    }
    if k.style == 3 {
        k.model.block(about(0.0, 0.6), [COUNTER_M, COUNTER_M + 0.14], [-d / 2.0, -d / 2.0 + 0.04], k.paint);
    }
    ["", k.by_style("|double|flat-topped|high-backed")]
}

fn small(k: &mut Draft) -> Words {
    match k.style {
        0 | 1 => {
            let (w, h) = (k.len(0.44, 0.54), k.len(0.26, 0.32));
            let bevel = [0.01, 0.04][k.style];
            k.model.soft(about(0.0, w), [0.0, h], about(0.0, 0.34), bevel, k.paint);
            k.model.lid([-w / 2.0 + 0.03, w / 2.0 - 0.13], [0.04, h - 0.04], [0.17, 0.178], Paint::SCREEN);
            k.model.lid(about(w / 2.0 - 0.06, 0.07), [h - 0.1, h - 0.05], [0.17, 0.176], Paint::SCREEN);
            [size_word(w, 0.47, 0.51, ["small", "large"]), k.by_style("square|rounded")]
        }
        2 => {
            k.noun = "coffee machine";
            let h = k.len(0.32, 0.4);
            k.model.soft(about(0.0, 0.24), [0.0, 0.06], about(0.0, 0.3), 0.01, k.paint);
            k.model.soft(about(0.0, 0.24), [0.06, h], [-0.15, -0.02], 0.01, k.paint);
            k.model.soft(about(0.0, 0.24), [h - 0.1, h], [-0.02, 0.13], 0.01, k.paint);
            k.model.lathe([0.0, 0.06], &[[0.05, 0.06], [0.06, 0.16], [0.04, 0.18]], 10, Paint::SCREEN);
            [size_word(h, 0.34, 0.38, ["low", "tall"]), ""]
        }
        3 => {
            k.noun = "kettle";
            let h = k.len(0.2, 0.27);
            k.turned(&[[1.0, 0.0], [1.05, 0.2], [0.7, 0.9], [0.2, 0.97], [0.15, 1.05]], 0.09, h, 12);
            k.model.rod(point(0.07, 0.8 * h, 0.0), point(0.14, 0.95 * h, 0.0), 0.02, k.paint);
            k.model.rod(point(-0.08, 0.2 * h, 0.0), point(-0.13, h, 0.0), 0.014, Paint::DARK_METAL);
            ["small", "round"]
        }
        _ => {
            k.noun = "toaster";
            let (w, h) = (k.len(0.26, 0.32), 0.2);
            k.model.soft(about(0.0, w), [0.01, h], about(0.0, 0.18), 0.05, k.paint);
            for z in [-0.035, 0.035] {
                k.model.block(about(0.0, w * 0.7), [h, h + 0.003], about(z, 0.025), Paint::SCREEN);
            }
            k.model.lid(about(0.0, 0.04), [0.12, 0.14], [0.09, 0.115], Paint::DARK_METAL);
            ["small", "rounded"]
        }
    }
}

fn hood(k: &mut Draft) -> Words {
    let (w, h) = (0.6, k.len(0.55, 0.75));
    match k.style {
        0 => {
            k.model.block(about(0.0, w), [0.0, 0.06], about(0.0, 0.46), k.paint);
            let funnel = [[-0.23, 0.06], [0.23, 0.06], [0.23, 0.26], [0.0, 0.26]];
            k.model.prism_x(&funnel, about(0.0, w * 0.8), k.paint);
            k.model.block(about(0.0, 0.26), [0.26, h], [-0.23, 0.03], k.paint);
        }
        1 => {
            k.model.soft(about(0.0, w), [0.0, 0.16], about(0.0, 0.46), 0.02, k.paint);
            k.model.block(about(0.0, 0.24), [0.16, h], [-0.23, 0.01], k.paint);
            k.model.lid(about(0.0, 0.2), [0.05, 0.09], [0.23, 0.236], Paint::SCREEN);
        }
        _ => {
            let cone = [[1.0, 0.0], [1.0, 0.06], [0.4, 0.4], [0.4, 1.0]];
            k.model.lathe([0.0, 0.05], &cone.map(|[s, y]| [s * 0.27, y * h]), 14, k.paint);
        }
    }
    ["", k.by_style("tapered|square|round")]
}

pub(crate) const WASHER: FurnitureKind = FurnitureKind::new("appliances", "washing machine", 4, washer)
    .made_of(&[Metal, Plastic, Metal, Ceramic], styles::MACHINE);

fn washer(k: &mut Draft) -> Words {
    let (w, h, d) = (k.len(0.58, 0.68), k.len(0.84, 1.02), 0.6);
    let p = k.paint;
    k.model.soft(about(0.0, w), [0.0, h], about(-0.02, d - 0.04), 0.012, p);
    let z = d / 2.0 - 0.04;
    let size = size_word(h, 0.89, 0.97, ["low", "tall"]);
    let ring = |k: &mut Draft, radius: f32, glass: Paint| {
        k.model.prism_z(&circle([0.0, 0.42], radius, 16), [z, z + 0.03], k.metal());
        k.model.prism_z(&circle([0.0, 0.42], radius * 0.78, 14), [z + 0.03, z + 0.04], glass);
    };
    match k.style {
        0 => ring(k, 0.19, Paint::SCREEN),
        1 => {
            k.noun = "dryer";
            ring(k, 0.22, p.times(0.9));
        }
        2 => {
            ring(k, 0.17, Paint::SCREEN);
            k.model.block(about(0.0, w), [h, h + 0.12], [-d / 2.0, -d / 2.0 + 0.08], p);
        }
        _ => {
            k.noun = "dishwasher";
            k.model.lid(about(0.0, w - 0.04), [0.1, h - 0.16], [z, z + 0.02], p.times(1.03));
            k.model.lid(about(0.0, w * 0.7), [h - 0.2, h - 0.18], [z + 0.02, z + 0.045], k.metal());
        }
    }
    k.model.lid([-w / 2.0 + 0.04, -0.06], [h - 0.12, h - 0.05], [z, z + 0.01], Paint::STEEL);
    k.model.lid([0.08, w / 2.0 - 0.05], [h - 0.12, h - 0.05], [z, z + 0.01], Paint::SCREEN);
    [size, k.by_style("||high-backed|plain")]
}
