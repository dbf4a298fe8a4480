//! Small pictures: wood, tiles, weave, plaster, bricks, and art for walls.

mod art;

pub(super) use art::Art;

use crate::Texture;
use avln_geom::Rng;

/// A picture that a house can use; all but art are shades of grey that a base colour multiplies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Pattern {
    /// Floor boards along u, four in a tile.
    Planks,
    /// Herringbone-like short floor boards.
    Parquet,
    /// Grain of one board.
    Grain,
    /// Square tiles with joints, two by two.
    Tiles,
    /// Flat glazed wall tiles, half-bonded.
    WallTiles,
    /// Light and dark squares.
    Checker,
    /// Fine noise.
    Plaster,
    /// Woven cloth.
    Weave,
    /// Thick pile.
    Carpet,
    /// Broad stripes along v.
    Stripes,
    /// Bricks in bond.
    Brick,
    /// Veined stone.
    Marble,
    /// A picture for a wall, in its own colours.
    Art(Art),
}

const SIZE: u32 = 64;

impl Pattern {
    /// Edge length in the world of one repetition, metres; `None` for pictures that are stretched over a face.
    pub(super) fn tile_m(self) -> Option<f32> {
        match self {
            Self::Planks => Some(0.8),
            Self::Parquet => Some(0.6),
            Self::Grain => Some(0.6),
            Self::Tiles => Some(0.6),
            Self::WallTiles => Some(0.32),
            Self::Checker => Some(0.8),
            Self::Plaster => Some(1.2),
            Self::Weave => Some(0.25),
            Self::Carpet => Some(0.5),
            Self::Stripes => Some(0.3),
            Self::Brick => Some(0.5),
            Self::Marble => Some(0.9),
            Self::Art(_) => None,
        }
    }

    /// Draws the picture.
    pub(super) fn draw(self) -> Texture {
        match self {
            Self::Art(art) => art.draw(),
            _ => self.grey(),
        }
    }

    fn grey(self) -> Texture {
        let noise = Noise::new(0x5eed + self.salt());
        let mut pixels = Vec::with_capacity((SIZE * SIZE * 4) as usize);
        for y in 0..SIZE {
            for x in 0..SIZE {
                let shade = (self.shade(&noise, x, y).clamp(0.0, 1.0) * 255.0).round() as u8;
                pixels.extend([shade, shade, shade, 255]);
            }
        }
        Texture { width: SIZE, height: SIZE, pixels }
    }

    fn salt(self) -> u64 {
        match self {
            Self::Planks => 1,
            Self::Parquet => 2,
            Self::Grain => 3,
            Self::Tiles => 4,
            Self::WallTiles => 5,
            Self::Checker => 6,
            Self::Plaster => 7,
            Self::Weave => 8,
            Self::Carpet => 9,
            Self::Stripes => 10,
            Self::Brick => 11,
            Self::Marble | Self::Art(_) => 12,
        }
    }

    /// Brightness of a texel, 0 to 1.
    fn shade(self, noise: &Noise, x: u32, y: u32) -> f32 {
        match self {
            Self::Planks => boards(noise, x, y, 16, 64),
            Self::Parquet => boards(noise, x, y, 16, 32),
            Self::Grain => 0.97 - 0.14 * noise.smooth(x, y, 32, 3),
            Self::Tiles => tiles(noise, x, y, [32, 32], 0),
            Self::WallTiles => tiles(noise, x, y, [32, 16], 16),
            Self::Checker => [0.55, 1.0][((x / 32 + y / 32) % 2) as usize],
            Self::Plaster => 0.95 + 0.05 * noise.smooth(x, y, 4, 4),
            Self::Weave => 0.93 + 0.06 * ((x / 2 + y / 2) % 2) as f32 + 0.01 * noise.at(x, y),
            Self::Carpet => 0.92 + 0.08 * noise.at(x, y),
            Self::Stripes => [0.72, 1.0][((x / 16) % 2) as usize],
            Self::Brick => tiles(noise, x, y, [32, 16], 16) - 0.12 * noise.smooth(x, y, 4, 4),
            Self::Marble | Self::Art(_) => veins(noise, x, y),
        }
    }
}

/// Boards of `width` rows and `length` columns, each in its own tone, with dark gaps.
fn boards(noise: &Noise, x: u32, y: u32, width: u32, length: u32) -> f32 {
    let row = y / width;
    let along = x + row * length * 5 / 8;
    let board = (along / length) % (SIZE / length);
    let gap = y.is_multiple_of(width) || along.is_multiple_of(length);
    let tone = 0.82 + 0.16 * noise.at(row * 7 + 3, board * 11 + 5);
    if gap { 0.55 } else { tone - 0.08 * noise.smooth(x, y, 32, 2) }
}

/// Tiles of `size` texels; odd rows are moved by `shift`.
fn tiles(noise: &Noise, x: u32, y: u32, [width, height]: [u32; 2], shift: u32) -> f32 {
    let row = y / height;
    let along = (x + row * shift) % SIZE;
    let joint = y.is_multiple_of(height) || along.is_multiple_of(width);
    if joint { 0.8 } else { 0.93 + 0.07 * noise.at(row * 5 + 1, along / width * 9 + 2) }
}

fn veins(noise: &Noise, x: u32, y: u32) -> f32 {
    let cloud = noise.smooth(x, y, 16, 16) * 0.7 + noise.smooth(x, y, 8, 8) * 0.3;
    let vein = 1.0 - ((cloud - 0.5).abs() * 14.0).min(1.0);
    0.97 - 0.22 * vein
}

/// Repeatable noise on the texel grid, 0 to 1, that repeats with the picture.
struct Noise(Vec<f32>);

impl Noise {
    fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        Self((0..SIZE * SIZE).map(|_| rng.unit() as f32).collect())
    }

    fn at(&self, x: u32, y: u32) -> f32 {
        self.0[((y % SIZE) * SIZE + x % SIZE) as usize]
    }

    /// Noise on a grid of `step_x` by `step_y` texels, linear in between.
    fn smooth(&self, x: u32, y: u32, step_x: u32, step_y: u32) -> f32 {
        let split = |value: u32, step: u32| (value / step * step, (value % step) as f32 / step as f32);
        let ((x0, fx), (y0, fy)) = (split(x, step_x), split(y, step_y));
        let row = |y: u32| self.at(x0, y) * (1.0 - fx) + self.at(x0 + step_x, y) * fx;
        row(y0) * (1.0 - fy) + row(y0 + step_y) * fy
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_bright_enough_not_to_change_the_name_of_a_colour() {
        for pattern in [Pattern::Grain, Pattern::Weave, Pattern::Plaster, Pattern::Marble, Pattern::Stripes] {
            let texture = pattern.draw();
            assert_eq!(texture.pixels.len(), (texture.width * texture.height * 4) as usize);
            let sum: f64 = texture.pixels.chunks(4).map(|texel| f64::from(texel[0])).sum();
            let mean = sum / f64::from(SIZE * SIZE) / 255.0;
            assert!((0.8..=1.0).contains(&mean), "{pattern:?}: {mean}");
        }
    }
}
