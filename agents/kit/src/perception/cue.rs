use super::{Palette, Thing, category, color::is_color};
use avln_client::{GoalCue, Image, RgbImage};
use std::ops::Range;

/// Sides of the layout grid of a picture.
const LAYOUT: usize = 3;

/// What a goal looks like, as far as its cue says.
#[derive(Clone, Debug, PartialEq)]
pub enum Query {
    /// A label or a sentence.
    Words(Words),
    /// A picture: what stands out in its middle, and how the whole is laid out.
    Picture {
        /// Colours of what stands in its middle.
        middle: Palette,
        /// Colours of its fields.
        layout: Layout,
    },
}

/// What a sentence says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Words {
    /// Label of the category.
    pub category: String,
    /// Colour word.
    pub color: Option<String>,
    /// The other words before the noun: size, shape, material.
    pub traits: Vec<String>,
    /// The room it is in.
    pub room: Option<String>,
    /// Category of what it is near to.
    pub near: Option<String>,
}

/// Rooms that sentences name.
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
    /// What a cue asks for.
    pub fn new(cue: &GoalCue) -> Self {
        match cue {
            GoalCue::Category(label) => Self::Words(Words::parse(&label.replace('_', " "))),
            GoalCue::Description(sentence) => Self::Words(Words::parse(sentence)),
            GoalCue::Image(image) => Self::Picture { middle: middle(image), layout: Layout::of(image) },
        }
    }

    /// How well one look at `thing` in a picture laid out as `layout` fits the cue by what is seen alone, 0 to 1 (s_vis
    /// of the paper for one look).
    pub fn fit(&self, thing: &Thing, layout: &Layout) -> f32 {
        match self {
            Self::Words(words) => words.fit(thing),
            Self::Picture { middle, layout: wanted } => {
                let view = stretched(layout.likeness(wanted), ALIKE);
                VIEW * view + (1.0 - VIEW) * thing.palette.likeness(middle)
            }
        }
    }
}

/// Share of the whole view, against that of the thing's own colours, in the fit with a picture.
const VIEW: f32 = 0.75;
/// Likenesses of views that show different things and of views that show the same.
const ALIKE: [f32; 2] = [0.4, 0.9];

fn stretched(value: f32, [low, high]: [f32; 2]) -> f32 {
    ((value - low) / (high - low)).clamp(0.0, 1.0)
}

impl Words {
    /// Understands sentences about one thing: its noun is the first that is known, what stands directly before it and
    /// after a later *is* are its looks, the next noun is what it is near to. Without a known noun the last word is it.
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

    /// How well a thing fits by extent, height and colours, 0 to 1.
    pub(super) fn fit(&self, thing: &Thing) -> f32 {
        let color = self.color.as_deref().and_then(|word| thing.palette.share_of(word));
        let traits = self.traits.iter().filter_map(|word| category::has_trait(thing, &self.category, word));
        let factor = |fit: f32, least: f32| least + (1.0 - least) * fit;
        category::likeness(thing, &self.category)
            * color.map_or(1.0, |share| factor((2.0 * share).min(1.0), WRONG_COLOR))
            * traits.map(|fit| factor(fit, WRONG_TRAIT)).product::<f32>()
    }
}

/// What is left of a fit where the colour, and where the size or shape is the opposite of what the cue says: extents of
/// things that were seen from one side only are too small.
const WRONG_COLOR: f32 = 0.15;
const WRONG_TRAIT: f32 = 0.6;

/// The known nouns of a sentence, each with the words that it takes; `floor lamp` is one, `television room` none.
fn nouns(words: &[&str]) -> Vec<(Range<usize>, &'static str)> {
    const LONGEST: usize = 3;
    let mut found = Vec::new();
    let mut from = 0;
    for end in 1..=words.len() {
        let ending = |end: usize| category::noun_of(&words[from.max(end.saturating_sub(LONGEST))..end]);
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

/// The adjectives of the noun at `span`: those before it back to its article, and those after the first *is* behind it.
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

/// Colours of the fields of a picture, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout(Vec<Palette>);

impl Layout {
    /// The layout of a picture.
    pub fn of(image: &Image) -> Self {
        let (width, height) = (image.width as usize, image.height as usize);
        let field = |i: usize| {
            let (column, row) = (i % LAYOUT, i / LAYOUT);
            let columns = [column * width / LAYOUT, (column + 1) * width / LAYOUT];
            palette(image, columns, [row * height / LAYOUT, (row + 1) * height / LAYOUT])
        };
        Self((0..LAYOUT * LAYOUT).map(field).collect())
    }

    /// How much two pictures look alike, 0 to 1.
    pub fn likeness(&self, other: &Self) -> f32 {
        let fields = self.0.iter().zip(&other.0);
        fields.map(|(a, b)| a.likeness(b)).sum::<f32>() / (LAYOUT * LAYOUT) as f32
    }
}

/// The colours in the middle of a picture.
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
    use crate::perception::Place;

    #[test]
    fn sentences_are_understood() {
        let words = Words::parse("the large round red wooden chest of drawers near a bed in the living room");
        assert_eq!(words.category, "chest_of_drawers");
        assert_eq!(words.color.as_deref(), Some("red"));
        assert_eq!(words.traits, ["large", "round", "wooden"]);
        assert_eq!((words.near.as_deref(), words.room.as_deref()), (Some("bed"), Some("living room")));
        let words = Words::parse("the yellow piece of gym equipment");
        assert_eq!((words.category.as_str(), words.color.as_deref()), ("gym_equipment", Some("yellow")));
        let words = Words::parse("A small black fridge, next to the coffee table");
        assert_eq!((words.category.as_str(), words.near.as_deref()), ("refrigerator", Some("coffee_table")));
        assert_eq!((words.color.as_deref(), words.traits), (Some("black"), vec!["small".to_owned()]));
    }

    #[test]
    fn orders_and_relative_clauses_are_understood() {
        let words = Words::parse("In one of the bedrooms, find the tall lamp that stands by the red sofa.");
        assert_eq!((words.category.as_str(), words.color), ("lamp", None));
        assert_eq!(words.traits, ["tall"]);
        assert_eq!((words.near.as_deref(), words.room.as_deref()), (Some("sofa"), Some("bedroom")));
        let words =
            Words::parse("The armchair that stands opposite the door is large, green and made of wood.");
        assert_eq!((words.category.as_str(), words.color.as_deref()), ("armchair", Some("green")));
        assert!(words.traits.contains(&"large".to_owned()) && words.near.as_deref() == Some("door"));
        let words = Words::parse("Look in the television room for a blue desk chair.");
        assert_eq!((words.category.as_str(), words.color.as_deref()), ("chair", Some("blue")));
    }

    #[test]
    fn labels_and_unknown_words_are_nouns() {
        assert_eq!(Words::parse("the unicorn"), Words { category: "unicorn".into(), ..Words::default() });
        assert_eq!(Words::parse("").category, "");
        let label = Query::new(&GoalCue::Category("tv_monitor".into()));
        assert_eq!(label, Query::Words(Words { category: "tv_monitor".into(), ..Words::default() }));
    }

    #[test]
    fn a_look_is_scored_by_form_and_colour() {
        // A bed of 2 x 1.6 m, 0.6 m high: inside of all that is usual, so 0.7 before colour and size count.
        let bed = Thing {
            max: Place::new(2.0, 1.6),
            high_m: 0.6,
            palette: Palette::of([[45, 85, 190]; 50].into_iter()),
            ..Thing::default()
        };
        let fit = |sentence: &str| Words::parse(sentence).fit(&bed);
        assert!((fit("the bed") - 0.7).abs() < 1e-4 && (fit("the blue bed") - 0.7).abs() < 1e-4);
        assert!((fit("the red bed") - 0.7 * 0.15).abs() < 0.02, "{}", fit("the red bed"));
        // It is 0.3 m longer than the shortest, of a range of 0.7 m.
        assert!((fit("the large bed") - 0.7 * (0.6 + 0.4 * 3.0 / 7.0)).abs() < 1e-3);
        assert!(fit("the bed") > 3.0 * fit("the sink"));
    }

    #[test]
    fn a_look_is_scored_by_the_view_where_the_cue_is_a_picture() {
        let red = Image { width: 30, height: 30, pixels: [200, 30, 30].repeat(900) };
        let query = Query::new(&GoalCue::Image(red.clone()));
        let thing = Thing { palette: Palette::of([[30, 30, 200]; 9].into_iter()), ..Thing::default() };
        // The view is the same, the colours of the thing are others.
        assert!((query.fit(&thing, &Layout::of(&red)) - 0.75).abs() < 0.02);
    }

    #[test]
    fn pictures_are_like_themselves() {
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
