//! Brightness patterns: wood, stone, tiles, metal, glass, cloth and wallpaper.

use super::{Noise, Pattern, SIZE};

/// Boards with `width` rows and `length` columns, individual tones and dark gaps.
pub(super) fn boards(noise: &Noise, x: u32, y: u32, width: u32, length: u32) -> f32 {
    let row = y / width;
    let along = x + row * length * 5 / 8;
    let board = (along / length) % (SIZE / length);
    let gap = y.is_multiple_of(width) || along.is_multiple_of(length);
    let tone = 0.84 + 0.14 * noise.at(row * 7 + 3, board * 11 + 5);
    if gap { 0.6 } else { tone - 0.08 * noise.smooth(x, y, 32, 2) }
}

/// Long wavy lines in u.
pub(super) fn grain(noise: &Noise, x: u32, y: u32) -> f32 {
    let bent = y as f32 + 5.0 * noise.smooth(x, y, 32, 32);
    let ring = (bent / 5.0).fract();
    0.98 - 0.12 * noise.smooth(x, y, 32, 2) - if ring < 0.22 { 0.05 } else { 0.0 }
}

/// Canes in v with rings.
pub(super) fn bamboo(noise: &Noise, x: u32, y: u32) -> f32 {
    let across = (x % 8) as f32 / 7.0 * 2.0 - 1.0;
    let ring = (y + (x / 8) * 23) % SIZE < 2;
    (if ring { 0.78 } else { 1.0 }) - 0.16 * across * across - 0.04 * noise.smooth(x, y, 8, 16)
}

/// Strips eight texels wide, over and under each other.
pub(super) fn wicker(x: u32, y: u32) -> f32 {
    let upright = (x / 8 + y / 8).is_multiple_of(2);
    let along = if upright { y % 8 } else { x % 8 };
    let across = if upright { x % 8 } else { y % 8 };
    let bend = (along as f32 - 3.5) / 3.5;
    let edge = if across == 0 { 0.22 } else { 0.0 };
    1.0 - 0.14 * bend * bend - edge
}

/// Tiles in texels; odd rows are moved by `shift`.
pub(super) fn tiles(noise: &Noise, x: u32, y: u32, [width, height]: [u32; 2], shift: u32) -> f32 {
    let row = y / height;
    let along = (x + row * shift) % SIZE;
    let joint = y.is_multiple_of(height) || along.is_multiple_of(width);
    if joint { 0.8 } else { 0.93 + 0.07 * noise.at(row * 5 + 1, along / width * 9 + 2) }
}

pub(super) fn veins(noise: &Noise, x: u32, y: u32) -> f32 {
    let cloud = noise.smooth(x, y, 16, 16) * 0.7 + noise.smooth(x, y, 8, 8) * 0.3;
    let vein = 1.0 - ((cloud - 0.5).abs() * 14.0).min(1.0);
    0.98 - 0.3 * vein - 0.04 * noise.smooth(x, y, 4, 4)
}

pub(super) fn concrete(noise: &Noise, x: u32, y: u32) -> f32 {
    let blotch = noise.smooth(x, y, 16, 16) * 0.6 + noise.smooth(x, y, 4, 4) * 0.4;
    let pore = noise.at(x, y) > 0.985;
    if pore { 0.72 } else { 0.86 + 0.14 * blotch }
}

/// Chips in three tones on a bright ground.
pub(super) fn terrazzo(noise: &Noise, x: u32, y: u32) -> f32 {
    let chip = noise.smooth(x, y, 4, 4);
    match chip {
        value if value > 0.72 => 0.74,
        value if value < 0.26 => 1.0,
        _ => 0.93,
    }
}

/// Two slanted bright bands.
pub(super) fn sheen(x: u32, y: u32) -> f32 {
    let along = (x + y) % SIZE;
    if (8..18).contains(&along) || (24..27).contains(&along) { 1.0 } else { 0.9 }
}

/// Brightness at a texel, 0 to 1.
pub(super) fn shade(pattern: Pattern, noise: &Noise, x: u32, y: u32) -> f32 {
    match pattern {
        Pattern::Weave => 0.9 + 0.08 * ((x / 2 + y / 2) % 2) as f32 + 0.02 * noise.at(x, y),
        Pattern::Velvet => 0.87 + 0.13 * (0.7 * noise.smooth(x, y, 16, 16) + 0.3 * noise.smooth(x, y, 8, 8)),
        Pattern::Leather => leather(noise, x, y),
        Pattern::Ribs => [0.8, 0.92, 1.0, 1.0, 1.0, 0.96, 0.9, 0.8][(x % 8) as usize],
        Pattern::Knit => knit(x, y),
        Pattern::Twill => [0.8, 0.92, 1.0, 0.94][((x + y) % 4) as usize] - 0.05 * noise.smooth(x, y, 8, 8),
        Pattern::Quilt => quilt(x, y),
        Pattern::ClothStripes => [0.74, 1.0][((x / 8) % 2) as usize] - 0.02 * ((x + y) % 2) as f32,
        Pattern::Gingham => 1.0 - 0.15 * (((x / 8) % 2) + ((y / 8) % 2)) as f32,
        Pattern::Dots => dots(x, y),
        Pattern::Stripes => [0.82, 1.0][((x / 16) % 2) as usize],
        Pattern::Damask => damask(x, y),
        Pattern::Floral => floral(x, y),
        Pattern::Trellis => trellis(x, y),
        _ => 1.0,
    }
}

fn leather(noise: &Noise, x: u32, y: u32) -> f32 {
    let crease = noise.smooth(x, y, 4, 4);
    0.97 - if (crease - 0.5).abs() < 0.06 { 0.14 } else { 0.04 * noise.smooth(x, y, 8, 8) }
}

/// Columns of V-shaped stitches.
fn knit(x: u32, y: u32) -> f32 {
    let across = (x % 8).abs_diff(4);
    let along = (y + across) % 8;
    if x.is_multiple_of(8) || along == 0 { 0.78 } else { 0.98 }
}

fn quilt(x: u32, y: u32) -> f32 {
    let (a, b) = ((x + y) % 32, (x + 64 - y) % 32);
    let distance = a.min(32 - a).min(b.min(32 - b)) as f32;
    0.74 + 0.26 * (distance / 6.0).min(1.0)
}

fn dots(x: u32, y: u32) -> f32 {
    let shift = if (y / 16).is_multiple_of(2) { 0 } else { 8 };
    let (dx, dy) = ((((x + shift) % 16) as f32) - 7.5, ((y % 16) as f32) - 7.5);
    if dx * dx + dy * dy < 16.0 { 0.66 } else { 1.0 }
}

/// Two leaves and a lozenge in each half tile.
fn damask(x: u32, y: u32) -> f32 {
    let (fx, fy) = ((x % 32) as f32 - 15.5, ((y + (x / 32) * 32) % 64) as f32 - 31.5);
    let leaf = (fx.abs() - 6.0).powi(2) / 20.0 + (fy - 4.0).powi(2) / 120.0 < 1.0;
    let lozenge = fx.abs() / 5.0 + (fy + 16.0).abs() / 9.0 < 1.0;
    if leaf || lozenge { 0.86 } else { 1.0 }
}

fn floral(x: u32, y: u32) -> f32 {
    let blossom = |cx: f32, cy: f32| {
        let (dx, dy) = (x as f32 - cx, y as f32 - cy);
        let petals = [[0.0, -5.0], [4.8, -1.5], [3.0, 4.0], [-3.0, 4.0], [-4.8, -1.5]];
        let petal = petals.iter().any(|[px, py]| (dx - px).powi(2) + (dy - py).powi(2) < 8.0);
        let stem = dx.abs() < 1.0 && dy > 4.0 && dy < 14.0;
        petal || stem
    };
    if blossom(16.0, 14.0) || blossom(48.0, 44.0) { 0.84 } else { 1.0 }
}

fn trellis(x: u32, y: u32) -> f32 {
    let (a, b) = ((x + y) % 32, (x + 64 - y) % 32);
    if a < 2 || b < 2 { 0.84 } else { 1.0 }
}
