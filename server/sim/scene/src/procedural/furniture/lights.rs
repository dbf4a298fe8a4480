//! Lamps.

use super::*;

/// A lamp that hangs from the ceiling at y = 0 (everything below 0).
pub(in crate::procedural) fn pendant(taste: &mut Taste) -> Piece {
    let tint = taste.tint("lighting", CLOTH);
    let drop = taste.length_m(0.4, 0.6);
    let mut m = Model::new();
    m.cylinder([0.0, 0.0], [-0.03, 0.0], 0.05, 8, Paint::DARK_METAL);
    m.cylinder([0.0, 0.0], [-drop + 0.18, -0.03], 0.008, 6, Paint::DARK_METAL);
    let profile = match taste.style(3) {
        0 => [[0.22, -drop], [0.18, -drop + 0.1], [0.05, -drop + 0.18], [0.02, -drop + 0.2]],
        1 => [[0.15, -drop], [0.15, -drop + 0.09], [0.15, -drop + 0.18], [0.02, -drop + 0.19]],
        _ => [[0.05, -drop], [0.17, -drop + 0.07], [0.15, -drop + 0.16], [0.02, -drop + 0.22]],
    };
    m.lathe([0.0, 0.0], &profile, 14, Paint::fabric(tint));
    m.lathe([0.0, 0.0], &[[0.04, -drop - 0.01], [0.05, -drop]], 8, Paint::LAMP);
    Piece::new("lighting", m, said(tint, "fabric", "", "round"))
}

/// A standing lamp.
pub(in crate::procedural) fn floor_lamp(taste: &mut Taste) -> Piece {
    let tint = taste.tint("lighting", CLOTH);
    let height = taste.length_m(1.45, 1.7);
    let mut m = Model::new();
    m.lathe([0.0, 0.0], &[[0.14, 0.0], [0.14, 0.02], [0.03, 0.04]], 12, Paint::DARK_METAL);
    m.cylinder([0.0, 0.0], [0.03, height - 0.25], 0.012, 6, Paint::DARK_METAL);
    m.lathe([0.0, 0.0], &[[0.2, height - 0.3], [0.14, height]], 14, Paint::fabric(tint));
    Piece::new("lighting", m, said(tint, "fabric", "tall", "round"))
}

/// A lamp for a table or nightstand.
pub(in crate::procedural) fn table_lamp(taste: &mut Taste) -> Piece {
    let tint = taste.tint("lighting", CLOTH);
    let height = taste.length_m(0.36, 0.46);
    let foot = Paint::ceramic(Tint::plain("white"));
    let mut m = Model::new();
    m.lathe([0.0, 0.0], &[[0.07, 0.0], [0.08, 0.05], [0.03, 0.16], [0.012, height - 0.18]], 10, foot);
    m.lathe([0.0, 0.0], &[[0.13, height - 0.2], [0.09, height]], 12, Paint::fabric(tint));
    Piece::new("lighting", m, said(tint, "fabric", "small", "round"))
}
