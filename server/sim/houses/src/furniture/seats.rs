//! Chairs, armchairs, sofas, stools and benches.

use super::*;

pub(crate) const CHAIR: FurnitureKind = FurnitureKind::new("chair", "", 8, chair)
    .made_of(&[Wood, Fabric, Wood, Leather, Plastic, Velvet, Metal, Wicker], styles::WOOD);
pub(crate) const OFFICE_CHAIR: FurnitureKind = FurnitureKind::new("chair", "office chair", 3, office_chair)
    .made_of(&[Fabric, Leather, Knit, Plastic, Velvet], styles::DARK);
pub(crate) const ARMCHAIR: FurnitureKind = FurnitureKind::new("chair", "armchair", 8, armchair)
    .made_of(&[Fabric, Leather, Velvet, Corduroy, Checked, Wicker, Striped], styles::CLOTH);

fn chair(k: &mut Draft) -> Words {
    let (w, d, h) = (k.len(0.42, 0.5), k.len(0.42, 0.5), k.len(0.8, 1.02));
    let seat = 0.45;
    let frame = if k.soft() { k.trim } else { k.paint };
    let back = -d / 2.0;
    match k.style {
        0 | 1 | 5 => {
            k.legs([w, d], seat - 0.04, 0.04, 0.0, frame);
            k.pad(about(0.0, w), [seat - 0.04, seat + if k.soft() { 0.04 } else { 0.0 }], about(0.0, d));
            open_back(k, [w, back], [seat, h], frame);
        }
        2 => {
            k.splayed_legs([w, d], seat - 0.05, 0.02, frame);
            k.model.soft(about(0.0, w), [seat - 0.06, seat], about(0.0, d), 0.03, k.paint);
            k.model.soft(about(0.0, w - 0.04), [seat - 0.02, h], [back - 0.01, back + 0.05], 0.02, k.paint);
        }
        3 => {
            k.sled([w, d], seat - 0.04, Paint::DARK_METAL);
            k.pad(about(0.0, w), [seat - 0.05, seat + 0.03], about(0.0, d));
            k.pad(about(0.0, w), [seat + 0.12, h], [back, back + 0.07]);
            let x = [w / 2.0 - 0.07, w / 2.0 - 0.04];
            k.model.pair(x, [seat, seat + 0.2], [back, back + 0.03], Paint::DARK_METAL);
        }
        4 => {
            k.splayed_legs([w, d], seat - 0.04, 0.02, frame);
            k.round_pad(w / 2.0, [seat - 0.05, seat], 14, k.paint);
            spindles(k, [w, back + 0.04], [seat, h], frame);
        }
        6 => {
            k.pedestal(0.24, seat - 0.05, Paint::DARK_METAL);
            k.round_pad(w / 2.0, [seat - 0.06, seat + 0.02], 16, k.paint);
            tub(k, w / 2.0, [seat, h - 0.12]);
        }
        _ => {
            k.legs([w, d], 0.2, 0.05, 0.0, k.trim);
            k.pad(about(0.0, w), [0.2, seat + 0.03], about(0.0, d));
            k.pad(about(0.0, w), [0.2, h], [back - 0.02, back + 0.07]);
        }
    }
    let shape = k.by_style("straight|straight|rounded||round|straight|round|square");
    [size_word(h, 0.86, 0.96, ["low", "tall"]), shape]
}

/// Adds posts with slats, rungs or a cross between them.
fn open_back(k: &mut Draft, [w, back]: [f32; 2], [seat, top]: Span, frame: Paint) {
    k.model.pair([w / 2.0 - 0.04, w / 2.0], [seat, top], [back, back + 0.035], frame);
    k.board(about(0.0, w - 0.08), [top - 0.09, top], [back, back + 0.03]);
    match k.style {
        0 => (0..4).for_each(|i| {
            let x = (i as f32 - 1.5) * (w - 0.1) / 4.0;
            k.board(about(x, 0.03), [seat, top - 0.09], [back + 0.005, back + 0.025]);
        }),
        1 => (0..2).for_each(|i| {
            let y = seat + 0.12 + i as f32 * (top - seat - 0.2) / 2.0;
            k.board(about(0.0, w - 0.08), [y, y + 0.06], [back, back + 0.025]);
        }),
        _ => {
            let x = w / 2.0 - 0.05;
            for side in [-1.0, 1.0] {
                let from = point(-x * side, seat, back + 0.015);
                k.model.rod(from, point(x * side, top - 0.09, back + 0.015), 0.016, k.paint);
            }
        }
    }
}

/// Adds thin bars on an arc behind a round seat, a rail on top.
fn spindles(k: &mut Draft, [w, back]: [f32; 2], [seat, top]: Span, frame: Paint) {
    for i in 0..5 {
        let x = (i as f32 - 2.0) * w * 0.19;
        let z = back + 0.05 * (i as f32 - 2.0).abs() * 0.5;
        k.model.rod(point(x, seat, z + 0.02), point(x * 1.05, top - 0.05, z - 0.02), 0.011, frame);
    }
    k.model.soft(about(0.0, w), [top - 0.08, top], [back - 0.03, back + 0.02], 0.015, k.paint);
}

/// Adds a low wall around the back half of a round seat.
fn tub(k: &mut Draft, radius: f32, [low, high]: Span) {
    const STEPS: usize = 8;
    let ring = |radius: f32, i: usize| {
        let turn = std::f32::consts::PI * (i as f32 / STEPS as f32);
        let (sin, cos) = angle::sin_cos(turn);
        [radius * cos, radius * sin]
    };
    for i in 0..STEPS {
        let outline =
            [ring(radius - 0.05, i), ring(radius, i), ring(radius, i + 1), ring(radius - 0.05, i + 1)];
        k.model.prism_y(&outline, [low, high], k.paint);
    }
}

fn office_chair(k: &mut Draft) -> Words {
    for spoke in 0..5 {
        let (sin, cos) = angle::sin_cos(spoke as f32 * 1.2566);
        let tip = point(0.27 * sin, 0.06, 0.27 * cos);
        k.model.rod(point(0.0, 0.1, 0.0), tip, 0.02, Paint::DARK_METAL);
        k.model.cylinder([0.27 * sin, 0.27 * cos], [0.0, 0.06], 0.03, 6, Paint::DARK_METAL);
    }
    k.model.cylinder([0.0, 0.0], [0.08, 0.42], 0.03, 8, Paint::DARK_METAL);
    k.model.soft(about(0.0, 0.52), [0.42, 0.52], about(0.0, 0.5), 0.03, k.paint);
    k.model.block(about(0.0, 0.06), [0.46, 0.66], [-0.27, -0.24], Paint::DARK_METAL);
    let top = k.len(0.95, 1.22);
    let width = [0.46, 0.52, 0.4][k.style];
    k.model.soft(about(0.0, width), [0.58, top], [-0.28, -0.18], 0.04, k.paint);
    if k.style != 2 {
        k.model.pair([0.25, 0.3], [0.68, 0.71], [-0.16, 0.14], Paint::DARK_METAL);
        k.model.pair([0.26, 0.29], [0.48, 0.68], [-0.04, 0.0], Paint::DARK_METAL);
    }
    [size_word(top, 1.03, 1.14, ["low", "tall"]), ""]
}

fn armchair(k: &mut Draft) -> Words {
    let (w, d, h) = (k.len(0.74, 0.98), k.len(0.78, 0.9), k.len(0.78, 1.08));
    let shape = match k.style {
        4 => {
            k.pedestal(0.3, 0.2, Paint::DARK_METAL);
            k.round_pad(d / 2.0, [0.18, 0.42], 14, k.paint);
            tub(k, d / 2.0, [0.4, h - 0.1]);
            "round"
        }
        5 => {
            k.sled([w - 0.1, d], 0.6, k.trim);
            k.model.pair([w / 2.0 - 0.09, w / 2.0 - 0.02], [0.58, 0.62], about(0.0, d), k.trim);
            k.pad(about(0.0, w - 0.16), [0.3, 0.46], about(0.04, d - 0.1));
            k.pad(about(0.0, w - 0.16), [0.4, h], [-d / 2.0, -d / 2.0 + 0.14]);
            "open"
        }
        _ => {
            let look = Upholstery::of(k);
            upholstered(k, [w, h, d], 1, &look);
            look.shape
        }
    };
    [size_word(w, 0.8, 0.92, ["small", "large"]), shape]
}

pub(crate) const SOFA: FurnitureKind = FurnitureKind::new("sofa", "", 8, sofa)
    .made_of(&[Fabric, Leather, Velvet, Corduroy, Striped, Checked, Denim, Wicker], styles::CLOTH);

pub(super) struct Upholstery {
    arm: f32,
    arm_top: f32,
    feet: f32,
    bevel: f32,
    /// Arms are rolled cylinders.
    rolled: bool,
    /// True for a single back with deep stitching.
    tufted: bool,
    pub(super) shape: &'static str,
}

impl Upholstery {
    pub(super) fn of(k: &mut Draft) -> Self {
        let base = Self {
            arm: k.len(0.12, 0.18),
            arm_top: k.len(0.54, 0.66),
            feet: k.len(0.05, 0.09),
            bevel: 0.03,
            rolled: false,
            tufted: false,
            shape: "",
        };
        match k.style {
            0 => Self { bevel: 0.05, ..base },
            1 => Self { bevel: 0.012, arm: 0.1, shape: "square", ..base },
            2 => Self { feet: 0.15, arm: 0.09, shape: "straight", ..base },
            3 => Self { rolled: true, arm: 0.2, arm_top: 0.62, shape: "rounded", ..base },
            6 => Self { rolled: true, tufted: true, arm: 0.2, arm_top: 0.68, shape: "tufted", ..base },
            _ => Self { bevel: 0.08, arm: 0.24, arm_top: 0.58, feet: 0.03, shape: "curved", ..base },
        }
    }
}

/// Adds base, seat cushions, back and arms.
pub(super) fn upholstered(k: &mut Draft, [w, top, d]: [f32; 3], seats: usize, look: &Upholstery) {
    let (back, front, feet) = (-d / 2.0, d / 2.0, look.feet);
    k.legs([w, d], feet, 0.05, 0.06, k.trim);
    k.model.rim(about(0.0, w - 0.04), [feet, 0.28], [back + 0.02, front - 0.02], k.paint.times(0.95));
    k.model.soft(about(0.0, w), [feet, top], [back, back + 0.2], look.bevel, k.paint);
    let inner = [-w / 2.0 + look.arm, w / 2.0 - look.arm];
    let step = (inner[1] - inner[0]) / seats as f32;
    for seat in 0..seats {
        let x = [inner[0] + step * seat as f32 + 0.005, inner[0] + step * (seat + 1) as f32 - 0.005];
        k.model.soft(x, [0.28, 0.45], [back + 0.18, front], 0.04, k.paint.times(1.03));
        if !look.tufted && seats < 3 {
            k.model.soft(x, [0.45, top - 0.04], [back + 0.18, back + 0.34], 0.05, k.paint.times(1.02));
        }
    }
    if !look.tufted && seats > 2 {
        k.model.soft(inner, [0.45, top - 0.04], [back + 0.18, back + 0.34], 0.05, k.paint.times(1.02));
    }
    if look.tufted {
        let quilt = k.paint.with(Pattern::Quilt);
        k.model.soft(inner, [0.45, top - 0.02], [back + 0.18, back + 0.3], 0.05, quilt);
    }
    let side = [w / 2.0 - look.arm, w / 2.0];
    for x in [side, [-side[1], -side[0]]] {
        let (z, high) = ([back + 0.02, front - 0.01], look.arm_top);
        if look.rolled {
            k.model.block(x, [feet, high - 0.1], z, k.paint);
            let center = (x[0] + x[1]) / 2.0;
            k.model.prism_z(&circle([center, high - 0.1], look.arm / 2.0 + 0.01, 10), z, k.paint);
        } else {
            k.model.soft(x, [feet, high], z, look.bevel, k.paint);
        }
    }
}

fn sofa(k: &mut Draft) -> Words {
    let (w, top, d) = (k.width(1.5, 2.4), k.len(0.76, 0.94), k.len(0.84, 0.96));
    let seats = if w > 1.85 { 3 } else { 2 };
    let look = Upholstery::of(k);
    let shape = match k.style {
        4 => daybed(k, [w, top, d]),
        5 => framed(k, [w, top, d], seats),
        _ => {
            upholstered(k, [w, top, d], seats, &look);
            look.shape
        }
    };
    [size_word(w, 1.65, 2.05, ["small", "large"]), shape]
}

/// Draws a padded bench with a single arm and a low back over one half.
fn daybed(k: &mut Draft, [w, top, d]: [f32; 3]) -> &'static str {
    k.legs([w, d], 0.14, 0.06, 0.04, k.trim);
    k.pad(about(0.0, w), [0.14, 0.3], about(0.0, d));
    k.model.soft(about(0.0, w - 0.02), [0.3, 0.45], about(0.0, d - 0.02), 0.04, k.paint.times(1.03));
    k.pad([-w / 2.0, -w / 2.0 + 0.16], [0.3, top], about(0.0, d));
    k.pad([-w / 2.0 + 0.16, w * 0.25], [0.43, top - 0.06], [-d / 2.0, -d / 2.0 + 0.2]);
    "open"
}

/// Draws loose cushions in a frame of bars.
fn framed(k: &mut Draft, [w, top, d]: [f32; 3], seats: usize) -> &'static str {
    let (frame, back) = (k.trim, -d / 2.0);
    for x in [[-w / 2.0, -w / 2.0 + 0.07], [w / 2.0 - 0.07, w / 2.0]] {
        k.model.block(x, [0.0, 0.6], [back, back + 0.07], frame);
        k.model.block(x, [0.0, 0.6], [d / 2.0 - 0.07, d / 2.0], frame);
        k.model.block(x, [0.56, 0.61], about(0.0, d), frame);
    }
    k.model.block(about(0.0, w - 0.1), [0.2, 0.27], about(0.0, d - 0.1), frame);
    let step = (w - 0.16) / seats as f32;
    for seat in 0..seats {
        let x = about(-w / 2.0 + 0.08 + step * (seat as f32 + 0.5), step - 0.01);
        k.pad(x, [0.27, 0.45], [back + 0.16, d / 2.0 - 0.01]);
        k.pad(x, [0.43, top], [back + 0.02, back + 0.2]);
    }
    "framed"
}

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
