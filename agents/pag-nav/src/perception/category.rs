use super::Thing;

/// What things of a category look like: ranges of their long side on the floor plan, of the height of their top and of
/// their lowest point above the floor, metres, and colours that they mostly have.
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

/// From everyday sizes of furniture.
const PRIORS: [Prior; 21] = [
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
];

/// How well the shape and the colours of `thing` fit a category, 0 to 1; 0.5 for a category that is not known.
pub(crate) fn likeness(thing: &Thing, category: &str) -> f32 {
    let Some(prior) = PRIORS.iter().find(|prior| prior.name == category) else { return 0.5 };
    let fit = inside(thing.long_m(), prior.long_m, 0.3)
        * inside(thing.high_m, prior.top_m, 0.25)
        * inside(thing.low_m, prior.low_m, 0.25);
    let shares = prior.colors.iter().filter_map(|word| thing.palette.share_of(word));
    let color = shares.fold(None, |sum: Option<f32>, share| Some(sum.unwrap_or(0.0) + share));
    fit * color.map_or(0.7, |share| 0.2 + 0.8 * share.min(1.0))
}

/// The category that a noun means; the noun itself with underscores where it is none.
pub(crate) fn category_of(noun: &str) -> String {
    const SYNONYMS: [(&str, &str); 8] = [
        ("couch", "sofa"),
        ("armchair", "chair"),
        ("dresser", "chest_of_drawers"),
        ("television", "tv_monitor"),
        ("tv", "tv_monitor"),
        ("painting", "picture"),
        ("pillow", "cushion"),
        ("potted plant", "plant"),
    ];
    let known = SYNONYMS.iter().find(|(word, _)| *word == noun);
    known.map_or_else(|| noun.replace(' ', "_"), |(_, name)| (*name).to_owned())
}

/// Whether `category` is one of the target categories.
pub(crate) fn is_known(category: &str) -> bool {
    PRIORS.iter().any(|prior| prior.name == category)
}

/// 1 inside a range, falling to 0 like a bell with `spread` outside.
fn inside(value: f32, [low, high]: [f32; 2], spread: f32) -> f32 {
    let out = (low - value).max(value - high).max(0.0) / spread;
    (-0.5 * out * out).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::{Palette, Place};

    fn thing(size_m: [f32; 2], low_m: f32, high_m: f32, rgb: [u8; 3]) -> Thing {
        Thing {
            min: Place::new(0.0, 0.0),
            max: Place::new(size_m[0], size_m[1]),
            low_m,
            high_m,
            palette: Palette::of([rgb; 50].into_iter()),
            views: 1,
        }
    }

    fn best(thing: &Thing, of: &[&'static str]) -> &'static str {
        of.iter().copied().max_by(|a, b| likeness(thing, a).total_cmp(&likeness(thing, b))).unwrap()
    }

    #[test]
    fn shapes_and_colours_tell_categories_apart() {
        let all = ["bed", "toilet", "picture", "plant", "bathtub", "table"];
        assert_eq!(best(&thing([2.0, 1.6], 0.0, 0.6, [60, 60, 180]), &all), "bed");
        assert_eq!(best(&thing([0.6, 0.4], 0.0, 0.8, [245, 245, 240]), &all), "toilet");
        assert_eq!(best(&thing([0.8, 0.05], 1.1, 1.7, [180, 60, 60]), &all), "picture");
        assert_eq!(best(&thing([0.4, 0.4], 0.0, 1.0, [50, 130, 50]), &all), "plant");
        assert_eq!(best(&thing([1.6, 0.7], 0.0, 0.55, [245, 245, 240]), &all), "bathtub");
    }

    #[test]
    fn nouns_are_understood() {
        assert_eq!(category_of("chest of drawers"), "chest_of_drawers");
        assert_eq!(category_of("tv"), "tv_monitor");
        assert!(is_known("sofa") && !is_known("ceiling"));
        assert_eq!(likeness(&thing([1.0, 1.0], 0.0, 1.0, [0; 3]), "unicorn"), 0.5);
    }
}
