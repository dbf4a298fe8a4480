//! Abstract pictures: each has a ground in a named colour and a few shapes on it.

use super::Texture;
use crate::colors::PALETTE;
use crate::procedural::paint::Tint;
use avln_geom::Rng;

/// A picture for a wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::procedural) struct Art {
    /// Index of the ground's colour in [`PALETTE`].
    pub(in crate::procedural) ground: u8,
    /// Seed of the shapes.
    pub(in crate::procedural) seed: u32,
}

const SIZE: u32 = 64;

impl Art {
    fn ground_rgb(self) -> [u8; 3] {
        Tint::plain(PALETTE[usize::from(self.ground)].0).rgb
    }

    /// Draws the picture; the ground stays visible on more than half of it.
    pub(super) fn draw(self) -> Texture {
        let mut rng = Rng::new(u64::from(self.seed));
        let ground = self.ground_rgb();
        let mut canvas = vec![ground; (SIZE * SIZE) as usize];
        // Brown and black are the colours of frames.
        let shapes =
            PALETTE.iter().filter(|(word, _)| !["brown", "black"].contains(word)).map(|(_, rgb)| *rgb);
        let shapes: Vec<[u8; 3]> = shapes.collect();
        let shape = rng.below(4);
        let count = 3 + rng.below(3);
        for _ in 0..count {
            let color = shapes[rng.below(shapes.len())];
            draw_shape(&mut rng, &mut canvas, shape, color);
        }
        let pixels = canvas.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect();
        Texture { width: SIZE, height: SIZE, pixels }
    }
}

fn draw_shape(rng: &mut Rng, canvas: &mut [[u8; 3]], shape: usize, color: [u8; 3]) {
    let (cx, cy) = (rng.range(10.0, 54.0), rng.range(10.0, 54.0));
    let size = rng.range(4.5, 9.0);
    for y in 0..SIZE {
        for x in 0..SIZE {
            let (dx, dy) = (x as f32 + 0.5 - cx, y as f32 + 0.5 - cy);
            let inside = match shape {
                0 => dx * dx + dy * dy < size * size,
                1 => dx.abs() < size * 0.9 && dy.abs() < size * 0.9,
                2 => dy.abs() < size * 0.22 && dx.abs() < 26.0,
                _ => dy > 0.4 * -size && dy < size && dx.abs() < (size - dy) * 0.7,
            };
            if inside {
                canvas[(y * SIZE + x) as usize] = color;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ground_covers_more_than_half() {
        for seed in 0..60 {
            let art = Art { ground: (seed % 12) as u8, seed };
            let ground = art.ground_rgb();
            let texture = art.draw();
            let same = texture.pixels.chunks(4).filter(|texel| texel[..3] == ground).count();
            assert!(same > (SIZE * SIZE / 2) as usize, "seed {seed}: {same}");
        }
    }
}
