/// Bins of a [`Palette`]: twelve hues, then black, dark grey, light grey and white.
const BINS: usize = 16;
const HUES: usize = 12;
/// Saturation below which a pixel is grey.
const GREY: f32 = 0.18;

/// Colour words, with examples.
const NAMED: [(&str, [u8; 3]); 13] = [
    ("red", [200, 40, 40]),
    ("orange", [240, 140, 30]),
    ("yellow", [240, 215, 60]),
    ("green", [60, 150, 60]),
    ("teal", [30, 145, 145]),
    ("blue", [45, 85, 190]),
    ("purple", [135, 55, 165]),
    ("pink", [240, 140, 180]),
    ("brown", [125, 85, 50]),
    ("black", [30, 30, 32]),
    ("grey", [135, 135, 135]),
    ("white", [240, 240, 235]),
    ("gray", [135, 135, 135]),
];

/// A histogram of hues and greys; the shares add up to 1 unless empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Palette {
    shares: [f32; BINS],
    pixels: f32,
}

impl Palette {
    /// Builds a palette from pixels.
    pub fn of(pixels: impl Iterator<Item = [u8; 3]>) -> Self {
        let mut palette = Self::default();
        for rgb in pixels {
            palette.shares[bin(rgb)] += 1.0;
            palette.pixels += 1.0;
        }
        let count = palette.pixels.max(1.0);
        palette.shares.iter_mut().for_each(|share| *share /= count);
        palette
    }

    /// Adds another view's pixels.
    pub fn merge(&mut self, other: &Self) {
        let all = (self.pixels + other.pixels).max(1.0);
        for (share, more) in self.shares.iter_mut().zip(&other.shares) {
            *share = (*share * self.pixels + more * other.pixels) / all;
        }
        // The cap lets new views change the colours of objects with many views.
        self.pixels = all.min(20_000.0);
    }

    /// Returns the similarity, 0 to 1; neighbouring hues count in part.
    pub fn likeness(&self, other: &Self) -> f32 {
        let (a, b) = (self.softened(), other.softened());
        a.iter().zip(&b).map(|(a, b)| (a * b).sqrt()).sum::<f32>().min(1.0)
    }

    /// Returns a colour word's share, 0 to 1; `None` for other words.
    pub fn share_of(&self, word: &str) -> Option<f32> {
        let (_, example) = NAMED.iter().find(|(name, _)| *name == word)?;
        Some(self.softened()[bin(*example)].min(1.0))
    }

    fn softened(&self) -> [f32; BINS] {
        const LEAK: f32 = 0.2;
        std::array::from_fn(|i| {
            let (before, after) = if i < HUES {
                ((i + HUES - 1) % HUES, (i + 1) % HUES)
            } else {
                ((i - 1).max(HUES), (i + 1).min(BINS - 1))
            };
            (1.0 - LEAK) * self.shares[i] + 0.5 * LEAK * (self.shares[before] + self.shares[after])
        })
    }
}

/// Returns true for a colour word.
pub(crate) fn is_color(word: &str) -> bool {
    NAMED.iter().any(|(name, _)| *name == word)
}

/// Returns the difference between two colours, 0 to about 1; brightness counts less than hue.
pub(crate) fn contrast(a: [u8; 3], b: [u8; 3]) -> f32 {
    let chroma = |rgb: [u8; 3]| {
        let [r, g, b] = rgb.map(|value| f32::from(value) / 255.0);
        [0.35 * (r + g + b) / 3.0, r - g, 0.5 * (r + g) - b]
    };
    let (a, b) = (chroma(a), chroma(b));
    a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

fn bin(rgb: [u8; 3]) -> usize {
    let [r, g, b] = rgb.map(|value| f32::from(value) / 255.0);
    let (high, low) = (r.max(g).max(b), r.min(g).min(b));
    if high - low < GREY * high.max(0.25) {
        return HUES + ((high * 4.0) as usize).min(3);
    }
    let span = high - low;
    let hue = if high == r {
        ((g - b) / span).rem_euclid(6.0)
    } else if high == g {
        (b - r) / span + 2.0
    } else {
        (r - g) / span + 4.0
    };
    ((hue * HUES as f32 / 6.0 + 0.5) as usize) % HUES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colour_words_match_pixels() {
        let red = Palette::of([[190, 30, 35]; 10].into_iter());
        assert!(red.share_of("red").unwrap() > 0.7 && red.share_of("blue").unwrap() < 0.1);
        let white = Palette::of([[250, 250, 240]; 10].into_iter());
        assert!(white.share_of("white").unwrap() > 0.7 && white.share_of("black").unwrap() < 0.1);
        assert_eq!(red.share_of("velvet"), None);
        assert!(is_color("teal") && !is_color("chair"));
    }

    #[test]
    fn palettes_match_themselves() {
        let red = Palette::of([[190, 30, 35]; 10].into_iter());
        let mut mixed = Palette::of([[30, 60, 190]; 10].into_iter());
        assert!(red.likeness(&red) > 0.95 && red.likeness(&mixed) < 0.1);
        mixed.merge(&red);
        assert!((0.3..0.95).contains(&red.likeness(&mixed)), "{}", red.likeness(&mixed));
    }

    #[test]
    fn brightness_counts_less_than_hue() {
        assert!(contrast([100, 50, 50], [120, 60, 60]) < 0.1);
        assert!(contrast([120, 60, 60], [60, 60, 120]) > 0.2);
    }
}
