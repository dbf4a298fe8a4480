//! Sentence frames.

/// A shape of a sentence: text with slots in braces.
///
/// `{the np}` and `{a np}` are the noun with the adjectives, `{a noun}` and `{the noun}` the bare noun with the adjectives
/// said by `{be}` (`is` is not part of it); `{r1}` to `{r3}` say a place after a noun (`next to the bed`), `{p1}` to
/// `{p3}` after *it* or *that* (`stands next to the bed`), `{p12}`, `{p23}` and `{p123}` join some, `{also2}` is
/// `{p2}` with *also*; `{in}` is the room.
/// A slot with a capital begins with one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Frame {
    pub(crate) text: &'static str,
    /// Location slots.
    pub(crate) places: usize,
    /// True if it has a room slot.
    pub(crate) room: bool,
}

impl Frame {
    /// True if adjectives follow the noun.
    pub(crate) fn is_predicative(&self) -> bool {
        self.text.contains("{be}")
    }

    /// All frames.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        FRAMES
            .iter()
            .flat_map(|&(places, room, texts)| texts.iter().map(move |&text| Self { text, places, room }))
    }
}

const FRAMES: &[(usize, bool, &[&str])] = &[
    (
        1,
        false,
        &[
            "{The np} that {p1}.",
            "Find the {np} that {p1}.",
            "Look for {a np} {r1}.",
            "Please go to the {np} {r1}.",
            "Your goal is the {np} that {p1}.",
            "{A noun} {r1}; it is {be}.",
            "Can you find the {np} that {p1}?",
            "We need {the np}: the one that {p1}.",
            "The {noun} that {p1} is {be}.",
        ],
    ),
    (
        1,
        true,
        &[
            "{The np} {in}, {r1}.",
            "{In}, find the {np} {r1}.",
            "There is {a np} {in}; it {p1}.",
            "{In} there is {a np} that {p1}.",
            "Look {in} for {a np} that {p1}.",
            "The {noun} {in} is {be} and {p1}.",
            "Walk to the {np} {in}; it {p1}.",
            "{A np} {r1}, {in}.",
        ],
    ),
    (
        2,
        false,
        &[
            "{The np} {r1} and {r2}.",
            "{The np} that {p12}.",
            "Find the {np} {r1}; it {p2}.",
            "Look for {a np} that {p12}.",
            "{A np} {r1}, {r2}.",
            "{A noun} that is {be}; it {p12}.",
            "You should find {a np} {r1}, {r2}.",
            "The {noun} that {p12} is {be}.",
            "Head for the {np} {r1} and {r2}.",
        ],
    ),
    (
        2,
        true,
        &[
            "{The np} {in}, {r1} and {r2}.",
            "{In}, find the {np} that {p12}.",
            "There is {a np} {in}: it {p12}.",
            "Find the {np} {r1} {in}; it {also2}.",
            "The {noun} {in} that is {be}; it {p12}.",
            "Look {in} for the {np} {r1}, {r2}.",
            "{A np} {r1} and {r2}, {in}.",
            "Search {in} for {a np} that {p12}.",
        ],
    ),
    (
        3,
        false,
        &[
            "{The np} {r1}, {r2} and {r3}.",
            "Find the {np} {r1}; it {p23}.",
            "{A np} that {p123}.",
            "Look for {a np} {r1}, {r2} and {r3}.",
            "{The np} that {p12}; it {also3}.",
            "{A noun} {r1}; it is {be} and {p23}.",
            "What you are looking for is {a np} {r1}; it {p23}.",
            "The goal is the {np} that {p1}; it {also23}.",
        ],
    ),
    (
        3,
        true,
        &[
            "{The np} {in}, {r1}, {r2} and {r3}.",
            "{In}, look for the {np} {r1}; it {p23}.",
            "There is {a np} {in} that {p123}.",
            "Find the {np} {in} that {p12}; it {also3}.",
            "{A noun} {in} that is {be}; it {p123}.",
            "Head for the {np} {r1} {in}; it {p23}.",
            "Search {in} for {a np} {r1}, {r2} and {r3}.",
            "{The np} {r1} {in} is the one that {p23}.",
        ],
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn frames_are_complete_and_numerous() {
        let frames: Vec<Frame> = Frame::all().collect();
        let texts: BTreeSet<_> = frames.iter().map(|frame| frame.text).collect();
        assert!(texts.len() >= 40 && texts.len() == frames.len());
        for frame in frames {
            let says = |digit: char| {
                frame
                    .text
                    .split(['{', '}'])
                    .skip(1)
                    .step_by(2)
                    .any(|slot| slot.starts_with(['r', 'p', 'a']) && slot.contains(digit))
            };
            let places = ['1', '2', '3'].into_iter().filter(|&digit| says(digit)).count();
            assert_eq!(places, frame.places, "{}", frame.text);
            let room = frame.text.contains("{in}") || frame.text.contains("{In}");
            assert_eq!(room, frame.room, "{}", frame.text);
            assert_eq!(frame.is_predicative(), frame.text.contains("noun}"), "{}", frame.text);
        }
    }
}
