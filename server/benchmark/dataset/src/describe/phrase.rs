//! Sentence frames, and conversion from claims to words.

use crate::{
    cue::{Claim, Landmark, Relation},
    describe::lexicon::{article, plural, substance},
};
use avln_geom::Rng;

/// Sentence frames: texts with slots in braces.
///
/// `{the np}` and `{a np}` are the noun with the adjectives, `{a noun}` and `{the noun}` the bare noun with the adjectives
/// in `{be}` (`is` is not part of it). `{r1}` to `{r3}` are places after a noun (`next to the bed`), `{p1}` to `{p3}` places
/// after *it* or *that* (`hangs above the bed`); `{p12}`, `{p23}` and `{p123}` join some, `{also2}` is `{p2}` with *also*.
/// `{in}` is the room. A capital in a slot becomes the first letter.
const FRAMES: &[&str] = &[
    "{The np} that {p1}.",
    "Find the {np} that {p1}.",
    "Look for {a np} {r1}.",
    "Please go to the {np} {r1}.",
    "Your goal is the {np} that {p1}.",
    "{A noun} {r1}; it is {be}.",
    "Can you find the {np} that {p1}?",
    "We need {the np}: the one that {p1}.",
    "The {noun} that {p1} is {be}.",
    "{The np} {in}, {r1}.",
    "{In}, find the {np} {r1}.",
    "There is {a np} {in}; it {p1}.",
    "{In} there is {a np} that {p1}.",
    "Look {in} for {a np} that {p1}.",
    "The {noun} {in} is {be} and {p1}.",
    "Walk to the {np} {in}; it {p1}.",
    "{A np} {r1}, {in}.",
    "{The np} {r1} and {r2}.",
    "{The np} that {p12}.",
    "Find the {np} {r1}; it {p2}.",
    "Look for {a np} that {p12}.",
    "{A np} {r1}, {r2}.",
    "{A noun} that is {be}; it {p12}.",
    "You should find {a np} {r1}, {r2}.",
    "The {noun} that {p12} is {be}.",
    "Head for the {np} {r1} and {r2}.",
    "{The np} {in}, {r1} and {r2}.",
    "{In}, find the {np} that {p12}.",
    "There is {a np} {in}: it {p12}.",
    "Find the {np} {r1} {in}; it {also2}.",
    "The {noun} {in} that is {be}; it {p12}.",
    "Look {in} for the {np} {r1}, {r2}.",
    "{A np} {r1} and {r2}, {in}.",
    "Search {in} for {a np} that {p12}.",
    "{The np} {r1}, {r2} and {r3}.",
    "Find the {np} {r1}; it {p23}.",
    "{A np} that {p123}.",
    "Look for {a np} {r1}, {r2} and {r3}.",
    "{The np} that {p12}; it {also3}.",
    "{A noun} {r1}; it is {be} and {p23}.",
    "What you are looking for is {a np} {r1}; it {p23}.",
    "The goal is the {np} that {p1}; it {also23}.",
    "{The np} {in}, {r1}, {r2} and {r3}.",
    "{In}, look for the {np} {r1}; it {p23}.",
    "There is {a np} {in} that {p123}.",
    "Find the {np} {in} that {p12}; it {also3}.",
    "{A noun} {in} that is {be}; it {p123}.",
    "Head for the {np} {r1} {in}; it {p23}.",
    "Search {in} for {a np} {r1}, {r2} and {r3}.",
    "{The np} {r1} {in} is the one that {p23}.",
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SentenceFrame(pub(crate) &'static str);

impl SentenceFrame {
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        FRAMES.iter().map(|text| Self(text))
    }

    /// Returns the location count: slots are numbered from 1.
    pub(crate) fn places(self) -> usize {
        ['1', '2', '3'].into_iter().filter(|&digit| self.0.contains(digit)).count()
    }

    pub(crate) fn has_room(self) -> bool {
        self.0.contains("{in}") || self.0.contains("{In}")
    }

    /// True if adjectives follow the noun.
    pub(crate) fn is_predicative(self) -> bool {
        self.0.contains("{be}")
    }
}

pub(crate) struct Words<'a> {
    pub(crate) noun: &'a str,
    /// Size, shape, colour and material claims, in order.
    pub(crate) looks: Vec<&'a Claim>,
    pub(crate) places: Vec<&'a Claim>,
    /// Room noun, and whether it is unique in the house.
    pub(crate) room: Option<(&'a str, bool)>,
    /// `is`, or a verb such as `hangs`.
    pub(crate) verb: &'static str,
}

/// Location in words: after a noun, and as verb and rest after *it*.
struct Said {
    after_noun: String,
    verb: &'static str,
    rest: String,
}

impl Words<'_> {
    /// Fills the frame; `rng` chooses between synonyms.
    pub(crate) fn fill(&self, frame: SentenceFrame, rng: &mut Rng) -> String {
        let places: Vec<Said> = self.places.iter().filter_map(|claim| self.place(claim, rng)).collect();
        let room = self.room_phrase(rng);
        let with_adjectives = self.noun_phrase(rng);
        let mut text = String::new();
        let (mut rest, mut last) = (frame.0, "");
        while let Some((before, after)) = rest.split_once('{') {
            let Some((slot, after)) = after.split_once('}') else { break };
            let said = self.slot(slot, &with_adjectives, &places, &room);
            // No second "is" after "it is red and".
            let goes_on = last == "be" && before == " and ";
            text.push_str(before);
            text.push_str(said.strip_prefix("is ").filter(|_| goes_on).unwrap_or(&said));
            (rest, last) = (after, slot);
        }
        text + rest
    }

    fn slot(&self, slot: &str, np: &str, places: &[Said], room: &str) -> String {
        let joined = |digits: &str| {
            let numbers = digits.bytes().map(|digit| usize::from(digit - b'1'));
            predicate(&numbers.filter_map(|number| places.get(number)).collect::<Vec<_>>())
        };
        let after_noun = |digits: &str| {
            let number = digits.parse::<usize>().unwrap_or(1) - 1;
            places.get(number).map_or(String::new(), |said| said.after_noun.clone())
        };
        match slot {
            "np" => np.to_owned(),
            "the np" | "The np" => cased(slot, &format!("the {np}")),
            "a np" | "A np" => cased(slot, &format!("{} {np}", article(np))),
            "noun" => self.noun.to_owned(),
            "a noun" | "A noun" => cased(slot, &format!("{} {}", article(self.noun), self.noun)),
            "be" => self.predicative(),
            "in" | "In" => cased(slot, room),
            _ if slot.starts_with("also") => with_also(&joined(&slot[4..])),
            _ if slot.starts_with('p') => joined(&slot[1..]),
            _ => after_noun(&slot[1..]),
        }
    }

    /// The noun with the adjectives: `large red wooden table`, sometimes `large red table made of wood`.
    fn noun_phrase(&self, rng: &mut Rng) -> String {
        let made_of = rng.chance(0.3);
        let mut words: Vec<&str> = Vec::new();
        let mut tail = String::new();
        for look in &self.looks {
            match look {
                Claim::Material(word) => match substance(word).filter(|_| made_of && self.places.len() < 3) {
                    Some(substance) => tail = format!(" made of {substance}"),
                    None => words.push(word),
                },
                Claim::Size(word) | Claim::Shape(word) | Claim::Color(word) => words.push(word),
                Claim::Room(_) | Claim::Place(..) => {}
            }
        }
        words.push(self.noun);
        words.join(" ") + &tail
    }

    /// The adjectives after *is*: `large, red and made of wood`.
    fn predicative(&self) -> String {
        let word = |look: &&Claim| match look {
            Claim::Material(word) => Some(substance(word).map_or(word.clone(), |of| format!("made of {of}"))),
            Claim::Size(word) | Claim::Shape(word) | Claim::Color(word) => Some(word.clone()),
            Claim::Room(_) | Claim::Place(..) => None,
        };
        listed(&self.looks.iter().filter_map(word).collect::<Vec<_>>())
    }

    fn room_phrase(&self, rng: &mut Rng) -> String {
        match self.room {
            Some((noun, true)) => format!("in the {noun}"),
            Some((noun, false)) if rng.chance(0.5) => format!("in one of the {}", plural(noun)),
            Some((noun, false)) => format!("in {} {noun}", article(noun)),
            None => String::new(),
        }
    }

    fn place(&self, claim: &Claim, rng: &mut Rng) -> Option<Said> {
        let Claim::Place(relation, landmarks) = claim else { return None };
        let things = things(landmarks);
        if *relation == Relation::Holds {
            let after_noun = format!("with {things} on it");
            return Some(Said { after_noun, verb: "has", rest: format!("{things} on it") });
        }
        let prepositions = self.prepositions(*relation, landmarks);
        let chosen = rng.choose(prepositions).copied().unwrap_or("near {}");
        let phrase = chosen.replace("{}", &things);
        let hanging = self.verb == "hangs" && *relation == Relation::Above && rng.chance(0.5);
        let after_noun = if hanging { format!("hanging {phrase}") } else { phrase.clone() };
        Some(Said { after_noun, verb: self.verb, rest: phrase })
    }

    fn prepositions(&self, relation: Relation, landmarks: &[Landmark]) -> &'static [&'static str] {
        let all_are = |categories: &[&str]| {
            landmarks.iter().all(|landmark| categories.contains(&landmark.name.category.as_str()))
        };
        match relation {
            Relation::Near | Relation::NextTo if all_are(&["door", "window"]) => {
                &["by {}", "near {}", "close to {}"]
            }
            Relation::Near => &["near {}", "close to {}", "not far from {}"],
            Relation::NextTo => &["next to {}", "beside {}", "right next to {}"],
            Relation::On if all_are(&["bed", "sofa", "chair", "seating", "rug"]) => &["on {}"],
            Relation::On => &["on {}", "on top of {}"],
            Relation::Holds => &["under {}"],
            Relation::Under => &["under {}", "underneath {}"],
            Relation::Above => &["above {}", "over {}"],
            Relation::Below => &["below {}", "beneath {}"],
            Relation::LeftOf => {
                &["to the left of {} as you face the wall", "to the left of {} when facing the wall"]
            }
            Relation::RightOf => {
                &["to the right of {} as you face the wall", "to the right of {} when facing the wall"]
            }
            Relation::Between => &["between {}", "in between {}"],
            Relation::Opposite => &["opposite {}", "across from {}", "on the other side of the room from {}"],
            Relation::Corner => &["in a corner", "in the corner"],
            Relation::AgainstWall => &["against the wall", "against a wall"],
        }
    }
}

/// Landmarks with articles: `the red sofa`, `a lamp and the door`, `two chairs`.
fn things(landmarks: &[Landmark]) -> String {
    let phrase = |landmark: &Landmark, noun: &str| match &landmark.color {
        Some(color) => format!("{color} {noun}"),
        None => noun.to_owned(),
    };
    if let [a, b] = landmarks
        && a.name.noun == b.name.noun
        && a.color == b.color
    {
        return format!("two {}", phrase(a, &plural(&a.name.noun)));
    }
    let said = |landmark: &Landmark| {
        let phrase = phrase(landmark, &landmark.name.noun);
        let article = if landmark.only { "the" } else { article(&phrase) };
        format!("{article} {phrase}")
    };
    landmarks.iter().map(said).collect::<Vec<_>>().join(" and ")
}

/// Verbs and locations without repeated verbs: `hangs above the bed and near a window`.
fn predicate(places: &[&Said]) -> String {
    let groups = places.chunk_by(|a, b| a.verb == b.verb);
    let clause = |group: &[&Said]| {
        let rests: Vec<String> = group.iter().map(|said| said.rest.clone()).collect();
        format!("{} {}", group[0].verb, listed(&rests))
    };
    groups.map(clause).collect::<Vec<_>>().join(" and ")
}

/// `also hangs above the bed`, `is also above the bed`.
fn with_also(predicate: &str) -> String {
    match predicate.strip_prefix("is ") {
        Some(rest) => format!("is also {rest}"),
        None => format!("also {predicate}"),
    }
}

/// `a`, `a and b`, `a, b and c`.
fn listed(parts: &[String]) -> String {
    match parts {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// Capitalises the text if the slot is capitalised.
fn cased(slot: &str, text: &str) -> String {
    let mut letters = text.chars();
    match letters.next() {
        Some(first) if slot.starts_with(char::is_uppercase) => first.to_uppercase().chain(letters).collect(),
        _ => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn frames_are_complete_and_numerous() {
        let texts: BTreeSet<&str> = FRAMES.iter().copied().collect();
        assert!(texts.len() >= 40 && texts.len() == FRAMES.len());
        for frame in SentenceFrame::all() {
            let slots: Vec<&str> = frame.0.split(['{', '}']).skip(1).step_by(2).collect();
            let says = |digit: char| {
                slots.iter().any(|slot| slot.starts_with(['r', 'p', 'a']) && slot.contains(digit))
            };
            let places = ['1', '2', '3'].into_iter().filter(|&digit| says(digit)).count();
            assert!((1..=3).contains(&places) && places == frame.places(), "{}", frame.0);
            assert!(says('1') && (places < 2 || says('2')), "{}", frame.0);
            assert_eq!(frame.is_predicative(), frame.0.contains("noun}"), "{}", frame.0);
        }
        for places in 1..=3 {
            for room in [false, true] {
                let fitting =
                    SentenceFrame::all().filter(|frame| frame.places() == places && frame.has_room() == room);
                assert!(fitting.count() >= 8, "{places} {room}");
            }
        }
    }
}
