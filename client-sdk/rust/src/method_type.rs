//! Method types.

use avln_proto::v1;
use std::{fmt, str::FromStr};

/// A method's type, declared with [`RunOptions::method_type`](crate::RunOptions::method_type).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MethodType {
    /// Without learnt parts.
    TrainingFree,
    /// Learnt perception, such as a network trained on training houses; the decisions are not learnt.
    LearntPerception,
    /// Foundation models: large detectors, encoders or language models trained on other data.
    FoundationModels,
    /// A policy learnt by imitation of demonstrations.
    Imitation,
    /// A policy learnt by reinforcement learning.
    Rl,
}

/// Error for an unknown method type.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "method type '{0}' does not exist; use training-free, learnt-perception, foundation-models, imitation or rl"
)]
pub struct UnknownMethodType(pub String);

impl MethodType {
    /// All types.
    pub const ALL: [Self; 5] =
        [Self::TrainingFree, Self::LearntPerception, Self::FoundationModels, Self::Imitation, Self::Rl];

    /// Returns the name used on the command line and in data: `learnt-perception`.
    pub fn name(self) -> &'static str {
        match self {
            Self::TrainingFree => "training-free",
            Self::LearntPerception => "learnt-perception",
            Self::FoundationModels => "foundation-models",
            Self::Imitation => "imitation",
            Self::Rl => "rl",
        }
    }

    pub(crate) fn to_wire(self) -> v1::MethodType {
        match self {
            Self::TrainingFree => v1::MethodType::TrainingFree,
            Self::LearntPerception => v1::MethodType::LearntPerception,
            Self::FoundationModels => v1::MethodType::FoundationModels,
            Self::Imitation => v1::MethodType::Imitation,
            Self::Rl => v1::MethodType::Rl,
        }
    }

    pub(crate) fn from_wire(declared: v1::MethodType) -> Option<Self> {
        Self::ALL.into_iter().find(|known| known.to_wire() == declared)
    }
}

impl FromStr for MethodType {
    type Err = UnknownMethodType;

    fn from_str(word: &str) -> Result<Self, UnknownMethodType> {
        let found = Self::ALL.into_iter().find(|known| known.name() == word);
        found.ok_or_else(|| UnknownMethodType(word.to_owned()))
    }
}

impl fmt::Display for MethodType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::LearntPerception => "learnt perception",
            Self::FoundationModels => "foundation models",
            Self::Rl => "RL",
            Self::TrainingFree | Self::Imitation => self.name(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_wire_numbers_round_trip() {
        for known in MethodType::ALL {
            assert_eq!(known.name().parse(), Ok(known));
            assert_eq!(MethodType::from_wire(known.to_wire()), Some(known));
        }
        assert_eq!(MethodType::from_wire(v1::MethodType::Unspecified), None);
        let error = "magic".parse::<MethodType>().unwrap_err().to_string();
        for known in MethodType::ALL {
            assert!(error.contains(known.name()), "{error}");
        }
    }
}
