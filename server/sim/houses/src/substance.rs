//! Materials of objects: word, acoustics, look.

use super::paint::{Paint, Tint};
use super::texture::Pattern;
use avln_scene::colors::name_of;
use std::collections::BTreeMap;
use std::sync::LazyLock;

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
