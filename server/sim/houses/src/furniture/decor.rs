//! Small decoration: vases, figures, books, baskets, bins.

use super::parts::*;
use super::*;
use Substance::*;

/// A vase.
pub(crate) const VASE: Make =
    Make::new("vase", "", 8, &[Ceramic, Glass, Metal, Wood, Marble, Concrete, Terrazzo], taste::CLOTH, vase);

/// A small figure.
pub(crate) const STATUE: Make = Make::new(
    "statue",
    "",
    8,
    &[Marble, Metal, Wood, Ceramic, Concrete, Plastic, Glass],
    taste::CLOTH,
    statue,
);

/// A stack or a row of books.
pub(crate) const BOOKS: Make =
    Make::new("books", "", 8, &[Paper, Leather, Fabric, Striped, Checked, Dotted], taste::CLOTH, books);

/// A basket for the floor.
pub(crate) const BASKET: Make =
    Make::new("basket", "", 8, &[Wicker, Fabric, Plastic, Metal, Knit, Bamboo], taste::WOOD, basket);

/// A waste bin.
pub(crate) const BIN: Make =
    Make::new("bin", "", 8, &[Plastic, Metal, Wicker, Wood, Rubber, Leather], taste::MACHINE, bin);

fn turned(k: &mut Draft, profile: &[[f32; 2]], radius: f32, height: f32) {
    let profile: Vec<[f32; 2]> = profile.iter().map(|[s, y]| [s * radius, y * height]).collect();
    k.m.lathe([0.0, 0.0], &profile, 12, k.p);
}

fn vase(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.18, 0.36), k.len(0.06, 0.1));
    let shape = match k.style {
        0 => {
            turned(k, &[[0.6, 0.0], [1.0, 0.35], [0.9, 0.6], [0.4, 0.85], [0.55, 1.0]], r, h);
            "bulbous"
        }
        1 => {
            turned(k, &[[0.7, 0.0], [0.7, 1.0], [0.55, 1.0], [0.55, 0.8]], r, h);
            "cylindrical"
        }
        2 => {
            turned(k, &[[0.4, 0.0], [0.5, 0.5], [1.0, 1.0], [0.9, 1.0]], r, h);
            "conical"
        }
        3 => {
            turned(k, &[[0.5, 0.0], [1.0, 0.3], [0.3, 0.55], [0.25, 1.0], [0.4, 1.05]], r, h);
            "bottle-shaped"
        }
        4 => {
            k.m.soft(about(0.0, r * 1.5), [0.0, h], about(0.0, r * 1.5), 0.012, k.p);
            "square"
        }
        5 => {
            turned(k, &[[0.5, 0.0], [1.1, 0.3], [1.1, 0.5], [0.8, 0.7]], r * 1.2, h);
            "bowl-shaped"
        }
        6 => {
            turned(k, &[[0.7, 0.0], [0.4, 0.2], [0.9, 0.6], [0.5, 0.9], [0.7, 1.0]], r, h);
            for side in [-1.0, 1.0] {
                let at = |s: f32, y: f32| Point3::new(side * s * r, y * h, 0.0);
                k.m.rod(at(0.5, 0.9), at(1.2, 0.75), 0.01, k.p);
                k.m.rod(at(1.2, 0.77), at(0.85, 0.55), 0.01, k.p);
            }
            "handled"
        }
        _ => {
            k.m.prism_y(&circle([0.0, 0.0], r, 6), [0.0, h], k.p);
            "hexagonal"
        }
    };
    [size_word(k.m.bounds().size().y, 0.23, 0.3, ["small", "tall"]), shape]
}

fn statue(k: &mut Draft) -> Words {
    let h = k.len(0.2, 0.42);
    let p = k.p;
    let plinth = about(0.0, h * 0.4);
    k.m.block(plinth, [0.0, h * 0.08], plinth, p.times(0.95));
    let ball = |k: &mut Draft, [x, y]: [f32; 2], r: f32| {
        let profile = [[0.3, -0.95], [0.85, -0.5], [1.0, 0.0], [0.85, 0.5], [0.3, 0.95]];
        k.m.lathe([x, 0.0], &profile.map(|[s, up]| [s * r, y + up * r]), 9, p);
    };
    let shape = match k.style {
        0 => {
            turned(k, &[[0.16, 0.08], [0.2, 0.3], [0.13, 0.62], [0.18, 0.72], [0.05, 0.8]], h, h);
            ball(k, [0.0, h * 0.88], h * 0.1);
            "human"
        }
        1 => {
            ball(k, [0.0, h * 0.5], h * 0.36);
            "spherical"
        }
        2 => {
            k.m.prism_y(&circle([0.0, 0.0], h * 0.16, 4), [h * 0.08, h * 0.8], p);
            k.m.lathe([0.0, 0.0], &[[h * 0.15, h * 0.8], [0.0, h]], 4, p);
            "obelisk-shaped"
        }
        3 => {
            k.m.soft(about(0.0, h * 0.6), [h * 0.3, h * 0.6], about(0.0, h * 0.22), 0.02, p);
            legs(&mut k.m, [h * 0.56, h * 0.2], h * 0.34, h * 0.08, 0.0, p);
            k.m.rod(Point3::new(h * 0.22, h * 0.5, 0.0), Point3::new(h * 0.34, h * 0.85, 0.0), h * 0.07, p);
            ball(k, [h * 0.38, h * 0.88], h * 0.1);
            "four-legged"
        }
        4 => {
            k.m.lathe([0.0, 0.0], &[[h * 0.26, h * 0.08], [0.0, h]], 14, p);
            "conical"
        }
        5 => {
            for i in 0..3 {
                let y = h * (0.22 + 0.26 * i as f32);
                ball(k, [0.0, y], h * (0.2 - 0.05 * i as f32));
            }
            "stacked"
        }
        6 => {
            let points = [[0.0, 0.1], [0.3, 0.4], [0.2, 0.75], [0.0, 1.0], [-0.2, 0.75], [-0.3, 0.4]];
            k.m.prism_z(&points.map(|[x, y]| [x * h, y * h]), about(0.0, h * 0.14), p);
            "leaf-shaped"
        }
        _ => {
            let outer = circle([0.0, h * 0.55], h * 0.42, 12);
            for i in 0..12 {
                let (a, b) = (outer[i], outer[(i + 1) % 12]);
                k.m.rod(Point3::new(a[0], a[1], 0.0), Point3::new(b[0], b[1], 0.0), h * 0.06, p);
            }
            "ring-shaped"
        }
    };
    [size_word(h, 0.27, 0.35, ["small", "tall"]), shape]
}

fn books(k: &mut Draft) -> Words {
    let p = k.p;
    let pages = Paint::plain("paper", [176, 170, 152]);
    let pages = if k.dark() { pages.times(0.4) } else { pages };
    let flat = |k: &mut Draft, x: f32, y: f32, size: [f32; 2], thick: f32, shade: f32| {
        k.m.block(about(x, size[0]), [y, y + thick * 0.2], about(0.0, size[1]), p.times(shade));
        k.m.block(
            about(x, size[0] - 0.012),
            [y + thick * 0.2, y + thick * 0.8],
            about(0.0, size[1] - 0.012),
            pages,
        );
        k.m.block(about(x, size[0]), [y + thick * 0.8, y + thick], about(0.0, size[1]), p.times(shade));
    };
    let upright = |k: &mut Draft, count: usize, lean: bool| {
        for i in 0..count {
            let shade = [1.0, 0.92, 1.05][i % 3];
            let h = k.len(0.18, 0.26);
            let x = (i as f32 - count as f32 / 2.0) * 0.042;
            let depth = if lean { 0.13 } else { 0.16 };
            k.m.block([x, x + 0.038], [0.0, h], about(0.0, depth), p.times(shade));
        }
    };
    match k.style {
        0 | 1 => {
            let count = [2, 4][k.style];
            for i in 0..count {
                let (w, d) = (k.len(0.2, 0.26), k.len(0.15, 0.19));
                flat(k, 0.0, 0.036 * i as f32, [w, d], 0.035, [1.0, 0.94][i % 2]);
            }
            [["low", "tall"][k.style], "stacked"]
        }
        2 | 3 => {
            let count = [4, 7][k.style - 2];
            upright(k, count, false);
            [["short", "long"][k.style - 2], "upright"]
        }
        4 => {
            flat(k, 0.0, 0.0, [0.3, 0.22], 0.04, 1.0);
            flat(k, 0.02, 0.04, [0.22, 0.16], 0.03, 0.95);
            ["large", "stacked"]
        }
        5 => {
            let half = [[0.0, 0.0], [0.18, 0.0], [0.17, 0.04], [0.0, 0.015]];
            k.m.prism_z(&half, about(0.0, 0.22), p);
            k.m.prism_z(&[half[1], half[0], half[3], half[2]].map(|[x, y]| [-x, y]), about(0.0, 0.22), p);
            k.m.block(about(0.0, 0.03), [0.0, 0.02], about(0.0, 0.22), p);
            ["", "open"]
        }
        6 => {
            upright(k, 5, true);
            k.m.pair([0.12, 0.15], [0.0, 0.16], about(0.0, 0.12), Paint::DARK_METAL);
            ["", "propped"]
        }
        _ => {
            k.m.soft(about(0.0, 0.26), [0.0, 0.16], about(0.0, 0.2), 0.01, p);
            ["", "boxed"]
        }
    }
}

fn basket(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.24, 0.55), k.len(0.17, 0.24));
    let p = k.p;
    let shape = match k.style {
        0 | 1 => {
            let low = [0.8, 0.95][k.style];
            turned(k, &[[low, 0.0], [1.0, 1.0], [0.92, 1.0], [0.85, 0.7], [0.0, 0.65]], r, h);
            ["round", "cylindrical"][k.style]
        }
        2 | 3 => {
            let w = [2.0, 2.6][k.style - 2] * r;
            let d = 1.8 * r;
            k.board(about(0.0, w - 0.03), [0.0, h * 0.7], about(0.0, d - 0.03));
            k.m.pair([w / 2.0 - 0.02, w / 2.0], [0.0, h], about(0.0, d), p);
            k.board(about(0.0, w - 0.04), [0.0, h], [d / 2.0 - 0.02, d / 2.0]);
            k.board(about(0.0, w - 0.04), [0.0, h], [-d / 2.0, -d / 2.0 + 0.02]);
            ["square", "rectangular"][k.style - 2]
        }
        4 => {
            turned(k, &[[0.7, 0.0], [1.1, 0.5], [0.85, 1.0], [0.75, 0.9]], r, h);
            "bulging"
        }
        5 => {
            turned(k, &[[0.8, 0.0], [1.0, 1.0], [0.9, 1.0], [0.8, 0.7]], r, h * 0.7);
            for (a, b) in [(0, 1), (1, 2), (2, 3)] {
                let arc = circle([0.0, h * 0.7], r * 0.9, 8);
                let at = |i: usize| Point3::new(arc[2 + i][0], arc[2 + i][1], 0.0);
                k.m.rod(at(a), at(b), 0.014, p);
            }
            "handled"
        }
        6 => {
            turned(k, &[[0.9, 0.0], [1.0, 0.9], [0.98, 0.9], [0.9, 1.0], [0.0, 1.06]], r, h);
            "lidded"
        }
        _ => {
            let outline = oval([0.0, 0.0], [r * 1.3, r * 0.8], 14);
            k.m.prism_y(&outline, [0.0, h * 0.9], p);
            let rim = oval([0.0, 0.0], [r * 1.36, r * 0.86], 14);
            k.m.prism_y(&rim, [h * 0.9, h], p.times(0.93));
            "oval"
        }
    };
    k.noun = if h > 0.42 { "laundry basket" } else { "" };
    [size_word(h, 0.32, 0.46, ["low", "tall"]), shape]
}

fn bin(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.28, 0.6), k.len(0.12, 0.18));
    let p = k.p;
    let shape = match k.style {
        0 => {
            turned(k, &[[0.8, 0.0], [1.0, 1.0], [0.9, 1.0], [0.84, 0.9]], r, h);
            "round"
        }
        1 => {
            turned(k, &[[0.95, 0.0], [0.95, 0.85], [0.7, 0.98], [0.2, 1.0]], r, h);
            "domed"
        }
        2 => {
            k.m.soft(about(0.0, 2.0 * r), [0.0, h * 0.9], about(0.0, 1.7 * r), 0.012, p);
            k.m.soft(about(0.0, 2.06 * r), [h * 0.9, h], about(0.0, 1.76 * r), 0.015, p.times(0.92));
            "square"
        }
        3 => {
            k.m.prism_y(&circle([0.0, 0.0], r, 6), [0.0, h], p);
            "hexagonal"
        }
        4 => {
            turned(k, &[[0.9, 0.03], [0.9, 0.92], [0.8, 1.0]], r, h);
            k.m.block(about(0.0, 0.1), [0.0, 0.025], [r * 0.7, r * 1.2], Paint::DARK_METAL);
            "pedalled"
        }
        5 => {
            k.m.prism_y(&oval([0.0, 0.0], [r * 1.3, r * 0.8], 14), [0.0, h], p);
            "oval"
        }
        6 => {
            turned(k, &[[1.0, 0.0], [0.75, 0.5], [1.0, 1.0], [0.9, 1.0]], r, h);
            "waisted"
        }
        _ => {
            k.m.soft(about(0.0, 1.5 * r), [0.0, h * 0.85], about(0.0, 1.5 * r), 0.01, p);
            k.m.prism_z(&arch(1.5 * r, h * 0.84, h), about(0.0, 1.5 * r), p.times(0.95));
            "arched"
        }
    };
    [size_word(h, 0.38, 0.5, ["small", "tall"]), shape]
}
