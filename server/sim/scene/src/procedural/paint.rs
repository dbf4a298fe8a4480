//! Colours with names, and what surfaces are painted with.

use super::texture::Pattern;
use crate::colors::PALETTE;
use avln_geom::Rng;

/// A named colour, a little lighter or darker than its prototype.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tint {
    pub(super) word: &'static str,
    pub(super) rgb: [u8; 3],
}

impl Tint {
    /// The prototype of `word`.
    ///
    /// # Panics
    /// When `word` is none of [`PALETTE`].
    pub(super) fn plain(word: &'static str) -> Self {
        let rgb = PALETTE.iter().find(|(name, _)| *name == word).expect("a colour word").1;
        Self { word, rgb }
    }

    /// A shade of `word`.
    pub(super) fn shade(rng: &mut Rng, word: &'static str) -> Self {
        let (brightness, tone) = (rng.range(0.93, 1.07), rng.range(-5.0, 5.0));
        let [r, g, b] = Self::plain(word).rgb.map(|value| f32::from(value) * brightness);
        Self { word, rgb: [byte(r + tone), byte(g), byte(b - tone)] }
    }
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// What a surface is painted with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Paint {
    /// The substance, in words that acoustics understands.
    pub(super) material: &'static str,
    /// Base colour.
    pub(super) rgb: [u8; 3],
    /// Picture that the base colour multiplies.
    pub(super) pattern: Option<Pattern>,
}

impl Paint {
    pub(super) const CHROME: Paint = Paint::plain("metal", [176, 180, 186]);
    pub(super) const STEEL: Paint = Paint::plain("metal", [138, 141, 146]);
    pub(super) const DARK_METAL: Paint = Paint::plain("metal", [42, 42, 46]);
    pub(super) const PORCELAIN: Paint = Paint::plain("ceramic", [240, 240, 238]);
    pub(super) const SCREEN: Paint = Paint::plain("glass", [22, 24, 30]);
    pub(super) const MIRROR: Paint = Paint::plain("glass", [196, 212, 220]);
    pub(super) const SOIL: Paint = Paint::plain("earth", [70, 50, 36]);
    pub(super) const LEAF: Paint = Paint::plain("plant", [58, 132, 56]);
    pub(super) const LAMP: Paint = Paint::plain("fabric", [255, 244, 214]);

    pub(super) const fn plain(material: &'static str, rgb: [u8; 3]) -> Self {
        Self { material, rgb, pattern: None }
    }

    pub(super) fn fabric(tint: Tint) -> Self {
        Self { material: "fabric", rgb: tint.rgb, pattern: Some(Pattern::Weave) }
    }

    pub(super) fn leather(tint: Tint) -> Self {
        Self { material: "leather", rgb: tint.rgb, pattern: Some(Pattern::Plaster) }
    }

    /// Wood: with visible grain when it is brown, painted otherwise.
    pub(super) fn wood(tint: Tint) -> Self {
        let pattern = (tint.word == "brown").then_some(Pattern::Grain);
        Self { material: "wood", rgb: tint.rgb, pattern }
    }

    pub(super) fn metal(tint: Tint) -> Self {
        Self::plain("metal", tint.rgb)
    }

    pub(super) fn plastic(tint: Tint) -> Self {
        Self::plain("plastic", tint.rgb)
    }

    pub(super) fn ceramic(tint: Tint) -> Self {
        Self::plain("ceramic", tint.rgb)
    }

    /// The same surface, lighter (above 1) or darker.
    pub(super) fn times(self, factor: f32) -> Self {
        Self { rgb: self.rgb.map(|value| byte(f32::from(value) * factor)), ..self }
    }

    pub(super) fn with(self, pattern: Pattern) -> Self {
        Self { pattern: Some(pattern), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colors::name_of;

    #[test]
    fn shades_keep_their_name_in_bright_and_in_dim_light() {
        let mut rng = Rng::new(1);
        for (word, _) in PALETTE {
            for _ in 0..50 {
                let rgb = Tint::shade(&mut rng, word).rgb;
                for light in [0.82, 1.0] {
                    assert_eq!(
                        nearest_word(rgb.map(|value| f32::from(value) * light)),
                        word,
                        "{rgb:?} x {light}"
                    );
                }
            }
        }
    }
}
