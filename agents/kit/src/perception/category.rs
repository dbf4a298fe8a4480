//! Category priors: sizes, heights, colours and synonyms.

use crate::perception::objects::DetectedObject;

/// A category's appearance: ranges for the long side and the top and bottom heights, metres, and typical colours.
struct Prior {
    name: &'static str,
    long_m: [f32; 2],
    top_m: [f32; 2],
    low_m: [f32; 2],
    colors: &'static [&'static str],
}

const fn prior(
    name: &'static str,
    long_m: [f32; 2],
    top_m: [f32; 2],
    low_m: [f32; 2],
    colors: &'static [&'static str],
) -> Prior {
    Prior { name, long_m, top_m, low_m, colors }
}

/// Everyday furniture sizes: mission categories first, then subtypes and other objects in cues.
const PRIORS: &[Prior] = &[
    prior("chair", [0.35, 0.8], [0.7, 1.15], [0.0, 0.15], &[]),
    prior("table", [0.5, 2.2], [0.65, 0.85], [0.0, 0.15], &[]),
    prior("picture", [0.25, 1.5], [1.3, 2.2], [0.8, 1.7], &[]),
    prior("cabinet", [0.5, 2.2], [0.7, 2.3], [0.0, 1.5], &["brown", "white"]),
    prior("cushion", [0.25, 0.6], [0.4, 0.9], [0.3, 0.6], &[]),
    prior("sofa", [1.3, 2.8], [0.65, 1.0], [0.0, 0.15], &[]),
    prior("bed", [1.7, 2.4], [0.4, 1.3], [0.0, 0.2], &[]),
    prior("chest_of_drawers", [0.5, 1.6], [0.6, 1.3], [0.0, 0.15], &["brown", "white"]),
    prior("plant", [0.2, 1.0], [0.3, 1.8], [0.0, 0.9], &["green"]),
    prior("sink", [0.35, 1.0], [0.75, 1.05], [0.0, 0.85], &["white"]),
    prior("toilet", [0.4, 0.8], [0.4, 1.0], [0.0, 0.15], &["white"]),
    prior("stool", [0.25, 0.55], [0.35, 0.8], [0.0, 0.15], &[]),
    prior("towel", [0.25, 0.9], [0.9, 1.7], [0.5, 1.3], &[]),
    prior("tv_monitor", [0.5, 1.7], [0.8, 1.9], [0.4, 1.2], &["black"]),
    prior("shower", [0.7, 1.5], [1.8, 2.4], [0.0, 0.2], &["white"]),
    prior("bathtub", [1.3, 1.9], [0.45, 0.75], [0.0, 0.15], &["white"]),
    prior("counter", [1.0, 3.5], [0.8, 1.05], [0.0, 0.15], &[]),
    prior("fireplace", [0.8, 1.8], [0.9, 2.6], [0.0, 0.15], &[]),
    prior("gym_equipment", [0.6, 2.2], [0.4, 1.7], [0.0, 0.15], &["black", "grey"]),
    prior("seating", [0.8, 2.2], [0.35, 1.0], [0.0, 0.15], &[]),
    prior("clothes", [0.3, 1.2], [0.9, 1.9], [0.2, 1.3], &[]),
    prior("armchair", [0.65, 1.1], [0.7, 1.15], [0.0, 0.15], &[]),
    prior("coffee_table", [0.5, 1.4], [0.3, 0.55], [0.0, 0.15], &[]),
    prior("nightstand", [0.3, 0.65], [0.4, 0.75], [0.0, 0.15], &["brown", "white"]),
    prior("desk", [0.9, 1.9], [0.68, 0.85], [0.0, 0.15], &[]),
    prior("wardrobe", [0.7, 2.4], [1.7, 2.4], [0.0, 0.15], &["brown", "white"]),
    prior("bookshelf", [0.5, 1.8], [1.0, 2.3], [0.0, 0.3], &[]),
    prior("bench", [0.8, 2.0], [0.35, 0.55], [0.0, 0.15], &[]),
    prior("ottoman", [0.35, 1.0], [0.3, 0.55], [0.0, 0.15], &[]),
    prior("refrigerator", [0.5, 1.0], [1.3, 2.0], [0.0, 0.1], &["white", "grey"]),
    prior("stove", [0.5, 0.95], [0.8, 1.1], [0.0, 0.1], &["white", "grey", "black"]),
    prior("washing_machine", [0.5, 0.75], [0.75, 1.0], [0.0, 0.1], &["white"]),
    prior("lamp", [0.15, 0.5], [0.4, 1.1], [0.0, 0.9], &[]),
    prior("floor_lamp", [0.2, 0.6], [1.2, 1.9], [0.0, 0.3], &[]),
    prior("mirror", [0.3, 1.4], [1.3, 2.2], [0.2, 1.4], &[]),
    prior("curtain", [0.4, 2.4], [1.6, 2.4], [0.0, 0.9], &[]),
    prior("vase", [0.1, 0.4], [0.2, 1.2], [0.0, 1.0], &[]),
    prior("bin", [0.2, 0.5], [0.25, 0.8], [0.0, 0.1], &[]),
    prior("door", [0.7, 1.1], [1.9, 2.3], [0.0, 0.1], &[]),
];

/// Synonyms for the names in [`PRIORS`].
const SYNONYMS: &[(&str, &[&str])] = &[
    ("sofa", &["couch", "loveseat"]),
    ("armchair", &["recliner"]),
    ("chest_of_drawers", &["dresser", "drawers", "commode"]),
    ("tv_monitor", &["television", "tv", "monitor", "screen"]),
    ("picture", &["painting", "poster", "photo", "frame"]),
    ("cushion", &["pillow"]),
    ("plant", &["flowerpot", "tree"]),
    ("sink", &["basin", "washbasin"]),
    ("bathtub", &["tub"]),
    ("counter", &["island", "worktop"]),
    ("seating", &["seat"]),
    ("gym_equipment", &["treadmill", "dumbbells", "machine"]),
    ("cabinet", &["cupboard", "sideboard"]),
    ("wardrobe", &["closet"]),
    ("nightstand", &["bedside_table", "side_table", "end_table"]),
    ("bookshelf", &["bookcase", "shelf", "shelves", "shelving"]),
    ("ottoman", &["footstool", "pouf"]),
    ("refrigerator", &["fridge", "freezer"]),
    ("stove", &["oven", "cooker"]),
    ("washing_machine", &["dishwasher", "dryer"]),
    ("lamp", &["lighting"]),
    ("curtain", &["curtains", "blind"]),
];

/// Categories of the room memory: the mission categories, then three that identify rooms.
pub(crate) const CATEGORIES: [&str; 24] = [
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
    "appliances",
    "mirror",
    "shelving",
];

/// Returns an object's fit with a category, 0 to 1; 0.5 for unknown categories.
pub(crate) fn likeness(detection: &DetectedObject, category: &str) -> f32 {
    if let Some(told) = detection.is_a(category) {
        return told;
    }
    let Some(prior) = PRIORS.iter().find(|prior| prior.name == category) else { return 0.5 };
    let fit = inside(detection.long_m(), prior.long_m, 0.3)
        * inside(detection.high_m, prior.top_m, 0.25)
        * inside(detection.low_m, prior.low_m, 0.25);
    let shares = prior.colors.iter().filter_map(|word| detection.palette.share_of(word));
    let color = shares.fold(None, |sum: Option<f32>, share| Some(sum.unwrap_or(0.0) + share));
    fit * color.map_or(0.7, |share| 0.2 + 0.8 * share.min(1.0))
}

/// Returns an object's probabilities of [`CATEGORIES`].
pub(crate) fn categories_of(detection: &DetectedObject) -> Vec<f32> {
    let mut shares: Vec<f32> = CATEGORIES.iter().map(|name| likeness(detection, name)).collect();
    if detection.kinds.is_empty() {
        // Extents fit several categories: squares favour the best, and the sum is 1 at most.
        shares.iter_mut().for_each(|share| *share *= *share);
        let sum = shares.iter().sum::<f32>().max(1.0);
        shares.iter_mut().for_each(|share| *share /= sum);
    }
    shares
}

/// Returns category and word count of the longest known ending: `old floor lamp` is a `floor_lamp`.
pub(crate) fn noun_of(words: &[&str]) -> Option<(&'static str, usize)> {
    (0..words.len()).find_map(|from| Some((known(&words[from..].join("_"))?, words.len() - from)))
}

fn known(noun: &str) -> Option<&'static str> {
    let singular = noun.strip_suffix('s').unwrap_or(noun);
    let is = |name: &str| name == noun || name == singular;
    let prior = PRIORS.iter().map(|prior| prior.name).find(|name| is(name));
    prior.or_else(|| {
        SYNONYMS.iter().find(|(_, words)| words.iter().any(|word| is(word))).map(|(name, _)| *name)
    })
}

/// Returns the fit with an adjective by extents, 0 to 1; `None` for materials and other adjectives.
pub(crate) fn has_trait(detection: &DetectedObject, category: &str, word: &str) -> Option<f32> {
    let prior = PRIORS.iter().find(|prior| prior.name == category)?;
    let share = |value: f32, [low, high]: [f32; 2]| ((value - low) / (high - low)).clamp(0.0, 1.0);
    let long = share(detection.long_m(), prior.long_m);
    let top = share(detection.high_m, prior.top_m);
    let slender = detection.short_m() / detection.long_m().max(0.01);
    match word {
        "large" | "big" | "long" | "wide" => Some(long),
        "small" | "short" | "narrow" | "little" => Some(1.0 - long),
        "tall" | "high" => Some(top),
        "low" => Some(1.0 - top),
        "upright" => {
            Some(share((detection.high_m - detection.low_m) / detection.long_m().max(0.01), [0.7, 1.3]))
        }
        "round" | "square" | "circular" => Some(share(slender, [0.4, 0.9])),
        "rectangular" | "oval" => Some(1.0 - share(slender, [0.6, 1.0])),
        _ => None,
    }
}

/// Returns 1 inside a range, with a Gaussian fall-off of width `spread` outside.
fn inside(value: f32, [low, high]: [f32; 2], spread: f32) -> f32 {
    let out = (low - value).max(value - high).max(0.0) / spread;
    libm::expf(-0.5 * out * out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::FloorPoint;
    use crate::perception::objects::Palette;

    fn detection(size_m: [f32; 2], low_m: f32, high_m: f32, rgb: [u8; 3]) -> DetectedObject {
        DetectedObject {
            min: FloorPoint::new(0.0, 0.0),
            max: FloorPoint::new(size_m[0], size_m[1]),
            low_m,
            high_m,
            palette: Palette::of([rgb; 50].into_iter()),
            views: 1,
            ..DetectedObject::default()
        }
    }

    fn best(detection: &DetectedObject, of: &[&'static str]) -> &'static str {
        of.iter().copied().max_by(|a, b| likeness(detection, a).total_cmp(&likeness(detection, b))).unwrap()
    }

    #[test]
    fn shape_and_colour_separate_categories() {
        let all = ["bed", "toilet", "picture", "plant", "bathtub", "table"];
        assert_eq!(best(&detection([2.0, 1.6], 0.0, 0.6, [60, 60, 180]), &all), "bed");
        assert_eq!(best(&detection([0.6, 0.4], 0.0, 0.8, [245, 245, 240]), &all), "toilet");
        assert_eq!(best(&detection([0.8, 0.05], 1.1, 1.7, [180, 60, 60]), &all), "picture");
        assert_eq!(best(&detection([0.4, 0.4], 0.0, 1.0, [50, 130, 50]), &all), "plant");
        assert_eq!(best(&detection([1.6, 0.7], 0.0, 0.55, [245, 245, 240]), &all), "bathtub");
    }

    #[test]
    fn longest_known_noun_wins() {
        assert_eq!(noun_of(&["chest", "of", "drawers"]), Some(("chest_of_drawers", 3)));
        assert_eq!(noun_of(&["wooden", "tv"]), Some(("tv_monitor", 1)));
        assert_eq!(noun_of(&["old", "floor", "lamp"]), Some(("floor_lamp", 2)));
        assert_eq!(noun_of(&["desk", "lamp"]), Some(("lamp", 1)));
        assert_eq!(noun_of(&["two", "armchairs"]), Some(("armchair", 1)));
        assert_eq!(noun_of(&["bathtub"]), Some(("bathtub", 1)));
        assert_eq!((noun_of(&["unicorn"]), noun_of(&[])), (None, None));
        assert_eq!(likeness(&detection([1.0, 1.0], 0.0, 1.0, [0; 3]), "unicorn"), 0.5);
    }

    #[test]
    fn traits_are_relative_to_the_category() {
        // Tables are 0.5 to 2.2 m long and 0.65 to 0.85 m high.
        let table = detection([1.84, 0.46], 0.0, 0.7, [120, 80, 50]);
        let has = |word: &str| has_trait(&table, "table", word);
        assert!((has("long").unwrap() - 1.34 / 1.7).abs() < 1e-3);
        assert!((has("small").unwrap() - 0.36 / 1.7).abs() < 1e-3);
        assert!((has("tall").unwrap() - 0.25).abs() < 1e-3 && (has("low").unwrap() - 0.75).abs() < 1e-3);
        // Its sides are as 1 to 4.
        assert_eq!((has("round"), has("rectangular")), (Some(0.0), Some(1.0)));
        assert_eq!((has("wooden"), has_trait(&table, "unicorn", "long")), (None, None));
    }
}
