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
    /// The plain colour called `word`.
    ///
    /// # Panics
    /// When `word` is no colour word.
    pub(super) fn plain(word: &'static str) -> Self {
        let brighter = BRIGHTER.iter().find(|(name, _)| *name == word);
        let named = brighter.or_else(|| PALETTE.iter().find(|(name, _)| *name == word));
        Self { word, rgb: named.expect("a colour word").1 }
    }

    /// A shade of `word`.
    pub(super) fn shade(rng: &mut Rng, word: &'static str) -> Self {
        let (brightness, tone) = (rng.range(0.94, 1.05), rng.range(-4.0, 4.0));
        let brightness = if word == "white" { brightness.max(0.985) } else { brightness };
        let [r, g, b] = Self::plain(word).rgb.map(|value| f32::from(value) * brightness);
        Self { word, rgb: [byte(r + tone), byte(g), byte(b - tone)] }
    }
}

/// Colours whose typical value would go by another word in the shade: kinds that keep their name there.
const BRIGHTER: [(&str, [u8; 3]); 5] = [
    ("orange", [250, 148, 14]),
    ("yellow", [246, 226, 52]),
    ("purple", [142, 46, 176]),
    ("pink", [248, 136, 184]),
    ("white", [252, 251, 245]),
];

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
    pub(super) const PORCELAIN: Paint = Paint::plain("ceramic", [250, 250, 246]);
    pub(super) const SCREEN: Paint = Paint::plain("glass", [22, 24, 30]);
    pub(super) const MIRROR: Paint = Paint::plain("glass", [196, 212, 220]);
    pub(super) const SOIL: Paint = Paint::plain("earth", [70, 50, 36]);
    pub(super) const LEAF: Paint = Paint::plain("plant", [58, 132, 56]);
    pub(super) const LAMP: Paint = Paint::plain("fabric", [255, 244, 214]);

    pub(super) const fn plain(material: &'static str, rgb: [u8; 3]) -> Self {
        Self { material, rgb, pattern: None }
    }

    /// Cloth; white is too fine for its weave to be seen.
    pub(super) fn fabric(tint: Tint) -> Self {
        let pattern = (tint.word != "white").then_some(Pattern::Weave);
        Self { material: "fabric", rgb: tint.rgb, pattern }
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

    /// How bright the base colour looks, 0 to 1 (ITU-R BT.601 weights).
    pub(super) fn brightness(&self) -> f32 {
        let [r, g, b] = self.rgb.map(f32::from);
        (0.299 * r + 0.587 * g + 0.114 * b) / 255.0
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
                for light in [if word == "white" { 0.88 } else { 0.75 }, 1.0] {
                    let lit = rgb.map(|value| (f32::from(value) * light) as u8);
                    assert_eq!(name_of(lit), word, "{rgb:?} x {light}");
                }
            }
        }
    }
}
