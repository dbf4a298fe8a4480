//! Small pictures: wood, tiles, cloth, wallpaper, stone, book spines and wall art.

pub(super) use art::{Art, Medium, Motif};
use avln_geom::Rng;
use avln_scene::Texture;

mod art;
mod patterns;

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
            Self::Planks => patterns::boards(noise, x, y, 16, 64),
            Self::Parquet => patterns::boards(noise, x, y, 16, 32),
            Self::Grain => patterns::grain(noise, x, y),
            Self::Bamboo => patterns::bamboo(noise, x, y),
            Self::Wicker => patterns::wicker(x, y),
            Self::Tiles => patterns::tiles(noise, x, y, [32, 32], 0),
            Self::WallTiles => patterns::tiles(noise, x, y, [32, 16], 16),
            Self::Checker => [0.55, 1.0][((x / 32 + y / 32) % 2) as usize],
            Self::Plaster => 0.965 + 0.035 * noise.smooth(x, y, 4, 4),
            Self::Brick => patterns::tiles(noise, x, y, [32, 16], 16) - 0.12 * noise.smooth(x, y, 4, 4),
            Self::Marble => patterns::veins(noise, x, y),
            Self::Concrete => patterns::concrete(noise, x, y),
            Self::Terrazzo => patterns::terrazzo(noise, x, y),
            Self::Brushed => 0.9 + 0.1 * noise.smooth(x, y, 32, 1),
            Self::Sheen => patterns::sheen(x, y),
            Self::Carpet => 0.88 + 0.12 * noise.at(x, y),
            _ => patterns::shade(self, noise, x, y),
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
