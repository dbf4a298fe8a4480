//! Category names: from annotators' words to the mpcat40 vocabulary (the 40 categories of Matterport3D).

/// The 21 mpcat40 target categories in missions, as in the MP3D object-goal and SAVi tasks.
pub const TARGET_CATEGORIES: [&str; 21] = [
    "chair",
    "table",
    "picture",
    "cabinet",
    "cushion",
    "sofa",
    "bed",
    "chest_of_drawers",
    "plant",
    "sink",
    "toilet",
    "stool",
    "towel",
    "tv_monitor",
    "shower",
    "bathtub",
    "counter",
    "fireplace",
    "gym_equipment",
    "seating",
    "clothes",
];

/// Returns whether an mpcat40 category may be a mission target.
pub fn is_target(category: &str) -> bool {
    TARGET_CATEGORIES.contains(&category)
}

/// Returns the mpcat40 category for an annotator's words; `None` for unlisted words.
///
/// Case, underscores, hyphens and `#` are ignored. An unlisted name has the longest listed ending's category
/// (`black leather sofa` is a `sofa`), a plural has the singular's category.
pub fn mpcat40(raw_name: &str) -> Option<&'static str> {
    let name = normalised(raw_name);
    let words: Vec<&str> = name.split(' ').collect();
    (0..words.len()).find_map(|first| listed(&words[first..].join(" ")))
}

/// Returns a category's number in mpcat40, 1 (`wall`) to 40; `None` for other categories.
pub fn mpcat40_number(category: &str) -> Option<u8> {
    (1..).zip(SYNONYMS).find(|(_, (name, _))| *name == category).map(|(number, _)| number)
}

/// Returns the mpcat40 category with this number, 1 (`wall`) to 40; `None` for other numbers.
pub fn mpcat40_of_number(number: u32) -> Option<&'static str> {
    SYNONYMS.get(number.checked_sub(1)? as usize).map(|(category, _)| *category)
}

/// Returns the everyday noun if it is more specific than the mpcat40 category: `armchair` for `black armchair`, of the category
/// `chair`. `None` if the category is as specific, or unknown.
pub fn noun(raw_name: &str) -> Option<&'static str> {
    let name = normalised(raw_name);
    let words: Vec<&str> = name.split(' ').collect();
    let endings = (0..words.len()).map(|first| words[first..].join(" "));
    let ending = endings.into_iter().find(|ending| listed(ending).is_some())?;
    let singular = ending.strip_suffix('s').unwrap_or(&ending);
    let mut listed_names = SYNONYMS.iter().flat_map(|(_, names)| split_names(names));
    let noun = listed_names.find(|name| *name == ending || *name == singular)?;
    split_names(SYNONYMS_OF_CATEGORIES).all(|synonym| synonym != noun).then_some(noun)
}

/// Names that are no more specific than their category.
const SYNONYMS_OF_CATEGORIES: &str = "couch, settee, tv, television, display, screen, pillow, bath, tub, bath tub, light, appliance, \
     object, decoration, decor, clothing, piece of furniture, board, panel, shelf";

fn normalised(raw_name: &str) -> String {
    let spaced = raw_name.to_lowercase().replace(['_', '-', '#'], " ");
    spaced.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn listed(name: &str) -> Option<&'static str> {
    let singular = name.strip_suffix('s').unwrap_or(name);
    let is_it = |entry: &str| entry == name || entry == singular;
    let mut rows = SYNONYMS.iter();
    let row =
        rows.find(|(category, names)| split_names(names).any(is_it) || is_it(&category.replace('_', " ")))?;
    Some(row.0)
}

fn split_names(names: &'static str) -> impl Iterator<Item = &'static str> {
    names.split(", ")
}

/// The mpcat40 categories with their names, in the singular.
const SYNONYMS: [(&str, &str); 40] = [
    ("wall", "baseboard, crown molding, molding, moulding, wainscotting, paneling, wall panel"),
    ("floor", "rug, mat, carpet, bath mat, doormat, landing, ground"),
    ("chair", "armchair, recliner, highchair, beanbag, chaise, throne"),
    ("door", "doorframe, door frame, doorway, doorknob, archway, garage door, folding door, gate"),
    ("table", "desk, coffee table, side table, nighttable, vanity, workbench, altar, sidetable"),
    ("picture", "picture frame, painting, photo, photograph, poster, portrait, artwork, wall art, art"),
    ("cabinet", "cupboard, wardrobe, closet, tv stand, sideboard, showcase, hutch, credenza, locker"),
    ("cushion", "pillow, bolster"),
    ("window", "window frame, windowsill, window sill, windowpane, skylight"),
    ("sofa", "couch, loveseat, settee"),
    ("bed", "headboard, footboard, mattress, bed frame, crib, bed sheet, bedspread, bunk"),
    ("curtain", "drape, curtain rod, shower curtain, shower rod, shower curtain rod, valence"),
    ("chest_of_drawers", "dresser, nightstand, night stand, drawer, bedside table, bureau, bedside cabinet"),
    ("plant", "flower, tree, bush, potted plant, houseplant, house plant, grass, flowerpot"),
    ("sink", "washbasin, wash basin, basin"),
    ("stairs", "stair, step, staircase, stairway, stairwell, ladder"),
    ("ceiling", "roof"),
    ("toilet", "bidet, commode, urinal, toilet seat, toilet bowl"),
    ("stool", "ottoman, footstool, footrest, bar stool, barstool"),
    ("towel", "paper towel, washcloth"),
    ("mirror", "mirror frame"),
    ("tv_monitor", "tv, television, monitor, display, screen, computer monitor, computer screen"),
    ("shower", "shower head, showerhead, shower wall, shower floor, shower door, shower stall"),
    ("column", "pillar, post"),
    ("bathtub", "bath, tub, hot tub, bath tub"),
    (
        "counter",
        "countertop, counter top, kitchen island, island, kitchen counter, worktop, wet bar, cooking bench",
    ),
    ("fireplace", "mantel, mantle, hearth, wood stove"),
    (
        "lighting",
        "lamp, light, chandelier, lampshade, sconce, spotlight, light fixture, wall sconce, lantern",
    ),
    ("beam", "rafter, lintel"),
    ("railing", "handrail, rail, banister, bannister, balustrade"),
    ("shelving", "shelf, shelves, bookshelf, bookcase, rack, shoe rack, shelving unit"),
    ("blinds", "blind, window blind, window shade"),
    (
        "gym_equipment",
        "treadmill, exercise machine, exercise bike, stationary bike, exercise equipment, fitness \
         equipment, exercise mat, exercise ball, dumbbell, weight bench, weight machine, weight, \
         elliptical, yoga mat",
    ),
    ("seating", "bench, pew, seat, pouffe, pouf, window seat"),
    ("board_panel", "board, panel, whiteboard, blackboard, bulletin board"),
    ("furniture", "piece of furniture"),
    (
        "appliances",
        "appliance, refrigerator, fridge, freezer, oven, stove, cooker, hob, microwave, dishwasher, washing \
         machine, washer, dryer, clothes dryer, toaster, kettle, coffee maker, coffee machine, range hood, \
         rangehood, extractor hood, air conditioner, airconditioner, vacuum cleaner",
    ),
    ("clothes", "clothing, coat, jacket, shirt, dress, robe, bathrobe, hat, scarf, laundry"),
    (
        "objects",
        "object, decoration, decor, vase, pot, box, trash, trash can, trashcan, bin, basket, book, bottle, \
         bowl, plate, cup, clock, fan, bag, handbag, shoe, statue, faucet, handle, toilet paper, toilet \
         brush, tableware, utensil, kitchen utensil, tablet, laptop, phone, candle, toy, camera, light \
         switch, radiator, instrument, piano",
    ),
    ("misc", "pipe, sign, fence, vent, arch, clutter"),
];

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn endings_plurals_and_spelling_do_not_matter() {
        for (raw, category) in [
            ("Sofa", "sofa"),
            ("black leather sofa", "sofa"),
            ("night_stand", "chest_of_drawers"),
            ("chest of drawers", "chest_of_drawers"),
            ("TV-stand", "cabinet"),
            ("towels", "towel"),
            ("shower curtain", "curtain"),
            ("office#desk", "table"),
            ("paper towels", "towel"),
            ("bathroom sink", "sink"),
            ("shelves", "shelving"),
        ] {
            assert_eq!(mpcat40(raw), Some(category), "{raw}");
        }
        assert_eq!(mpcat40("quxotron"), None);
        assert_eq!(mpcat40("  "), None);
    }

    #[test]
    fn noun_is_most_specific_term() {
        for (raw, expected) in [
            ("black leather Armchair", Some("armchair")),
            ("office#desk", Some("desk")),
            ("nightstands", Some("nightstand")),
            ("sofa", None),
            ("couch", None),
            ("quxotron", None),
        ] {
            assert_eq!(noun(raw), expected, "{raw}");
        }
    }

    #[test]
    fn targets_map_to_themselves_and_names_are_unique() {
        for category in TARGET_CATEGORIES {
            assert_eq!(mpcat40(category), Some(category));
            assert!(is_target(category));
        }
        let mut names: Vec<_> = SYNONYMS.iter().flat_map(|(_, names)| split_names(names)).collect();
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count);
        assert!(!is_target("wall"));
        assert_eq!(mpcat40_number("wall"), Some(1));
        assert_eq!(mpcat40_number("clothes"), Some(38));
        assert_eq!(mpcat40_number("couch"), None);
    }

    #[test]
    fn labels_map_to_annotators_categories() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../../../shared/scenes/aws_small_house/instances.json");
        let Ok(text) = std::fs::read_to_string(&path) else {
            // Not `println!`, which the test harness hides.
            let _ = std::io::Write::write_fmt(
                &mut std::io::stderr(),
                format_args!("skipped: labels of a real house; put scenes into ../shared/scenes\n"),
            );
            return;
        };
        let instances: Vec<serde_json::Value> = serde_json::from_str(&text).expect("a list of instances");
        assert_eq!(instances.len(), 85);
        for instance in instances {
            let (raw, expected) = (instance["category"].as_str(), instance["mpcat40"].as_str());
            assert_eq!(mpcat40(raw.expect("a category")), expected, "{raw:?}");
        }
    }
}
