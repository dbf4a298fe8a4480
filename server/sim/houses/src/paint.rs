//! Colours, surface paints and object materials.

use super::texture::Pattern;
use avln_scene::colors::name_of;
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// A shade of a named colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tint {
    pub(super) word: &'static str,
    pub(super) rgb: [u8; 3],
}

fn byte(value: f32) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Paint {
    /// Material, a word known to the acoustics.
    pub(super) material: &'static str,
    pub(super) rgb: [u8; 3],
    /// Picture multiplied by the base colour.
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

    /// Perceived brightness, 0 to 1 (ITU-R BT.601 weights), without the pattern.
    pub(super) fn brightness(&self) -> f32 {
        let [r, g, b] = self.rgb.map(f32::from);
        (0.299 * r + 0.587 * g + 0.114 * b) / 255.0
    }

    pub(super) fn times(self, factor: f32) -> Self {
        Self { rgb: self.rgb.map(|value| byte(f32::from(value) * factor)), ..self }
    }

    pub(super) const fn with(self, pattern: Pattern) -> Self {
        Self { pattern: Some(pattern), ..self }
    }
}

/// Mean brightness of every substance's pattern, 0 to 1.
// Computed once: every drawn colour needs a mean.
static MEANS: LazyLock<BTreeMap<Pattern, f32>> = LazyLock::new(|| {
    let patterns = SUBSTANCES.iter().filter_map(|(.., pattern)| *pattern);
    patterns.map(|pattern| (pattern, pattern.mean())).collect()
});

/// A visually recognisable material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Substance {
    Wood,
    Bamboo,
    Wicker,
    Metal,
    Plastic,
    Glass,
    Ceramic,
    Marble,
    Concrete,
    Terrazzo,
    Brick,
    Tile,
    Paper,
    Fabric,
    Velvet,
    Leather,
    Corduroy,
    Knit,
    Denim,
    Quilt,
    Striped,
    Checked,
    Dotted,
    Wool,
    Rubber,
}

/// Description, acoustic material and pattern per substance, in enum order.
const SUBSTANCES: [(Substance, &str, &str, Option<Pattern>); 25] = [
    (Substance::Wood, "wooden", "wood", Some(Pattern::Grain)),
    (Substance::Bamboo, "bamboo", "wood", Some(Pattern::Bamboo)),
    (Substance::Wicker, "wicker", "wood", Some(Pattern::Wicker)),
    (Substance::Metal, "metal", "metal", Some(Pattern::Brushed)),
    (Substance::Plastic, "plastic", "plastic", None),
    (Substance::Glass, "glass", "glass", Some(Pattern::Sheen)),
    (Substance::Ceramic, "ceramic", "ceramic", None),
    (Substance::Marble, "marble", "stone", Some(Pattern::Marble)),
    (Substance::Concrete, "concrete", "stone", Some(Pattern::Concrete)),
    (Substance::Terrazzo, "terrazzo", "stone", Some(Pattern::Terrazzo)),
    (Substance::Brick, "brick", "brick", Some(Pattern::Brick)),
    (Substance::Tile, "tiled", "tile", Some(Pattern::WallTiles)),
    (Substance::Paper, "paper", "paper", None),
    (Substance::Fabric, "fabric", "fabric", Some(Pattern::Weave)),
    (Substance::Velvet, "velvet", "fabric", Some(Pattern::Velvet)),
    (Substance::Leather, "leather", "leather", Some(Pattern::Leather)),
    (Substance::Corduroy, "corduroy", "fabric", Some(Pattern::Ribs)),
    (Substance::Knit, "knitted", "fabric", Some(Pattern::Knit)),
    (Substance::Denim, "denim", "fabric", Some(Pattern::Twill)),
    (Substance::Quilt, "quilted", "fabric", Some(Pattern::Quilt)),
    (Substance::Striped, "striped", "fabric", Some(Pattern::ClothStripes)),
    (Substance::Checked, "checked", "fabric", Some(Pattern::Gingham)),
    (Substance::Dotted, "dotted", "fabric", Some(Pattern::Dots)),
    (Substance::Wool, "woollen", "carpet", Some(Pattern::Carpet)),
    (Substance::Rubber, "rubber", "rubber", None),
];

impl Substance {
    pub(super) fn word(self) -> &'static str {
        SUBSTANCES[self as usize].1
    }

    /// Acoustic material.
    pub(super) fn surface(self) -> &'static str {
        SUBSTANCES[self as usize].2
    }

    fn pattern(self) -> Option<Pattern> {
        SUBSTANCES[self as usize].3
    }

    /// Returns true if the pattern preserves the colour word in mean room light.
    pub(super) fn keeps(self, tint: Tint) -> bool {
        let paint = self.paint(tint);
        // Two light levels, because the baked light differs over a piece.
        let light = 0.85 + 0.07 * paint.brightness();
        let seen = light * self.pattern().map_or(1.0, |pattern| MEANS[&pattern]);
        let lit = |light: f32| name_of(tint.rgb.map(|value| (f32::from(value) * light) as u8));
        lit(seen) == tint.word && lit(seen * 0.94) == tint.word
    }

    /// Returns true for cloth and leather.
    pub(super) fn is_soft(self) -> bool {
        matches!(self.surface(), "fabric" | "leather" | "carpet")
    }

    pub(super) fn paint(self, tint: Tint) -> Paint {
        Paint { material: self.surface(), rgb: tint.rgb, pattern: self.pattern() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn substance_rows_follow_the_enum() {
        assert!(SUBSTANCES.iter().enumerate().all(|(index, row)| row.0 as usize == index));
    }
}
