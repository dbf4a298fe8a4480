//! Goal cues as queries: category, attributes, relations, or a reference image.

use crate::perception::category::{has_trait, likeness, noun_of};
use crate::perception::objects::{DetectedObject, Palette, is_color};
use avln_client::{GoalCue, Image, RgbImage};
use std::ops::Range;

/// Fields per side in a layout.
const LAYOUT: usize = 3;

/// A goal's appearance, parsed from the cue.
#[derive(Clone, Debug, PartialEq)]
pub enum Query {
    /// A label or a sentence.
    Words(CueWords),
    /// A reference image.
    Picture {
        /// Colours in the middle.
        middle: Palette,
        /// Colours by field.
        layout: Layout,
    },
}

/// A parsed sentence.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CueWords {
    /// Category.
    pub category: String,
    /// Colour word.
    pub color: Option<String>,
    /// Other adjectives: size, shape, material.
    pub traits: Vec<String>,
    /// Room.
    pub room: Option<String>,
    /// Neighbour's category.
    pub near: Option<String>,
}

const ROOMS: [&str; 12] = [
    "living room",
    "dining room",
    "bathroom",
    "bedroom",
    "kitchen",
    "office",
    "gym",
    "hallway",
    "laundry room",
    "corridor",
    "closet",
    "study",
];

impl Query {
    /// Parses a cue.
    pub fn new(cue: &GoalCue) -> Self {
        match cue {
            GoalCue::Category(label) => Self::Words(CueWords::parse(&label.replace('_', " "))),
            GoalCue::Description(sentence) => Self::Words(CueWords::parse(sentence)),
            GoalCue::Image(image) => Self::Picture { middle: middle(image), layout: Layout::of(image) },
        }
    }

    /// Returns an object's visual fit in a single view, given the image layout, 0 to 1 (s_vis in the paper).
    pub fn fit(&self, detection: &DetectedObject, layout: &Layout) -> f32 {
        match self {
            Self::Words(words) => words.fit(detection),
            Self::Picture { middle, layout: wanted } => {
                let view = stretched(layout.likeness(wanted), ALIKE);
                VIEW * view + (1.0 - VIEW) * detection.palette.likeness(middle)
            }
        }
    }
}

/// Weight of the whole view against the object's colours in the fit with a reference image.
const VIEW: f32 = 0.75;
/// Similarities for different and for equal views.
const ALIKE: [f32; 2] = [0.4, 0.9];

fn stretched(value: f32, [low, high]: [f32; 2]) -> f32 {
    ((value - low) / (high - low)).clamp(0.0, 1.0)
}

impl CueWords {
    /// Parses a sentence: the first known noun is the category, otherwise the last word; adjectives are
    /// directly before it and after a later *is*; the next known noun is a neighbour.
    pub fn parse(sentence: &str) -> Self {
        let text = sentence.to_lowercase().replace(|c: char| !c.is_alphanumeric(), " ");
        let words: Vec<&str> = text.split_whitespace().collect();
        let mut nouns = nouns(&words).into_iter();
        let last = words.len().saturating_sub(1)..words.len();
        let (span, name) = nouns.next().map_or_else(
            || (last.clone(), words.last().map_or(String::new(), |word| (*word).to_owned())),
            |(span, name)| (span, name.to_owned()),
        );
        let looks = looks(&words, &span);
        let (colors, traits): (Vec<&str>, Vec<&str>) = looks.into_iter().partition(|word| is_color(word));
        let spaced = words.join(" ");
        Self {
            category: name,
            color: colors.first().map(|&word| word.to_owned()),
            traits: traits.into_iter().map(str::to_owned).collect(),
            room: ROOMS.iter().find(|room| spaced.contains(*room)).map(|&room| room.to_owned()),
            near: nouns.next().map(|(_, name)| name.to_owned()),
        }
    }

    /// Returns the fit by extents and colours, 0 to 1.
    pub(crate) fn fit(&self, detection: &DetectedObject) -> f32 {
        let color = self.color.as_deref().and_then(|word| detection.palette.share_of(word));
        let traits = self.traits.iter().filter_map(|word| has_trait(detection, &self.category, word));
        let factor = |fit: f32, least: f32| least + (1.0 - least) * fit;
        likeness(detection, &self.category)
            * color.map_or(1.0, |share| factor((2.0 * share).min(1.0), WRONG_COLOR))
            * traits.map(|fit| factor(fit, WRONG_TRAIT)).product::<f32>()
    }
}

/// Factors for a wrong colour, and for the opposite size or shape: objects seen from a single side appear too small.
const WRONG_COLOR: f32 = 0.15;
const WRONG_TRAIT: f32 = 0.6;

/// Returns the known nouns with their word ranges: `floor lamp` counts once, `television room` not at all.
fn nouns(words: &[&str]) -> Vec<(Range<usize>, &'static str)> {
    const LONGEST: usize = 3;
    let mut found = Vec::new();
    let mut from = 0;
    for end in 1..=words.len() {
        let ending = |end: usize| noun_of(&words[from.max(end.saturating_sub(LONGEST))..end]);
        let Some((name, length)) = ending(end) else { continue };
        let next = words.get(end).copied().unwrap_or_default();
        if next.starts_with("room") || (!next.is_empty() && ending(end + 1).is_some()) {
            continue;
        }
        found.push((end - length..end, name));
        from = end;
    }
    found
}

/// Returns a noun's adjectives: back to its article, and after the first later *is*.
fn looks<'a>(words: &[&'a str], span: &Range<usize>) -> Vec<&'a str> {
    const ARTICLES: [&str; 4] = ["the", "a", "an", "one"];
    const MOST: usize = 4;
    let before = words[..span.start].iter().rev().take(MOST).take_while(|word| !ARTICLES.contains(word));
    let before: Vec<&str> = before.copied().collect();
    let mut looks: Vec<&str> = before.into_iter().rev().collect();
    if let Some(is) = words[span.end..].iter().position(|word| *word == "is") {
        let after = words[span.end + is + 1..].iter();
        looks.extend(
            after.take(MOST).take_while(|word| !ARTICLES.contains(word)).filter(|word| **word != "and"),
        );
    }
    looks
}

/// Palettes by field, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout(Vec<Palette>);

impl Layout {
    /// Computes an image's layout.
    pub fn of(image: &Image) -> Self {
        let (width, height) = (image.width as usize, image.height as usize);
        let field = |i: usize| {
            let (column, row) = (i % LAYOUT, i / LAYOUT);
            let columns = [column * width / LAYOUT, (column + 1) * width / LAYOUT];
            palette(image, columns, [row * height / LAYOUT, (row + 1) * height / LAYOUT])
        };
        Self((0..LAYOUT * LAYOUT).map(field).collect())
    }

    /// Compares two images, 0 to 1.
    pub fn likeness(&self, other: &Self) -> f32 {
        let fields = self.0.iter().zip(&other.0);
        fields.map(|(a, b)| a.likeness(b)).sum::<f32>() / (LAYOUT * LAYOUT) as f32
    }
}

fn middle(image: &RgbImage) -> Palette {
    let (width, height) = (image.width as usize, image.height as usize);
    palette(image, [width * 3 / 8, width * 5 / 8], [height * 3 / 8, height * 5 / 8])
}

fn palette(image: &Image, columns: [usize; 2], rows: [usize; 2]) -> Palette {
    let every = 2;
    let places = (rows[0]..rows[1])
        .step_by(every)
        .flat_map(|row| (columns[0]..columns[1]).step_by(every).map(move |column| (row, column)));
    Palette::of(places.filter_map(|(row, column)| {
        let start = 3 * (row * image.width as usize + column);
        image.pixels.get(start..start + 3)?.try_into().ok()
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::FloorPoint;

    #[test]
    fn sentences_are_parsed() {
        let words =
            CueWords::parse("the large round red wooden chest of drawers near a bed in the living room");
        assert_eq!(words.category, "chest_of_drawers");
        assert_eq!(words.color.as_deref(), Some("red"));
        assert_eq!(words.traits, ["large", "round", "wooden"]);
        assert_eq!((words.near.as_deref(), words.room.as_deref()), (Some("bed"), Some("living room")));
        let words = CueWords::parse("the yellow piece of gym equipment");
        assert_eq!((words.category.as_str(), words.color.as_deref()), ("gym_equipment", Some("yellow")));
        let words = CueWords::parse("A small black fridge, next to the coffee table");
        assert_eq!((words.category.as_str(), words.near.as_deref()), ("refrigerator", Some("coffee_table")));
        assert_eq!((words.color.as_deref(), words.traits), (Some("black"), vec!["small".to_owned()]));
    }

    #[test]
    fn commands_and_relative_clauses_are_parsed() {
        let words =
            CueWords::parse("In one of the bedrooms, find the tall lamp that stands by the red sofa.");
        assert_eq!((words.category.as_str(), words.color), ("lamp", None));
        assert_eq!(words.traits, ["tall"]);
        assert_eq!((words.near.as_deref(), words.room.as_deref()), (Some("sofa"), Some("bedroom")));
        let words =
            CueWords::parse("The armchair that stands opposite the door is large, green and made of wood.");
        assert_eq!((words.category.as_str(), words.color.as_deref()), ("armchair", Some("green")));
        assert!(words.traits.contains(&"large".to_owned()) && words.near.as_deref() == Some("door"));
        let words = CueWords::parse("Look in the television room for a blue desk chair.");
        assert_eq!((words.category.as_str(), words.color.as_deref()), ("chair", Some("blue")));
    }

    #[test]
    fn unknown_labels_become_categories() {
        assert_eq!(
            CueWords::parse("the unicorn"),
            CueWords { category: "unicorn".into(), ..CueWords::default() }
        );
        assert_eq!(CueWords::parse("").category, "");
        let label = Query::new(&GoalCue::Category("tv_monitor".into()));
        assert_eq!(label, Query::Words(CueWords { category: "tv_monitor".into(), ..CueWords::default() }));
    }

    #[test]
    fn categories_are_scored_by_shape_and_colour() {
        // A bed, 2 x 1.6 m, 0.6 m high: inside all usual ranges, so 0.7 before colour and size.
        let bed = DetectedObject {
            max: FloorPoint::new(2.0, 1.6),
            high_m: 0.6,
            palette: Palette::of([[45, 85, 190]; 50].into_iter()),
            ..DetectedObject::default()
        };
        let fit = |sentence: &str| CueWords::parse(sentence).fit(&bed);
        assert!((fit("the bed") - 0.7).abs() < 1e-4 && (fit("the blue bed") - 0.7).abs() < 1e-4);
        assert!((fit("the red bed") - 0.7 * 0.15).abs() < 0.02, "{}", fit("the red bed"));
        // 0.3 m above the minimum in a range of 0.7 m.
        assert!((fit("the large bed") - 0.7 * (0.6 + 0.4 * 3.0 / 7.0)).abs() < 1e-3);
        assert!(fit("the bed") > 3.0 * fit("the sink"));
    }

    #[test]
    fn image_cues_are_scored_by_the_view() {
        let red = Image { width: 30, height: 30, pixels: [200, 30, 30].repeat(900) };
        let query = Query::new(&GoalCue::Image(red.clone()));
        let detection = DetectedObject {
            palette: Palette::of([[30, 30, 200]; 9].into_iter()),
            ..DetectedObject::default()
        };
        // The view is the same, the colours of the thing are others.
        assert!((query.fit(&detection, &Layout::of(&red)) - 0.75).abs() < 0.02);
    }

    #[test]
    fn layouts_match_themselves() {
        let picture = |rgb: [u8; 3]| Image { width: 30, height: 30, pixels: rgb.repeat(900) };
        let (red, blue) = (Layout::of(&picture([200, 30, 30])), Layout::of(&picture([30, 30, 200])));
        assert!(red.likeness(&red) > 0.95 && red.likeness(&blue) < 0.2);
        let Query::Picture { middle, .. } = Query::new(&GoalCue::Image(picture([200, 30, 30]))) else {
            panic!()
        };
        assert!(middle.share_of("red").unwrap() > 0.7);
        assert_eq!(Layout::of(&Image::default()).likeness(&red), 0.0);
    }
}
