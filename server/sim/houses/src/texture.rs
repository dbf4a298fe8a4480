//! Small pictures: wood, tiles, cloth, wallpaper, stone, book spines, and art for walls.

pub(super) use art::{Art, Medium, Motif};
use avln_geom::Rng;
use avln_scene::Texture;

mod art;
mod patterns;

/// A texture pattern; all except art and books are grey and multiplied with a base colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Pattern {
    /// Floor boards in u direction, four per tile.
    Planks,
    /// Herringbone-like short floor boards.
    Parquet,
    /// Grain of a single board.
    Grain,
    /// Canes with rings.
    Bamboo,
    /// Strips that go over and under each other.
    Wicker,
    /// Square tiles with joints, two by two.
    Tiles,
    /// Flat glazed wall tiles, half-bonded.
    WallTiles,
    /// Light and dark squares.
    Checker,
    /// Fine noise.
    Plaster,
    /// Bricks in bond.
    Brick,
    /// Veined stone.
    Marble,
    /// Cast stone with blotches and pores.
    Concrete,
    /// Stone chips.
    Terrazzo,
    /// Fine lines.
    Brushed,
    /// Slanted reflections.
    Sheen,
    /// Woven cloth.
    Weave,
    /// Thick pile.
    Carpet,
    /// Soft light and shade.
    Velvet,
    /// Pebbled skin.
    Leather,
    /// Ribs in v direction.
    Ribs,
    /// Rows of stitches.
    Knit,
    /// Slanted ribs.
    Twill,
    /// Stitched diamonds.
    Quilt,
    /// Cloth stripes in v direction.
    ClothStripes,
    /// Crossing stripes.
    Gingham,
    /// Spots.
    Dots,
    /// Broad wallpaper stripes in v direction.
    Stripes,
    /// Wallpaper with ornaments.
    Damask,
    /// Wallpaper with flowers.
    Floral,
    /// Wallpaper with a lattice.
    Trellis,
    /// The spines of a row of books, in their own colours.
    Books(u8),
    /// A coloured wall picture.
    Art(Art),
}

impl Pattern {
    /// Size of a repetition, metres; `None` for stretched pictures.
    pub(super) fn tile_m(self) -> Option<f32> {
        Some(match self {
            Self::Planks | Self::Checker => 0.8,
            Self::Parquet | Self::Grain | Self::Tiles => 0.6,
            Self::Bamboo => 0.35,
            Self::Wicker => 0.22,
            Self::WallTiles => 0.32,
            Self::Plaster => 1.2,
            Self::Brick => 0.5,
            Self::Marble | Self::Concrete => 0.9,
            Self::Terrazzo => 0.4,
            Self::Brushed => 0.5,
            Self::Sheen => 0.8,
            Self::Weave => 0.25,
            Self::Carpet => 0.5,
            Self::Velvet => 0.7,
            Self::Leather => 0.3,
            Self::Ribs => 0.2,
            Self::Knit => 0.24,
            Self::Twill => 0.16,
            Self::Quilt => 0.32,
            Self::ClothStripes => 0.24,
            Self::Gingham => 0.2,
            Self::Dots => 0.24,
            Self::Stripes => 0.4,
            Self::Damask | Self::Trellis => 0.5,
            Self::Floral => 0.6,
            Self::Books(_) | Self::Art(_) => return None,
        })
    }

    /// Draws the picture.
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

    /// Brightness of a texel, 0 to 1.
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

/// Texels per side of a pattern.
pub(super) const SIZE: u32 = 64;

/// Repeatable noise on the texel grid, 0 to 1, that repeats with the picture.
pub(super) struct Noise(Vec<f32>);

impl Noise {
    pub(super) fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        Self((0..SIZE * SIZE).map(|_| rng.unit() as f32).collect())
    }

    pub(super) fn at(&self, x: u32, y: u32) -> f32 {
        self.0[((y % SIZE) * SIZE + x % SIZE) as usize]
    }

    /// Noise on a grid of `step_x` by `step_y` texels, linear in between.
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
    fn patterns_are_bright_enough_not_to_change_the_name_of_a_colour() {
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
            assert!(range(u8::max) > range(u8::min), "{pattern:?} can be seen");
        }
    }
}
