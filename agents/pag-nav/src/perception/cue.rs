use super::{Palette, category, color::is_color};
use avln_client::{GoalCue, Image, RgbImage};

/// Sides of the layout grid of a picture.
const LAYOUT: usize = 3;

/// What a goal looks like, as far as its cue says.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Query {
    /// A label or a sentence.
    Words(Words),
    /// A picture: what stands out in its middle, and how the whole is laid out.
    Picture { middle: Palette, layout: Layout },
}

/// What a sentence says.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Words {
    /// Label of the category.
    pub(crate) category: String,
    /// Colour word.
    pub(crate) color: Option<String>,
    /// The other words before the noun: size, shape, material.
    pub(crate) traits: Vec<String>,
    /// The room it is in.
    pub(crate) room: Option<String>,
    /// Category of what it is near to.
    pub(crate) near: Option<String>,
}

impl Query {
    pub(crate) fn new(cue: &GoalCue) -> Self {
        match cue {
            GoalCue::Category(label) => {
                Self::Words(Words { category: category::category_of(label), ..Words::default() })
            }
            GoalCue::Description(sentence) => Self::Words(Words::parse(sentence)),
            GoalCue::Image(image) => Self::Picture { middle: middle(image), layout: Layout::of(image) },
        }
    }
}

impl Words {
    /// Understands "the ADJECTIVES NOUN near a NOUN in the ROOM".
    pub(crate) fn parse(sentence: &str) -> Self {
        let text = sentence.to_lowercase().replace(['.', ','], "");
        let (text, room) = split(&text, " in the ");
        let (text, near) = split(&text, " near a ");
        let text = text.trim_start_matches("the ").trim_start_matches("a ");
        let text = text.replace("pair of ", "").replace("piece of ", "").replace("set of ", "");
        let words: Vec<&str> = text.split_whitespace().collect();
        let noun_from =
            (0..words.len()).find(|&from| is_noun(&words[from..])).unwrap_or(words.len().saturating_sub(1));
        let (before, noun) = words.split_at(noun_from);
        let (colors, traits): (Vec<&str>, Vec<&str>) = before.iter().partition(|word| is_color(word));
        Self {
            category: category::category_of(&noun.join(" ")),
            color: colors.first().map(|&word| word.to_owned()),
            traits: traits.into_iter().map(str::to_owned).collect(),
            room,
            near: near.map(|noun| category::category_of(&noun)),
        }
    }
}

fn is_noun(words: &[&str]) -> bool {
    category::is_known(&category::category_of(&words.join(" ")))
}

/// The text before and after the last `separator`.
fn split(text: &str, separator: &str) -> (String, Option<String>) {
    match text.rsplit_once(separator) {
        Some((before, after)) => (before.to_owned(), Some(after.trim().to_owned())),
        None => (text.to_owned(), None),
    }
}

/// Colours of the fields of a picture, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Layout(Vec<Palette>);

impl Layout {
    pub(crate) fn of(image: &Image) -> Self {
        let (width, height) = (image.width as usize, image.height as usize);
        let field = |i: usize| {
            let (column, row) = (i % LAYOUT, i / LAYOUT);
            let columns = [column * width / LAYOUT, (column + 1) * width / LAYOUT];
            palette(image, columns, [row * height / LAYOUT, (row + 1) * height / LAYOUT])
        };
        Self((0..LAYOUT * LAYOUT).map(field).collect())
    }

    /// How much two pictures look alike, 0 to 1.
    pub(crate) fn likeness(&self, other: &Self) -> f32 {
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

    #[test]
    fn sentences_are_understood() {
        let words = Words::parse("the large round red wooden chest of drawers near a bed in the living room");
        assert_eq!(words.category, "chest_of_drawers");
        assert_eq!(words.color.as_deref(), Some("red"));
        assert_eq!(words.traits, ["large", "round", "wooden"]);
        assert_eq!((words.near.as_deref(), words.room.as_deref()), (Some("bed"), Some("living room")));
        let words = Words::parse("the yellow piece of gym equipment");
        assert_eq!((words.category.as_str(), words.color.as_deref()), ("gym_equipment", Some("yellow")));
        assert_eq!(Words::parse("the lamp"), Words { category: "lamp".into(), ..Words::default() });
        assert_eq!(Words::parse("").category, "");
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
