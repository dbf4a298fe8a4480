//! Windows, closed doors, curtains and blinds, as panels on a wall.

use super::*;

const DOOR: FurnitureKind = FurnitureKind::new("door", "", 4, panelled_door).made_of(
    &[Wood, Wood, Metal, Plastic, Glass],
    "brown red green blue black white grey teal yellow orange purple pink",
);

pub(crate) fn door(sampler: &mut StyleSampler) -> Piece {
    DOOR.any(sampler)
}

/// Draws a window; lower edge at y = 0, back at z = 0.
pub(crate) fn window(width: f32, height: f32) -> Piece {
    let frame = Paint::plain("wood", [240, 238, 232]);
    let pane = Paint::plain("glass", [176, 208, 232]).with(Pattern::Sheen);
    let (bar, half) = (0.06, width / 2.0);
    let mut m = Model::new();
    m.block(about(0.0, width), [0.0, bar], [0.0, 0.035], frame);
    m.block(about(0.0, width), [height - bar, height], [0.0, 0.035], frame);
    m.pair([half - bar, half], [bar, height - bar], [0.0, 0.035], frame);
    m.block(about(0.0, bar * 0.7), [bar, height - bar], [0.0, 0.03], frame);
    let p = |x: f32, y: f32| point(x, y, 0.012);
    let (x, y) = (half - bar, [bar, height - bar]);
    m.quad([p(-x, y[0]), p(x, y[0]), p(x, y[1]), p(-x, y[1])], pane);
    m.block(about(0.0, width + 0.08), [-0.03, 0.0], [0.0, 0.08], frame);
    m.lamps = daylight([width, height]);
    let size = size_word(width, 0.8, 1.4, ["small", "wide"]).to_owned();
    let (material, shape) = ("glass".to_owned(), "rectangular".to_owned());
    let attributes = Attributes { material, size, shape, ..Attributes::default() };
    Piece { category: "window", model: m, attributes }
}

/// Daylight through a window: lamps side by side just inside.
fn daylight([width, height]: [f32; 2]) -> Vec<Lamp> {
    const WIDEST_M: f32 = 0.8;
    const STRENGTH_PER_M2: f32 = 2.2;
    const SKYLIGHT: [f32; 3] = [0.96, 0.98, 1.0];
    // A row of small lamps approximates a wide pane (docs/decisions/0008).
    let count = (width / WIDEST_M).ceil().max(1.0);
    let piece = width / count;
    let lamp = |index: usize| Lamp {
        position: point((index as f32 + 0.5) * piece - width / 2.0, height / 2.0, 0.1),
        facing: Some(Vector3::z()),
        radius_m: 0.25,
        strength: SKYLIGHT.map(|channel| channel * STRENGTH_PER_M2 * piece * height),
    };
    (0..count as usize).map(lamp).collect()
}

fn panelled_door(k: &mut Draft) -> Words {
    let p = k.paint;
    let frame = p.times(0.9);
    k.model.pair([0.46, 0.52], [0.0, 2.1], [0.0, 0.05], frame);
    k.model.block(about(0.0, 0.92), [2.04, 2.1], [0.0, 0.05], frame);
    k.model.block(about(0.0, 0.92), [0.0, 2.04], [0.0, 0.03], p);
    let z = [0.03, 0.038];
    match k.style {
        0 => {
            for y in [[0.2, 0.9], [1.1, 1.85]] {
                for x in [-0.2, 0.2] {
                    k.model.lid(about(x, 0.28), y, z, p.times(0.9));
                }
            }
        }
        1 => k.model.lid(about(0.0, 0.5), [1.2, 1.8], z, Paint::PANE),
        2 => {
            for i in 0..5 {
                k.model.lid(about(0.0, 0.7), about(0.35 + 0.34 * i as f32, 0.22), z, p.times(0.92));
            }
        }
        _ => k.model.prism_z(&arch(0.6, 0.2, 1.8), z, p.times(0.92)),
    }
    k.model.rod(point(0.38, 1.0, 0.03), point(0.38, 1.0, 0.09), 0.015, Paint::CHROME);
    k.model.rod(point(0.39, 1.0, 0.085), point(0.28, 1.0, 0.085), 0.012, Paint::CHROME);
    ["", k.by_style("panelled|glazed|panelled|arched")]
}

/// One curtain of a pair.
pub(crate) const CURTAIN: FurnitureKind = FurnitureKind::new("curtain", "", 8, curtain)
    .made_of(&[Fabric, Velvet, Striped, Checked, Dotted, Knit, Corduroy], styles::CLOTH);

/// A blind over the upper part of a window.
pub(crate) const BLIND: FurnitureKind = FurnitureKind::new("blinds", "", 8, blind).made_of(
    &[Fabric, Wood, Bamboo, Metal, Plastic, Paper, Striped],
    "white brown grey blue green teal yellow red black orange pink purple",
);

/// Adds a wavy sheet between two heights; `width_at` returns the width at a relative height.
fn folds(k: &mut Draft, count: usize, [low, high]: Span, width_at: impl Fn(f32) -> f32) {
    const ROWS: usize = 2;
    let point = |i: usize, row: usize| {
        let share = row as f32 / ROWS as f32;
        let x = width_at(share) * (i as f32 / count as f32 - 0.5);
        let z = if i.is_multiple_of(2) { 0.03 } else { 0.08 };
        point(x, low + share * (high - low), z)
    };
    for i in 0..count {
        for row in 0..ROWS {
            let corners = [point(i, row), point(i + 1, row), point(i + 1, row + 1), point(i, row + 1)];
            k.model.quad(corners, k.paint);
        }
    }
}

fn curtain(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.24, 0.5), k.height(1.0, 2.2));
    let rod = k.trim;
    k.model.block(about(0.0, w + 0.04), [h, h + 0.025], [0.0, 0.06], rod);
    let p = k.paint;
    let span = [0.0, h];
    match k.style {
        0 => folds(k, 8, span, |_| w),
        1 => {
            folds(k, 8, span, |share| w * if share == 0.5 { 0.5 } else { 1.0 });
            k.model.block(about(0.0, w * 0.56), about(h * 0.5, 0.05), [0.02, 0.09], p.times(0.8));
        }
        2 => {
            folds(k, 6, span, |_| w);
            k.model.block(about(0.0, w), [0.0, 0.08], [0.025, 0.085], p.times(0.85));
        }
        3 => folds(k, 12, span, |_| w),
        4 => folds(k, 8, span, |share| w * (1.1 - 0.3 * share)),
        5 => {
            folds(k, 8, span, |_| w);
            k.model.block(about(0.0, w + 0.04), [h - 0.14, h], [0.08, 0.1], p.times(0.9));
        }
        6 => folds(k, 4, span, |_| w),
        _ => {
            folds(k, 8, [0.0, h * 0.45], |_| w);
            folds(k, 8, [h * 0.5, h], |_| w);
        }
    }
    let shape = k.by_style("straight|tied|hemmed|pleated|flared|valanced|loose|two-tiered");
    [size_word(h, 1.25, 1.9, ["short", "long"]), shape]
}

fn blind(k: &mut Draft) -> Words {
    let (w, h) = (k.width(0.6, 1.6), k.height(0.3, 0.9));
    let p = k.paint;
    k.model.block(about(0.0, w), [h - 0.05, h], [0.0, 0.06], p.times(0.95));
    let slats = |k: &mut Draft, count: usize| {
        for i in 0..count {
            let y = (h - 0.06) * i as f32 / count as f32;
            k.model.block(about(0.0, w - 0.02), [y, y + (h - 0.06) / count as f32 * 0.8], [0.015, 0.03], p);
        }
    };
    match k.style {
        0 => slats(k, 10),
        1 => slats(k, 5),
        2 => {
            k.model.block(about(0.0, w - 0.02), [0.0, h - 0.05], [0.02, 0.03], p);
            k.model.block(about(0.0, w), [0.0, 0.03], [0.015, 0.04], p.times(0.85));
        }
        3 => {
            for i in 0..4 {
                let y = (h - 0.05) * i as f32 / 4.0;
                k.model.soft(about(0.0, w - 0.02), [y, y + (h - 0.05) / 4.0], [0.012, 0.05], 0.015, p);
            }
        }
        4 => {
            for i in 0..8 {
                let x = ((i as f32 + 0.5) / 8.0 - 0.5) * w;
                k.model.block(about(x, w / 9.0), [0.0, h - 0.05], [0.015, 0.025], p);
            }
        }
        5 => slats(k, 14),
        6 => {
            k.model.pair([w * 0.02, w / 2.0], [0.0, h - 0.05], [0.012, 0.03], p);
            for i in 0..4 {
                let y = 0.04 + (h - 0.13) * i as f32 / 4.0;
                k.model.pair([w * 0.06, w * 0.46], [y, y + (h - 0.13) / 5.0], [0.03, 0.04], p.times(0.93));
            }
        }
        _ => {
            k.model.block(about(0.0, w - 0.02), [0.08, h - 0.05], [0.015, 0.025], p);
            for i in 0..6 {
                let x = ((i as f32 + 0.5) / 6.0 - 0.5) * w;
                k.model.prism_z(&[[x - w / 13.0, 0.08], [x, 0.0], [x + w / 13.0, 0.08]], [0.015, 0.025], p);
            }
        }
    }
    let shape = k.by_style("slatted|slatted|rolled|folded|vertical|pleated|shuttered|scalloped");
    [size_word(w, 0.8, 1.2, ["narrow", "wide"]), shape]
}
