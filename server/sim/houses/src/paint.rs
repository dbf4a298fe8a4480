//! Colours, surface paints, and materials of objects.

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

/// Mean brightness of the pattern of each substance, 0 to 1.
static MEANS: LazyLock<BTreeMap<Pattern, f32>> = LazyLock::new(|| {
    let patterns = Substance::ALL.iter().filter_map(|substance| substance.pattern());
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

impl Substance {
    const ALL: [Self; 25] = [
        Self::Wood,
        Self::Bamboo,
        Self::Wicker,
        Self::Metal,
        Self::Plastic,
        Self::Glass,
        Self::Ceramic,
        Self::Marble,
        Self::Concrete,
        Self::Terrazzo,
        Self::Brick,
        Self::Tile,
        Self::Paper,
        Self::Fabric,
        Self::Velvet,
        Self::Leather,
        Self::Corduroy,
        Self::Knit,
        Self::Denim,
        Self::Quilt,
        Self::Striped,
        Self::Checked,
        Self::Dotted,
        Self::Wool,
        Self::Rubber,
    ];

    /// The word that describes it.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Wood => "wooden",
            Self::Bamboo => "bamboo",
            Self::Wicker => "wicker",
            Self::Metal => "metal",
            Self::Plastic => "plastic",
            Self::Glass => "glass",
            Self::Ceramic => "ceramic",
            Self::Marble => "marble",
            Self::Concrete => "concrete",
            Self::Terrazzo => "terrazzo",
            Self::Brick => "brick",
            Self::Tile => "tiled",
            Self::Paper => "paper",
            Self::Fabric => "fabric",
            Self::Velvet => "velvet",
            Self::Leather => "leather",
            Self::Corduroy => "corduroy",
            Self::Knit => "knitted",
            Self::Denim => "denim",
            Self::Quilt => "quilted",
            Self::Striped => "striped",
            Self::Checked => "checked",
            Self::Dotted => "dotted",
            Self::Wool => "woollen",
            Self::Rubber => "rubber",
        }
    }

    /// Material name of its surfaces, in words known to the acoustics.
    pub(super) fn surface(self) -> &'static str {
        match self {
            Self::Wood | Self::Bamboo | Self::Wicker => "wood",
            Self::Metal => "metal",
            Self::Plastic => "plastic",
            Self::Glass => "glass",
            Self::Ceramic => "ceramic",
            Self::Marble | Self::Concrete | Self::Terrazzo => "stone",
            Self::Brick => "brick",
            Self::Tile => "tile",
            Self::Paper => "paper",
            Self::Leather => "leather",
            Self::Wool => "carpet",
            Self::Rubber => "rubber",
            _ => "fabric",
        }
    }

    fn pattern(self) -> Option<Pattern> {
        Some(match self {
            Self::Wood => Pattern::Grain,
            Self::Bamboo => Pattern::Bamboo,
            Self::Wicker => Pattern::Wicker,
            Self::Metal => Pattern::Brushed,
            Self::Glass => Pattern::Sheen,
            Self::Marble => Pattern::Marble,
            Self::Concrete => Pattern::Concrete,
            Self::Terrazzo => Pattern::Terrazzo,
            Self::Brick => Pattern::Brick,
            Self::Tile => Pattern::WallTiles,
            Self::Fabric => Pattern::Weave,
            Self::Velvet => Pattern::Velvet,
            Self::Leather => Pattern::Leather,
            Self::Corduroy => Pattern::Ribs,
            Self::Knit => Pattern::Knit,
            Self::Denim => Pattern::Twill,
            Self::Quilt => Pattern::Quilt,
            Self::Striped => Pattern::ClothStripes,
            Self::Checked => Pattern::Gingham,
            Self::Dotted => Pattern::Dots,
            Self::Wool => Pattern::Carpet,
            Self::Plastic | Self::Ceramic | Self::Paper | Self::Rubber => return None,
        })
    }

    /// Returns true if its pattern preserves the colour word in mean room light.
    pub(super) fn keeps(self, tint: Tint) -> bool {
        let paint = self.paint(tint);
        let light = 0.85 + 0.07 * paint.brightness();
        let seen = light * self.pattern().map_or(1.0, |pattern| MEANS[&pattern]);
        let lit = |light: f32| name_of(tint.rgb.map(|value| (f32::from(value) * light) as u8));
        lit(seen) == tint.word && lit(seen * 0.94) == tint.word
    }

    /// Returns true for cloth and leather.
    pub(super) fn is_soft(self) -> bool {
        matches!(self.surface(), "fabric" | "leather" | "carpet")
    }

    /// A surface of it in the colour `tint`.
    pub(super) fn paint(self, tint: Tint) -> Paint {
        Paint { material: self.surface(), rgb: tint.rgb, pattern: self.pattern() }
    }
}
