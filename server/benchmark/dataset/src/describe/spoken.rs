//! Whether a sentence says all that it claims.

use super::{
    claim::{Claim, Claims, Landmark, Relation},
    lexicon,
};

/// The first word that `claims` need and `text` lacks.
pub(crate) fn unsaid(text: &str, claims: &Claims) -> Option<String> {
    let text = text.to_lowercase();
    let said = |word: &String| text.contains(word) || text.contains(&lexicon::plural(word));
    let head = std::iter::once(claims.head.noun.clone());
    let words = head.chain(claims.list.iter().flat_map(words)).map(|word| word.to_lowercase());
    words.into_iter().find(|word| !said(word))
}

/// The words without which a claim is not made.
fn words(claim: &Claim) -> Vec<String> {
    match claim {
        Claim::Color(word) | Claim::Shape(word) | Claim::Size(word) => vec![word.clone()],
        // `wool` is in `woollen`, `wood` in `wooden`: said as adjective or as what it is made of.
        Claim::Material(word) => vec![lexicon::substance(word).unwrap_or(word).to_owned()],
        Claim::Room(noun) => vec![noun.clone()],
        Claim::Place(relation, landmarks) => {
            let side = side(*relation).map(str::to_owned);
            landmarks.iter().flat_map(named).cloned().chain(side).collect()
        }
    }
}

fn named(landmark: &Landmark) -> impl Iterator<Item = &String> {
    landmark.color.iter().chain([&landmark.name.noun])
}

fn side(relation: Relation) -> Option<&'static str> {
    match relation {
        Relation::LeftOf => Some("to the left of"),
        Relation::RightOf => Some("to the right of"),
        Relation::Between => Some("between"),
        Relation::Corner => Some("corner"),
        Relation::AgainstWall => Some("wall"),
        _ => None,
    }
}
