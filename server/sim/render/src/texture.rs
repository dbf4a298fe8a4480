use avln_scene::Texture;

/// A texture with ever smaller versions of itself; it repeats in both directions.
pub(crate) struct Pyramid {
    /// The full size first, then each half as large as the one before.
    levels: Vec<Level>,
}

/// Texels in a row or column, at most: more would not fit the arithmetic of [`neighbours`].
const LARGEST: usize = 16_384;

struct Level {
    width: usize,
    height: usize,
    /// RGBA, row-major from the top-left.
    texels: Vec<[u8; 4]>,
}

impl Pyramid {
    /// `None` for a picture without texels, of more than 16,384 in a row or column, or with another number of bytes
    /// than its size asks for.
    pub(crate) fn new(texture: &Texture) -> Option<Self> {
        let (width, height) = (texture.width as usize, texture.height as usize);
        let (texels, rest) = texture.pixels.as_chunks::<4>();
        if width.max(height) > LARGEST
            || texels.is_empty()
            || !rest.is_empty()
            || width.checked_mul(height) != Some(texels.len())
        {
            return None;
        }
        let mut levels = vec![Level { width, height, texels: texels.to_vec() }];
        while let Some(half) = levels.last().and_then(Level::halved) {
            levels.push(half);
        }
        Some(Self { levels })
    }

    /// Texels of the full size.
    pub(crate) fn area(&self) -> f32 {
        (self.levels[0].width * self.levels[0].height) as f32
    }

    /// The colour at texture coordinates `uv`, where `footprint` texels of the full size fall on one pixel.
    #[inline]
    pub(crate) fn sample(&self, uv: [f32; 2], footprint: f32) -> [u8; 4] {
        self.levels[level_of(footprint).min(self.levels.len() - 1)].bilinear(uv)
    }
}

/// The level whose texels are about as large as a pixel: half of log2(`footprint`), rounded.
#[inline]
fn level_of(footprint: f32) -> usize {
    // The exponent of a float is its log2 rounded down; numbers below 1 and NaN have no business here.
    let log2 = (footprint.to_bits() >> 23) as i32 - 127;
    ((log2 + 1) >> 1).max(0) as usize
}

impl Level {
    /// Half the size, each texel the mean of four; `None` for a single texel.
    fn halved(&self) -> Option<Self> {
        if self.texels.len() == 1 {
            return None;
        }
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mean = |at: usize| {
            let (x, y) = (2 * (at % width), 2 * (at / width));
            let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
            mean_of(
                [(x, y), (right, y), (x, below), (right, below)]
                    .map(|(x, y)| self.texels[y * self.width + x]),
            )
        };
        Some(Self { width, height, texels: (0..width * height).map(mean).collect() })
    }

    /// The four texels around a point, weighted by how near they are.
    #[inline]
    fn bilinear(&self, [u, v]: [f32; 2]) -> [u8; 4] {
        let (x0, x1, right) = neighbours(u, self.width);
        let (y0, y1, below) = neighbours(v, self.height);
        let (top, bottom) = (y0 * self.width, y1 * self.width);
        let corners =
            [(top + x0, 256 - right), (top + x1, right), (bottom + x0, 256 - right), (bottom + x1, right)];
        let rows = [256 - below, 256 - below, below, below];
        let mut sum = [1_u32 << 15; 4];
        for ((at, weight), row) in corners.into_iter().zip(rows) {
            for (sum, value) in sum.iter_mut().zip(self.texels[at]) {
                *sum += u32::from(value) * (weight * row);
            }
        }
        sum.map(|sum| (sum >> 16) as u8)
    }
}

/// The two texels of `count` around a repeating coordinate, and the weight of the second, 0 to 256.
#[inline]
fn neighbours(coordinate: f32, count: usize) -> (usize, usize, u32) {
    let within = fraction(coordinate);
    // Texel centres lie half a texel, 128 of 256 steps, after their beginnings.
    let steps = rounded(within * (count as f32 * 256.0)) + 128;
    let (second, weight) = ((steps >> 8) as usize, steps & 255);
    let second = if second < count { second } else { 0 };
    (if second == 0 { count - 1 } else { second - 1 }, second, weight)
}

/// The distance from the whole number below, 0 to 1; 0 for what is not a number.
#[inline]
fn fraction(value: f32) -> f32 {
    /// Numbers of this size have no binary places left, so that adding it rounds.
    const ROUNDER: f32 = 12_582_912.0;
    let nearest = (value + ROUNDER) - ROUNDER;
    let floor = if nearest > value { nearest - 1.0 } else { nearest };
    let within = value - floor;
    if within > 0.0 { within.min(1.0) } else { 0.0 }
}

/// The nearest whole number to `value`, which must lie between 0 and 2^23. A cast would check for more.
#[inline]
pub(crate) fn rounded(value: f32) -> u32 {
    /// From 2^23 on floats are whole, with the number's bits at the end.
    const WHOLE: f32 = 8_388_608.0;
    (value + WHOLE).to_bits() & 0x007f_ffff
}

/// The mean colour of four texels, of which clear ones count less, and their mean alpha.
fn mean_of(texels: [[u8; 4]; 4]) -> [u8; 4] {
    let alpha: u32 = texels.iter().map(|t| u32::from(t[3])).sum();
    let weight = |t: &[u8; 4]| if alpha == 0 { 1 } else { u32::from(t[3]) };
    let total = if alpha == 0 { 4 } else { alpha };
    let mut mean = [0, 1, 2, 3].map(|channel| {
        let sum: u32 = texels.iter().map(|t| u32::from(t[channel]) * weight(t)).sum();
        ((sum + total / 2) / total) as u8
    });
    mean[3] = ((alpha + 2) / 4) as u8;
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: u32, height: u32, values: &[u8]) -> Texture {
        Texture { width, height, pixels: values.iter().flat_map(|&v| [v, v, v, 255]).collect() }
    }

    #[test]
    fn texel_centres_have_the_texels_own_colour_and_borders_the_mean() {
        let pyramid = Pyramid::new(&grey(2, 2, &[0, 100, 200, 40])).expect("well-formed");
        let at = |u, v| pyramid.sample([u, v], 0.0)[0];
        assert_eq!([at(0.25, 0.25), at(0.75, 0.25), at(0.25, 0.75), at(0.75, 0.75)], [0, 100, 200, 40]);
        assert_eq!([at(0.5, 0.25), at(0.25, 0.5), at(0.5, 0.5)], [50, 100, 85]);
        assert_eq!(at(0.0, 0.25), 50, "the first texel's neighbour to the left is the last one");
    }

    #[test]
    fn a_texture_repeats_in_both_directions_and_senses() {
        let pyramid = Pyramid::new(&grey(3, 2, &[10, 20, 30, 40, 50, 60])).expect("well-formed");
        for (u, v) in [(0.2, 0.3), (0.9, 0.1), (0.5, 0.75)] {
            let here = pyramid.sample([u, v], 0.0)[0];
            for (du, dv) in [(1.0, 0.0), (-1.0, 2.0), (-7.0, -3.0), (100.0, 5.0)] {
                assert!(pyramid.sample([u + du, v + dv], 0.0)[0].abs_diff(here) <= 1);
            }
        }
    }

    #[test]
    fn a_large_footprint_takes_the_mean_of_the_whole() {
        let board: Vec<u8> = (0..64).map(|i| if (i % 8 + i / 8) % 2 == 0 { 0 } else { 200 }).collect();
        let pyramid = Pyramid::new(&grey(8, 8, &board)).expect("well-formed");
        assert_eq!(pyramid.sample([0.3, 0.6], 64.0), [100, 100, 100, 255]);
        assert_eq!((level_of(1.0), level_of(4.0), level_of(64.0), level_of(1e9)), (0, 1, 3, 15));
        assert_eq!((level_of(0.0), level_of(0.1)), (0, 0));
    }

    #[test]
    fn fractions_and_rounding_are_exact() {
        for (value, expected) in
            [(0.25, 0.25), (-0.25, 0.75), (7.5, 0.5), (-3.0, 0.0), (8.0, 0.0), (-2.5, 0.5)]
        {
            assert_eq!(fraction(value), expected, "{value}");
        }
        for (value, expected) in [(0.0, 0), (0.4, 0), (0.6, 1), (254.7, 255), (4_194_304.0, 4_194_304)] {
            assert_eq!(rounded(value), expected, "{value}");
        }
    }

    #[test]
    fn clear_texels_do_not_darken_smaller_versions() {
        let mixed = mean_of([[0, 0, 0, 0], [200, 100, 50, 255], [0, 0, 0, 0], [200, 100, 50, 255]]);
        assert_eq!(mixed, [200, 100, 50, 128]);
    }

    #[test]
    fn odd_sizes_shrink_to_one_texel_and_bad_ones_are_refused() {
        let pyramid = Pyramid::new(&grey(5, 1, &[1, 2, 3, 4, 5])).expect("well-formed");
        assert_eq!(
            pyramid.levels.iter().map(|l| (l.width, l.height)).collect::<Vec<_>>(),
            [(5, 1), (2, 1), (1, 1)]
        );
        assert!(Pyramid::new(&grey(2, 2, &[1, 2, 3])).is_none());
        assert!(Pyramid::new(&grey(0, 0, &[])).is_none());
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, -1e-30, 1e7] {
            pyramid.sample([odd, odd], odd);
        }
    }
}
