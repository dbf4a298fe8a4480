//! Bathrooms.

use super::*;

const SANITARY: &[&str] = &["white", "white", "pink", "teal", "grey", "black", "yellow", "green"];

/// A toilet with its cistern against the wall.
pub(in crate::procedural) fn toilet(taste: &mut Taste) -> Piece {
    let tint = taste.tint("toilet", SANITARY);
    let paint = Paint::ceramic(tint);
    let mut m = Model::new();
    let bowl = [[0.62, 0.0], [0.55, 0.12], [0.7, 0.25], [1.0, 0.38], [1.0, 0.41]].map(|[r, y]| [r * 0.19, y]);
    m.oval([0.0, 0.1], [1.0, 1.3], &bowl, 14, paint);
    let seat_tint =
        if taste.rng.chance(0.25) { Paint::wood(Tint::plain("brown")) } else { paint.times(1.03) };
    m.oval([0.0, 0.1], [1.0, 1.3], &[[0.195, 0.41], [0.2, 0.425], [0.19, 0.445]], 14, seat_tint);
    m.soft(about(0.0, 0.38), [0.4, 0.8], [-0.34, -0.15], 0.025, paint);
    m.soft(about(0.0, 0.4), [0.8, 0.83], [-0.34, -0.14], 0.01, paint);
    m.block(about(0.0, 0.2), [0.0, 0.4], [-0.34, 0.0], paint);
    m.cylinder([0.0, -0.24], [0.83, 0.845], 0.025, 8, Paint::CHROME);
    Piece::new("toilet", m, said(tint, "ceramic", "", "round"))
}

/// A wash basin on a pedestal.
pub(in crate::procedural) fn pedestal_sink(taste: &mut Taste) -> Piece {
    let tint = taste.tint("sink", SANITARY);
    let paint = Paint::ceramic(tint);
    let mut m = Model::new();
    m.lathe([0.0, -0.06], &[[0.13, 0.0], [0.09, 0.1], [0.08, 0.55], [0.14, 0.68]], 12, paint);
    basin(&mut m, [0.56, 0.46], 0.66, 0.84, taste.rng.chance(0.5), paint);
    Piece::new("sink", m, said(tint, "ceramic", "", ""))
}

/// A basin to stand on a cabinet or counter.
pub(in crate::procedural) fn vessel_sink(taste: &mut Taste) -> Piece {
    let tint = taste.tint("sink", SANITARY);
    let round = taste.rng.chance(0.5);
    let mut m = Model::new();
    basin(&mut m, [0.46, 0.4], 0.0, 0.15, round, Paint::ceramic(tint));
    Piece::new("sink", m, said(tint, "ceramic", "small", if round { "round" } else { "square" }))
}

/// A hollow basin from `low` to `high`, a tap at its back.
fn basin(m: &mut Model, [w, d]: [f32; 2], low: f32, high: f32, round: bool, paint: Paint) {
    if round {
        let r = d / 2.0;
        let profile = [
            [0.6, low],
            [0.95, (low + high) / 2.0],
            [1.0, high],
            [0.88, high],
            [0.7, high - 0.09],
            [0.0, high - 0.1],
        ];
        m.oval([0.0, 0.0], [w / d, 1.0], &profile.map(|[s, y]| [s * r, y]), 16, paint);
    } else {
        let floor = high - 0.1;
        m.block(about(0.0, w), [low, floor], about(0.0, d), paint);
        m.pair([w / 2.0 - 0.03, w / 2.0], [floor, high], about(0.0, d), paint);
        m.block(about(0.0, w - 0.06), [floor, high], [d / 2.0 - 0.03, d / 2.0], paint);
        m.block(about(0.0, w - 0.06), [floor, high], [-d / 2.0, -d / 2.0 + 0.09], paint);
        let bottom = [-d / 2.0 + 0.09, d / 2.0 - 0.03];
        m.block(about(0.0, w - 0.06), [floor, floor + 0.002], bottom, paint.times(0.86));
    }
    m.cylinder([0.0, 0.02], [high - 0.1, high - 0.094], 0.025, 8, Paint::CHROME);
    tap(m, [0.0, -d / 2.0 + 0.04], high);
}

/// A tap that leans over towards +z.
pub(super) fn tap(m: &mut Model, [x, z]: [f32; 2], base: f32) {
    m.cylinder([x, z], [base - 0.02, base + 0.14], 0.016, 8, Paint::CHROME);
    m.rod(Point3::new(x, base + 0.13, z), Point3::new(x, base + 0.11, z + 0.13), 0.014, Paint::CHROME);
    m.block(about(x, 0.09), [base + 0.02, base + 0.04], about(z, 0.02), Paint::CHROME);
}

/// A bathtub, its long side along x.
pub(in crate::procedural) fn bathtub(taste: &mut Taste) -> Piece {
    let tint = taste.tint("bathtub", SANITARY);
    let paint = Paint::ceramic(tint);
    let (length, width, height) =
        (taste.length_m(1.5, 1.7), taste.length_m(0.7, 0.76), taste.length_m(0.52, 0.6));
    let mut m = Model::new();
    let free_standing = taste.rng.chance(0.4);
    if free_standing {
        let r = width / 2.0;
        let profile = [[0.7, 0.06], [0.9, 0.2], [1.0, height], [0.9, height], [0.78, 0.24], [0.0, 0.18]];
        m.oval([0.0, 0.0], [length / width, 1.0], &profile.map(|[s, y]| [s * r, y]), 20, paint);
        legs(&mut m, [length * 0.6, width * 0.7], 0.12, 0.06, 0.02, Paint::STEEL);
    } else {
        m.block(about(0.0, length), [0.0, 0.16], about(0.0, width), paint);
        m.pair([length / 2.0 - 0.1, length / 2.0], [0.16, height], about(0.0, width), paint);
        let wall = [width / 2.0 - 0.08, width / 2.0];
        for z in [wall, [-wall[1], -wall[0]]] {
            m.block(about(0.0, length - 0.2), [0.16, height], z, paint);
        }
        m.block(
            about(0.0, length - 0.2),
            [0.05, height - 0.06],
            [width / 2.0, width / 2.0 + 0.01],
            paint.times(1.03),
        );
    }
    m.cylinder([-length / 2.0 + 0.07, 0.0], [height - 0.02, height + 0.12], 0.02, 8, Paint::CHROME);
    m.block(
        [-length / 2.0 + 0.06, -length / 2.0 + 0.22],
        [height + 0.09, height + 0.12],
        about(0.0, 0.03),
        Paint::CHROME,
    );
    let shape = if free_standing { "oval" } else { "rectangular" };
    Piece::new("bathtub", m, said(tint, "ceramic", size_word(length, 1.56, 1.64, ["small", "large"]), shape))
}

/// A shower: a tray, a tiled back, glass at one side, a pipe with a head.
pub(in crate::procedural) fn shower(taste: &mut Taste) -> Piece {
    let tint = taste.tint("shower", &["blue", "teal", "grey", "green", "pink", "black", "yellow", "brown"]);
    let tile = Paint::plain("tile", tint.rgb).with(Pattern::WallTiles);
    let size = taste.length_m(0.82, 0.95);
    let half = size / 2.0;
    let mut m = Model::new();
    m.block(about(0.0, size), [0.0, 0.1], about(0.0, size), Paint::PORCELAIN);
    m.block(about(0.0, size), [0.1, 2.1], [-half, -half + 0.03], tile);
    m.block([-half, -half + 0.03], [0.1, 2.1], [-half + 0.03, half], tile);
    for z in [-half * 0.2, half - 0.02] {
        m.block([half - 0.02, half], [0.1, 2.0], [z, z + 0.02], Paint::CHROME);
    }
    m.block([half - 0.02, half], [1.97, 2.0], [-half + 0.03, half - 0.02], Paint::CHROME);
    m.rod(Point3::new(0.0, 0.9, -half + 0.06), Point3::new(0.0, 2.0, -half + 0.06), 0.014, Paint::CHROME);
    m.rod(Point3::new(0.0, 2.0, -half + 0.06), Point3::new(0.0, 2.0, 0.0), 0.014, Paint::CHROME);
    m.lathe([0.0, 0.02], &[[0.1, 1.95], [0.1, 1.97], [0.02, 2.0]], 12, Paint::CHROME);
    m.block(about(0.0, 0.16), [1.05, 1.1], [-half + 0.03, -half + 0.08], Paint::CHROME);
    Piece::new("shower", m, said(tint, "tiled", "tall", "square"))
}

/// A towel on a rail; its lower edge is on y = 0.
pub(in crate::procedural) fn towel(taste: &mut Taste) -> Piece {
    let tint = taste.tint("towel", CLOTH);
    let (width, height) = (taste.length_m(0.3, 0.5), taste.length_m(0.45, 0.65));
    let paint = Paint::fabric(tint);
    let mut m = Model::new();
    m.soft(about(0.0, width), [0.0, height], [0.035, 0.065], 0.012, paint);
    m.soft(about(0.0, width), [height * 0.25, height], [0.012, 0.035], 0.01, paint.times(0.92));
    m.block(about(0.0, width + 0.002), [0.06, 0.09], [0.064, 0.067], paint.times(0.82));
    let rail = width / 2.0 + 0.06;
    m.rod(
        Point3::new(-rail, height - 0.02, 0.038),
        Point3::new(rail, height - 0.02, 0.038),
        0.01,
        Paint::CHROME,
    );
    m.pair([rail - 0.02, rail], [height - 0.04, height], [0.0, 0.05], Paint::CHROME);
    Piece::new("towel", m, said(tint, "fabric", size_word(width, 0.36, 0.44, ["small", "large"]), ""))
}
