//! Random choices of colour that do not repeat sooner than they must.

use super::Pool;
use super::paint::Tint;
use crate::Attributes;
use avln_geom::Rng;
use std::collections::BTreeMap;

/// Colours of upholstery and cloth.
pub(super) const CLOTH: &[&str] = &[
    "red", "orange", "yellow", "green", "teal", "blue", "purple", "pink", "brown", "black", "grey", "white",
];

/// Colours of wooden furniture, the common ones first.
pub(super) const WOOD: &[&str] =
    &["brown", "white", "black", "grey", "teal", "blue", "green", "red", "yellow"];

/// Draws sizes and colours for the furniture of one house.
pub(super) struct Taste {
    pub(super) rng: Rng,
    used: BTreeMap<(&'static str, &'static str), u32>,
}

impl Taste {
    pub(super) fn new(rng: Rng, pool: Pool) -> Self {
        let rng = if pool == Pool::Train { rng } else { rng.fork(pool.name()) };
        Self { rng, used: BTreeMap::new() }
    }

    /// One of `words`, of those that `category` has used least so far; earlier words are likelier.
    pub(super) fn tint(&mut self, category: &'static str, words: &[&'static str]) -> Tint {
        let uses = |taste: &Self, word: &'static str| taste.used.get(&(category, word)).copied().unwrap_or(0);
        let least = words.iter().map(|word| uses(self, word)).min().unwrap_or(0);
        let unused: Vec<_> = words.iter().copied().filter(|word| uses(self, word) == least).collect();
        let (a, b) = (self.rng.below(unused.len()), self.rng.below(unused.len()));
        let word = unused[a.min(b)];
        *self.used.entry((category, word)).or_default() += 1;
        Tint::shade(&mut self.rng, word)
    }

    /// A number in [`low`, `high`), in whole centimetres.
    pub(super) fn length_m(&mut self, low: f32, high: f32) -> f32 {
        (self.rng.range(low, high) * 100.0).round() / 100.0
    }

    /// A number below `count`, for a choice of style.
    pub(super) fn style(&mut self, count: usize) -> usize {
        self.rng.below(count)
    }
}

/// Attributes in words; empty for what is not said.
pub(super) fn said(tint: Tint, material: &str, size: &str, shape: &str) -> Attributes {
    Attributes {
        noun: String::new(),
        color: tint.word.to_owned(),
        material: material.to_owned(),
        size: size.to_owned(),
        shape: shape.to_owned(),
    }
}

/// The first word where `value` is below `low`, the second where it is above `high`, nothing in between.
pub(super) fn size_word(value: f32, low: f32, high: f32, words: [&'static str; 2]) -> &'static str {
    if value < low {
        words[0]
    } else if value > high {
        words[1]
    } else {
        ""
    }
}
