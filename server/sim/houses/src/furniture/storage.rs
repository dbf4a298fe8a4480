//! Storage: cabinets, wardrobes, chests of drawers; shelves and their contents.

use super::*;

const FACES: &[Substance] = &[Wood, Wood, Metal, Plastic, Bamboo, Wicker, Glass];

pub(crate) const WARDROBE: FurnitureKind =
    FurnitureKind::new("cabinet", "wardrobe", 5, wardrobe).made_of(FACES, styles::WOOD);
pub(crate) const SIDEBOARD: FurnitureKind =
    FurnitureKind::new("cabinet", "sideboard", 8, sideboard).made_of(FACES, styles::WOOD);
pub(crate) const TV_STAND: FurnitureKind =
    FurnitureKind::new("cabinet", "tv stand", 4, tv_stand).made_of(FACES, styles::WOOD);

/// Base at y = 0.
pub(crate) const WALL_CABINET: FurnitureKind =
    FurnitureKind::new("cabinet", "wall cabinet", 4, wall_cabinet).made_of(FACES, styles::WOOD);

/// A low cabinet below a basin.
pub(crate) const VANITY: FurnitureKind =
    FurnitureKind::new("cabinet", "vanity", 4, vanity).made_of(FACES, styles::WOOD);

/// A tall cabinet with glass doors, or a locker.
pub(crate) const TALL_CABINET: FurnitureKind = FurnitureKind::new("cabinet", "", 4, tall_cabinet)
    .made_of(&[Wood, Wood, Metal, Metal, Plastic, Bamboo, Wicker], styles::WOOD);

fn wardrobe(k: &mut Draft) -> Words {
    let (w, h, d) = (k.width(0.9, 1.5), k.len(1.85, 2.2), k.len(0.52, 0.62));
    let columns = if w > 1.25 { 3 } else { 2 };
    let size = size_word(w, 1.0, 1.3, ["narrow", "wide"]);
    match k.style {
        0 => carcass(k, &Carcass { size: [w, h, d], feet: 0.06, cells: [columns, 1], doors: true }),
        1 => {
            carcass(k, &Carcass { size: [w, h, d], feet: 0.12, cells: [columns, 1], doors: true });
            let looks = Fronts { panel: k.paint.times(0.95), handle: handle(k), doors: false };
            fronts(&mut k.model, about(0.0, w - 0.02), [0.14, 0.46], d / 2.0 + 0.018, [columns, 1], &looks);
        }
        2 => {
            k.board(about(0.0, w), [0.0, h], about(0.0, d));
            for i in 0..2 {
                let x = about((i as f32 - 0.5) * w * 0.48, w * 0.5);
                let z = d / 2.0 + 0.02 * i as f32;
                k.model.lid(x, [0.05, h - 0.04], [z, z + 0.02], k.paint.times(1.03));
                let at = x[0] + 0.05;
                k.model.lid(about(at, 0.03), [0.8, 1.3], [z + 0.02, z + 0.03], Paint::STEEL);
            }
        }
        3 => {
            carcass(k, &Carcass { size: [w, h - 0.1, d], feet: 0.08, cells: [columns, 2], doors: true });
            k.model.soft(about(0.0, w + 0.1), [h - 0.1, h], about(0.02, d + 0.08), 0.03, k.paint);
        }
        _ => {
            carcass(k, &Carcass { size: [w, h, d], feet: 0.06, cells: [2, 1], doors: true });
            let x = w / 4.0 - 0.01;
            let glass = [0.3, h - 0.2];
            k.model.lid(about(x, w * 0.3), glass, [d / 2.0 + 0.018, d / 2.0 + 0.022], Paint::MIRROR);
        }
    }
    [size, k.by_style("||sliding|corniced|mirrored")]
}

fn sideboard(k: &mut Draft) -> Words {
    let size @ [w, h, d] = [k.width(0.8, 1.5), k.len(0.5, 0.88), k.depth(0.36, 0.46)];
    let columns = if w > 1.2 { 3 } else { 2 };
    match k.style {
        0 => carcass(k, &Carcass { size, feet: 0.05, cells: [columns, 1], doors: true }),
        1 => carcass(k, &Carcass { size, feet: 0.15, cells: [columns, 1], doors: true }),
        2 => carcass(k, &Carcass { size, feet: 0.05, cells: [columns, 2], doors: false }),
        3 => carcass(k, &Carcass { size, feet: 0.18, cells: [1, 2], doors: false }),
        4 => {
            k.model.soft(about(0.0, w), [0.12, h], about(0.0, d), 0.04, k.paint);
            k.splayed_legs([w - 0.2, d], 0.13, 0.02, k.trim);
            let looks = Fronts { panel: k.paint.times(0.95), handle: handle(k), doors: true };
            fronts(&mut k.model, about(0.0, w - 0.1), [0.17, h - 0.05], d / 2.0, [columns, 1], &looks);
        }
        5 => {
            let outline = oval([0.0, 0.0], [w / 2.0, d / 2.0], 16);
            k.model.prism_y(&outline, [0.08, h], k.paint);
            k.legs([w * 0.7, d * 0.7], 0.08, 0.05, 0.0, k.trim);
            for x in [-0.05, 0.05] {
                let z = [d / 2.0 - 0.005, d / 2.0 + 0.025];
                k.model.lid(about(x, 0.02), about(h * 0.55, 0.14), z, Paint::BRASS);
            }
        }
        6 => carcass(k, &Carcass { size, feet: 0.05, cells: [4, 1], doors: true }),
        _ => {
            k.model.pair([w / 2.0 - 0.03, w / 2.0], [0.0, h], about(0.0, d), k.paint);
            for y in [0.06, h * 0.5, h - 0.03] {
                k.board(about(0.0, w - 0.06), [y, y + 0.03], about(0.0, d));
            }
            k.board(about(0.0, w - 0.06), [0.06, h], [-d / 2.0, -d / 2.0 + 0.015]);
        }
    }
    let shape = k.by_style("plain|legged|drawered|legged|rounded|oval|panelled|open");
    [size_word(h, 0.62, 0.78, ["low", "tall"]), shape]
}

fn tv_stand(k: &mut Draft) -> Words {
    let (w, h, d) = (k.width(1.1, 1.6), k.len(0.38, 0.56), 0.4);
    match k.style {
        0 => {
            k.legs([w, d], 0.1, 0.05, 0.03, k.paint.times(0.85));
            k.board(about(0.0, w), [0.1, h - 0.16], about(0.0, d));
            k.board(about(0.0, w), [h - 0.03, h], about(0.0, d));
            k.model.pair([w / 2.0 - 0.03, w / 2.0], [h - 0.16, h - 0.03], about(0.0, d), k.paint);
            k.board(about(0.0, w - 0.06), [h - 0.16, h - 0.03], [-d / 2.0, -d / 2.0 + 0.02]);
            let looks = Fronts { panel: k.paint.times(1.04), handle: handle(k), doors: false };
            fronts(&mut k.model, about(0.0, w - 0.04), [0.12, h - 0.18], d / 2.0, [2, 1], &looks);
        }
        1 => carcass(k, &Carcass { size: [w, h, d], feet: 0.12, cells: [3, 1], doors: true }),
        2 => carcass(k, &Carcass { size: [w, h, d], feet: 0.04, cells: [2, 2], doors: false }),
        _ => {
            k.model.soft(about(0.0, w), [0.1, h], about(0.0, d), 0.05, k.paint);
            k.legs([w - 0.2, d], 0.1, 0.04, 0.0, Paint::DARK_METAL);
            let z = [d / 2.0, d / 2.0 + 0.012];
            k.model.lid(about(0.0, w * 0.4), [0.16, h - 0.06], z, k.paint.times(0.85));
        }
    }
    [size_word(w, 1.25, 1.45, ["short", "long"]), k.by_style("open|legged|drawered|rounded")]
}

fn wall_cabinet(k: &mut Draft) -> Words {
    let (w, h, d) = (k.width(0.45, 1.2), k.height(0.5, 0.72), k.depth(0.28, 0.34));
    let columns = ((w / 0.45).round() as usize).max(1);
    let p = k.paint;
    k.board(about(0.0, w), [0.0, h], about(0.0, d));
    let looks = Fronts { panel: p.times(1.04), handle: handle(k), doors: true };
    let (x, y) = (about(0.0, w - 0.01), [0.01, h - 0.01]);
    match k.style {
        0 => fronts(&mut k.model, x, y, d / 2.0, [columns, 1], &looks),
        1 => fronts(&mut k.model, x, y, d / 2.0, [columns, 2], &looks),
        2 => {
            fronts(&mut k.model, x, y, d / 2.0, [columns, 1], &Fronts { handle: Paint::DARK_METAL, ..looks });
            let glass = [h * 0.3, h * 0.85];
            k.model.lid(about(0.0, w * 0.6), glass, [d / 2.0 + 0.018, d / 2.0 + 0.022], Paint::PANE);
        }
        _ => {
            k.model.soft(about(0.0, w + 0.04), [h, h + 0.05], about(0.01, d + 0.05), 0.015, p.times(0.97));
            fronts(&mut k.model, x, y, d / 2.0, [columns, 1], &Fronts { doors: false, ..looks });
        }
    }
    [size_word(w, 0.6, 1.0, ["small", "long"]), k.by_style("|panelled|glazed|corniced")]
}

fn vanity(k: &mut Draft) -> Words {
    let (w, h, d) = (k.width(0.6, 0.95), k.len(0.66, 0.74), 0.46);
    let cells = [[2, 1], [1, 2], [2, 2], [2, 1]][k.style];
    let feet = [0.06, 0.14, 0.06, 0.2][k.style];
    let doors = k.style != 1 && k.style != 2;
    carcass(k, &Carcass { size: [w, h, d], feet, cells, doors });
    [size_word(w, 0.7, 0.85, ["small", "wide"]), k.by_style("|legged|drawered|legged")]
}

fn tall_cabinet(k: &mut Draft) -> Words {
    let (w, h, d) = (k.width(0.55, 0.95), k.len(1.4, 1.95), k.depth(0.34, 0.44));
    let size = size_word(h, 1.55, 1.8, ["low", "tall"]);
    let p = k.paint;
    match k.style {
        0 | 1 => {
            carcass(k, &Carcass { size: [w, h, d], feet: [0.05, 0.16][k.style], cells: [2, 1], doors: true });
            let z = [d / 2.0 + 0.018, d / 2.0 + 0.022];
            for x in [-w / 4.0, w / 4.0] {
                k.model.lid(about(x + 0.01, w * 0.3), [h * 0.5, h - 0.14], z, Paint::PANE);
            }
        }
        2 => {
            carcass(k, &Carcass { size: [w, h, d], feet: 0.04, cells: [2, 3], doors: true });
            k.noun = "locker";
        }
        _ => {
            k.board(about(0.0, w), [0.0, h * 0.45], about(0.0, d));
            let looks = Fronts { panel: p.times(1.04), handle: handle(k), doors: true };
            fronts(&mut k.model, about(0.0, w), [0.04, h * 0.45 - 0.02], d / 2.0, [2, 1], &looks);
            k.model.pair([w / 2.0 - 0.03, w / 2.0], [h * 0.45, h], about(-0.04, d - 0.08), p);
            for y in [h * 0.7, h - 0.03] {
                k.board(about(0.0, w - 0.06), [y, y + 0.03], about(-0.04, d - 0.08));
            }
            k.board(about(0.0, w - 0.06), [h * 0.45, h], [-d / 2.0, -d / 2.0 + 0.015]);
        }
    }
    [size, k.by_style("glazed|glazed|panelled|open")]
}

const CHEST_FACES: &[Substance] = &[Wood, Wood, Metal, Plastic, Wicker, Bamboo, Leather];

pub(crate) const CHEST: FurnitureKind =
    FurnitureKind::new("chest_of_drawers", "", 8, chest).made_of(CHEST_FACES, styles::WOOD);
pub(crate) const NIGHTSTAND: FurnitureKind =
    FurnitureKind::new("chest_of_drawers", "nightstand", 5, nightstand).made_of(CHEST_FACES, styles::WOOD);

fn chest(k: &mut Draft) -> Words {
    let (w, d) = (k.width(0.78, 1.25), k.len(0.42, 0.5));
    let rows = 3 + k.rng.below(3);
    let p = k.paint;
    let rows = if k.style == 5 { rows.min(4) } else { rows };
    let (feet, columns, step) = match k.style {
        0 => (0.04, 1, 0.19),
        1 => (0.13, 1, 0.19),
        2 => (0.05, 2, 0.18),
        3 => (0.16, 2, 0.17),
        4 => (0.04, 1, 0.17),
        5 => (0.04, 3, 0.15),
        6 => (0.2, 1, 0.15),
        _ => (0.06, 2, 0.2),
    };
    let h = feet + 0.04 + step * rows as f32;
    carcass(k, &Carcass { size: [w, h, d], feet, cells: [columns, rows], doors: false });
    match k.style {
        4 => k.model.soft(about(0.0, w + 0.06), [h, h + 0.04], about(0.01, d + 0.08), 0.015, p),
        7 => k.model.pair([w / 2.0, w / 2.0 + 0.04], [0.0, h], about(0.0, d + 0.03), p),
        1 | 3 | 6 => {}
        5 => {}
        _ => {}
    }
    let shape = k.by_style("plain|legged|plain|legged|corniced|many-drawered|legged|framed");
    [size_word(h, 0.72, 0.95, ["low", "tall"]), shape]
}

fn nightstand(k: &mut Draft) -> Words {
    let (w, h, d) = (k.len(0.4, 0.54), k.len(0.46, 0.64), 0.38);
    let size = size_word(h, 0.51, 0.58, ["low", "tall"]);
    let p = k.paint;
    match k.style {
        0 => carcass(k, &Carcass { size: [w, h, d], feet: 0.04, cells: [1, 2], doors: false }),
        1 => carcass(k, &Carcass { size: [w, h, d], feet: 0.16, cells: [1, 1], doors: false }),
        2 => carcass(k, &Carcass { size: [w, h, d], feet: 0.04, cells: [1, 3], doors: false }),
        3 => {
            k.model.pair([w / 2.0 - 0.03, w / 2.0], [0.0, h - 0.03], about(0.0, d), p);
            k.board(about(0.0, w - 0.06), [0.08, 0.11], about(0.0, d));
            k.board(about(0.0, w - 0.06), [h - 0.2, h - 0.03], about(0.0, d));
            k.board(about(0.0, w), [h - 0.03, h], about(0.0, d));
            let looks = Fronts { panel: p.times(1.04), handle: handle(k), doors: false };
            fronts(&mut k.model, about(0.0, w - 0.08), [h - 0.19, h - 0.04], d / 2.0, [1, 1], &looks);
        }
        _ => {
            k.model.lathe([0.0, 0.0], &[[w / 2.0 - 0.02, 0.0], [w / 2.0, 0.03], [w / 2.0, h]], 16, p);
            let z = [w / 2.0 - 0.01, w / 2.0 + 0.02];
            k.model.lid(about(0.0, 0.12), about(h * 0.6, 0.02), z, Paint::BRASS);
        }
    }
    [size, k.by_style("plain|legged|plain|open|round")]
}

pub(crate) const BOOKCASE: FurnitureKind = FurnitureKind::new("shelving", "bookcase", 8, bookcase)
    .made_of(&[Wood, Wood, Metal, Bamboo, Plastic, Glass, Wicker], styles::WOOD);

/// A wall shelf; base at y = 0.
pub(crate) const WALL_SHELF: FurnitureKind = FurnitureKind::new("shelving", "wall shelf", 4, wall_shelf)
    .made_of(&[Wood, Metal, Glass, Bamboo, Plastic, Marble], styles::WOOD);

/// Adds books or another object on a board.
fn filled(k: &mut Draft, x: Span, y: f32, z: Span) {
    let room = x[1] - x[0];
    match k.rng.below(5) {
        0 | 1 => {
            let end = x[0] + room * k.rng.range(0.45, 0.95);
            books_row(k, [x[0], end], y, z);
        }
        2 => {
            let paint = k.trim;
            let x = about((x[0] + x[1]) / 2.0, room * 0.6);
            k.model.block(x, [y, y + 0.18], [z[0] + 0.03, z[1] - 0.02], paint);
        }
        3 => {
            let r = 0.06;
            let center = [x[0] + room * k.rng.range(0.3, 0.7), (z[0] + z[1]) / 2.0];
            let profile = [[0.7, 0.0], [1.0, 0.08], [0.5, 0.2]];
            k.model.lathe(center, &profile.map(|[s, up]| [s * r, y + up]), 6, k.trim);
        }
        _ => {}
    }
}

/// Adds books as a single block with drawn spines.
fn books_row(k: &mut Draft, x: Span, y: f32, z: Span) {
    let height = k.len(0.19, 0.25);
    let spines = Paint::plain("paper", [255; 3]).with(Pattern::Books(k.rng.below(12) as u8));
    let ([x0, x1], [back, front], high) = (x, [z[0] + 0.02, z[1] - 0.05], y + height);
    let pages = Paint::plain("paper", [132, 124, 108]);
    let mut m = Model::new();
    m.picture(
        [point(x0, y, front), point(x1, y, front), point(x1, high, front), point(x0, high, front)],
        spines,
    );
    m.quad(
        [point(x0, high, front), point(x1, high, front), point(x1, high, back), point(x0, high, back)],
        pages,
    );
    m.quad([point(x1, y, front), point(x1, y, back), point(x1, high, back), point(x1, high, front)], pages);
    m.quad([point(x0, y, back), point(x0, y, front), point(x0, high, front), point(x0, high, back)], pages);
    k.model.add(&m, 0, Vector3::zeros());
}

fn bookcase(k: &mut Draft) -> Words {
    let (w, d) = (k.width(0.7, 1.15), k.depth(0.28, 0.34));
    let levels = match k.style {
        2 => 2,
        5 => 3,
        _ => 3 + k.rng.below(3),
    };
    let h = k.height(0.08 + 0.34 * levels as f32, 0.1 + 0.38 * levels as f32);
    let size = size_word(h, 1.15, 1.65, ["low", "tall"]);
    let z = about(0.0, d);
    let shelf_at = |level: usize| 0.04 + (h - 0.07) * level as f32 / levels as f32;
    match k.style {
        3 => k.legs([w, d], h, 0.03, 0.0, k.trim),
        4 => {
            for side in [-1.0, 1.0] {
                let x = side * (w / 2.0 - 0.02);
                k.model.rod(point(x, 0.0, d / 2.0 - 0.02), point(x, h, -d / 2.0 + 0.04), 0.02, k.trim);
                k.model.rod(point(x, 0.0, -d / 2.0 + 0.02), point(x, h, -d / 2.0 + 0.02), 0.02, k.trim);
            }
        }
        _ => k.model.pair([w / 2.0 - 0.03, w / 2.0], [0.0, h], z, k.paint),
    }
    if !matches!(k.style, 3 | 4 | 6) {
        k.board(about(0.0, w - 0.06), [0.04, h], [-d / 2.0, -d / 2.0 + 0.015]);
    }
    for level in 0..=levels {
        let y = shelf_at(level);
        let depth = if k.style == 4 { d * (1.0 - 0.5 * level as f32 / levels as f32) } else { d };
        let z = [-d / 2.0, -d / 2.0 + depth - 0.01];
        k.board(about(0.0, w - 0.06), [y, y + 0.03], z);
        if level < levels {
            match k.style {
                5 => {
                    k.board(about(0.0, 0.025), [y + 0.03, shelf_at(level + 1)], z);
                    filled(k, [-w / 2.0 + 0.05, -0.03], y + 0.03, z);
                    filled(k, [0.03, w / 2.0 - 0.05], y + 0.03, z);
                }
                _ => filled(k, [-w / 2.0 + 0.05, w / 2.0 - 0.05], y + 0.03, z),
            }
        }
    }
    if k.style == 1 {
        k.model.block(about(0.0, w + 0.05), [h - 0.02, h + 0.03], about(0.01, d + 0.04), k.paint);
    }
    if k.style == 7 {
        k.model.prism_z(&arch(w, h, h + 0.12), [-d / 2.0, -d / 2.0 + 0.03], k.paint);
    }
    [size, k.by_style("||low|framed|leaning|cubed|open|arched")]
}

fn wall_shelf(k: &mut Draft) -> Words {
    let (w, d) = (k.width(0.5, 1.1), 0.22);
    let p = k.paint;
    let z = about(0.0, d);
    k.model.soft(about(0.0, w), [0.1, 0.13], z, 0.005, p);
    match k.style {
        0 => {
            for x in [-w * 0.35, w * 0.35] {
                k.model.prism_x(&[[d / 2.0, 0.0], [d / 2.0, 0.1], [-d / 4.0, 0.1]], about(x, 0.02), k.trim);
            }
        }
        1 => {
            k.model.pair([w / 2.0 - 0.02, w / 2.0], [0.0, 0.34], z, p);
            k.board(about(0.0, w), [0.34, 0.36], z);
        }
        2 => {
            k.board(about(0.0, w), [0.4, 0.43], z);
            k.model.pair([w * 0.36, w * 0.38], [0.0, 0.46], [-d / 2.0, -d / 2.0 + 0.02], Paint::DARK_METAL);
        }
        _ => k.board(about(0.0, w), [0.0, 0.1], [-d / 2.0, -d / 2.0 + 0.02]),
    }
    let shape = k.by_style("bracketed|box-shaped|double|plain");
    filled(k, [-w / 2.0 + 0.04, w / 2.0 - 0.04], 0.13, z);
    [size_word(w, 0.65, 0.95, ["short", "long"]), shape]
}
