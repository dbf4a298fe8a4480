//! Shelves and their contents.

use super::*;

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
