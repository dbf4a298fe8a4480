//! Textures with mipmaps, in blocks, so that neighbouring texels share a cache line.

use avln_scene::Texture;

// 16 texels of 4 bytes fill a cache line.
pub(crate) const BLOCK: usize = 4;

/// Bits for a texture's level count; the others are the first level.
pub(crate) const LEVEL_BITS: u32 = 5;

/// White texture (level 0) for untextured surfaces.
pub(crate) const NO_TEXTURE: u32 = 1;

// More texels per side would not fit the sampling arithmetic.
const LARGEST: usize = 16_384;

/// A model's textures.
pub(super) struct Textures {
    pub(super) levels: Vec<super::Level>,
    pub(super) texels: Vec<u32>,
}

/// A picture, row-major from the top-left.
struct Level {
    width: usize,
    height: usize,
    texels: Vec<[u8; 4]>,
}

impl Textures {
    pub(super) fn new() -> Self {
        Self { levels: vec![[0, 1 | 1 << 16]], texels: vec![u32::MAX; BLOCK * BLOCK] }
    }

    /// Adds a texture with mipmaps. Returns the first level with the level count in the low [`LEVEL_BITS`]
    /// bits; [`NO_TEXTURE`] for an empty image, more than 16,384 texels per side, a wrong byte count, or 2^32
    /// texels in total.
    pub(super) fn add(&mut self, texture: &Texture) -> u32 {
        let first = self.levels.len() as u32;
        let mut level = Level::full(texture);
        while let Some(current) = level {
            let Ok(start) = u32::try_from(self.texels.len()) else { break };
            self.levels.push([start, current.width as u32 | (current.height as u32) << 16]);
            current.store(&mut self.texels);
            level = current.halved();
        }
        match self.levels.len() as u32 - first {
            0 => NO_TEXTURE,
            count => first << LEVEL_BITS | count,
        }
    }
}

impl Level {
    fn full(texture: &Texture) -> Option<Self> {
        let (width, height) = (texture.width as usize, texture.height as usize);
        let (texels, rest) = texture.pixels.as_chunks::<4>();
        let fits = !texels.is_empty()
            && rest.is_empty()
            && width.max(height) <= LARGEST
            && width.checked_mul(height) == Some(texels.len());
        fits.then(|| Self { width, height, texels: texels.to_vec() })
    }

    /// Appends the texels block by block; blocks across the border repeat border texels.
    fn store(&self, texels: &mut Vec<u32>) {
        for (top, left) in (0..self.height)
            .step_by(BLOCK)
            .flat_map(|top| (0..self.width).step_by(BLOCK).map(move |left| (top, left)))
        {
            for at in 0..BLOCK * BLOCK {
                let x = (left + at % BLOCK).min(self.width - 1);
                let y = (top + at / BLOCK).min(self.height - 1);
                texels.push(u32::from_le_bytes(self.texels[y * self.width + x]));
            }
        }
    }

    /// Returns half the size, by means of four texels; `None` for a single texel.
    fn halved(&self) -> Option<Self> {
        if self.texels.len() == 1 {
            return None;
        }
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            let upper = &self.texels[2 * y * self.width..][..self.width];
            let lower = &self.texels[(2 * y + 1).min(self.height - 1) * self.width..][..self.width];
            texels.extend((0..width).map(|x| {
                let (left, right) = (2 * x, (2 * x + 1).min(self.width - 1));
                mean_of([upper[left], upper[right], lower[left], lower[right]])
            }));
        }
        Some(Self { width, height, texels })
    }
}

/// Returns the mean colour, weighted by alpha, and the mean alpha.
fn mean_of(texels: [[u8; 4]; 4]) -> [u8; 4] {
    let sum = |channel: usize| texels.iter().map(|texel| u32::from(texel[channel])).sum::<u32>();
    let alpha = sum(3);
    if alpha == 4 * 255 {
        return [0, 1, 2, 3].map(|channel| ((sum(channel) + 2) / 4) as u8);
    }
    let weight = |texel: &[u8; 4]| if alpha == 0 { 1 } else { u32::from(texel[3]) };
    let total = if alpha == 0 { 4 } else { alpha };
    let mut mean = [0, 1, 2, 3].map(|channel| {
        let sum: u32 = texels.iter().map(|texel| u32::from(texel[channel]) * weight(texel)).sum();
        ((sum + total / 2) / total) as u8
    });
    mean[3] = ((alpha + 2) / 4) as u8;
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clear_texels_do_not_darken_smaller_versions() {
        let mixed = mean_of([[0, 0, 0, 0], [200, 100, 50, 255], [0, 0, 0, 0], [200, 100, 50, 255]]);
        assert_eq!(mixed, [200, 100, 50, 128]);
        assert_eq!(mean_of([[1, 2, 3, 255], [1, 2, 3, 255], [5, 6, 7, 255], [5, 6, 7, 255]]), [3, 4, 5, 255]);
    }

    #[test]
    fn mipmaps_end_with_one_texel_in_padded_blocks() {
        let pixels = (0..5 * 3).flat_map(|i| [i, 0, 0, 255]).collect();
        let mut textures = Textures::new();
        assert_eq!(textures.add(&Texture { width: 5, height: 3, pixels }), 1 << LEVEL_BITS | 3);
        assert_eq!(textures.levels[1..], [[16, 5 | 3 << 16], [48, 2 | 1 << 16], [64, 1 | 1 << 16]]);
        assert_eq!(textures.texels.len(), 80);
        let red = |at: usize| textures.texels[16 + at] as u8;
        assert_eq!([red(0), red(3), red(4), red(16), red(17), red(12)], [0, 3, 5, 4, 4, 10]);
    }

    #[test]
    fn invalid_images_have_no_levels() {
        let mut textures = Textures::new();
        for (width, height, bytes) in [(2, 2, 3), (2, 2, 12), (0, 0, 0), (0, 5, 0), (20_000, 1, 80_000)] {
            let texture = Texture { width, height, pixels: vec![0; bytes] };
            assert_eq!(textures.add(&texture), NO_TEXTURE, "{width} x {height}");
        }
    }
}
