//! Tables and desks.

use super::*;

/// A dining table of the given size; round ones have the diameter `size[0]`.
pub(in crate::procedural) fn dining_table(taste: &mut Taste, size: [f32; 2], round: bool) -> Piece {
    let tint = taste.tint("table", WOOD);
    let paint = Paint::wood(tint);
    let height = taste.length_m(0.73, 0.78);
    let mut m = Model::new();
    if round {
        let r = size[0] / 2.0;
        m.lathe([0.0, 0.0], &[[r - 0.02, height - 0.05], [r, height - 0.03], [r, height]], 20, paint);
        m.lathe([0.0, 0.0], &[[0.28, 0.0], [0.26, 0.03], [0.06, 0.1], [0.05, height - 0.04]], 12, paint);
        return Piece::new("table", m, said(tint, "wooden", "", "round"));
    }
    let [width, depth] = size;
    m.block(about(0.0, width), [height - 0.04, height], about(0.0, depth), paint);
    m.block(
        about(0.0, width - 0.16),
        [height - 0.12, height - 0.04],
        about(0.0, depth - 0.16),
        paint.times(0.92),
    );
    match taste.style(3) {
        0 => legs(&mut m, size, height - 0.04, 0.07, 0.03, paint),
        1 => splayed_legs(&mut m, [width - 0.08, depth - 0.08], height - 0.04, 0.035, paint),
        _ => trestle(&mut m, size, height - 0.04, paint),
    }
    let shape = if width - depth < 0.12 { "square" } else { "rectangular" };
    Piece::new("table", m, said(tint, "wooden", size_word(width, 1.1, 1.6, ["small", "long"]), shape))
}

fn trestle(m: &mut Model, [width, depth]: [f32; 2], height: f32, paint: Paint) {
    let x = [width / 2.0 - 0.3, width / 2.0 - 0.22];
    m.pair(x, [0.0, 0.06], about(0.0, depth - 0.1), paint);
    m.pair(x, [0.06, height], about(0.0, 0.16), paint);
    m.block(about(0.0, width - 0.5), [0.2, 0.3], about(0.0, 0.05), paint);
}

/// A low table for the front of a sofa.
pub(in crate::procedural) fn coffee_table(taste: &mut Taste) -> Piece {
    let tint = taste.tint("table", WOOD);
    let paint = Paint::wood(tint);
    let (width, depth, height) =
        (taste.length_m(0.85, 1.15), taste.length_m(0.5, 0.62), taste.length_m(0.38, 0.45));
    let mut m = Model::new();
    match taste.style(3) {
        0 => {
            m.block(about(0.0, width), [height - 0.04, height], about(0.0, depth), paint);
            m.block(about(0.0, width - 0.1), [0.12, 0.14], about(0.0, depth - 0.1), paint);
            legs(&mut m, [width, depth], height - 0.04, 0.05, 0.01, paint);
            Piece::new("table", m, said(tint, "wooden", "low", "rectangular"))
        }
        1 => {
            let r = depth * 0.62;
            m.lathe([0.0, 0.0], &[[r - 0.01, height - 0.05], [r, height - 0.04], [r, height]], 20, paint);
            splayed_legs(&mut m, [r * 1.7, r * 1.7], height - 0.04, 0.02, paint);
            Piece::new("table", m, said(tint, "wooden", "low", "round"))
        }
        _ => {
            m.block(about(0.0, width), [height - 0.12, height], about(0.0, depth), paint);
            m.pair([width / 2.0 - 0.06, width / 2.0], [0.0, height - 0.12], about(0.0, depth), paint);
            let panel = paint.times(0.85);
            m.block(
                about(0.0, width * 0.4),
                [height - 0.1, height - 0.02],
                [depth / 2.0, depth / 2.0 + 0.01],
                panel,
            );
            Piece::new("table", m, said(tint, "wooden", "low", "rectangular"))
        }
    }
}

/// A small table for the side of a sofa or a bath.
pub(in crate::procedural) fn side_table(taste: &mut Taste) -> Piece {
    let metal = taste.rng.chance(0.4);
    let tint =
        taste.tint("table", if metal { &["black", "white", "grey", "red", "yellow", "teal"] } else { WOOD });
    let paint = if metal { Paint::metal(tint) } else { Paint::wood(tint) };
    let (size, height) = (taste.length_m(0.4, 0.5), taste.length_m(0.5, 0.6));
    let mut m = Model::new();
    let round = metal || taste.rng.chance(0.5);
    if round {
        let r = size / 2.0;
        m.lathe([0.0, 0.0], &[[r, height - 0.03], [r, height]], 16, paint);
        m.lathe(
            [0.0, 0.0],
            &[[r * 0.7, 0.0], [r * 0.7, 0.02], [0.025, 0.05], [0.025, height - 0.02]],
            12,
            paint,
        );
    } else {
        m.block(about(0.0, size), [height - 0.03, height], about(0.0, size), paint);
        m.block(about(0.0, size - 0.06), [0.16, 0.18], about(0.0, size - 0.06), paint);
        legs(&mut m, [size, size], height - 0.03, 0.04, 0.0, paint);
    }
    let material = if metal { "metal" } else { "wooden" };
    Piece::new("table", m, said(tint, material, "small", if round { "round" } else { "square" }))
}

/// A desk with drawers on one side.
pub(in crate::procedural) fn desk(taste: &mut Taste) -> Piece {
    let tint = taste.tint("table", WOOD);
    let paint = Paint::wood(tint);
    let (width, depth, height) = (taste.length_m(1.15, 1.45), taste.length_m(0.58, 0.66), 0.74);
    let mut m = Model::new();
    m.block(about(0.0, width), [height - 0.03, height], about(0.0, depth), paint);
    let side = if taste.rng.chance(0.5) { 1.0 } else { -1.0 };
    let x = about(side * (width / 2.0 - 0.2), 0.38);
    m.block(x, [0.05, height - 0.03], [-depth / 2.0 + 0.02, depth / 2.0 - 0.04], paint);
    let looks = Fronts { panel: paint.times(1.06), handle: Paint::STEEL, doors: false };
    fronts(&mut m, x, [0.06, height - 0.04], depth / 2.0 - 0.04, [1, 3], &looks);
    m.block(x, [0.0, 0.05], about(0.0, depth - 0.16), paint.times(0.7));
    let far = about(-side * (width / 2.0 - 0.03), 0.05);
    m.block(far, [0.0, height - 0.03], about(0.0, depth - 0.06), paint);
    m.block(
        about(0.0, width - 0.1),
        [height - 0.3, height - 0.03],
        [-depth / 2.0 + 0.02, -depth / 2.0 + 0.04],
        paint,
    );
    Piece::new("table", m, said(tint, "wooden", "large", "rectangular"))
}
