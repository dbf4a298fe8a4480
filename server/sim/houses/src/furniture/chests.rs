//! Chests of drawers.

use super::parts::*;
use super::*;
use Substance::*;

const FACES: &[Substance] = &[Wood, Wood, Metal, Plastic, Wicker, Bamboo, Leather];

/// A chest of drawers.
pub(crate) const CHEST: Make = Make {
    category: "chest_of_drawers",
    noun: "",
    styles: 8,
    substances: FACES,
    colors: taste::WOOD,
    draw: chest,
};

/// A small chest for the side of a bed.
pub(crate) const NIGHTSTAND: Make = Make {
    category: "chest_of_drawers",
    noun: "nightstand",
    styles: 5,
    substances: FACES,
    colors: taste::WOOD,
    draw: nightstand,
};

fn chest(k: &mut Draft) -> Words {
    let (w, d) = (k.width(0.78, 1.25), k.len(0.42, 0.5));
    let rows = 3 + k.rng.below(3);
    let p = k.p;
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
    let shape = match k.style {
        4 => {
            k.m.soft(about(0.0, w + 0.06), [h, h + 0.04], about(0.01, d + 0.08), 0.015, p);
            "corniced"
        }
        7 => {
            k.m.pair([w / 2.0, w / 2.0 + 0.04], [0.0, h], about(0.0, d + 0.03), p);
            "framed"
        }
        1 | 3 | 6 => "legged",
        5 => "many-drawered",
        _ => "plain",
    };
    [size_word(h, 0.72, 0.95, ["low", "tall"]), shape]
}

fn nightstand(k: &mut Draft) -> Words {
    let (w, h, d) = (k.len(0.4, 0.54), k.len(0.46, 0.64), 0.38);
    let size = size_word(h, 0.51, 0.58, ["low", "tall"]);
    let p = k.p;
    let shape = match k.style {
        0 => {
            carcass(k, &Carcass { size: [w, h, d], feet: 0.04, cells: [1, 2], doors: false });
            "plain"
        }
        1 => {
            carcass(k, &Carcass { size: [w, h, d], feet: 0.16, cells: [1, 1], doors: false });
            "legged"
        }
        2 => {
            carcass(k, &Carcass { size: [w, h, d], feet: 0.04, cells: [1, 3], doors: false });
            "plain"
        }
        3 => {
            k.m.pair([w / 2.0 - 0.03, w / 2.0], [0.0, h - 0.03], about(0.0, d), p);
            k.board(about(0.0, w - 0.06), [0.08, 0.11], about(0.0, d));
            k.board(about(0.0, w - 0.06), [h - 0.2, h - 0.03], about(0.0, d));
            k.board(about(0.0, w), [h - 0.03, h], about(0.0, d));
            let looks = Fronts { panel: p.times(1.04), handle: handle(k), doors: false };
            fronts(&mut k.m, about(0.0, w - 0.08), [h - 0.19, h - 0.04], d / 2.0, [1, 1], &looks);
            "open"
        }
        _ => {
            k.m.lathe([0.0, 0.0], &[[w / 2.0 - 0.02, 0.0], [w / 2.0, 0.03], [w / 2.0, h]], 16, p);
            k.m.lid(about(0.0, 0.12), about(h * 0.6, 0.02), [w / 2.0 - 0.01, w / 2.0 + 0.02], Paint::BRASS);
            "round"
        }
    };
    [size, shape]
}
