//! Brightness of wood, stone, tiles, metal and glass.

use super::noise::{Noise, SIZE};

/// Boards of `width` rows and `length` columns with individual tones and dark gaps.
pub(super) fn boards(noise: &Noise, x: u32, y: u32, width: u32, length: u32) -> f32 {
    let row = y / width;
    let along = x + row * length * 5 / 8;
    let board = (along / length) % (SIZE / length);
    let gap = y.is_multiple_of(width) || along.is_multiple_of(length);
    let tone = 0.84 + 0.14 * noise.at(row * 7 + 3, board * 11 + 5);
    if gap { 0.6 } else { tone - 0.08 * noise.smooth(x, y, 32, 2) }
}

/// Long wavy lines in u direction.
pub(super) fn grain(noise: &Noise, x: u32, y: u32) -> f32 {
    let bent = y as f32 + 5.0 * noise.smooth(x, y, 32, 32);
    let ring = (bent / 5.0).fract();
    0.98 - 0.12 * noise.smooth(x, y, 32, 2) - if ring < 0.22 { 0.05 } else { 0.0 }
}

/// Canes in v direction with rings.
pub(super) fn bamboo(noise: &Noise, x: u32, y: u32) -> f32 {
    let across = (x % 8) as f32 / 7.0 * 2.0 - 1.0;
    let ring = (y + (x / 8) * 23) % SIZE < 2;
    (if ring { 0.78 } else { 1.0 }) - 0.16 * across * across - 0.04 * noise.smooth(x, y, 8, 16)
}

/// Strips of eight texels over and under each other.
pub(super) fn wicker(x: u32, y: u32) -> f32 {
    let upright = (x / 8 + y / 8).is_multiple_of(2);
    let along = if upright { y % 8 } else { x % 8 };
    let across = if upright { x % 8 } else { y % 8 };
    let bend = (along as f32 - 3.5) / 3.5;
    let edge = if across == 0 { 0.22 } else { 0.0 };
    1.0 - 0.14 * bend * bend - edge
}

/// Tiles of `size` texels; odd rows are moved by `shift`.
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

/// Chips of three tones in a bright ground.
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
