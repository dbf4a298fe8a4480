use serde::{Deserialize, Serialize};
use std::fmt;

/// What an agent can do in one step. Every action counts as one of the episode's steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Action {
    /// Walk forward, sliding along walls.
    MoveForward,
    /// Turn left on the spot.
    TurnLeft,
    /// Turn right on the spot.
    TurnRight,
    /// Claim that a target is here.
    Submit,
    /// Claim the last target and end the episode.
    Stop,
}

/// An action number outside of 0 to 4.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("action {0} does not exist; use 0 MoveForward, 1 TurnLeft, 2 TurnRight, 3 Submit or 4 Stop")]
pub struct UnknownAction(pub u32);

impl Action {
    /// All actions, in the order of their numbers.
    pub const ALL: [Self; 5] = [Self::MoveForward, Self::TurnLeft, Self::TurnRight, Self::Submit, Self::Stop];

    /// The number of the action in logs and action spaces, 0 to 4.
    pub fn index(self) -> u8 {
        self as u8
    }
}

impl TryFrom<u32> for Action {
    type Error = UnknownAction;

    fn try_from(index: u32) -> Result<Self, UnknownAction> {
        Self::ALL.get(index as usize).copied().ok_or(UnknownAction(index))
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
    fn numbers_go_there_and_back() {
        for action in Action::ALL {
            assert_eq!(Action::try_from(u32::from(action.index())), Ok(action));
        }
        assert_eq!(Action::try_from(5), Err(UnknownAction(5)));
    }
}
