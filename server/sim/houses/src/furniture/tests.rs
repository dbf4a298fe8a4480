//! Invariants of furniture.

use super::*;
use crate::Pool;
use crate::assembly::Assembly;
use crate::taste::combination_owner;
use avln_scene::colors::PALETTE;
use std::collections::{BTreeMap, BTreeSet};

/// Everything that can be placed, doors and windows aside.
const MAKES: &[&Make] = &[
    &chairs::CHAIR,
    &chairs::OFFICE_CHAIR,
    &chairs::ARMCHAIR,
    &sofas::SOFA,
    &stools::STOOL,
    &stools::BAR_STOOL,
    &stools::FOOTSTOOL,
    &stools::SEATING,
    &tables::DINING_TABLE,
    &tables::COFFEE_TABLE,
    &tables::SIDE_TABLE,
    &tables::CONSOLE,
    &tables::DESK,
    &cabinets::WARDROBE,
    &cabinets::SIDEBOARD,
    &cabinets::TV_STAND,
    &cabinets::WALL_CABINET,
    &cabinets::VANITY,
    &cabinets::TALL_CABINET,
    &chests::CHEST,
    &chests::NIGHTSTAND,
    &shelves::BOOKCASE,
    &shelves::WALL_SHELF,
    &counters::COUNTER,
    &counters::ISLAND,
    &appliances::FRIDGE,
    &appliances::COOKER,
    &appliances::SMALL,
    &appliances::HOOD,
    &washing::WASHER,
    &sinks::PEDESTAL_SINK,
    &sinks::VESSEL_SINK,
    &sinks::KITCHEN_SINK,
    &baths::TOILET,
    &baths::BATHTUB,
    &baths::SHOWER,
    &towels::TOWEL,
    &towels::TOWEL_PILE,
    &beds::BED,
    &beds::CUSHION,
    &clothes::HANGING,
    &clothes::FOLDED,
    &plants::FLOOR_PLANT,
    &plants::SMALL_PLANT,
    &pictures::PICTURE,
    &pictures::MIRROR,
    &boards::BOARD,
    &boards::CLOCK,
    &decor::VASE,
    &decor::STATUE,
    &decor::BOOKS,
    &decor::BASKET,
    &decor::BIN,
    &floor::RUG,
    &lights::PENDANT,
    &lights::FLOOR_LAMP,
    &lights::TABLE_LAMP,
    &lights::SCONCE,
    &screens::TV,
    &screens::WALL_TV,
    &screens::MONITOR,
    &hearths::FIREPLACE,
    &hearths::RADIATOR,
    &sports::MACHINE,
    &sports::KIT_PIECE,
    &curtains::CURTAIN,
    &curtains::BLIND,
];

/// The piece of a make with everything chosen by `seed` but the style.
fn piece(make: &Make, style: usize, seed: u64) -> Piece {
    let mut taste = Taste::new(Rng::new(seed).fork(make.category), Pool::Train);
    let (substance, tint) = taste.look(make.category, style, make.substances, make.colors);
    let trim = trim(&mut taste.rng, substance.paint(tint));
    let look = Look { rng: taste.rng.fork("piece"), style, substance, tint, trim };
    make.drawn(&look, [0.0; 3])
}

#[test]
fn every_category_comes_in_many_shapes_colours_and_materials() {
    let mut kinds: BTreeMap<&str, (usize, BTreeSet<&str>, BTreeSet<&str>)> = BTreeMap::new();
    for make in MAKES {
        let (shapes, colors, materials) = kinds.entry(make.category).or_default();
        *shapes += make.styles;
        colors.extend(make.colors);
        match make.category {
            "picture" => (0..80).for_each(|seed| {
                let said = piece(make, 0, seed).attributes.material;
                materials.extend(
                    ["painted", "printed", "woven", "wooden", "metal", "ceramic"]
                        .iter()
                        .filter(|w| **w == said),
                );
            }),
            _ => materials.extend(make.substances.iter().map(|substance| substance.word())),
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
fn pieces_have_20_to_400_triangles_and_stand_on_their_base() {
    let mut strange = Vec::new();
    for make in MAKES {
        for style in 0..make.styles {
            for seed in 0..6 {
                let piece = piece(make, style, seed);
                let named = format!("{} {} {style} {seed}", make.category, piece.attributes.noun);
                let count = piece.model.triangles.len();
                if !(20..=400).contains(&count) {
                    strange.push(format!("{named}: {count} triangles"));
                }
                let bounds = piece.model.bounds();
                let finite = piece.model.corners.iter().all(|c| c.normal.iter().all(|n| n.is_finite()));
                assert!(finite, "{named}");
                let hangs = make.noun == "ceiling lamp" || make.noun == "kitchen sink";
                if !hangs && bounds.min.y.abs() > 0.16 || bounds.size().max() > 2.6 {
                    strange.push(format!("{named}: {bounds:?}"));
                }
            }
        }
    }
    assert!(strange.is_empty(), "{strange:#?}");
}

#[test]
fn styles_of_a_make_differ() {
    let mut alike = Vec::new();
    for make in MAKES {
        let shapes: BTreeSet<String> = (0..make.styles)
            .map(|style| {
                let piece = piece(make, style, 5);
                let [x, y, z]: [f32; 3] = piece.size().into();
                let sum: f32 = piece.model.corners.iter().map(|c| c.position.coords.abs().sum()).sum();
                format!("{} {sum:.3} {x:.3} {y:.3} {z:.3}", piece.model.triangles.len())
            })
            .collect();
        if shapes.len() < make.styles {
            alike.push((make.category, make.noun, shapes.len()));
        }
    }
    assert!(alike.is_empty(), "{alike:?}");
}

#[test]
fn the_mean_colour_of_nearly_all_pieces_goes_by_the_word_that_is_said() {
    let mut missed: BTreeMap<&str, u32> = BTreeMap::new();
    let (mut all, mut wrong) = (0, 0);
    for make in MAKES.iter().filter(|make| make.category != "mirror") {
        for style in 0..make.styles {
            for seed in 0..5 {
                let mut assembly = Assembly::default();
                let wanted = piece(make, style, seed);
                assembly.add_object(&wanted, 0);
                let scene = assembly.into_scene("one", vec![]);
                all += 1;
                if scene.objects[0].attributes.color.is_empty() {
                    wrong += 1;
                    *missed
                        .entry(if make.noun.is_empty() { make.category } else { make.noun })
                        .or_default() += 1;
                }
            }
        }
    }
    assert!(wrong * 10 < all, "{wrong} of {all}: {missed:?}");
}

#[test]
fn what_is_held_out_for_one_pool_is_shown_by_no_other() {
    for pool in Pool::ALL {
        let mut taste = Taste::new(Rng::new(3), pool);
        for _ in 0..40 {
            for make in [&chairs::CHAIR, &sofas::SOFA, &beds::CUSHION, &decor::VASE] {
                let style = taste.style(make.styles);
                let (substance, tint) = taste.look(make.category, style, make.substances, make.colors);
                let owner = combination_owner(style, substance, tint.word);
                assert!(owner.is_none_or(|owner| owner == pool), "{owner:?} in {pool:?}");
                let owner = taste::owner(style, make.styles);
                assert!(owner.is_none_or(|owner| owner == pool), "{owner:?} in {pool:?}");
            }
        }
    }
}

#[test]
fn size_words_fit_the_sizes() {
    for (make, small, large, axis) in [
        (&sofas::SOFA, "small", "large", 0),
        (&tables::DESK, "small", "large", 0),
        (&cabinets::SIDEBOARD, "low", "tall", 1),
        (&decor::VASE, "small", "tall", 1),
        (&shelves::BOOKCASE, "low", "tall", 1),
        (&shelves::WALL_SHELF, "short", "long", 0),
        (&hearths::RADIATOR, "short", "long", 0),
    ] {
        let sized: Vec<(String, f32)> = (0..120)
            .map(|seed| piece(make, seed as usize % make.styles, seed))
            .map(|piece| (piece.attributes.size.clone(), piece.size()[axis]))
            .collect();
        let of =
            |word: &str| sized.iter().filter(|(w, _)| w == word).map(|(_, size)| *size).collect::<Vec<_>>();
        let longest = of(small).into_iter().fold(0.0, f32::max);
        let shortest = of(large).into_iter().fold(9.0, f32::min);
        assert!(longest > 0.0 && shortest < 9.0 && longest < shortest, "{}: {longest} {shortest}", make.noun);
    }
}
