//! Small decoration: vases, figures, books, baskets, bins.

use super::*;

pub(crate) const VASE: FurnitureKind = FurnitureKind::new("vase", "", 8, vase)
    .made_of(&[Ceramic, Glass, Metal, Wood, Marble, Concrete, Terrazzo], styles::CLOTH);
pub(crate) const STATUE: FurnitureKind = FurnitureKind::new("statue", "", 8, statue)
    .made_of(&[Marble, Metal, Wood, Ceramic, Concrete, Plastic, Glass], styles::CLOTH);

/// A stack or row.
pub(crate) const BOOKS: FurnitureKind = FurnitureKind::new("books", "", 8, books)
    .made_of(&[Paper, Leather, Fabric, Striped, Checked, Dotted], styles::CLOTH);
pub(crate) const BASKET: FurnitureKind = FurnitureKind::new("basket", "", 8, basket)
    .made_of(&[Wicker, Fabric, Plastic, Metal, Knit, Bamboo], styles::WOOD);

pub(crate) const BIN: FurnitureKind = FurnitureKind::new("bin", "", 8, bin)
    .made_of(&[Plastic, Metal, Wicker, Wood, Rubber, Leather], styles::MACHINE);

fn vase(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.18, 0.36), k.len(0.06, 0.1));
    match k.style {
        0 => k.turned(&[[0.6, 0.0], [1.0, 0.35], [0.9, 0.6], [0.4, 0.85], [0.55, 1.0]], r, h, 12),
        1 => k.turned(&[[0.7, 0.0], [0.7, 1.0], [0.55, 1.0], [0.55, 0.8]], r, h, 12),
        2 => k.turned(&[[0.4, 0.0], [0.5, 0.5], [1.0, 1.0], [0.9, 1.0]], r, h, 12),
        3 => k.turned(&[[0.5, 0.0], [1.0, 0.3], [0.3, 0.55], [0.25, 1.0], [0.4, 1.05]], r, h, 12),
        4 => k.model.soft(about(0.0, r * 1.5), [0.0, h], about(0.0, r * 1.5), 0.012, k.paint),
        5 => k.turned(&[[0.5, 0.0], [1.1, 0.3], [1.1, 0.5], [0.8, 0.7]], r * 1.2, h, 12),
        6 => {
            k.turned(&[[0.7, 0.0], [0.4, 0.2], [0.9, 0.6], [0.5, 0.9], [0.7, 1.0]], r, h, 12);
            for side in [-1.0, 1.0] {
                let at = |s: f32, y: f32| point(side * s * r, y * h, 0.0);
                k.model.rod(at(0.5, 0.9), at(1.2, 0.75), 0.01, k.paint);
                k.model.rod(at(1.2, 0.77), at(0.85, 0.55), 0.01, k.paint);
            }
        }
        _ => k.model.prism_y(&circle([0.0, 0.0], r, 6), [0.0, h], k.paint),
    }
    let shape = k.by_style("bulbous|cylindrical|conical|bottle-shaped|square|bowl-shaped|handled|hexagonal");
    [size_word(k.model.bounds().size().y, 0.23, 0.3, ["small", "tall"]), shape]
}

fn statue(k: &mut Draft) -> Words {
    let h = k.len(0.2, 0.42);
    let plinth = about(0.0, h * 0.4);
    k.model.block(plinth, [0.0, h * 0.08], plinth, k.paint.times(0.95));
    let ball = |k: &mut Draft, [x, y]: [f32; 2], r: f32| {
        let profile = [[0.3, -0.95], [0.85, -0.5], [1.0, 0.0], [0.85, 0.5], [0.3, 0.95]];
        k.model.lathe([x, 0.0], &profile.map(|[s, up]| [s * r, y + up * r]), 9, k.paint);
    };
    match k.style {
        0 => {
            k.turned(&[[0.16, 0.08], [0.2, 0.3], [0.13, 0.62], [0.18, 0.72], [0.05, 0.8]], h, h, 12);
            ball(k, [0.0, h * 0.88], h * 0.1);
        }
        1 => ball(k, [0.0, h * 0.5], h * 0.36),
        2 => {
            k.model.prism_y(&circle([0.0, 0.0], h * 0.16, 4), [h * 0.08, h * 0.8], k.paint);
            k.model.lathe([0.0, 0.0], &[[h * 0.15, h * 0.8], [0.0, h]], 4, k.paint);
        }
        3 => {
            k.model.soft(about(0.0, h * 0.6), [h * 0.3, h * 0.6], about(0.0, h * 0.22), 0.02, k.paint);
            k.legs([h * 0.56, h * 0.2], h * 0.34, h * 0.08, 0.0, k.paint);
            k.model.rod(point(h * 0.22, h * 0.5, 0.0), point(h * 0.34, h * 0.85, 0.0), h * 0.07, k.paint);
            ball(k, [h * 0.38, h * 0.88], h * 0.1);
        }
        4 => k.model.lathe([0.0, 0.0], &[[h * 0.26, h * 0.08], [0.0, h]], 14, k.paint),
        5 => {
            for i in 0..3 {
                let y = h * (0.22 + 0.26 * i as f32);
                ball(k, [0.0, y], h * (0.2 - 0.05 * i as f32));
            }
        }
        6 => {
            let points = [[0.0, 0.1], [0.3, 0.4], [0.2, 0.75], [0.0, 1.0], [-0.2, 0.75], [-0.3, 0.4]];
            k.model.prism_z(&points.map(|[x, y]| [x * h, y * h]), about(0.0, h * 0.14), k.paint);
        }
        _ => {
            let outer = circle([0.0, h * 0.55], h * 0.42, 12);
            for i in 0..12 {
                let (a, b) = (outer[i], outer[(i + 1) % 12]);
                k.model.rod(point(a[0], a[1], 0.0), point(b[0], b[1], 0.0), h * 0.06, k.paint);
            }
        }
    }
    let shape =
        k.by_style("human|spherical|obelisk-shaped|four-legged|conical|stacked|leaf-shaped|ring-shaped");
    [size_word(h, 0.27, 0.35, ["small", "tall"]), shape]
}

fn books(k: &mut Draft) -> Words {
    let pages = Paint::plain("paper", [176, 170, 152]);
    let pages = if k.dark() { pages.times(0.4) } else { pages };
    let flat = |k: &mut Draft, x: f32, y: f32, size: [f32; 2], thick: f32, shade: f32| {
        k.model.block(about(x, size[0]), [y, y + thick * 0.2], about(0.0, size[1]), k.paint.times(shade));
        let inside = [y + thick * 0.2, y + thick * 0.8];
        k.model.block(about(x, size[0] - 0.012), inside, about(0.0, size[1] - 0.012), pages);
        let cover = [y + thick * 0.8, y + thick];
        k.model.block(about(x, size[0]), cover, about(0.0, size[1]), k.paint.times(shade));
    };
    let upright = |k: &mut Draft, count: usize, lean: bool| {
        for i in 0..count {
            let shade = [1.0, 0.92, 1.05][i % 3];
            let h = k.len(0.18, 0.26);
            let x = (i as f32 - count as f32 / 2.0) * 0.042;
            let depth = if lean { 0.13 } else { 0.16 };
            k.model.block([x, x + 0.038], [0.0, h], about(0.0, depth), k.paint.times(shade));
        }
    };
    match k.style {
        0 | 1 => {
            let count = [2, 4][k.style];
            for i in 0..count {
                let (w, d) = (k.len(0.2, 0.26), k.len(0.15, 0.19));
                flat(k, 0.0, 0.036 * i as f32, [w, d], 0.035, [1.0, 0.94][i % 2]);
            }
            [k.by_style("low|tall"), "stacked"]
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
            k.model.prism_z(&half, about(0.0, 0.22), k.paint);
            let other = [half[1], half[0], half[3], half[2]].map(|[x, y]| [-x, y]);
            k.model.prism_z(&other, about(0.0, 0.22), k.paint);
            k.model.block(about(0.0, 0.03), [0.0, 0.02], about(0.0, 0.22), k.paint);
            ["", "open"]
        }
        6 => {
            upright(k, 5, true);
            k.model.pair([0.12, 0.15], [0.0, 0.16], about(0.0, 0.12), Paint::DARK_METAL);
            ["", "propped"]
        }
        _ => {
            k.model.soft(about(0.0, 0.26), [0.0, 0.16], about(0.0, 0.2), 0.01, k.paint);
            ["", "boxed"]
        }
    }
}

fn basket(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.24, 0.55), k.len(0.17, 0.24));
    let shape = match k.style {
        0 | 1 => {
            let low = [0.8, 0.95][k.style];
            k.turned(&[[low, 0.0], [1.0, 1.0], [0.92, 1.0], [0.85, 0.7], [0.0, 0.65]], r, h, 12);
            k.by_style("round|cylindrical")
        }
        2 | 3 => {
            let w = [2.0, 2.6][k.style - 2] * r;
            let d = 1.8 * r;
            k.board(about(0.0, w - 0.03), [0.0, h * 0.7], about(0.0, d - 0.03));
            k.model.pair([w / 2.0 - 0.02, w / 2.0], [0.0, h], about(0.0, d), k.paint);
            k.board(about(0.0, w - 0.04), [0.0, h], [d / 2.0 - 0.02, d / 2.0]);
            k.board(about(0.0, w - 0.04), [0.0, h], [-d / 2.0, -d / 2.0 + 0.02]);
            ["square", "rectangular"][k.style - 2]
        }
        4 => {
            k.turned(&[[0.7, 0.0], [1.1, 0.5], [0.85, 1.0], [0.75, 0.9]], r, h, 12);
            "bulging"
        }
        5 => {
            k.turned(&[[0.8, 0.0], [1.0, 1.0], [0.9, 1.0], [0.8, 0.7]], r, h * 0.7, 12);
            for (a, b) in [(0, 1), (1, 2), (2, 3)] {
                let arc = circle([0.0, h * 0.7], r * 0.9, 8);
                let at = |i: usize| point(arc[2 + i][0], arc[2 + i][1], 0.0);
                k.model.rod(at(a), at(b), 0.014, k.paint);
            }
            "handled"
        }
        6 => {
            k.turned(&[[0.9, 0.0], [1.0, 0.9], [0.98, 0.9], [0.9, 1.0], [0.0, 1.06]], r, h, 12);
            "lidded"
        }
        _ => {
            let outline = oval([0.0, 0.0], [r * 1.3, r * 0.8], 14);
            k.model.prism_y(&outline, [0.0, h * 0.9], k.paint);
            let rim = oval([0.0, 0.0], [r * 1.36, r * 0.86], 14);
            k.model.prism_y(&rim, [h * 0.9, h], k.paint.times(0.93));
            "oval"
        }
    };
    k.noun = if h > 0.42 { "laundry basket" } else { "" };
    [size_word(h, 0.32, 0.46, ["low", "tall"]), shape]
}

fn bin(k: &mut Draft) -> Words {
    let (h, r) = (k.len(0.28, 0.6), k.len(0.12, 0.18));
    let p = k.paint;
    match k.style {
        0 => k.turned(&[[0.8, 0.0], [1.0, 1.0], [0.9, 1.0], [0.84, 0.9]], r, h, 12),
        1 => k.turned(&[[0.95, 0.0], [0.95, 0.85], [0.7, 0.98], [0.2, 1.0]], r, h, 12),
        2 => {
            k.model.soft(about(0.0, 2.0 * r), [0.0, h * 0.9], about(0.0, 1.7 * r), 0.012, p);
            k.model.soft(about(0.0, 2.06 * r), [h * 0.9, h], about(0.0, 1.76 * r), 0.015, p.times(0.92));
        }
        3 => k.model.prism_y(&circle([0.0, 0.0], r, 6), [0.0, h], p),
        4 => {
            k.turned(&[[0.9, 0.03], [0.9, 0.92], [0.8, 1.0]], r, h, 12);
            k.model.block(about(0.0, 0.1), [0.0, 0.025], [r * 0.7, r * 1.2], Paint::DARK_METAL);
        }
        5 => k.model.prism_y(&oval([0.0, 0.0], [r * 1.3, r * 0.8], 14), [0.0, h], p),
        6 => k.turned(&[[1.0, 0.0], [0.75, 0.5], [1.0, 1.0], [0.9, 1.0]], r, h, 12),
        _ => {
            k.model.soft(about(0.0, 1.5 * r), [0.0, h * 0.85], about(0.0, 1.5 * r), 0.01, p);
            k.model.prism_z(&arch(1.5 * r, h * 0.84, h), about(0.0, 1.5 * r), p.times(0.95));
        }
    }
    let shape = k.by_style("round|domed|square|hexagonal|pedalled|oval|waisted|arched");
    [size_word(h, 0.38, 0.5, ["small", "tall"]), shape]
}
