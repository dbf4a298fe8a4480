use avln_scene::colors;
use std::sync::LazyLock;

/// Steps of each channel in the table of names.
const STEPS: usize = 32;
/// Colour words.
const WORDS: usize = colors::PALETTE.len();

/// Index of the colour word of each cell of the RGB cube.
static NAMES: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let middle = |step: usize| (step * 256 / STEPS + 128 / STEPS) as u8;
    let word = |cell: usize| {
        let rgb = [cell / (STEPS * STEPS), cell / STEPS % STEPS, cell % STEPS].map(middle);
        word_index(colors::name_of(rgb)) as u8
    };
    (0..STEPS * STEPS * STEPS).map(word).collect()
});

fn word_index(word: &str) -> usize {
    colors::PALETTE.iter().position(|(name, _)| *name == word).unwrap_or(WORDS - 1)
}

/// The colours in which something was seen.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Palette {
    counts: [u64; WORDS],
    sums: [u64; 3],
}

impl Palette {
    /// Adds one pixel.
    pub(crate) fn add(&mut self, rgb: [u8; 3]) {
        let [r, g, b] = rgb.map(|value| usize::from(value) * STEPS / 256);
        self.counts[usize::from(NAMES[(r * STEPS + g) * STEPS + b])] += 1;
        (0..3).for_each(|channel| self.sums[channel] += u64::from(rgb[channel]));
    }

    /// Pixels seen.
    pub(crate) fn pixels(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Share of the pixels that have the colour `word`, 0 to 1; 0 when nothing was seen.
    pub(crate) fn share_of(&self, word: &str) -> f32 {
        let known = colors::PALETTE.iter().position(|(name, _)| *name == word);
        known.map_or(0.0, |index| self.counts[index] as f32 / self.pixels().max(1) as f32)
    }

    /// The word of the mean colour; `None` when nothing was seen.
    pub(crate) fn mean_word(&self) -> Option<&'static str> {
        let pixels = self.pixels();
        (pixels > 0).then(|| colors::name_of(self.sums.map(|sum| (sum / pixels) as u8)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_palette_counts_words_and_names_the_mean() {
        let mut palette = Palette::default();
        assert_eq!((palette.mean_word(), palette.share_of("red")), (None, 0.0));
        (0..3).for_each(|_| palette.add([200, 30, 30]));
        palette.add([24, 24, 26]);
        assert_eq!(palette.pixels(), 4);
        assert!((palette.share_of("red") - 0.75).abs() < 1e-6);
        assert!((palette.share_of("black") - 0.25).abs() < 1e-6);
        assert_eq!(palette.mean_word(), Some("red"), "the mean is (156, 28, 29)");
        assert_eq!(palette.share_of("beige"), 0.0);
    }

    #[test]
    fn the_table_agrees_with_the_names() {
        for (word, rgb) in colors::PALETTE {
            let mut palette = Palette::default();
            palette.add(rgb);
            assert_eq!(palette.share_of(word), 1.0, "{word}");
        }
    }
}
