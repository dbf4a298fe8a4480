use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Everything that an agent is told at the start of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Mission {
    /// Whether the goals must be completed in the order given.
    pub order: Order,
    /// The goals, 2 to 4; the index of a goal is its place here.
    pub goals: Vec<GoalCue>,
}

/// Whether goals have an order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// Goals count in the order of the mission only.
    Ordered,
    /// Goals count in any order.
    Unordered,
}

/// How a goal is described to the agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Modality {
    /// By the label of its category.
    Category,
    /// By a sentence.
    Description,
    /// By a picture of the target.
    Image,
}

/// One goal as the agent sees it.
#[derive(Clone, Debug, PartialEq)]
pub enum GoalCue {
    /// The label of the target's category.
    Category(String),
    /// A sentence that fits the target alone.
    Description(String),
    /// A picture of the target.
    Image(RgbImage),
}

/// A picture: `height × width × 3` bytes, row-major from the top-left pixel, RGB.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The bytes.
    pub pixels: Vec<u8>,
}

/// A word that names no order.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("order '{0}' does not exist; use ordered or unordered")]
pub struct UnknownOrder(pub String);

impl GoalCue {
    /// Which kind of cue this is.
    pub fn modality(&self) -> Modality {
        match self {
            Self::Category(_) => Modality::Category,
            Self::Description(_) => Modality::Description,
            Self::Image(_) => Modality::Image,
        }
    }
}

impl Order {
    /// The word used in files and URLs.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ordered => "ordered",
            Self::Unordered => "unordered",
        }
    }
}

impl FromStr for Order {
    type Err = UnknownOrder;

    fn from_str(word: &str) -> Result<Self, UnknownOrder> {
        match word {
            "ordered" => Ok(Self::Ordered),
            "unordered" => Ok(Self::Unordered),
            other => Err(UnknownOrder(other.to_owned())),
        }
    }
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl Modality {
    /// The word used in files and URLs.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Category => "category",
            Self::Description => "description",
            Self::Image => "image",
        }
    }
}
