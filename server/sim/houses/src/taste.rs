//! Random choices of style, material and colour that do not repeat sooner than they must.

use super::Pool;
use super::paint::Tint;
use super::substance::Substance;
use super::tints::shades;
use avln_geom::Rng;
use std::collections::BTreeMap;

/// Colours of upholstery and cloth.
pub(super) const CLOTH: &[&str] = &[
    "blue", "grey", "red", "green", "brown", "teal", "yellow", "white", "orange", "purple", "black", "pink",
];

/// Colours of furniture, the common ones first.
pub(super) const WOOD: &[&str] = &[
    "brown", "white", "brown", "black", "grey", "blue", "green", "teal", "red", "yellow", "orange", "purple",
    "pink",
];

/// Colours of bathroom furniture.
pub(super) const SANITARY: &[&str] = &[
    "white", "white", "white", "grey", "pink", "teal", "black", "green", "yellow", "blue", "brown", "purple",
    "red", "orange",
];

/// Colours of machines.
pub(super) const MACHINE: &[&str] = &[
    "white", "grey", "black", "white", "grey", "red", "teal", "blue", "green", "yellow", "orange", "pink",
    "brown", "purple",
];

/// Colours of screens' cases and frames.
pub(super) const DARK: &[&str] = &[
    "black", "black", "grey", "black", "white", "brown", "red", "blue", "teal", "green", "yellow", "orange",
    "purple", "pink",
];

/// Colours of leaves and blossoms.
pub(super) const GREENERY: &[&str] = &[
    "green", "green", "green", "red", "green", "yellow", "pink", "purple", "white", "orange", "teal", "blue",
    "brown", "grey", "black",
];

/// Random styles, materials, sizes and colours for the furniture of a house.
pub(super) struct Taste {
    pub(super) rng: Rng,
    pool: Pool,
    used: BTreeMap<(&'static str, &'static str), u32>,
}

impl Taste {
    pub(super) fn new(rng: Rng, pool: Pool) -> Self {
        Self { rng, pool, used: BTreeMap::new() }
    }

    /// Draws a word, with preference for earlier words and words not yet used for `category`.
    pub(super) fn tint(&mut self, category: &'static str, words: &[&'static str]) -> Tint {
        let weight = |(place, word): (usize, &&'static str)| {
            let used = self.used.get(&(category, *word)).copied().unwrap_or(0);
            1.0 / ((1.5 + place as f32) * (1.0 + used as f32))
        };
        let weights: Vec<f32> = words.iter().enumerate().map(weight).collect();
        let word = words[self.weighted(&weights)];
        *self.used.entry((category, word)).or_default() += 1;
        self.shade(word)
    }

    /// Some shade of `word` of this pool.
    pub(super) fn shade(&mut self, word: &'static str) -> Tint {
        let rgb = *self.rng.choose(shades(self.pool, word)).expect("every colour word has shades");
        Tint { word, rgb }
    }

    /// Draws a material, with preference for the first.
    pub(super) fn substance(&mut self, substances: &[Substance]) -> Substance {
        let weights: Vec<f32> = (0..substances.len()).map(|place| 1.0 / (1.2 + place as f32)).collect();
        substances[self.weighted(&weights)]
    }

    /// A material and a colour for style number `style` of `category` that this pool may show together.
    pub(super) fn look(
        &mut self,
        category: &'static str,
        style: usize,
        substances: &[Substance],
        words: &[&'static str],
    ) -> (Substance, Tint) {
        for _ in 0..12 {
            let substance = self.substance(substances);
            let tint = self.tint(category, words);
            let ours = combination_owner(style, substance, tint.word).is_none_or(|owner| owner == self.pool);
            if ours && substance.keeps(tint) {
                return (substance, tint);
            }
        }
        (substances[0], self.shade(words[0]))
    }

    /// Draws a style below `count` that this pool may show.
    ///
    /// The second-last style is reserved for validation and the last for test (the last two of every eight in
    /// larger sets); those pools show their styles every other time.
    pub(super) fn style(&mut self, count: usize) -> usize {
        let own = match self.pool {
            Pool::Train => None,
            pool => Some(pool),
        };
        let wanted = own.filter(|_| self.rng.chance(0.5));
        let fitting: Vec<usize> = (0..count).filter(|&style| owner(style, count) == wanted).collect();
        let common = || (0..count).filter(|&style| owner(style, count).is_none()).collect();
        let choice: Vec<usize> = if fitting.is_empty() { common() } else { fitting };
        choice[self.rng.below(choice.len())]
    }

    /// An index drawn with probabilities in proportion to `weights`.
    pub(super) fn weighted(&mut self, weights: &[f32]) -> usize {
        let total: f32 = weights.iter().sum();
        let mut left = self.rng.range(0.0, total);
        let index = weights.iter().position(|weight| {
            left -= weight;
            left < 0.0
        });
        index.unwrap_or(weights.len() - 1)
    }
}

/// The only pool with style `style` of `count`; `None` for shared styles.
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

/// The only pool with a style in this material and colour; `None` for shared combinations: four of five.
pub(super) fn combination_owner(style: usize, substance: Substance, word: &str) -> Option<Pool> {
    let place = CLOTH.iter().position(|known| *known == word).unwrap_or(0);
    match (style * 3 + substance as usize * 7 + place) % 10 {
        4 => Some(Pool::Validation),
        9 => Some(Pool::Test),
        _ => None,
    }
}

/// The first word below `low`, the second above `high`, otherwise empty.
pub(super) fn size_word(value: f32, low: f32, high: f32, words: [&'static str; 2]) -> &'static str {
    if value < low {
        words[0]
    } else if value > high {
        words[1]
    } else {
        ""
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn drawn(pool: Pool, count: usize) -> BTreeSet<usize> {
        let mut taste = Taste::new(Rng::new(4), pool);
        (0..400).map(|_| taste.style(count)).collect()
    }

    #[test]
    fn styles_that_are_held_out_are_shown_by_their_own_pool_only() {
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
        let mut taste = Taste::new(Rng::new(2), Pool::Train);
        let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
        (0..1200).for_each(|_| *counts.entry(taste.tint("chair", CLOTH).word).or_default() += 1);
        assert_eq!(counts.len(), 12);
        assert!(counts["blue"] > counts["pink"] && counts["pink"] >= 20, "{counts:?}");
    }
}
