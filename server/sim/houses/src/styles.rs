//! Random styles, materials and colours; shades per pool.

use super::Pool;
use super::paint::{Substance, Tint};
use avln_geom::Rng;
use std::collections::BTreeMap;

/// Upholstery and cloth colours.
pub(super) const CLOTH: &str = "blue grey red green brown teal yellow white orange purple black pink";

/// Furniture colours, common ones first.
pub(super) const WOOD: &str = "brown white brown black grey blue green teal red yellow orange purple pink";

/// Bathroom furniture colours.
pub(super) const SANITARY: &str =
    "white white white grey pink teal black green yellow blue brown purple red orange";

pub(super) const MACHINE: &str =
    "white grey black white grey red teal blue green yellow orange pink brown purple";

/// Screen cases and dark frames.
pub(super) const DARK: &str =
    "black black grey black white brown red blue teal green yellow orange purple pink";

/// Leaf and blossom colours.
pub(super) const GREENERY: &str =
    "green green green red green yellow pink purple white orange teal blue brown grey black";

/// Random styles, materials and colours for a house's furniture.
pub(super) struct StyleSampler {
    pub(super) rng: Rng,
    pool: Pool,
    used: BTreeMap<(&'static str, &'static str), u32>,
}

impl StyleSampler {
    pub(super) fn new(rng: Rng, pool: Pool) -> Self {
        Self { rng, pool, used: BTreeMap::new() }
    }

    /// Draws a word, with preference for earlier words and words not yet used for `category`.
    pub(super) fn tint(&mut self, category: &'static str, words: &'static str) -> Tint {
        let words: Vec<&str> = words.split(' ').collect();
        let weight = |(place, word): (usize, &&'static str)| {
            let used = self.used.get(&(category, *word)).copied().unwrap_or(0);
            1.0 / ((1.5 + place as f32) * (1.0 + used as f32))
        };
        let weights: Vec<f32> = words.iter().enumerate().map(weight).collect();
        let word = words[self.weighted(&weights)];
        *self.used.entry((category, word)).or_default() += 1;
        self.shade(word)
    }

    /// Draws a shade from the pool.
    pub(super) fn shade(&mut self, word: &'static str) -> Tint {
        let rgb = *self.rng.choose(shades(self.pool, word)).expect("every colour word has shades");
        Tint { word, rgb }
    }

    /// Draws a material, with preference for the first.
    pub(super) fn substance(&mut self, substances: &[Substance]) -> Substance {
        let weights: Vec<f32> = (0..substances.len()).map(|place| 1.0 / (1.2 + place as f32)).collect();
        substances[self.weighted(&weights)]
    }

    /// Draws a material and a colour that the pool may combine with `style`.
    pub(super) fn look(
        &mut self,
        category: &'static str,
        style: usize,
        substances: &[Substance],
        words: &'static str,
    ) -> (Substance, Tint) {
        for _ in 0..12 {
            let substance = self.substance(substances);
            let tint = self.tint(category, words);
            let ours = combination_owner(style, substance, tint.word).is_none_or(|owner| owner == self.pool);
            if ours && substance.keeps(tint) {
                return (substance, tint);
            }
        }
        let likeliest = words.split(' ').next().unwrap_or_default();
        (substances[0], self.shade(likeliest))
    }

    /// Draws a style below `count` from the pool's styles.
    pub(super) fn style(&mut self, count: usize) -> usize {
        let own = match self.pool {
            Pool::Train => None,
            pool => Some(pool),
        };
        // The second-last style is reserved for validation, the last for test (the last two in every eight of
        // larger sets). Half of the draws in these two pools show reserved styles.
        let wanted = own.filter(|_| self.rng.chance(0.5));
        let fitting: Vec<usize> = (0..count).filter(|&style| owner(style, count) == wanted).collect();
        let common = || (0..count).filter(|&style| owner(style, count).is_none()).collect();
        let choice: Vec<usize> = if fitting.is_empty() { common() } else { fitting };
        choice[self.rng.below(choice.len())]
    }

    /// Draws an index in proportion to `weights`.
    pub(super) fn weighted(&mut self, weights: &[f32]) -> usize {
        weighted(&mut self.rng, weights).unwrap_or(weights.len() - 1)
    }
}

/// Draws an index in proportion to `weights`; `None` if they are empty, or if rounding exhausts them.
pub(super) fn weighted(rng: &mut Rng, weights: &[f32]) -> Option<usize> {
    let mut left = rng.range(0.0, weights.iter().sum());
    weights.iter().position(|weight| {
        left -= weight;
        left < 0.0
    })
}

/// Returns the only pool with a style; `None` for shared styles.
pub(super) fn owner(style: usize, count: usize) -> Option<Pool> {
    if count < 4 {
        return None;
    }
    let block = if count < 8 { count } else { 8 };
    match style % block {
        place if place + 2 == block => Some(Pool::Validation),
        place if place + 1 == block => Some(Pool::Test),
        _ => None,
    }
}

/// Returns the only pool with this combination; `None` for shared combinations, four in five.
pub(super) fn combination_owner(style: usize, substance: Substance, word: &str) -> Option<Pool> {
    let place = CLOTH.split(' ').position(|known| known == word).unwrap_or(0);
    // Multipliers without a common factor with ten spread the reserved combinations evenly.
    match (style * 3 + substance as usize * 7 + place) % 10 {
        4 => Some(Pool::Validation),
        9 => Some(Pool::Test),
        _ => None,
    }
}

/// Returns the first word below `low`, the second above `high`, otherwise an empty word.
pub(super) fn size_word(value: f32, low: f32, high: f32, words: [&'static str; 2]) -> &'static str {
    if value < low {
        words[0]
    } else if value > high {
        words[1]
    } else {
        ""
    }
}

/// A pool's sRGB shades per colour word. A shade matches the word in full light and in room shade.
type Shades = [(&'static str, &'static [[u8; 3]]); 12];

const TRAIN_SHADES: Shades = [
    ("red", &[[196, 36, 34], [170, 28, 40], [206, 60, 48], [150, 30, 34], [186, 44, 58]]),
    ("orange", &[[250, 148, 14], [252, 140, 30], [246, 150, 40], [255, 156, 26], [248, 138, 12]]),
    ("yellow", &[[246, 226, 52], [240, 212, 48], [228, 198, 44], [250, 232, 90], [252, 226, 30]]),
    ("green", &[[58, 146, 66], [84, 150, 70], [110, 160, 84], [46, 110, 60], [122, 170, 104]]),
    ("teal", &[[36, 150, 150], [24, 124, 128], [60, 160, 156], [20, 100, 104], [84, 170, 168]]),
    ("blue", &[[52, 88, 196], [44, 72, 150], [62, 100, 170], [34, 54, 120], [80, 120, 190]]),
    ("purple", &[[142, 46, 176], [160, 104, 194], [154, 60, 170], [170, 116, 204], [160, 70, 190]]),
    ("pink", &[[248, 136, 184], [255, 150, 190], [250, 128, 176], [255, 160, 200], [252, 142, 176]]),
    ("brown", &[[112, 72, 42], [147, 90, 50], [170, 116, 72], [92, 58, 36], [190, 136, 88]]),
    ("black", &[[30, 30, 32], [38, 38, 40], [46, 45, 46], [24, 24, 26], [42, 40, 44]]),
    ("grey", &[[128, 128, 128], [150, 150, 152], [168, 168, 166], [140, 142, 146], [112, 114, 116]]),
    ("white", &[[252, 251, 245], [255, 253, 248], [250, 250, 250], [255, 252, 240], [252, 252, 252]]),
];

const VALIDATION_SHADES: Shades = [
    ("red", &[[176, 16, 24], [210, 48, 62], [222, 40, 30]]),
    ("orange", &[[255, 146, 48], [244, 144, 22], [255, 150, 4]]),
    ("yellow", &[[236, 204, 20], [244, 220, 76], [232, 210, 64]]),
    ("green", &[[70, 132, 84], [96, 140, 60], [140, 186, 116]]),
    ("teal", &[[30, 138, 130], [52, 146, 160], [70, 184, 176]]),
    ("blue", &[[40, 80, 180], [30, 60, 140], [126, 170, 222]]),
    ("purple", &[[176, 90, 200], [148, 40, 160], [168, 128, 206]]),
    ("pink", &[[255, 146, 200], [246, 124, 170], [255, 166, 196]]),
    ("brown", &[[128, 82, 48], [180, 124, 70], [206, 150, 98]]),
    ("black", &[[34, 36, 40], [50, 48, 48], [20, 22, 24]]),
    ("grey", &[[160, 158, 154], [134, 132, 130], [146, 148, 150]]),
    ("white", &[[254, 250, 244], [249, 251, 250], [255, 255, 246]]),
];

const TEST_SHADES: Shades = [
    ("red", &[[190, 20, 50], [134, 22, 30], [216, 66, 58]]),
    ("orange", &[[250, 134, 24], [242, 152, 30], [255, 160, 48]]),
    ("yellow", &[[222, 194, 30], [250, 214, 36], [255, 228, 70]]),
    ("green", &[[40, 92, 50], [76, 164, 86], [100, 130, 72]]),
    ("teal", &[[18, 112, 120], [40, 170, 162], [64, 132, 134]]),
    ("blue", &[[70, 90, 200], [48, 66, 132], [72, 108, 182]]),
    ("purple", &[[150, 90, 186], [136, 36, 170], [180, 120, 210]]),
    ("pink", &[[255, 156, 184], [250, 136, 194], [252, 120, 180]]),
    ("brown", &[[156, 104, 62], [104, 66, 34], [196, 144, 104]]),
    ("black", &[[28, 26, 28], [40, 42, 44], [44, 42, 40]]),
    ("grey", &[[176, 176, 176], [120, 122, 126], [156, 160, 160]]),
    ("white", &[[255, 255, 252], [253, 252, 248], [251, 252, 246]]),
];

/// Shades for `word` in `pool`; empty for other words.
fn shades(pool: Pool, word: &str) -> &'static [[u8; 3]] {
    let rows = match pool {
        Pool::Train => &TRAIN_SHADES,
        Pool::Validation => &VALIDATION_SHADES,
        Pool::Test => &TEST_SHADES,
    };
    rows.iter().find(|row| row.0 == word).map_or(&[], |row| row.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_scene::colors::{PALETTE, name_of};
    use std::collections::BTreeSet;

    fn drawn(pool: Pool, count: usize) -> BTreeSet<usize> {
        let mut sampler = StyleSampler::new(Rng::new(4), pool);
        (0..400).map(|_| sampler.style(count)).collect()
    }

    #[test]
    fn reserved_styles_stay_in_their_pool() {
        for (count, common, validation, test) in
            [(8, 6, vec![6], vec![7]), (5, 3, vec![3], vec![4]), (16, 12, vec![6, 14], vec![7, 15])]
        {
            let train = drawn(Pool::Train, count);
            assert_eq!(train.len(), common);
            let own = |pool| drawn(pool, count).difference(&train).copied().collect::<Vec<_>>();
            assert_eq!((own(Pool::Validation), own(Pool::Test)), (validation, test));
        }
        assert_eq!(drawn(Pool::Train, 3).len(), 3);
    }

    #[test]
    fn colours_seldom_repeat_and_common_ones_come_first() {
        let mut sampler = StyleSampler::new(Rng::new(2), Pool::Train);
        let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
        (0..1200).for_each(|_| *counts.entry(sampler.tint("chair", CLOTH).word).or_default() += 1);
        assert_eq!(counts.len(), 12);
        assert!(counts["blue"] > counts["pink"] && counts["pink"] >= 20, "{counts:?}");
    }

    #[test]
    fn shades_match_their_name_in_any_light() {
        for pool in Pool::ALL {
            for (word, _) in PALETTE {
                assert!(shades(pool, word).len() >= 3, "{word}");
                for rgb in shades(pool, word) {
                    let dim = if word == "white" { 0.88 } else { 0.75 };
                    for light in [dim, (1.0 + dim) / 2.0, 1.0] {
                        let lit = rgb.map(|value| (f32::from(value) * light) as u8);
                        assert_eq!(name_of(lit), word, "{rgb:?} x {light}");
                    }
                }
            }
        }
    }

    #[test]
    fn pools_have_disjoint_shades() {
        let pools = [TRAIN_SHADES, VALIDATION_SHADES, TEST_SHADES];
        let all: Vec<_> = pools.iter().flatten().flat_map(|(_, shades)| shades.iter()).collect();
        assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), all.len());
    }
}
