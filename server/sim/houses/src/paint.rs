//! Named colours and surface paints.

use super::texture::Pattern;

/// A shade of a named colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tint {
    pub(super) word: &'static str,
    pub(super) rgb: [u8; 3],
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// Paint of a surface.
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
    pub(super) const BRASS: Paint = Paint::plain("metal", [190, 158, 88]);
    pub(super) const PORCELAIN: Paint = Paint::plain("ceramic", [250, 250, 246]);
    pub(super) const LINEN: Paint = Paint::plain("fabric", [250, 249, 243]);
    pub(super) const SCREEN: Paint = Paint::plain("glass", [22, 24, 30]);
    pub(super) const MIRROR: Paint = Paint::plain("glass", [196, 212, 220]);
    pub(super) const PANE: Paint = Paint::plain("glass", [188, 212, 222]);
    pub(super) const SOIL: Paint = Paint::plain("earth", [70, 50, 36]);
    pub(super) const RUBBER: Paint = Paint::plain("rubber", [40, 40, 44]);
    pub(super) const OAK: Paint = Paint::plain("wood", [170, 122, 80]).with(Pattern::Grain);
    pub(super) const WALNUT: Paint = Paint::plain("wood", [104, 70, 46]).with(Pattern::Grain);

    pub(super) const fn plain(material: &'static str, rgb: [u8; 3]) -> Self {
        Self { material, rgb, pattern: None }
    }

    /// Perceived brightness of the base colour, 0 to 1 (ITU-R BT.601 weights).
    pub(super) fn brightness(&self) -> f32 {
        let [r, g, b] = self.rgb.map(f32::from);
        (0.299 * r + 0.587 * g + 0.114 * b) / 255.0
    }

    /// The paint scaled in brightness.
    pub(super) fn times(self, factor: f32) -> Self {
        Self { rgb: self.rgb.map(|value| byte(f32::from(value) * factor)), ..self }
    }

    pub(super) const fn with(self, pattern: Pattern) -> Self {
        Self { pattern: Some(pattern), ..self }
    }
}
