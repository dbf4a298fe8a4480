//! Names of teams, methods and tokens: visible characters and look-alikes.

use std::ops::RangeInclusive;

/// Letters in small form, and the Latin letters that they look like, in small or capital form.
const LOOK_ALIKES: [(char, char); 36] = [
    ('0', 'o'),
    ('1', 'l'),
    ('i', 'l'),
    ('|', 'l'),
    ('\u{131}', 'l'),
    // Cyrillic
    ('\u{430}', 'a'),
    ('\u{432}', 'b'),
    ('\u{435}', 'e'),
    ('\u{43a}', 'k'),
    ('\u{43c}', 'm'),
    ('\u{43d}', 'h'),
    ('\u{43e}', 'o'),
    ('\u{440}', 'p'),
    ('\u{441}', 'c'),
    ('\u{442}', 't'),
    ('\u{443}', 'y'),
    ('\u{445}', 'x'),
    ('\u{455}', 's'),
    ('\u{456}', 'l'),
    ('\u{458}', 'j'),
    ('\u{4cf}', 'l'),
    ('\u{501}', 'd'),
    // Greek
    ('\u{3b1}', 'a'),
    ('\u{3b2}', 'b'),
    ('\u{3b5}', 'e'),
    ('\u{3b6}', 'z'),
    ('\u{3b7}', 'h'),
    ('\u{3b9}', 'l'),
    ('\u{3ba}', 'k'),
    ('\u{3bc}', 'm'),
    ('\u{3bd}', 'n'),
    ('\u{3bf}', 'o'),
    ('\u{3c1}', 'p'),
    ('\u{3c4}', 't'),
    ('\u{3c5}', 'y'),
    ('\u{3c7}', 'x'),
];

/// Returns whether a character is visible or a space. Control characters, characters without width, and characters that change the
/// direction of a text are not.
pub fn is_visible(letter: char) -> bool {
    let is_hidden = matches!(
        letter,
        '\u{ad}'
            | '\u{61c}'
            | '\u{180e}'
            | '\u{200b}'..='\u{200f}'
            | '\u{2028}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}'
            | '\u{feff}'
            | '\u{fff9}'..='\u{fffb}'
            | '\u{e0000}'..='\u{e007f}'
    );
    !letter.is_control() && !is_hidden
}

/// Returns whether a text has only visible characters, and a number of them in `length`.
pub fn is_visible_text(text: &str, length: &RangeInclusive<usize>) -> bool {
    length.contains(&text.chars().count()) && text.chars().all(is_visible)
}

/// Returns whether a name has Latin letters together with Greek or Cyrillic ones, which look like them.
pub fn mixes_scripts(name: &str) -> bool {
    name.chars().any(is_latin) && name.chars().any(is_greek_or_cyrillic)
}

fn is_latin(letter: char) -> bool {
    let is_in_block =
        matches!(letter, '\u{c0}'..='\u{24f}' | '\u{1e00}'..='\u{1eff}' | '\u{ff21}'..='\u{ff5a}');
    letter.is_ascii_alphabetic() || (is_in_block && letter.is_alphabetic())
}

fn is_greek_or_cyrillic(letter: char) -> bool {
    let is_greek = matches!(letter, '\u{370}'..='\u{3ff}' | '\u{1f00}'..='\u{1fff}');
    let is_cyrillic = matches!(
        letter,
        '\u{400}'..='\u{52f}' | '\u{1c80}'..='\u{1c8f}' | '\u{2de0}'..='\u{2dff}' | '\u{a640}'..='\u{a69f}'
    );
    (is_greek || is_cyrillic) && letter.is_alphabetic()
}

/// Returns a form that is equal for names that people confuse: without case and extra spaces, with a single letter for look-alikes.
pub fn look_alike_form(name: &str) -> String {
    let words: Vec<&str> = name.split_whitespace().collect();
    let letters =
        words.join(" ").chars().flat_map(char::to_lowercase).map(latin_look_alike).collect::<String>();
    letters.replace("rn", "m")
}

fn latin_look_alike(letter: char) -> char {
    LOOK_ALIKES.iter().find(|(from, _)| *from == letter).map_or(letter, |(_, to)| *to)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invisible_characters_are_refused() {
        for hidden in [
            '\n',
            '\u{7f}',
            '\u{ad}',
            '\u{200b}',
            '\u{200e}',
            '\u{202e}',
            '\u{2060}',
            '\u{2066}',
            '\u{feff}',
            '\u{e0041}',
        ] {
            assert!(!is_visible(hidden) && !is_visible_text(&format!("a{hidden}"), &(0..=9)), "{hidden:?}");
        }
        for shown in ["Ada's team", "Équipe 7", "Команда", "Ομάδα", "战队", "🦊"] {
            assert!(is_visible_text(shown, &(1..=10)), "{shown}");
        }
        assert!(!is_visible_text("", &(1..=10)) && !is_visible_text("eleven long", &(1..=10)));
    }

    #[test]
    fn only_look_alike_scripts_must_not_mix() {
        for mixed in ["M\u{430}llory", "\u{391}da", "team \u{43e}ne"] {
            assert!(mixes_scripts(mixed), "{mixed}");
        }
        for plain in ["Mallory", "Équipe 7", "Команда 7", "Ομάδα 7", "Team 战队", "7 × 7"] {
            assert!(!mixes_scripts(plain), "{plain}");
        }
    }

    #[test]
    fn confusable_names_have_one_form() {
        let names = [
            ("Mallory", "ma1lory"),
            ("MALLORY", "Ma||ory"),
            ("Bill", "BiIl"),
            ("corner", "comer"),
            ("Team 10", "team  lO"),
            ("\u{421}\u{41e}\u{420}\u{410}", "copa"),
            ("\u{39a}\u{391}\u{3a4}\u{391}", "kata"),
        ];
        for (one, other) in names {
            assert_eq!(look_alike_form(one), look_alike_form(other), "{one} and {other}");
        }
        for (one, other) in [("team 1", "team 2"), ("red", "read"), ("Ada", "Ida")] {
            assert_ne!(look_alike_form(one), look_alike_form(other));
        }
    }
}
