//! Fixtures: toilets, bathtubs, showers, sinks, fireplaces and radiators.

use super::kitchen::HOLE_M;
use super::*;

pub(crate) const TOILET: FurnitureKind = FurnitureKind::new("toilet", "", 8, toilet)
    .made_of(&[Ceramic, Ceramic, Ceramic, Metal, Plastic, Marble, Concrete, Wood], styles::SANITARY);

/// A bathtub, long in x.
pub(crate) const BATHTUB: FurnitureKind = FurnitureKind::new("bathtub", "", 8, bathtub)
    .made_of(&[Ceramic, Ceramic, Plastic, Metal, Marble, Wood, Concrete], styles::SANITARY);

/// A tray, a back wall, a pipe with a head.
pub(crate) const SHOWER: FurnitureKind = FurnitureKind::new("shower", "", 8, shower).made_of(
    &[Tile, Tile, Marble, Glass, Plastic, Concrete, Terrazzo, Wood],
    "blue white grey teal green brown black pink yellow purple orange red",
);

fn toilet(k: &mut Draft) -> Words {
    let h = k.len(0.76, 0.88);
    let square = matches!(k.style, 2 | 6);
    let lid = if !k.dark() && k.rng.chance(0.15) { Paint::OAK } else { k.paint.times(0.97) };
    if square {
        k.model.soft(about(0.0, 0.36), [0.02, 0.41], [-0.1, 0.34], 0.03, k.paint);
        k.model.soft(about(0.0, 0.37), [0.41, 0.44], [-0.12, 0.35], 0.012, lid);
    } else {
        let low = if k.style == 3 { 0.12 } else { 0.0 };
        let bowl =
            [[0.62, low], [0.55, 0.14], [0.7, 0.25], [1.0, 0.38], [1.0, 0.41]].map(|[r, y]| [r * 0.19, y]);
        let long = if k.style == 1 { 1.5 } else { 1.3 };
        k.model.oval([0.0, 0.1], [1.0, long], &bowl, 12, k.paint);
        k.model.oval([0.0, 0.1], [1.0, long], &[[0.195, 0.41], [0.2, 0.425], [0.19, 0.445]], 12, lid);
    }
    let (back, feet) = (-0.34, if k.style == 3 { 0.12 } else { 0.0 });
    k.model.block(about(0.0, 0.2), [feet, 0.4], [back, 0.0], k.paint);
    match k.style {
        3 => k.model.block(about(0.0, 0.46), [0.0, 1.05], [back, back + 0.12], k.paint),
        4 => {
            k.model.rod(point(0.0, 0.4, back + 0.06), point(0.0, 1.55, back + 0.06), 0.02, k.metal());
            k.model.soft(about(0.0, 0.42), [1.55, 1.85], [back, back + 0.18], 0.02, k.paint);
        }
        5 => {
            k.model.oval([0.0, back + 0.11], [1.7, 1.0], &[[0.11, 0.4], [0.12, 0.5], [0.11, h]], 12, k.paint)
        }
        6 => k.model.block(about(0.0, 0.5), [0.0, 1.1], [back, back + 0.14], k.paint),
        7 => k.model.soft(about(0.0, 0.38), [0.4, 0.6], [back, back + 0.24], 0.05, k.paint),
        _ => {
            k.model.soft(about(0.0, 0.38), [0.4, h - 0.03], [back, back + 0.19], 0.025, k.paint);
            k.model.soft(about(0.0, 0.4), [h - 0.03, h], [back, back + 0.2], 0.01, k.paint);
        }
    }
    let shape = k.by_style("round|oval|square|wall-hung|high-tanked|round|square|low-backed");
    [size_word(h, 0.8, 0.85, ["low", "tall"]), shape]
}

fn bathtub(k: &mut Draft) -> Words {
    let (l, w, h) = (k.width(1.45, 1.75), k.len(0.7, 0.78), k.len(0.5, 0.6));
    let r = w / 2.0;
    let turned = |k: &mut Draft, profile: [[f32; 2]; 6]| {
        k.model.oval([0.0, 0.0], [l / w, 1.0], &profile.map(|[s, y]| [s * r, y]), 18, k.paint);
    };
    let oval = |foot: f32| [[0.7, foot], [0.9, 0.2], [1.0, h], [0.9, h], [0.78, 0.26], [0.0, 0.2]];
    match k.style {
        0..=2 => {
            walls(k, [l, h, w], [0.1, 0.08, 0.05][k.style]);
            let panel = [0.05, h - 0.06];
            if k.style == 1 {
                k.model.lid(about(0.0, l - 0.2), panel, [r, r + 0.012], k.paint.with(Pattern::WallTiles));
            }
        }
        3 => {
            turned(k, oval(0.06));
            k.legs([l * 0.6, w * 0.7], 0.12, 0.06, 0.02, Paint::STEEL);
        }
        4 => turned(k, oval(0.0)),
        5 => {
            let boat = [[0.72, 0.0], [0.8, 0.2], [1.0, h + 0.04], [0.93, h + 0.04], [0.7, 0.26], [0.0, 0.22]];
            turned(k, boat);
        }
        6 => {
            let deep = [[1.0, 0.0], [1.0, 0.66], [0.9, 0.66], [0.88, 0.3], [0.0, 0.28]];
            k.model.lathe([0.0, 0.0], &deep.map(|[s, y]| [s * 0.55, y]), 20, k.paint);
            return ["small", "round"];
        }
        _ => {
            walls(k, [l, h, w], 0.06);
            k.model.soft(about(0.0, l + 0.06), [h - 0.03, h + 0.02], [r, r + 0.08], 0.015, k.paint);
        }
    }
    let x = -l / 2.0 + 0.07;
    k.model.cylinder([x, 0.0], [h - 0.02, h + 0.12], 0.02, 8, k.metal());
    k.model.block([x, x + 0.15], [h + 0.09, h + 0.12], about(0.0, 0.03), k.metal());
    let shape = k.by_style("rectangular|rectangular|rectangular|oval|oval|boat-shaped|round|rectangular");
    [size_word(l, 1.55, 1.66, ["small", "large"]), shape]
}

/// Adds a straight tub: bottom and four walls.
fn walls(k: &mut Draft, [l, h, w]: [f32; 3], thick: f32) {
    k.board(about(0.0, l), [0.0, 0.16], about(0.0, w));
    k.model.pair([l / 2.0 - thick, l / 2.0], [0.16, h], about(0.0, w), k.paint);
    for z in [[w / 2.0 - thick, w / 2.0], [-w / 2.0, -w / 2.0 + thick]] {
        k.board(about(0.0, l - 2.0 * thick), [0.16, h], z);
    }
}

fn shower(k: &mut Draft) -> Words {
    let size = k.len(0.8, 1.0);
    let half = size / 2.0;
    let tray_paint = if k.paint.brightness() > 0.6 { Paint::PORCELAIN } else { k.paint.times(0.9) };
    let words = |shape| [size_word(size, 0.86, 0.94, ["small", "large"]), shape];
    let curved = matches!(k.style, 2 | 6);
    if curved {
        let mut quadrant = vec![[-half, half], [-half, -half * 0.2]];
        quadrant.extend((0..=6).map(|i| {
            let (sin, cos) = angle::sin_cos(std::f32::consts::FRAC_PI_2 * i as f32 / 6.0);
            [-half * 0.2 + half * 1.2 * sin, half * 0.2 - half * 1.2 * cos]
        }));
        quadrant.push([half, half]);
        k.model.prism_y(&quadrant, [0.0, 0.1], tray_paint);
    } else {
        let tray = if k.style == 5 { 0.03 } else { 0.1 };
        k.model.block(about(0.0, size), [0.0, tray], about(0.0, size), tray_paint);
    }
    k.board(about(0.0, size), [0.03, 2.1], [-half, -half + 0.03]);
    if k.style != 4 {
        k.board([-half, -half + 0.03], [0.03, 2.1], [-half + 0.03, half]);
    }
    if k.style == 3 || k.style == 7 {
        k.board([half - 0.03, half], [0.03, 2.1], [-half + 0.03, half]);
    }
    frame(k, half);
    plumbing(k, half);
    words(k.by_style("square|open|rounded|walled|open|flat|rounded|walled"))
}

/// Adds the posts and rails around the glass.
fn frame(k: &mut Draft, half: f32) {
    if matches!(k.style, 1 | 4 | 5) {
        return;
    }
    for z in [-half * 0.2, half - 0.02] {
        if !matches!(k.style, 3 | 7 | 2 | 6) {
            k.model.block([half - 0.02, half], [0.1, 2.0], [z, z + 0.02], k.metal());
        }
    }
    if matches!(k.style, 0 | 3 | 7) {
        k.model.block([half - 0.02, half], [1.97, 2.0], [-half + 0.03, half - 0.02], k.metal());
    }
    if k.style == 3 {
        k.model.block(about(0.0, 2.0 * half - 0.06), [2.0, 2.03], [half - 0.03, half], k.metal());
    }
}

fn plumbing(k: &mut Draft, half: f32) {
    let back = -half + 0.06;
    let reach = if k.style == 1 || k.style == 6 { 0.0 } else { -half * 0.5 };
    k.model.rod(point(0.0, 0.9, back), point(0.0, 2.0, back), 0.014, k.metal());
    k.model.rod(point(0.0, 2.0, back), point(0.0, 2.0, reach), 0.014, k.metal());
    k.model.lathe([0.0, reach + 0.02], &[[0.1, 1.95], [0.1, 1.97], [0.02, 2.0]], 10, k.metal());
    k.model.block(about(0.0, 0.16), [1.05, 1.1], [-half + 0.03, -half + 0.08], k.metal());
}

const BOWLS: &[Substance] = &[Ceramic, Ceramic, Marble, Metal, Glass, Concrete, Wood];

pub(crate) const PEDESTAL_SINK: FurnitureKind =
    FurnitureKind::new("sink", "", 5, pedestal_sink).made_of(BOWLS, styles::SANITARY);

/// A basin on top of a cabinet.
pub(crate) const VESSEL_SINK: FurnitureKind =
    FurnitureKind::new("sink", "", 5, vessel_sink).made_of(BOWLS, styles::SANITARY);

/// A sink for a counter hole; y = 0 is the counter top.
pub(crate) const KITCHEN_SINK: FurnitureKind = FurnitureKind::new("sink", "kitchen sink", 3, kitchen_sink)
    .made_of(&[Metal, Metal, Ceramic, Concrete, Marble], styles::MACHINE);

fn pedestal_sink(k: &mut Draft) -> Words {
    let (w, h) = (k.len(0.5, 0.66), 0.84);
    let size = size_word(w, 0.55, 0.61, ["small", "wide"]);
    let back = -0.06;
    let metal = k.metal();
    match k.style {
        0 | 1 => {
            k.model.lathe([0.0, back], &[[0.13, 0.0], [0.09, 0.1], [0.08, 0.55], [0.14, 0.68]], 12, k.paint)
        }
        2 => k.model.block(about(0.0, 0.26), [0.0, 0.68], about(back, 0.22), k.paint),
        3 => k.legs([w - 0.04, 0.4], 0.68, 0.03, 0.02, metal),
        _ => k.model.lathe([0.0, back], &[[0.2, 0.0], [0.16, 0.3], [0.2, 0.68]], 14, k.paint),
    }
    let round = matches!(k.style, 0 | 4);
    basin(k, [w, 0.46], [0.66, h], round);
    [size, k.by_style("round|square|square|square|round")]
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
            let p = k.paint;
            let bowl = [[0.45, 0.0], [1.0, 1.0], [0.92, 1.0], [0.3, 0.25], [0.0, 0.2]];
            k.model.lathe([0.0, 0.02], &bowl.map(|[s, y]| [s * 0.19, y * h]), 16, p);
            tap(k, [0.0, -0.19], h);
        }
    }
    [size, k.by_style("oval|square|round|rectangular|conical")]
}

/// Adds a hollow basin between two heights, with a tap at the back.
fn basin(k: &mut Draft, [w, d]: [f32; 2], [low, high]: Span, round: bool) {
    let m = &mut k.model;
    if round {
        let r = d / 2.0;
        let middle = (low + high) / 2.0;
        let floor = high - (high - low).min(0.1) * 0.9;
        let profile =
            [[0.6, low], [0.95, middle], [1.0, high], [0.88, high], [0.7, floor + 0.01], [0.0, floor]];
        m.oval([0.0, 0.0], [w / d, 1.0], &profile.map(|[s, y]| [s * r, y]), 16, k.paint);
    } else {
        let floor = high - (high - low).min(0.1) * 0.8;
        m.block(about(0.0, w), [low, floor], about(0.0, d), k.paint);
        m.pair([w / 2.0 - 0.03, w / 2.0], [floor, high], about(0.0, d), k.paint);
        m.block(about(0.0, w - 0.06), [floor, high], [d / 2.0 - 0.03, d / 2.0], k.paint);
        m.block(about(0.0, w - 0.06), [floor, high], [-d / 2.0, -d / 2.0 + 0.09], k.paint);
    }
    tap(k, [0.0, -d / 2.0 + 0.04], high);
}

/// Adds a tap that leans towards +z.
fn tap(k: &mut Draft, [x, z]: [f32; 2], base: f32) {
    let metal = k.metal();
    let m = &mut k.model;
    m.cylinder([x, z], [base - 0.02, base + 0.14], 0.016, 8, metal);
    m.rod(point(x, base + 0.13, z), point(x, base + 0.11, z + 0.13), 0.014, metal);
    m.block(about(x, 0.09), [base + 0.02, base + 0.04], about(z, 0.02), metal);
}

fn kitchen_sink(k: &mut Draft) -> Words {
    let [x, z] = HOLE_M;
    let m = &mut k.model;
    m.block(about(0.0, 2.0 * x), [-0.17, -0.15], about(0.0, 2.0 * z), k.paint);
    m.pair([x - 0.012, x], [-0.15, 0.01], about(0.0, 2.0 * z), k.paint);
    m.block(about(0.0, 2.0 * x), [-0.15, 0.01], [z - 0.012, z], k.paint);
    m.block(about(0.0, 2.0 * x), [-0.15, 0.01], [-z, -z + 0.012], k.paint);
    let rim = if k.style == 1 { 0.03 } else { 0.012 };
    m.pair([x, x + 0.03], [0.0, rim], about(0.0, 2.0 * z + 0.06), k.paint);
    m.block(about(0.0, 2.0 * x), [0.0, rim], [z, z + 0.03], k.paint);
    m.block(about(0.0, 2.0 * x), [0.0, rim], [-z - 0.06, -z], k.paint);
    if k.style == 2 {
        m.block(about(0.0, 0.02), [-0.15, 0.0], about(0.0, 2.0 * z), k.paint);
    }
    tap(k, [0.0, -z - 0.03], 0.03);
    ["", k.by_style("rectangular|rectangular|double")]
}

pub(crate) const FIREPLACE: FurnitureKind = FurnitureKind::new("fireplace", "", 8, fireplace).made_of(
    &[Brick, Marble, Wood, Concrete, Tile, Metal, Terrazzo],
    "red white grey brown black green teal yellow blue orange pink purple",
);
pub(crate) const RADIATOR: FurnitureKind = FurnitureKind::new("radiator", "", 8, radiator)
    .made_of(&[Metal, Metal, Metal, Ceramic, Plastic, Wood, Glass, Marble], styles::SANITARY);

/// Logs and flames in a dark hole between `-half` and `half`, `high` up.
fn fire(k: &mut Draft, half: f32, high: f32, back: f32) {
    let soot = Paint::plain("brick", [44, 38, 36]).with(Pattern::Brick);
    k.model.block(about(0.0, 2.0 * half), [0.0, high], [back, back + 0.05], soot);
    for (x, y) in [(-0.06, 0.06), (0.08, 0.06), (0.0, 0.14)] {
        let z = back + 0.15 + x * 0.4;
        let (from, to) = (point(-half * 0.7, y, z), point(half * 0.7, y + x * 0.2, z + 0.03));
        k.model.rod(from, to, 0.05, Paint::WALNUT);
    }
    for flame in 0..3 {
        let x = (flame as f32 - 1.0) * half * 0.4;
        let paint = Paint::plain("fire", if flame == 1 { [250, 200, 70] } else { [240, 130, 40] });
        k.model.lathe([x, back + 0.17], &[[0.04, 0.14], [0.06, 0.2], [0.0, 0.36]], 6, paint);
    }
}

fn fireplace(k: &mut Draft) -> Words {
    let (w, h, d) = (k.len(1.15, 1.55), k.len(0.95, 1.25), 0.34);
    let (half, hole, p) = (w / 2.0, w * 0.28, k.paint);
    let (back, front) = (-d / 2.0, d / 2.0);
    if k.style == 6 {
        k.model.lathe([0.0, 0.0], &[[0.3, 0.0], [0.3, 0.7], [0.1, 0.95], [0.09, 1.9]], 14, p);
        k.model.prism_z(&arch(0.36, 0.15, 0.55), [0.27, 0.31], Paint::SCREEN);
        k.model.lid(about(0.0, 0.2), [0.2, 0.38], [0.31, 0.315], Paint::plain("fire", [240, 130, 40]));
        return ["tall", "round"];
    }
    k.model.pair([hole, half], [0.0, h - 0.06], [back, front], p);
    k.model.block(about(0.0, 2.0 * hole), [0.62, h - 0.06], [back, front], p);
    fire(k, hole, 0.62, back);
    let shelf = if k.style == 2 { Paint::WALNUT } else { p.times(0.95) };
    match k.style {
        2 => k.model.block(about(0.0, w), [h - 0.14, h - 0.06], [front, front + 0.04], shelf),
        1 => k.model.block(about(0.0, w * 0.7), [h - 0.06, 2.3], [back, front - 0.08], p),
        3 => k.model.pair([half - 0.1, half], [0.0, h - 0.06], [front, front + 0.05], p.times(1.03)),
        4 => k.model.soft(about(0.0, w), [0.0, 0.05], [front, front + 0.2], 0.01, p),
        5 => {
            let crown = [[-half, h - 0.06], [half, h - 0.06], [0.0, h + 0.28]];
            k.model.prism_z(&crown, [back, back + 0.1], p);
        }
        7 => k.model.prism_z(&arch(w, h - 0.06, h + 0.3), [back, back + 0.12], p),
        _ => {}
    }
    let shape = k.by_style("plain|chimneyed|beamed|pillared|hearthed|gabled|plain|arched");
    k.model.soft(about(0.0, w + 0.14), [h - 0.06, h], [back, front + 0.06], 0.012, shelf);
    [size_word(w, 1.25, 1.42, ["small", "large"]), shape]
}

fn radiator(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.6, 1.2), k.height(0.5, 0.66));
    let size = size_word(w, 0.75, 1.0, ["short", "long"]);
    match k.style {
        0 | 1 => {
            let count =
                if k.style == 0 { ((w / 0.08) as usize).min(14) } else { ((w / 0.12) as usize).min(10) };
            for i in 0..count {
                let x = ((i as f32 + 0.5) / count as f32 - 0.5) * w;
                k.model.block(about(x, w / count as f32 * 0.7), [0.1, 0.1 + h], about(0.0, 0.11), k.paint);
            }
            k.model.block(about(0.0, w), [0.14, 0.18], about(0.0, 0.06), k.paint);
            k.model.pair([w * 0.4, w * 0.44], [0.0, 0.12], about(0.0, 0.06), k.paint);
        }
        2 | 3 => {
            k.model.soft(about(0.0, w), [0.1, 0.1 + h], about(0.0, 0.1), 0.012, k.paint);
            k.model.pair([w * 0.4, w * 0.43], [0.0, 0.1], about(0.0, 0.04), Paint::CHROME);
            let slot = [0.1 + h - 0.04, 0.1 + h - 0.02];
            k.model.lid(about(0.0, w - 0.06), slot, [0.05, 0.055], k.paint.times(0.8));
            if k.style == 3 {
                k.model.lid(about(0.0, w * 0.9), [0.16, h - 0.02], [0.05, 0.065], k.paint);
            }
        }
        4 => {
            for i in 0..6 {
                let y = 0.12 + h * i as f32 / 6.0;
                k.model.soft(about(0.0, w), [y, y + h * 0.11], about(0.0, 0.06), 0.01, k.paint);
            }
            k.model.pair([w / 2.0 - 0.05, w / 2.0 - 0.02], [0.0, 0.1 + h], [-0.04, -0.02], k.paint);
        }
        5 => {
            k.model.block(about(0.0, w + 0.06), [0.0, h + 0.14], about(-0.01, 0.1), k.paint);
            for i in 0..6 {
                let x = (i as f32 - 2.5) * w / 6.5;
                k.model.lid(about(x, w * 0.07), [0.08, h + 0.06], [0.04, 0.06], k.paint.times(0.9));
            }
        }
        6 => {
            for i in 0..6 {
                let x = ((i as f32 + 0.5) / 6.0 - 0.5) * w;
                k.model.lathe([x, 0.0], &[[0.045, 0.08], [0.045, 0.1 + h]], 8, k.paint);
            }
            k.model.pair([w * 0.38, w * 0.42], [0.0, 0.1], about(0.0, 0.05), k.paint);
        }
        _ => {
            k.model.soft(about(0.0, w), [0.12, 0.1 + h], about(0.0, 0.12), 0.05, k.paint);
            k.model.pair([w * 0.36, w * 0.42], [0.0, 0.14], about(0.0, 0.2), Paint::DARK_METAL);
        }
    }
    [size, k.by_style("ribbed|ribbed|flat|flat|barred|covered|tubular|rounded")]
}
