//! English nouns, plurals, articles, room names and adjectives.

use crate::cue::Name;
use avln_scene::Object;

/// Nouns per category, most common first. Other categories use their own name.
const NOUNS: &[(&str, &[&str])] = &[
    ("appliances", &["appliance", "household appliance"]),
    ("blinds", &["window blind"]),
    ("board_panel", &["board"]),
    ("book_stack", &["stack of books"]),
    ("books", &["stack of books"]),
    ("chest_of_drawers", &["chest of drawers", "dresser"]),
    ("clothes", &["set of clothes"]),
    ("cushion", &["cushion", "pillow"]),
    ("furniture", &["piece of furniture"]),
    ("gym_equipment", &["piece of gym equipment", "exercise machine"]),
    ("lighting", &["lamp"]),
    ("picture", &["picture", "painting"]),
    ("plant", &["plant", "potted plant"]),
    ("seating", &["seat"]),
    ("shelving", &["shelf"]),
    ("sofa", &["sofa", "couch"]),
    ("stairs", &["staircase"]),
    ("tv_monitor", &["television", "TV"]),
];

/// Categories with interchangeable nouns.
const KIN: &[&[&str]] = &[
    &["table", "desk"],
    &["cabinet", "chest_of_drawers"],
    &["sofa", "seating"],
    &["lighting", "lamp"],
    &["board", "board_panel"],
    &["book_stack", "books"],
    &["curtain", "blinds"],
];

/// Categories of building parts and unnamed objects, which are no landmarks.
const NAMELESS: &str =
    "|void|wall|floor|ceiling|misc|objects|object|unlabeled|unknown|beam|column|furniture|appliances";
/// Room nouns without meaning, or without the preposition *in*.
const NAMELESS_ROOMS: &str =
    "|other|other room|unknown|junk|misc|no label|none|room|outdoor|outside|porch|balcony";

pub(crate) const SIZES: &[(&str, Measure)] = &[
    ("small", Measure::Diagonal),
    ("large", Measure::Diagonal),
    ("tall", Measure::Height),
    ("low", Measure::Height),
    ("long", Measure::Width),
    ("wide", Measure::Width),
    ("short", Measure::Width),
    ("narrow", Measure::Width),
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Measure {
    /// Box diagonal.
    Diagonal,
    /// Box height.
    Height,
    /// Longer side on the floor plan.
    Width,
}

/// Nouns for an object, most specific first.
pub(crate) fn names(object: &Object) -> Vec<Name> {
    let nouns = own_noun(object).map_or_else(|| general_nouns(&object.category), |noun| vec![noun]);
    nouns.into_iter().map(|noun| Name { noun, category: object.category.clone() }).collect()
}

/// Noun from the object's source.
fn own_noun(object: &Object) -> Option<String> {
    clean(&object.attributes.noun).map(|noun| match noun {
        "trousers" | "jeans" | "shorts" | "pyjamas" | "glasses" | "scissors" => format!("pair of {noun}"),
        "curtains" | "shoes" | "boots" | "slippers" | "gloves" => format!("pair of {noun}"),
        "shelves" | "drawers" => format!("set of {noun}"),
        "tv stand" => "TV stand".to_owned(),
        "tv" => "TV".to_owned(),
        _ => noun.to_owned(),
    })
}

/// Nouns for a category, most common first; empty for unnamed categories.
pub(crate) fn general_nouns(category: &str) -> Vec<String> {
    if let Some((_, nouns)) = NOUNS.iter().find(|(name, _)| *name == category) {
        return nouns.iter().map(|&noun| noun.to_owned()).collect();
    }
    let spaced = category.replace('_', " ");
    clean(&spaced).map(str::to_owned).into_iter().collect()
}

pub(crate) fn is_landmark(object: &Object) -> bool {
    const MIN_M: f32 = 0.2;
    let named =
        NAMELESS.split('|').all(|known| known != object.category) || clean(&object.attributes.noun).is_some();
    named && object.bounds.size().max() >= MIN_M
}

/// True if `name` could refer to `object`. Unknown properties count as matching.
pub(crate) fn may_be_called(object: &Object, name: &Name) -> bool {
    if object.category == name.category && general_nouns(&name.category).contains(&name.noun) {
        return true;
    }
    let kin = object.category == name.category
        || KIN
            .iter()
            .any(|group| [&object.category, &name.category].iter().all(|c| group.contains(&c.as_str())));
    match own_noun(object) {
        Some(own) => own == name.noun || own.ends_with(&format!(" {}", name.noun)),
        None => kin || general_nouns(&object.category).contains(&name.noun),
    }
}

/// Accepts up to three lower-case words without digits or signs.
pub(crate) fn clean(words: &str) -> Option<&str> {
    let letters = |c: char| c.is_ascii_lowercase() || c == ' ' || c == '-';
    let fits = !words.trim().is_empty() && words.len() <= 32 && words.chars().all(letters);
    (fits && words.split_whitespace().count() <= 4).then(|| words.trim())
}

/// Room noun for a label: `living room`; `None` for meaningless labels.
pub(crate) fn room_noun(label: &str) -> Option<String> {
    let first = label.split('/').next().unwrap_or_default();
    let spaced = first.to_lowercase().replace('_', " ");
    let noun = match spaced.trim() {
        "familyroom" => "family room",
        "laundryroom" => "laundry room",
        "meetingroom" => "meeting room",
        "utilityroom" => "utility room",
        "rec" => "recreation room",
        "workout" | "gym" => "home gym",
        "tv" => "television room",
        "stairs" => "stairwell",
        "toilet" => "toilet room",
        other => other,
    };
    clean(noun).filter(|noun| NAMELESS_ROOMS.split('|').all(|known| known != *noun)).map(str::to_owned)
}

pub(crate) fn material_word(object: &Object) -> Option<&str> {
    let word = clean(&object.attributes.material)?;
    (!word.contains(' ') && word != "painted" && !names(object).iter().any(|name| name.noun.contains(word)))
        .then_some(word)
}

/// Shape adjective, if informative: wardrobes are always rectangular.
pub(crate) fn shape_word(object: &Object) -> Option<&str> {
    const OBLONG: &[&str] = &["table", "desk", "rug", "mirror", "picture", "cushion", "stool"];
    let word = clean(&object.attributes.shape)?;
    (!word.contains(' ') && (word != "rectangular" || OBLONG.contains(&object.category.as_str())))
        .then_some(word)
}

pub(crate) fn size_word(object: &Object) -> Option<&str> {
    let word = object.attributes.size.as_str();
    SIZES.iter().any(|(known, _)| *known == word).then_some(word)
}

/// Noun for a material adjective: `wood` for `wooden`; `None` if unusual.
pub(crate) fn substance(material: &str) -> Option<&str> {
    match material {
        "wooden" => Some("wood"),
        "woollen" | "woolen" => Some("wool"),
        "metal" | "leather" | "glass" | "plastic" | "fabric" | "stone" | "marble" | "rattan" | "wicker"
        | "velvet" | "steel" | "brass" | "concrete" | "bamboo" | "linen" | "cotton" | "paper" | "rubber"
        | "denim" | "terrazzo" | "brick" | "corduroy" => Some(material),
        _ => None,
    }
}

pub(crate) fn article(phrase: &str) -> &'static str {
    let lower = phrase.to_lowercase();
    let spoken_as_consonant = ["one", "uni", "use", "eu"].iter().any(|start| lower.starts_with(start));
    let vowel = lower.starts_with(['a', 'e', 'i', 'o', 'u']) && !spoken_as_consonant;
    if vowel { "an" } else { "a" }
}

/// Plural form: `chests of drawers`, `shelves`, `benches`.
pub(crate) fn plural(noun: &str) -> String {
    if let Some((head, tail)) = noun.split_once(" of ") {
        return format!("{} of {tail}", plural(head));
    }
    if let Some(stem) = noun.strip_suffix("shelf") {
        return format!("{stem}shelves");
    }
    let before_y = noun.strip_suffix('y').filter(|stem| !stem.ends_with(['a', 'e', 'i', 'o', 'u']));
    match before_y {
        Some(stem) => format!("{stem}ies"),
        None if ["s", "x", "ch", "sh"].iter().any(|end| noun.ends_with(end)) => format!("{noun}es"),
        None => format!("{noun}s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::{Aabb, Point3};
    use avln_scene::{Attributes, InstanceId};

    fn object(category: &str, noun: &str) -> Object {
        Object {
            id: InstanceId(1),
            category: category.to_owned(),
            bounds: Aabb::new(Point3::origin(), Point3::new(1.0, 1.0, 1.0)),
            region: None,
            attributes: Attributes { noun: noun.to_owned(), ..Attributes::default() },
        }
    }

    #[test]
    fn categories_are_lower_case_words() {
        for category in avln_scene::categories::TARGET_CATEGORIES {
            let nouns = general_nouns(category);
            assert!(!nouns.is_empty(), "{category}");
            assert!(nouns.iter().all(|noun| !noun.contains('_')), "{nouns:?}");
        }
        assert_eq!(general_nouns("tv_monitor")[0], "television");
        assert_eq!(general_nouns("coat_rack"), ["coat rack"]);
        assert!(general_nouns("object_17").is_empty(), "a number is no noun");
    }

    #[test]
    fn general_noun_fits_the_whole_category() {
        let name = |noun: &str, category: &str| Name { noun: noun.into(), category: category.into() };
        let (armchair, chair) = (object("chair", "armchair"), object("chair", ""));
        assert!(may_be_called(&armchair, &name("chair", "chair")));
        assert!(may_be_called(&chair, &name("armchair", "chair")), "it may be one");
        assert!(!may_be_called(&object("chair", "rocking chair"), &name("armchair", "chair")));
        assert!(may_be_called(&object("table", "coffee table"), &name("table", "table")));
        assert!(may_be_called(&object("desk", ""), &name("table", "table")), "a desk is a kind of table");
        assert!(!may_be_called(&object("sofa", ""), &name("table", "table")));
    }

    #[test]
    fn plurals_and_articles_are_english() {
        for (one, many) in [
            ("chair", "chairs"),
            ("bench", "benches"),
            ("shelf", "shelves"),
            ("bookshelf", "bookshelves"),
            ("chest of drawers", "chests of drawers"),
            ("pair of curtains", "pairs of curtains"),
            ("vanity", "vanities"),
            ("toy", "toys"),
            ("couch", "couches"),
            ("box", "boxes"),
        ] {
            assert_eq!(plural(one), many);
        }
        for (word, expected) in [("armchair", "an"), ("chair", "a"), ("orange sofa", "an"), ("unit", "a")] {
            assert_eq!(article(word), expected, "{word}");
        }
    }

    #[test]
    fn rooms_are_said_as_people_do() {
        assert_eq!(room_noun("living_room").as_deref(), Some("living room"));
        assert_eq!(room_noun("workout/gym/exercise").as_deref(), Some("home gym"));
        assert_eq!(room_noun("entryway/foyer/lobby").as_deref(), Some("entryway"));
        for label in ["", "other room", "room_12", "???"] {
            assert_eq!(room_noun(label), None, "{label}");
        }
    }
}
