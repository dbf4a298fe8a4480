//! Cabinets, chests of drawers, shelves.

use super::*;

/// Measures of a box with doors or drawers.
struct Carcass {
    size: [f32; 3],
    feet: f32,
    cells: [usize; 2],
    doors: bool,
}

/// A wooden box with a front of doors or drawers; the front reaches 4 cm out of `size`.
fn carcass(body: &Carcass, paint: Paint, handle: Paint) -> Model {
    let [width, height, depth] = body.size;
    let mut m = Model::new();
    match body.feet {
        feet if feet > 0.09 => legs(&mut m, [width, depth], feet, 0.05, 0.02, paint.times(0.8)),
        feet => m.block(about(0.0, width - 0.06), [0.0, feet], about(-0.02, depth - 0.08), paint.times(0.6)),
    }
    m.block(about(0.0, width), [body.feet, height], about(0.0, depth), paint.times(0.98));
    m.block(
        about(0.0, width + 0.02),
        [height, height + 0.025],
        about(0.005, depth + 0.03),
        paint.times(0.94),
    );
    let looks = Fronts { panel: paint.times(1.05), handle, doors: body.doors };
    let (x, y) = (about(0.0, width - 0.04), [body.feet + 0.02, height - 0.02]);
    fronts(&mut m, x, y, depth / 2.0, body.cells, &looks);
    m
}

fn handle(taste: &mut Taste) -> Paint {
    *taste
        .rng
        .choose(&[Paint::STEEL, Paint::DARK_METAL, Paint::plain("metal", [190, 158, 88])])
        .expect("not empty")
}

/// A wardrobe.
pub(in crate::procedural) fn wardrobe(taste: &mut Taste, width: f32) -> Piece {
    let tint = taste.tint("cabinet", WOOD);
    let (height, depth) = (taste.length_m(1.85, 2.15), taste.length_m(0.52, 0.6));
    let columns = if width > 1.3 { 3 } else { 2 };
    let paint = Paint::wood(tint);
    let handle = handle(taste);
    let drawers = taste.rng.chance(0.4);
    let mut m = carcass(
        &Carcass { size: [width, height, depth], feet: 0.06, cells: [columns, 1], doors: true },
        paint,
        handle,
    );
    if drawers {
        let looks = Fronts { panel: paint.times(0.95), handle, doors: false };
        let x = about(0.0, width - 0.02);
        fronts(&mut m, x, [0.08, 0.42], depth / 2.0 + 0.018, [columns, 1], &looks);
    }
    Piece::new("cabinet", m, said(tint, "wooden", "tall", ""))
}

/// A low and wide cabinet: sideboard, television stand, shoe cabinet.
pub(in crate::procedural) fn sideboard(taste: &mut Taste, width: f32, depth: f32) -> Piece {
    let tint = taste.tint("cabinet", WOOD);
    let height = taste.length_m(0.5, 0.82);
    let feet = if taste.rng.chance(0.5) { 0.14 } else { 0.05 };
    let columns = if width > 1.2 { 3 } else { 2 };
    let handle = handle(taste);
    let rows = 1 + taste.style(2);
    let body = Carcass { size: [width, height, depth], feet, cells: [columns, rows], doors: rows == 1 };
    let m = carcass(&body, Paint::wood(tint), handle);
    Piece::new(
        "cabinet",
        m,
        said(
            tint,
            "wooden",
            size_word(height, 0.65, 0.9, ["low", "tall"]),
            size_word(width, 0.0, 1.2, ["", "long"]),
        ),
    )
}

/// A stand for a television, with an open shelf.
pub(in crate::procedural) fn tv_stand(taste: &mut Taste, width: f32) -> Piece {
    let tint = taste.tint("cabinet", WOOD);
    let paint = Paint::wood(tint);
    let (height, depth) = (taste.length_m(0.4, 0.52), 0.4);
    let mut m = Model::new();
    legs(&mut m, [width, depth], 0.1, 0.05, 0.03, paint.times(0.8));
    m.block(about(0.0, width), [0.1, height - 0.16], about(0.0, depth), paint);
    m.block(about(0.0, width), [height - 0.03, height], about(0.0, depth), paint);
    m.block(
        about(0.0, width),
        [height - 0.16, height - 0.03],
        [-depth / 2.0, -depth / 2.0 + 0.02],
        paint.times(0.7),
    );
    m.pair([width / 2.0 - 0.03, width / 2.0], [height - 0.16, height - 0.03], about(0.0, depth), paint);
    m.block(about(0.0, 0.03), [height - 0.16, height - 0.03], about(0.0, depth), paint);
    let looks = Fronts { panel: paint.times(1.05), handle: handle(taste), doors: false };
    fronts(&mut m, about(0.0, width - 0.04), [0.12, height - 0.18], depth / 2.0, [2, 1], &looks);
    Piece::new("cabinet", m, said(tint, "wooden", "low", "long"))
}

/// A cabinet that hangs on a wall; its base is on y = 0.
pub(in crate::procedural) fn wall_cabinet(taste: &mut Taste, tint: Tint, width: f32) -> Piece {
    let mut m = Model::new();
    let paint = Paint::wood(tint);
    let (height, depth) = (0.62, 0.33);
    m.block(about(0.0, width), [0.0, height], about(0.0, depth), paint);
    let looks = Fronts { panel: paint.times(1.05), handle: handle(taste), doors: true };
    let columns = ((width / 0.45).round() as usize).max(1);
    fronts(&mut m, about(0.0, width - 0.01), [0.01, height - 0.01], depth / 2.0, [columns, 1], &looks);
    Piece::new("cabinet", m, said(tint, "wooden", size_word(width, 0.6, 1.1, ["small", "long"]), ""))
}

/// A chest of drawers.
pub(in crate::procedural) fn chest_of_drawers(taste: &mut Taste) -> Piece {
    let tint = taste.tint("chest_of_drawers", WOOD);
    let (width, depth) = (taste.length_m(0.8, 1.15), taste.length_m(0.42, 0.48));
    let rows = 3 + taste.style(3);
    let height = 0.16 + 0.19 * rows as f32;
    let feet = if taste.rng.chance(0.5) { 0.12 } else { 0.04 };
    let columns = if width > 1.0 { 2 } else { 1 };
    let handle = handle(taste);
    let body = Carcass { size: [width, height, depth], feet, cells: [columns, rows], doors: false };
    let m = carcass(&body, Paint::wood(tint), handle);
    Piece::new("chest_of_drawers", m, said(tint, "wooden", size_word(height, 0.8, 1.0, ["low", "tall"]), ""))
}

/// A small chest of drawers for the side of a bed.
pub(in crate::procedural) fn nightstand(taste: &mut Taste) -> Piece {
    let tint = taste.tint("chest_of_drawers", WOOD);
    let (width, height) = (taste.length_m(0.4, 0.5), taste.length_m(0.48, 0.58));
    let feet = if taste.rng.chance(0.6) { 0.14 } else { 0.04 };
    let handle = handle(taste);
    let body = Carcass { size: [width, height, 0.38], feet, cells: [1, 2], doors: false };
    let m = carcass(&body, Paint::wood(tint), handle);
    Piece::new("chest_of_drawers", m, said(tint, "wooden", "small", ""))
}

/// An open shelf with books.
pub(in crate::procedural) fn bookshelf(taste: &mut Taste) -> Piece {
    let tint = taste.tint("shelving", WOOD);
    let paint = Paint::wood(tint);
    let (width, depth) = (taste.length_m(0.7, 1.1), 0.32);
    let levels = 3 + taste.style(3);
    let height = 0.06 + 0.36 * levels as f32;
    let mut m = Model::new();
    m.pair([width / 2.0 - 0.03, width / 2.0], [0.0, height], about(0.0, depth), paint);
    m.block(about(0.0, width), [0.04, height], [-depth / 2.0, -depth / 2.0 + 0.015], paint);
    for level in 0..=levels {
        let y = 0.04 + (height - 0.065) * level as f32 / levels as f32;
        m.block(about(0.0, width - 0.06), [y, y + 0.025], about(0.0, depth), paint);
        if level < levels {
            books(taste, &mut m, about(0.0, width - 0.08), y + 0.025, depth);
        }
    }
    let size = size_word(height, 1.3, 1.6, ["low", "tall"]);
    Piece::new("shelving", m, said(tint, "wooden", size, ""))
}

/// A row of books of random colours over a part of `x`.
fn books(taste: &mut Taste, m: &mut Model, x: Span, y: f32, depth: f32) {
    let end = x[0] + (x[1] - x[0]) * taste.rng.range(0.45, 0.95);
    let mut at = x[0];
    while at < end {
        let thick = taste.rng.range(0.035, 0.075);
        let color = taste.rng.choose(CLOTH).expect("there are colours");
        let paint = Paint::plain("paper", Tint::plain(color).rgb);
        let height = taste.rng.range(0.18, 0.27);
        m.block([at, at + thick - 0.004], [y, y + height], [-depth / 2.0 + 0.03, depth / 2.0 - 0.09], paint);
        at += thick;
    }
}

/// A low cabinet to carry a basin.
pub(in crate::procedural) fn vanity(taste: &mut Taste) -> Piece {
    let tint = taste.tint("cabinet", WOOD);
    let handle = handle(taste);
    let width = taste.length_m(0.6, 0.85);
    let body = Carcass { size: [width, 0.7, 0.45], feet: 0.12, cells: [2, 1], doors: true };
    let m = carcass(&body, Paint::wood(tint), handle);
    Piece::new("cabinet", m, said(tint, "wooden", "small", ""))
}
