//! Small pictures: wood, tiles, cloth, wallpaper, stone, book spines and wall art.

mod art;

pub(super) use art::{Art, Medium, Motif};
use avln_geom::Rng;
use avln_scene::Texture;

/// A texture pattern. All except art and books are grey and multiplied with a base colour; u is horizontal, v
/// vertical.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Pattern {
    /// Floor boards in u, four per tile.
    Planks,
    Parquet,
    Grain,
    Bamboo,
    Wicker,
    /// Square tiles, two by two.
    Tiles,
    /// Glazed wall tiles, half-bonded.
    WallTiles,
    Checker,
    Plaster,
    Brick,
    Marble,
    Concrete,
    Terrazzo,
    /// Fine lines in metal.
    Brushed,
    /// Slanted reflections.
    Sheen,
    Weave,
    Carpet,
    Velvet,
    Leather,
    /// Corduroy ribs in v.
    Ribs,
    Knit,
    Twill,
    Quilt,
    ClothStripes,
    Gingham,
    Dots,
    /// Broad wallpaper stripes in v.
    Stripes,
    Damask,
    Floral,
    Trellis,
    /// Book spines in a row, in their own colours.
    Books(u8),
    Art(Art),
}

impl Pattern {
    /// Tile size, metres; `None` for stretched pictures.
    pub(super) fn tile_m(self) -> Option<f32> {
        Some(match self {
            Self::Twill => 0.16,
            Self::Ribs | Self::Gingham => 0.2,
            Self::Wicker => 0.22,
            Self::Knit | Self::ClothStripes | Self::Dots => 0.24,
            Self::Weave => 0.25,
            Self::Leather => 0.3,
            Self::WallTiles | Self::Quilt => 0.32,
            Self::Bamboo => 0.35,
            Self::Terrazzo | Self::Stripes => 0.4,
            Self::Brick | Self::Brushed | Self::Carpet | Self::Damask | Self::Trellis => 0.5,
            Self::Parquet | Self::Grain | Self::Tiles | Self::Floral => 0.6,
            Self::Velvet => 0.7,
            Self::Planks | Self::Checker | Self::Sheen => 0.8,
            Self::Marble | Self::Concrete => 0.9,
            Self::Plaster => 1.2,
            Self::Books(_) | Self::Art(_) => return None,
        })
    }

    pub(super) fn draw(self) -> Texture {
        match self {
            Self::Art(art) => art.draw(),
            Self::Books(seed) => art::books(seed),
            _ => self.grey(),
        }
    }

    /// Mean brightness, 0 to 1.
    pub(super) fn mean(self) -> f32 {
        let texture = self.draw();
        let sum: f32 = texture.pixels.as_chunks::<4>().0.iter().map(|texel| f32::from(texel[0])).sum();
        sum / (255.0 * (texture.width * texture.height) as f32)
    }

    fn grey(self) -> Texture {
        // Fixed seeds: a pattern looks equal in all houses and pools.
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
            Self::Bamboo => 4,
            Self::Marble => 5,
            Self::Concrete => 6,
            Self::Terrazzo => 7,
            Self::Brushed => 8,
            _ => 9,
        }
    }

    /// Brightness at a texel, 0 to 1.
    fn shade(self, noise: &Noise, x: u32, y: u32) -> f32 {
        match self {
            Self::Planks => boards(noise, x, y, 16, 64),
            Self::Parquet => boards(noise, x, y, 16, 32),
            Self::Grain => grain(noise, x, y),
            Self::Bamboo => bamboo(noise, x, y),
            Self::Wicker => wicker(x, y),
            Self::Tiles => tiles(noise, x, y, [32, 32], 0),
            Self::WallTiles => tiles(noise, x, y, [32, 16], 16),
            Self::Checker => [0.55, 1.0][((x / 32 + y / 32) % 2) as usize],
            Self::Plaster => 0.965 + 0.035 * noise.smooth(x, y, 4, 4),
            Self::Brick => tiles(noise, x, y, [32, 16], 16) - 0.12 * noise.smooth(x, y, 4, 4),
            Self::Marble => veins(noise, x, y),
            Self::Concrete => concrete(noise, x, y),
            Self::Terrazzo => terrazzo(noise, x, y),
            Self::Brushed => 0.9 + 0.1 * noise.smooth(x, y, 32, 1),
            Self::Sheen => sheen(x, y),
            Self::Carpet => 0.88 + 0.12 * noise.at(x, y),
            Self::Weave => 0.9 + 0.08 * ((x / 2 + y / 2) % 2) as f32 + 0.02 * noise.at(x, y),
            Self::Velvet => 0.87 + 0.13 * (0.7 * noise.smooth(x, y, 16, 16) + 0.3 * noise.smooth(x, y, 8, 8)),
            Self::Leather => leather(noise, x, y),
            Self::Ribs => [0.8, 0.92, 1.0, 1.0, 1.0, 0.96, 0.9, 0.8][(x % 8) as usize],
            Self::Knit => knit(x, y),
            Self::Twill => [0.8, 0.92, 1.0, 0.94][((x + y) % 4) as usize] - 0.05 * noise.smooth(x, y, 8, 8),
            Self::Quilt => quilt(x, y),
            Self::ClothStripes => [0.74, 1.0][((x / 8) % 2) as usize] - 0.02 * ((x + y) % 2) as f32,
            Self::Gingham => 1.0 - 0.15 * (((x / 8) % 2) + ((y / 8) % 2)) as f32,
            Self::Dots => dots(x, y),
            Self::Stripes => [0.82, 1.0][((x / 16) % 2) as usize],
            Self::Damask => damask(x, y),
            Self::Floral => floral(x, y),
            Self::Trellis => trellis(x, y),
            Self::Books(_) | Self::Art(_) => 1.0,
        }
    }
}

/// Texels per pattern side.
pub(super) const SIZE: u32 = 64;

/// Repeatable noise on the texel grid, 0 to 1, seamless at the picture's edges.
pub(super) struct Noise(Vec<f32>);

impl Noise {
    pub(super) fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        Self((0..SIZE * SIZE).map(|_| rng.unit() as f32).collect())
    }

    pub(super) fn at(&self, x: u32, y: u32) -> f32 {
        self.0[((y % SIZE) * SIZE + x % SIZE) as usize]
    }

    /// Noise on a grid with steps `step_x` and `step_y`, linear in between.
    pub(super) fn smooth(&self, x: u32, y: u32, step_x: u32, step_y: u32) -> f32 {
        let split = |value: u32, step: u32| (value / step * step, (value % step) as f32 / step as f32);
        let ((x0, fx), (y0, fy)) = (split(x, step_x), split(y, step_y));
        let row = |y: u32| self.at(x0, y) * (1.0 - fx) + self.at(x0 + step_x, y) * fx;
        row(y0) * (1.0 - fy) + row(y0 + step_y) * fy
    }
}

/// Boards with `width` rows and `length` columns, individual tones and dark gaps.
fn boards(noise: &Noise, x: u32, y: u32, width: u32, length: u32) -> f32 {
    let row = y / width;
    let along = x + row * length * 5 / 8;
    let board = (along / length) % (SIZE / length);
    let gap = y.is_multiple_of(width) || along.is_multiple_of(length);
    let tone = 0.84 + 0.14 * noise.at(row * 7 + 3, board * 11 + 5);
    if gap { 0.6 } else { tone - 0.08 * noise.smooth(x, y, 32, 2) }
}

/// Long wavy lines in u.
fn grain(noise: &Noise, x: u32, y: u32) -> f32 {
    let bent = y as f32 + 5.0 * noise.smooth(x, y, 32, 32);
    let ring = (bent / 5.0).fract();
    0.98 - 0.12 * noise.smooth(x, y, 32, 2) - if ring < 0.22 { 0.05 } else { 0.0 }
}

/// Canes in v with rings.
fn bamboo(noise: &Noise, x: u32, y: u32) -> f32 {
    let across = (x % 8) as f32 / 7.0 * 2.0 - 1.0;
    let ring = (y + (x / 8) * 23) % SIZE < 2;
    (if ring { 0.78 } else { 1.0 }) - 0.16 * across * across - 0.04 * noise.smooth(x, y, 8, 16)
}

/// Strips eight texels wide, over and under each other.
fn wicker(x: u32, y: u32) -> f32 {
    let upright = (x / 8 + y / 8).is_multiple_of(2);
    let along = if upright { y % 8 } else { x % 8 };
    let across = if upright { x % 8 } else { y % 8 };
    let bend = (along as f32 - 3.5) / 3.5;
    let edge = if across == 0 { 0.22 } else { 0.0 };
    1.0 - 0.14 * bend * bend - edge
}

/// Tiles in texels; odd rows are moved by `shift`.
fn tiles(noise: &Noise, x: u32, y: u32, [width, height]: [u32; 2], shift: u32) -> f32 {
    let row = y / height;
    let along = (x + row * shift) % SIZE;
    let joint = y.is_multiple_of(height) || along.is_multiple_of(width);
    if joint { 0.8 } else { 0.93 + 0.07 * noise.at(row * 5 + 1, along / width * 9 + 2) }
}

fn veins(noise: &Noise, x: u32, y: u32) -> f32 {
    let cloud = noise.smooth(x, y, 16, 16) * 0.7 + noise.smooth(x, y, 8, 8) * 0.3;
    let vein = 1.0 - ((cloud - 0.5).abs() * 14.0).min(1.0);
    0.98 - 0.3 * vein - 0.04 * noise.smooth(x, y, 4, 4)
}

fn concrete(noise: &Noise, x: u32, y: u32) -> f32 {
    let blotch = noise.smooth(x, y, 16, 16) * 0.6 + noise.smooth(x, y, 4, 4) * 0.4;
    let pore = noise.at(x, y) > 0.985;
    if pore { 0.72 } else { 0.86 + 0.14 * blotch }
}

/// Chips in three tones on a bright ground.
fn terrazzo(noise: &Noise, x: u32, y: u32) -> f32 {
    let chip = noise.smooth(x, y, 4, 4);
    match chip {
        value if value > 0.72 => 0.74,
        value if value < 0.26 => 1.0,
        _ => 0.93,
    }
}

/// Two slanted bright bands.
fn sheen(x: u32, y: u32) -> f32 {
    let along = (x + y) % SIZE;
    if (8..18).contains(&along) || (24..27).contains(&along) { 1.0 } else { 0.9 }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_preserve_colour_names() {
        use Pattern::*;
        for pattern in [
            Grain,
            Bamboo,
            Wicker,
            WallTiles,
            Plaster,
            Brick,
            Marble,
            Concrete,
            Terrazzo,
            Brushed,
            Sheen,
            Weave,
            Carpet,
            Velvet,
            Leather,
            Ribs,
            Knit,
            Twill,
            Quilt,
            ClothStripes,
            Gingham,
            Dots,
            Stripes,
            Damask,
            Floral,
            Trellis,
        ] {
            let texture = pattern.draw();
            assert_eq!(texture.pixels.len(), (texture.width * texture.height * 4) as usize);
            let mean = pattern.mean();
            assert!((0.84..=1.0).contains(&mean), "{pattern:?}: {mean}");
            let range = |pick: fn(u8, u8) -> u8| texture.pixels.chunks(4).map(|texel| texel[0]).reduce(pick);
            assert!(range(u8::max) > range(u8::min), "{pattern:?} has no contrast");
        }
    }
}
