//! What node names say: `KitchenTable_01_002` is a kitchen table.

use avln_scene::categories::mpcat40;

/// The mpcat40 category that a node's name says, numbers and a letter of the variant at its end aside.
pub(crate) fn category(name: &str) -> Option<&'static str> {
    let phrase = phrase(name);
    if phrase.is_empty() {
        return None;
    }
    mpcat40(&phrase).or_else(|| {
        let (rest, variant) = phrase.rsplit_once(' ')?;
        if variant.chars().count() == 1 { mpcat40(rest) } else { None }
    })
}

/// The name without its last number, where that numbers the pieces of one instance: `Bed_01_001_2` is a piece of
/// `Bed_01_001`, as exporters write it that save one node per material. `chair_2` is no piece.
pub(super) fn whole_of_piece(name: &str) -> Option<&str> {
    let whole = without_number(name)?;
    without_number(whole).map(|_| whole)
}

fn without_number(name: &str) -> Option<&str> {
    let (rest, number) = name.rsplit_once(['_', '.'])?;
    let is_number = !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit());
    is_number.then_some(rest)
}

/// `KitchenTable_01.002` as `kitchen table`, `TVCabinet` as `tv cabinet`.
fn phrase(name: &str) -> String {
    let trimmed = name.trim_end_matches(|letter: char| letter.is_ascii_digit() || "_-. ".contains(letter));
    let letters: Vec<char> = trimmed.chars().collect();
    let mut phrase = String::new();
    for (index, &letter) in letters.iter().enumerate() {
        let before = index.checked_sub(1).map_or(' ', |before| letters[before]);
        let is_followed_by_small = letters.get(index + 1).is_some_and(|next| next.is_lowercase());
        let ends_acronym = before.is_uppercase() && is_followed_by_small;
        if letter.is_uppercase() && (before.is_lowercase() || before.is_ascii_digit() || ends_acronym) {
            phrase.push(' ');
        }
        let shown = if "_-.".contains(letter) { ' ' } else { letter };
        phrase.extend(shown.to_lowercase());
    }
    phrase.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_common_exporters_say_their_category() {
        for (name, expected) in [
            ("chair_3", Some("chair")),
            ("KitchenTable_01_001_26", Some("table")),
            ("SofaC_01_001_89", Some("sofa")),
            ("bed.002", Some("bed")),
            ("TVCabinet_01_001", Some("cabinet")),
            ("TV_01_001", Some("tv_monitor")),
            ("CookingBench_01_001_3", Some("counter")),
            ("AirconditionerA_01_001", Some("appliances")),
            ("HouseWallB_01_001_36", Some("wall")),
            ("mesh2057757694", None),
            ("", None),
            ("_01", None),
        ] {
            assert_eq!(category(name), expected, "{name}");
        }
    }

    #[test]
    fn only_doubly_numbered_names_are_pieces() {
        assert_eq!(whole_of_piece("Bed_01_001_2"), Some("Bed_01_001"));
        assert_eq!(whole_of_piece("PortraitA_01_44"), Some("PortraitA_01"));
        assert_eq!(whole_of_piece("chair_2"), None);
        assert_eq!(whole_of_piece("chair"), None);
    }
}
