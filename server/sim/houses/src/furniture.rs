//! Furniture of procedural houses, by kind. Every function draws a piece in its own frame (base at y = 0 unless it hangs, front towards +z)
//! and returns matching words. The draft is called `k`, with the model `k.m` and the main paint `k.paint`.

pub(super) mod decor;
pub(super) mod displays;
pub(super) mod fixtures;
pub(super) mod kitchen;
pub(super) mod lights;
pub(super) mod openings;
pub(super) mod parts;
pub(super) mod seats;
pub(super) mod sports;
pub(super) mod storage;
pub(super) mod tables;
pub(super) mod textiles;

use super::assembly::Piece;
use super::model::{Model, Span, about};
use super::paint::{Paint, Substance, Substance::*, Tint};
use super::styles::{self, StyleSampler, size_word};
use super::texture::Pattern;
use avln_geom::{Point3, Rng, Vector3, angle};
use avln_scene::{Attributes, Lamp};
use parts::*;

/// A furniture kind.
pub(super) struct FurnitureKind {
    /// Category, from mpcat40 if possible.
    pub(super) category: &'static str,
    /// Common name if the category is more general; otherwise empty.
    pub(super) noun: &'static str,
    /// Style count.
    pub(super) styles: usize,
    /// Materials, likelier first.
    pub(super) substances: &'static [Substance],
    /// Colour words separated by spaces, likelier first.
    pub(super) colors: &'static str,
    /// Draws the draft's style; returns size and shape words.
    pub(super) draw: fn(&mut Draft) -> Words,
}

/// Size word and shape word; may be empty.
pub(super) type Words = [&'static str; 2];

/// A piece in progress.
pub(super) struct Draft {
    pub(super) model: Model,
    pub(super) rng: Rng,
    pub(super) style: usize,
    pub(super) tint: Tint,
    pub(super) substance: Substance,
    pub(super) paint: Paint,
    /// Paint for legs, frames and handles.
    pub(super) trim: Paint,
    /// Requested width, height and depth, metres; 0 for any.
    pub(super) wish: [f32; 3],
    /// Common name, initially the kind's.
    pub(super) noun: &'static str,
    /// Material word, initially the substance's.
    pub(super) material: &'static str,
}

impl Draft {
    /// Draws a length in [`low`, `high`), in whole centimetres.
    pub(super) fn len(&mut self, low: f32, high: f32) -> f32 {
        (self.rng.range(low, high) * 100.0).round() / 100.0
    }

    /// Returns the requested width, or draws one.
    pub(super) fn width(&mut self, low: f32, high: f32) -> f32 {
        // Always draws, so that a request does not shift later draws.
        let drawn = self.len(low, high);
        if self.wish[0] > 0.0 { self.wish[0] } else { drawn }
    }

    /// Returns the requested height, or draws one.
    pub(super) fn height(&mut self, low: f32, high: f32) -> f32 {
        let drawn = self.len(low, high);
        if self.wish[1] > 0.0 { self.wish[1] } else { drawn }
    }

    /// Returns the requested depth, or draws one.
    pub(super) fn depth(&mut self, low: f32, high: f32) -> f32 {
        let drawn = self.len(low, high);
        if self.wish[2] > 0.0 { self.wish[2] } else { drawn }
    }

    /// Returns the style's entry in `words`, which are separated by `|`.
    pub(super) fn by_style(&self, words: &'static str) -> &'static str {
        words.split('|').nth(self.style).expect("a word for every style")
    }

    /// Returns true for upholstered or draped pieces.
    pub(super) fn soft(&self) -> bool {
        self.substance.is_soft()
    }

    /// Returns true for a dark paint, which bright parts would dominate.
    pub(super) fn dark(&self) -> bool {
        self.paint.brightness() < 0.3
    }

    /// Metal paint for taps, pipes and handles.
    pub(super) fn metal(&self) -> Paint {
        // Bright metal on a dark piece would change the mean colour, and so the colour word.
        if self.dark() { Paint::CHROME.times(0.4) } else { Paint::CHROME }
    }

    /// Adds a box in the main paint: upholstered for soft substances, otherwise with fine bevels.
    pub(super) fn pad(&mut self, x: Span, y: Span, z: Span) {
        let bevel = if self.soft() { 0.035 } else { 0.006 };
        self.model.soft(x, y, z, bevel, self.paint);
    }

    /// Adds a turned shape in the main paint; `profile` is in shares of `radius` and `height`.
    pub(super) fn turned(&mut self, profile: &[[f32; 2]], radius: f32, height: f32, sides: usize) {
        let profile: Vec<[f32; 2]> = profile.iter().map(|[s, y]| [s * radius, y * height]).collect();
        self.model.lathe([0.0, 0.0], &profile, sides, self.paint);
    }

    /// Adds a plain box in the main paint.
    pub(super) fn board(&mut self, x: Span, y: Span, z: Span) {
        self.model.block(x, y, z, self.paint);
    }
}

/// Common choices of a furniture set.
#[derive(Clone)]
pub(super) struct Look {
    pub(super) rng: Rng,
    pub(super) style: usize,
    pub(super) substance: Substance,
    pub(super) tint: Tint,
    pub(super) trim: Paint,
}

/// Chooses a paint for legs and frames that matches the main paint's brightness.
fn trim(rng: &mut Rng, main: Paint) -> Paint {
    let paints: &[Paint] = match main.brightness() {
        dark if dark < 0.3 => &[Paint::WALNUT, Paint::DARK_METAL],
        bright if bright > 0.75 => &[Paint::OAK, Paint::STEEL, Paint::BRASS],
        _ => &[Paint::OAK, Paint::WALNUT, Paint::STEEL, Paint::DARK_METAL, Paint::BRASS],
    };
    *rng.choose(paints).expect("the list is not empty")
}

impl FurnitureKind {
    const fn new(
        category: &'static str,
        noun: &'static str,
        styles: usize,
        draw: fn(&mut Draft) -> Words,
    ) -> Self {
        Self { category, noun, styles, substances: &[], colors: "", draw }
    }

    const fn made_of(self, substances: &'static [Substance], colors: &'static str) -> Self {
        Self { substances, colors, ..self }
    }

    /// Draws style, material and colours.
    pub(super) fn look(&self, sampler: &mut StyleSampler) -> Look {
        let style = sampler.style(self.styles);
        let (substance, tint) = sampler.look(self.category, style, self.substances, self.colors);
        let trim = trim(&mut sampler.rng, substance.paint(tint));
        Look { rng: sampler.rng.fork(self.category), style, substance, tint, trim }
    }

    /// Draws a piece with any size.
    pub(super) fn any(&self, sampler: &mut StyleSampler) -> Piece {
        self.sized(sampler, [0.0; 3])
    }

    /// Draws a piece with an approximate width, height and depth; zeros are free.
    pub(super) fn sized(&self, sampler: &mut StyleSampler, wish: [f32; 3]) -> Piece {
        let look = self.look(sampler);
        self.drawn(&look, wish)
    }

    /// Draws a piece with a given look.
    pub(super) fn drawn(&self, look: &Look, wish: [f32; 3]) -> Piece {
        let Look { rng, style, substance, tint, trim } = look.clone();
        let paint = substance.paint(tint);
        let (noun, material) = (self.noun, substance.word());
        let mut draft =
            Draft { model: Model::new(), rng, style, tint, substance, paint, trim, wish, noun, material };
        let [size, shape] = (self.draw)(&mut draft);
        let said = |word: &str| word.to_owned();
        let attributes = Attributes {
            noun: said(draft.noun),
            color: said(tint.word),
            material: said(draft.material),
            size: said(size),
            shape: said(shape),
        };
        Piece { category: self.category, model: draft.model, attributes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pool;
    use crate::assembly::Assembly;
    use crate::styles::combination_owner;
    use avln_scene::colors::PALETTE;
    use std::collections::{BTreeMap, BTreeSet};

    /// All furniture except doors and windows.
    const KINDS: &[&FurnitureKind] = &[
        &seats::CHAIR,
        &seats::OFFICE_CHAIR,
        &seats::ARMCHAIR,
        &seats::SOFA,
        &seats::STOOL,
        &seats::BAR_STOOL,
        &seats::FOOTSTOOL,
        &seats::SEATING,
        &tables::DINING_TABLE,
        &tables::COFFEE_TABLE,
        &tables::SIDE_TABLE,
        &tables::CONSOLE,
        &tables::DESK,
        &storage::WARDROBE,
        &storage::SIDEBOARD,
        &storage::TV_STAND,
        &storage::WALL_CABINET,
        &storage::VANITY,
        &storage::TALL_CABINET,
        &storage::CHEST,
        &storage::NIGHTSTAND,
        &storage::BOOKCASE,
        &storage::WALL_SHELF,
        &kitchen::COUNTER,
        &kitchen::ISLAND,
        &kitchen::FRIDGE,
        &kitchen::COOKER,
        &kitchen::SMALL,
        &kitchen::HOOD,
        &kitchen::WASHER,
        &fixtures::PEDESTAL_SINK,
        &fixtures::VESSEL_SINK,
        &fixtures::KITCHEN_SINK,
        &fixtures::TOILET,
        &fixtures::BATHTUB,
        &fixtures::SHOWER,
        &textiles::TOWEL,
        &textiles::TOWEL_PILE,
        &textiles::BED,
        &textiles::CUSHION,
        &textiles::HANGING,
        &textiles::FOLDED,
        &decor::FLOOR_PLANT,
        &decor::SMALL_PLANT,
        &displays::PICTURE,
        &displays::MIRROR,
        &displays::BOARD,
        &displays::CLOCK,
        &decor::VASE,
        &decor::STATUE,
        &decor::BOOKS,
        &decor::BASKET,
        &decor::BIN,
        &textiles::RUG,
        &lights::PENDANT,
        &lights::FLOOR_LAMP,
        &lights::TABLE_LAMP,
        &lights::SCONCE,
        &displays::TV,
        &displays::WALL_TV,
        &displays::MONITOR,
        &fixtures::FIREPLACE,
        &fixtures::RADIATOR,
        &sports::MACHINE,
        &sports::KIT_PIECE,
        &openings::CURTAIN,
        &openings::BLIND,
    ];

    /// Draws a piece with a given style; `seed` determines the rest.
    fn piece(kind: &FurnitureKind, style: usize, seed: u64) -> Piece {
        let mut sampler = StyleSampler::new(Rng::new(seed).fork(kind.category), Pool::Train);
        let (substance, tint) = sampler.look(kind.category, style, kind.substances, kind.colors);
        let trim = trim(&mut sampler.rng, substance.paint(tint));
        let look = Look { rng: sampler.rng.fork("piece"), style, substance, tint, trim };
        kind.drawn(&look, [0.0; 3])
    }

    #[test]
    fn categories_have_many_shapes_colours_and_materials() {
        let mut kinds: BTreeMap<&str, (usize, BTreeSet<&str>, BTreeSet<&str>)> = BTreeMap::new();
        for kind in KINDS {
            let (shapes, colors, materials) = kinds.entry(kind.category).or_default();
            *shapes += kind.styles;
            colors.extend(kind.colors.split(' '));
            match kind.category {
                "picture" => (0..80).for_each(|seed| {
                    let said = piece(kind, 0, seed).attributes.material;
                    materials.extend(
                        ["painted", "printed", "woven", "wooden", "metal", "ceramic"]
                            .iter()
                            .filter(|w| **w == said),
                    );
                }),
                _ => materials.extend(kind.substances.iter().map(|substance| substance.word())),
            }
        }
        assert_eq!(kinds.len(), 36, "{:?}", kinds.keys());
        for (category, (shapes, colors, materials)) in kinds {
            assert!(shapes >= 8, "{category}: {shapes} shapes");
            assert_eq!(colors.len(), PALETTE.len(), "{category}: {colors:?}");
            assert!(materials.len() >= 6, "{category}: {materials:?}");
        }
    }

    #[test]
    fn furniture_has_20_to_400_triangles() {
        let mut strange = Vec::new();
        for kind in KINDS {
            for style in 0..kind.styles {
                for seed in 0..6 {
                    let piece = piece(kind, style, seed);
                    let named = format!("{} {} {style} {seed}", kind.category, piece.attributes.noun);
                    let count = piece.model.triangles.len();
                    if !(20..=400).contains(&count) {
                        strange.push(format!("{named}: {count} triangles"));
                    }
                    let bounds = piece.model.bounds();
                    let finite = piece.model.corners.iter().all(|c| c.normal.iter().all(|n| n.is_finite()));
                    assert!(finite, "{named}");
                    let hangs = kind.noun == "ceiling lamp" || kind.noun == "kitchen sink";
                    if !hangs && bounds.min.y.abs() > 0.16 || bounds.size().max() > 2.6 {
                        strange.push(format!("{named}: {bounds:?}"));
                    }
                }
            }
        }
        assert!(strange.is_empty(), "{strange:#?}");
    }

    #[test]
    fn styles_of_a_furniture_kind_differ() {
        let mut alike = Vec::new();
        for kind in KINDS {
            let shapes: BTreeSet<String> = (0..kind.styles)
                .map(|style| {
                    let piece = piece(kind, style, 5);
                    let [x, y, z]: [f32; 3] = piece.size().into();
                    let sum: f32 = piece.model.corners.iter().map(|c| c.position.coords.abs().sum()).sum();
                    format!("{} {sum:.3} {x:.3} {y:.3} {z:.3}", piece.model.triangles.len())
                })
                .collect();
            if shapes.len() < kind.styles {
                alike.push((kind.category, kind.noun, shapes.len()));
            }
        }
        assert!(alike.is_empty(), "{alike:?}");
    }

    #[test]
    fn mean_colours_usually_match_their_name() {
        let mut missed: BTreeMap<&str, u32> = BTreeMap::new();
        let (mut all, mut wrong) = (0, 0);
        for kind in KINDS.iter().filter(|kind| kind.category != "mirror") {
            for style in 0..kind.styles {
                for seed in 0..5 {
                    let mut assembly = Assembly::default();
                    let wanted = piece(kind, style, seed);
                    assembly.add_object(&wanted, 0);
                    let scene = assembly.into_scene("one", vec![]);
                    all += 1;
                    if scene.objects[0].attributes.color.is_empty() {
                        wrong += 1;
                        *missed
                            .entry(if kind.noun.is_empty() { kind.category } else { kind.noun })
                            .or_default() += 1;
                    }
                }
            }
        }
        assert!(wrong * 10 < all, "{wrong} of {all}: {missed:?}");
    }

    #[test]
    fn reserved_combinations_stay_in_their_pool() {
        for pool in Pool::ALL {
            let mut sampler = StyleSampler::new(Rng::new(3), pool);
            for _ in 0..40 {
                for kind in [&seats::CHAIR, &seats::SOFA, &textiles::CUSHION, &decor::VASE] {
                    let style = sampler.style(kind.styles);
                    let (substance, tint) = sampler.look(kind.category, style, kind.substances, kind.colors);
                    let owner = combination_owner(style, substance, tint.word);
                    assert!(owner.is_none_or(|owner| owner == pool), "{owner:?} in {pool:?}");
                    let owner = styles::owner(style, kind.styles);
                    assert!(owner.is_none_or(|owner| owner == pool), "{owner:?} in {pool:?}");
                }
            }
        }
    }

    #[test]
    fn size_terms_fit_sizes() {
        for (kind, small, large, axis) in [
            (&seats::SOFA, "small", "large", 0),
            (&tables::DESK, "small", "large", 0),
            (&storage::SIDEBOARD, "low", "tall", 1),
            (&decor::VASE, "small", "tall", 1),
            (&storage::BOOKCASE, "low", "tall", 1),
            (&storage::WALL_SHELF, "short", "long", 0),
            (&fixtures::RADIATOR, "short", "long", 0),
        ] {
            let sized: Vec<(String, f32)> = (0..120)
                .map(|seed| piece(kind, seed as usize % kind.styles, seed))
                .map(|piece| (piece.attributes.size.clone(), piece.size()[axis]))
                .collect();
            let of = |word: &str| {
                sized.iter().filter(|(w, _)| w == word).map(|(_, size)| *size).collect::<Vec<_>>()
            };
            let longest = of(small).into_iter().fold(0.0, f32::max);
            let shortest = of(large).into_iter().fold(9.0, f32::min);
            assert!(
                longest > 0.0 && shortest < 9.0 && longest < shortest,
                "{}: {longest} {shortest}",
                kind.noun
            );
        }
    }
}
