use super::lexicon::Name;
use serde::{Deserialize, Serialize};

/// What a sentence says of its target, apart from the words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claims {
    /// What it is called.
    pub(crate) head: Name,
    /// What is said of it.
    pub(crate) list: Vec<Claim>,
}

/// One thing that is said of a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Claim {
    Size(String),
    Shape(String),
    Color(String),
    Material(String),
    /// The kind of room that it is in.
    Room(String),
    /// Where it is.
    Place(Relation, Vec<Landmark>),
}

/// Where a thing is, as seen from where one can stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Relation {
    /// With something standing or lying on it.
    Holds,
    /// On something.
    On,
    /// Inside the legs of a table.
    Under,
    /// Hanging over something.
    Above,
    /// With something hanging over it.
    Below,
    /// On the left of something on the same wall, for somebody who faces the wall.
    LeftOf,
    /// On the right of something on the same wall, for somebody who faces the wall.
    RightOf,
    /// Between two things.
    Between,
    /// Hardly an arm's length away.
    NextTo,
    /// Within a step.
    Near,
    /// Across the room, wall to wall.
    Opposite,
    /// Where two walls meet.
    Corner,
    /// With its back to a wall.
    AgainstWall,
}

/// A thing that says where another one is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Landmark {
    pub(crate) name: Name,
    pub(crate) color: Option<String>,
    /// Whether its room has no other such thing.
    pub(crate) only: bool,
}
