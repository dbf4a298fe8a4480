//! Missions, goal cues and actions.

use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// Information for the agent at episode start.
#[derive(Clone, Debug, PartialEq)]
pub struct Mission {
    /// Goal order.
    pub order: Order,
    /// Goals, 2 to 4, identified by index.
    pub goals: Vec<GoalCue>,
}

/// Goal order in a mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// Goals in mission order only.
    Ordered,
    /// Goals in any order.
    Unordered,
}

/// Goal cue kind.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, utoipa::ToSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum Modality {
    /// Category label.
    Category,
    /// Sentence.
    Description,
    /// The target's picture.
    Image,
}

/// Goal cue for the agent.
#[derive(Clone, Debug, PartialEq)]
pub enum GoalCue {
    /// The target's category label.
    Category(String),
    /// Sentence that fits only the target.
    Description(String),
    /// The target's picture.
    Image(RgbImage),
}

/// A picture: `height × width × 3` bytes, row-major from the top-left pixel, RGB.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pixel bytes.
    pub pixels: Vec<u8>,
}

/// Unknown goal order.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("order '{0}' does not exist; use ordered or unordered")]
pub struct UnknownOrder(pub String);

impl GoalCue {
    /// Returns the cue kind.
    pub fn modality(&self) -> Modality {
        match self {
            Self::Category(_) => Modality::Category,
            Self::Description(_) => Modality::Description,
            Self::Image(_) => Modality::Image,
        }
    }
}

impl Order {
    /// Returns the name in files and URLs.
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
    /// Returns the name in files and URLs.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Category => "category",
            Self::Description => "description",
            Self::Image => "image",
        }
    }
}

/// Agent action. All five kinds count as steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Action {
    /// Walk forward, sliding along walls.
    MoveForward,
    /// Turn left on the spot.
    TurnLeft,
    /// Turn right on the spot.
    TurnRight,
    /// Claim a target here.
    Submit,
    /// Claim the last target and end the episode.
    Stop,
}

/// An action number outside 0 to 4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("action {0} does not exist; use 0 MoveForward, 1 TurnLeft, 2 TurnRight, 3 Submit or 4 Stop")]
pub struct UnknownAction(pub i64);

impl Action {
    /// All actions in numeric order.
    // Run logs and stored records contain these numbers, so the order never changes.
    pub const ALL: [Self; 5] = [Self::MoveForward, Self::TurnLeft, Self::TurnRight, Self::Submit, Self::Stop];

    /// Returns the action number for logs and action spaces, 0 to 4.
    pub fn index(self) -> u8 {
        self as u8
    }
}

impl TryFrom<u32> for Action {
    type Error = UnknownAction;

    fn try_from(index: u32) -> Result<Self, UnknownAction> {
        Self::try_from(i64::from(index))
    }
}

impl TryFrom<i64> for Action {
    type Error = UnknownAction;

    fn try_from(index: i64) -> Result<Self, UnknownAction> {
        let known = Self::ALL.into_iter().find(|action| i64::from(action.index()) == index);
        known.ok_or(UnknownAction(index))
    }
}

impl fmt::Display for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn action_numbers_round_trip() {
        for action in Action::ALL {
            assert_eq!(Action::try_from(u32::from(action.index())), Ok(action));
        }
        assert_eq!(Action::try_from(5_u32), Err(UnknownAction(5)));
        assert_eq!(Action::try_from(-1_i64), Err(UnknownAction(-1)));
    }
}
