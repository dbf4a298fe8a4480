//! What one sits on: chairs, stools, benches, sofas.

use super::*;

/// A chair for a dining table or a wall.
pub(in crate::procedural) fn chair(taste: &mut Taste) -> Piece {
    let wooden = taste.rng.chance(0.55);
    let tint = taste.tint("chair", if wooden { WOOD } else { CLOTH });
    let paint = if wooden { Paint::wood(tint) } else { Paint::fabric(tint) };
    let (width, depth, height) =
        (taste.length_m(0.42, 0.48), taste.length_m(0.42, 0.48), taste.length_m(0.82, 1.0));
    let seat = 0.45;
    let mut model = Model::new();
    let frame = if wooden { paint } else { Paint::wood(Tint::plain("brown")).times(0.8) };
    let style = taste.style(3);
    match style {
        0 => legs(&mut model, [width, depth], seat - 0.04, 0.04, 0.0, frame),
        1 => splayed_legs(&mut model, [width, depth], seat - 0.04, 0.02, frame),
        _ => sled(&mut model, [width, depth], seat - 0.04),
    }
    match wooden {
        true => model.block(about(0.0, width), [seat - 0.04, seat], about(0.0, depth), paint),
        false => model.soft(about(0.0, width), [seat - 0.05, seat + 0.04], about(0.0, depth), 0.02, paint),
    }
    chair_back(&mut model, [width, depth], [seat, height], wooden, taste.style(3), paint);
    let size = size_word(height, 0.86, 0.95, ["low", "tall"]);
    Piece::new("chair", model, said(tint, if wooden { "wooden" } else { "fabric" }, size, ""))
}

fn chair_back(m: &mut Model, [w, d]: [f32; 2], [seat, top]: Span, wooden: bool, style: usize, paint: Paint) {
    let back = -d / 2.0;
    if !wooden {
        m.pair([w / 2.0 - 0.07, w / 2.0 - 0.04], [seat, seat + 0.2], [back, back + 0.03], paint);
        m.soft(about(0.0, w), [seat + 0.12, top], [back, back + 0.07], 0.02, paint);
        return;
    }
    m.pair([w / 2.0 - 0.04, w / 2.0], [seat, top], [back, back + 0.035], paint);
    m.block(about(0.0, w - 0.08), [top - 0.08, top], [back, back + 0.03], paint);
    match style {
        0 => (0..4).for_each(|i| {
            let x = (i as f32 - 1.5) * (w - 0.1) / 4.0;
            m.block(about(x, 0.03), [seat, top - 0.08], [back + 0.005, back + 0.025], paint);
        }),
        1 => (0..2).for_each(|i| {
            let y = seat + 0.12 + i as f32 * (top - seat - 0.2) / 2.0;
            m.block(about(0.0, w - 0.08), [y, y + 0.05], [back, back + 0.025], paint);
        }),
        _ => m.block(about(0.0, w - 0.08), [seat + 0.06, top - 0.08], [back, back + 0.025], paint),
    }
}

/// Two metal runners with uprights.
fn sled(m: &mut Model, [w, d]: [f32; 2], height: f32) {
    let x = [w / 2.0 - 0.025, w / 2.0];
    m.pair(x, [0.0, 0.025], about(0.0, d), Paint::STEEL);
    m.pair(x, [0.025, height], [-d / 2.0, -d / 2.0 + 0.025], Paint::STEEL);
    m.pair(x, [0.025, height], [d / 2.0 - 0.025, d / 2.0], Paint::STEEL);
    m.block(about(0.0, w), [height - 0.02, height], about(0.0, 0.04), Paint::STEEL);
}

/// A swivel chair on five castors.
pub(in crate::procedural) fn office_chair(taste: &mut Taste) -> Piece {
    let tint = taste.tint("chair", &["black", "blue", "red", "grey", "teal", "orange", "white", "green"]);
    let paint = Paint::fabric(tint);
    let mut m = Model::new();
    for spoke in 0..5 {
        let (sin, cos) = angle::sin_cos(spoke as f32 * 1.2566);
        let tip = Point3::new(0.27 * sin, 0.06, 0.27 * cos);
        m.rod(Point3::new(0.0, 0.1, 0.0), tip, 0.02, Paint::DARK_METAL);
        m.cylinder([0.27 * sin, 0.27 * cos], [0.0, 0.06], 0.03, 6, Paint::DARK_METAL);
    }
    m.cylinder([0.0, 0.0], [0.08, 0.42], 0.03, 8, Paint::STEEL);
    m.soft(about(0.0, 0.5), [0.42, 0.52], about(0.0, 0.48), 0.03, paint);
    m.soft(about(0.0, 0.46), [0.6, 1.08], [-0.27, -0.18], 0.03, paint);
    m.block(about(0.0, 0.06), [0.46, 0.66], [-0.27, -0.24], Paint::DARK_METAL);
    if taste.rng.chance(0.6) {
        m.pair([0.23, 0.28], [0.68, 0.71], [-0.16, 0.12], Paint::DARK_METAL);
        m.pair([0.24, 0.27], [0.48, 0.68], [-0.04, 0.0], Paint::DARK_METAL);
    }
    Piece::new("chair", m, said(tint, "fabric", "", ""))
}

/// An upholstered armchair.
pub(in crate::procedural) fn armchair(taste: &mut Taste) -> Piece {
    let tint = taste.tint("chair", CLOTH);
    let (paint, material) = upholstery(taste, tint);
    let width = taste.length_m(0.78, 0.92);
    let m = upholstered(taste, width, 0.82, 1, paint);
    Piece::new("chair", m, said(tint, material, "large", ""))
}

/// A sofa with two or three seats.
pub(in crate::procedural) fn sofa(taste: &mut Taste, seats: usize) -> Piece {
    let tint = taste.tint("sofa", CLOTH);
    let (paint, material) = upholstery(taste, tint);
    let width = taste.length_m(0.36, 0.42) + seats as f32 * taste.length_m(0.58, 0.64);
    let m = upholstered(taste, width, taste_depth(seats), seats, paint);
    let size = if seats > 2 { "large" } else { "small" };
    Piece::new("sofa", m, said(tint, material, size, ""))
}

fn taste_depth(seats: usize) -> f32 {
    if seats > 2 { 0.94 } else { 0.88 }
}

fn upholstery(taste: &mut Taste, tint: Tint) -> (Paint, &'static str) {
    let leather = matches!(tint.word, "brown" | "black" | "white") && taste.rng.chance(0.7);
    if leather { (Paint::leather(tint), "leather") } else { (Paint::fabric(tint), "fabric") }
}

/// Base, seat cushions, back and arms.
fn upholstered(taste: &mut Taste, width: f32, depth: f32, seats: usize, paint: Paint) -> Model {
    let (arm, arm_top) = (taste.length_m(0.12, 0.2), taste.length_m(0.54, 0.66));
    let (back_top, feet) = (taste.length_m(0.78, 0.92), taste.length_m(0.05, 0.14));
    let bevel = taste.length_m(0.02, 0.06);
    let mut m = Model::new();
    legs(&mut m, [width, depth], feet, 0.05, 0.06, Paint::wood(Tint::plain("brown")).times(0.7));
    m.soft(
        about(0.0, width - 0.04),
        [feet, 0.28],
        [-depth / 2.0, depth / 2.0 - 0.02],
        0.015,
        paint.times(0.93),
    );
    m.soft(about(0.0, width), [feet, back_top], [-depth / 2.0, -depth / 2.0 + 0.2], bevel, paint);
    let inner = [-width / 2.0 + arm, width / 2.0 - arm];
    let step = (inner[1] - inner[0]) / seats as f32;
    for seat in 0..seats {
        let x = [inner[0] + step * seat as f32 + 0.005, inner[0] + step * (seat + 1) as f32 - 0.005];
        m.soft(x, [0.28, 0.45], [-depth / 2.0 + 0.18, depth / 2.0], 0.04, paint.times(1.04));
        m.soft(
            x,
            [0.45, back_top - 0.04],
            [-depth / 2.0 + 0.18, -depth / 2.0 + 0.34],
            0.05,
            paint.times(1.02),
        );
    }
    let side = [width / 2.0 - arm, width / 2.0];
    for x in [side, [-side[1], -side[0]]] {
        m.soft(x, [feet, arm_top], [-depth / 2.0 + 0.02, depth / 2.0 - 0.01], bevel, paint);
    }
    m
}

/// A footstool: round or square and upholstered, or a small wooden one.
pub(in crate::procedural) fn footstool(taste: &mut Taste) -> Piece {
    let tint = taste.tint("stool", CLOTH);
    let mut m = Model::new();
    let (size, height) = (taste.length_m(0.4, 0.55), taste.length_m(0.36, 0.45));
    let round = taste.rng.chance(0.5);
    let feet = Paint::wood(Tint::plain("brown")).times(0.75);
    splayed_legs(&mut m, [size * 0.8, size * 0.8], 0.14, 0.02, feet);
    let r = size / 2.0;
    let profile = [[r * 0.94, 0.12], [r, 0.18], [r, height - 0.06], [r * 0.9, height - 0.01], [0.0, height]];
    match round {
        true => m.lathe([0.0, 0.0], &profile, 16, Paint::fabric(tint)),
        false => m.soft(about(0.0, size), [0.12, height], about(0.0, size), 0.04, Paint::fabric(tint)),
    }
    Piece::new("stool", m, said(tint, "fabric", "", if round { "round" } else { "square" }))
}

/// A stool with three or four legs and a hard seat; a tall one for counters.
pub(in crate::procedural) fn stool(taste: &mut Taste, tall: bool) -> Piece {
    let tint = taste.tint("stool", WOOD);
    let paint = Paint::wood(tint);
    let (height, r) = (if tall { taste.length_m(0.62, 0.7) } else { taste.length_m(0.42, 0.48) }, 0.18);
    let mut m = Model::new();
    splayed_legs(&mut m, [0.38, 0.38], height - 0.04, 0.022, paint);
    let ring = if tall { 0.24 } else { 0.14 };
    for (a, b) in [((-1.0, -1.0), (1.0, -1.0)), ((1.0, 1.0), (-1.0, 1.0))] {
        let at = |(x, z): (f32, f32)| Point3::new(x * 0.15, ring, z * 0.15);
        m.rod(at(a), at(b), 0.015, paint);
    }
    let round = taste.rng.chance(0.6);
    match round {
        true => m.cylinder([0.0, 0.0], [height - 0.05, height], r, 14, paint),
        false => m.soft(about(0.0, 0.36), [height - 0.06, height], about(0.0, 0.34), 0.015, paint),
    }
    let size = if tall { "tall" } else { "small" };
    Piece::new("stool", m, said(tint, "wooden", size, if round { "round" } else { "square" }))
}

const SLATS: &[&str] = &["brown", "black", "grey", "teal", "blue", "green", "red"];

/// A bench for two: slatted wood, a box with a seat cushion, or a padded top on metal legs.
pub(in crate::procedural) fn bench(taste: &mut Taste, depth: f32) -> Piece {
    let (width, height) = (taste.length_m(0.95, 1.3), taste.length_m(0.43, 0.48));
    let style = taste.style(3);
    let tint = taste.tint("seating", if style == 0 { SLATS } else { CLOTH });
    let (wood, cloth) = (Paint::wood(tint), Paint::fabric(tint));
    let mut m = Model::new();
    match style {
        0 => {
            legs(&mut m, [width, depth], height - 0.04, 0.06, 0.02, wood);
            let slat = depth / 4.0;
            (0..4).for_each(|i| {
                let z = -depth / 2.0 + slat * (i as f32 + 0.5);
                m.block(about(0.0, width), [height - 0.04, height], about(z, slat - 0.015), wood);
            });
            m.block(about(0.0, width - 0.16), [0.12, 0.16], about(0.0, 0.05), wood);
        }
        1 => {
            m.block(about(0.0, width), [0.0, height - 0.16], about(0.0, depth), wood.times(0.97));
            m.soft(about(0.0, width), [height - 0.16, height], about(0.0, depth), 0.04, cloth);
        }
        _ => {
            sled(&mut m, [width, depth], height - 0.15);
            m.soft(about(0.0, width), [height - 0.17, height], about(0.0, depth), 0.05, cloth);
        }
    }
    let material = if style == 0 { "wooden" } else { "fabric" };
    Piece::new("seating", m, said(tint, material, size_word(width, 1.05, 1.18, ["short", "long"]), ""))
}
