//! Lamps.

use super::*;

const SHADES: &[Substance] = &[Fabric, Metal, Paper, Glass, Wicker, Bamboo, Plastic];

/// A ceiling lamp; the ceiling is at y = 0.
pub(crate) const PENDANT: FurnitureKind =
    FurnitureKind::new("lighting", "ceiling lamp", 8, pendant).made_of(SHADES, styles::CLOTH);
pub(crate) const FLOOR_LAMP: FurnitureKind =
    FurnitureKind::new("lighting", "floor lamp", 5, floor_lamp).made_of(SHADES, styles::CLOTH);
pub(crate) const TABLE_LAMP: FurnitureKind =
    FurnitureKind::new("lighting", "table lamp", 5, table_lamp).made_of(SHADES, styles::CLOTH);

/// A wall lamp; lower edge at y = 0, back at z = 0.
pub(crate) const SCONCE: FurnitureKind =
    FurnitureKind::new("lighting", "wall lamp", 4, sconce).made_of(SHADES, styles::CLOTH);

/// Shade profiles (radius, height), relative: a cone, a drum, a bell, a ball.
const PROFILES: [&[[f32; 2]]; 4] = [
    &[[1.0, 0.0], [0.55, 1.0]],
    &[[1.0, 0.0], [1.0, 1.0]],
    &[[1.0, 0.0], [0.8, 0.35], [0.45, 0.75], [0.3, 1.0]],
    &[[0.4, 0.0], [0.85, 0.2], [1.0, 0.5], [0.85, 0.8], [0.35, 1.0]],
];

const SHAPES: [&str; 4] = ["conical", "cylindrical", "bell-shaped", "spherical"];

/// Lamp strength per metre of shade radius; see [`Lamp::strength`].
const STRENGTH_PER_M: f32 = 11.0;

/// Slightly warm lamp colour.
const LAMPLIGHT: [f32; 3] = [1.0, 0.975, 0.93];

/// Adds light around the axis at (x, z).
fn shine(k: &mut Draft, [x, z]: [f32; 2], radius: f32, [low, high]: Span) {
    // The lamp radius covers the shade: shades are translucent (docs/decisions/0008).
    let half = 0.5 * (high - low);
    k.model.lamps.push(Lamp {
        position: point(x, low + half, z),
        facing: None,
        radius_m: (radius * radius + half * half).sqrt(),
        strength: LAMPLIGHT.map(|channel| channel * STRENGTH_PER_M * radius),
    });
}

/// Adds a lampshade around the axis at (x, z).
fn shade(k: &mut Draft, kind: usize, center: [f32; 2], radius: f32, [low, high]: Span) {
    let profile: Vec<[f32; 2]> =
        PROFILES[kind % 4].iter().map(|[s, y]| [s * radius, low + y * (high - low)]).collect();
    k.model.lathe(center, &profile, 12, k.paint);
    shine(k, center, radius, [low, high]);
}

fn pendant(k: &mut Draft) -> Words {
    let (drop, r) = (k.len(0.38, 0.6), k.len(0.15, 0.25));
    let size = size_word(r, 0.18, 0.22, ["small", "large"]);
    k.model.cylinder([0.0, 0.0], [-0.03, 0.0], 0.05, 8, Paint::DARK_METAL);
    let cord = |k: &mut Draft, x: f32, z: f32, low: f32| {
        k.model.cylinder([x, z], [low, -0.02], 0.008, 5, Paint::DARK_METAL);
    };
    match k.style {
        0..=3 => {
            cord(k, 0.0, 0.0, -drop + 0.15);
            shade(k, k.style, [0.0, 0.0], r, [-drop, -drop + r * 1.1]);
            [size, SHAPES[k.style]]
        }
        4 => {
            k.model.lathe([0.0, 0.0], &[[r * 0.8, -0.12], [r * 1.2, -0.06], [r * 1.2, -0.02]], 16, k.paint);
            shine(k, [0.0, 0.0], r * 1.2, [-0.12, -0.02]);
            [size, "flat"]
        }
        5 => {
            k.model.block(about(0.0, 0.9), [-0.05, -0.03], about(0.0, 0.05), Paint::DARK_METAL);
            for x in [-0.35, 0.0, 0.35] {
                cord(k, x, 0.0, -drop + 0.12);
                shade(k, 2, [x, 0.0], 0.1, [-drop, -drop + 0.14]);
            }
            ["large", "triple"]
        }
        6 => {
            cord(k, 0.0, 0.0, -drop + 0.1);
            for i in 0..5 {
                let (sin, cos) = angle::sin_cos(i as f32 * 1.2566);
                let (hub, tip) = (point(0.0, -drop + 0.12, 0.0), point(0.28 * sin, -drop, 0.28 * cos));
                k.model.rod(hub, tip, 0.012, k.trim);
                let bulb = [[0.4, 0.0], [1.0, 0.5], [0.8, 1.0]];
                let profile = bulb.map(|[s, y]| [s * 0.06, -drop + y * 0.1]);
                k.model.lathe([0.28 * sin, 0.28 * cos], &profile, 8, k.paint);
                shine(k, [0.28 * sin, 0.28 * cos], 0.06, [-drop, -drop + 0.1]);
            }
            k.noun = "chandelier";
            ["large", "many-armed"]
        }
        _ => {
            cord(k, 0.0, 0.0, -drop + 0.1);
            k.model.soft(about(0.0, r * 1.6), [-drop, -drop + r], about(0.0, r * 1.6), 0.01, k.paint);
            shine(k, [0.0, 0.0], r, [-drop, -drop + r]);
            [size, "square"]
        }
    }
}

fn floor_lamp(k: &mut Draft) -> Words {
    let h = k.len(1.4, 1.8);
    let dark = k.trim;
    k.model.lathe([0.0, 0.0], &[[0.14, 0.0], [0.14, 0.02], [0.03, 0.04]], 10, dark);
    let shape = match k.style {
        3 => {
            for i in 0..3 {
                let (sin, cos) = angle::sin_cos(i as f32 * 2.094);
                let foot = point(0.22 * sin, 0.0, 0.22 * cos);
                k.model.rod(foot, point(0.0, h - 0.3, 0.0), 0.015, dark);
            }
            shade(k, 1, [0.0, 0.0], 0.22, [h - 0.3, h]);
            "three-legged"
        }
        4 => {
            k.model.cylinder([0.0, 0.0], [0.03, h - 0.1], 0.012, 6, dark);
            k.model.rod(point(0.0, h - 0.1, 0.0), point(0.0, h, 0.24), 0.012, dark);
            shade(k, 2, [0.0, 0.26], 0.15, [h - 0.16, h]);
            "arched"
        }
        style => {
            k.model.cylinder([0.0, 0.0], [0.03, h - 0.25], 0.012, 6, dark);
            shade(k, style, [0.0, 0.0], 0.21, [h - 0.32, h]);
            SHAPES[style]
        }
    };
    [size_word(h, 1.5, 1.68, ["low", "tall"]), shape]
}

fn table_lamp(k: &mut Draft) -> Words {
    let h = k.len(0.34, 0.52);
    let foot = k.trim;
    let shape = match k.style {
        4 => {
            k.model.lathe([0.0, 0.0], &[[0.08, 0.0], [0.08, 0.02], [0.015, 0.03]], 10, foot);
            k.model.rod(point(0.0, 0.02, 0.0), point(0.0, h - 0.12, -0.08), 0.01, foot);
            k.model.rod(point(0.0, h - 0.13, -0.08), point(0.0, h - 0.05, 0.1), 0.01, foot);
            shade(k, 2, [0.0, 0.1], 0.09, [h - 0.16, h - 0.04]);
            "jointed"
        }
        style => {
            let profile = [[0.07, 0.0], [0.08, 0.05], [0.03, 0.16], [0.012, h - 0.16]];
            k.model.lathe([0.0, 0.0], &profile, 10, foot);
            shade(k, style, [0.0, 0.0], 0.14, [h - 0.2, h]);
            SHAPES[style]
        }
    };
    [size_word(h, 0.4, 0.46, ["small", "tall"]), shape]
}

fn sconce(k: &mut Draft) -> Words {
    k.model.prism_z(&circle([0.0, 0.1], 0.06, 8), [0.0, 0.02], k.trim);
    k.model.rod(point(0.0, 0.1, 0.02), point(0.0, 0.12, 0.12), 0.01, k.trim);
    let r = k.len(0.08, 0.11);
    let style = k.style;
    shade(k, style, [0.0, 0.13], r, [0.04, 0.24]);
    [size_word(r, 0.09, 0.1, ["small", "large"]), SHAPES[style]]
}
