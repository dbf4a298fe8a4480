//! Domain types for challenges: phases, runs, quotas, visibility, accounts, episode draws.
//!
//! The store, the gRPC server, the web server and the arena share these types. Enums convert to and from the words used in
//! database columns, JSON and URLs: `as_str`, `FromStr`.
//!
//! Start reading at [`Schedule`], [`RunState`] and [`Quota`].
//!
//! This crate never does I/O, reads a clock, or depends on hidden data.

pub mod calendar;
pub mod names;
mod phase;
mod quota;
mod run;
mod sampling;
pub use phase::{
    Account, Admission, PhaseInfo, PhaseState, Reference, RunChoice, Schedule, TokenScope, Visibility,
};
pub use quota::{Quota, QuotaLimits, QuotaWindow, RunGrant, quotas};
pub use run::{
    Charge, EpisodeOutcome, EpisodeState, MethodInfo, MethodType, Ruling, RunState, RunStatus, RunUse,
    TimeAccount,
};
pub use sampling::{
    CommitmentValues, GoalText, PhaseEpisode, PhaseSecret, Sample, Sampling, draw, pool_digest,
};

/// A word without a matching enum value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown {kind} '{word}'")]
pub struct UnknownWord {
    /// Enum name, for people: `run state`.
    pub kind: &'static str,
    /// The rejected word.
    pub word: String,
}

/// Implements `ALL`, `as_str`, `Display` and conversions from text for an enum without fields.
macro_rules! words {
    ($name:ident, $kind:literal, { $($variant:ident => $word:literal),+ $(,)? }) => {
        impl $name {
            /// All values, in declaration order.
            pub const ALL: &[Self] = &[$(Self::$variant),+];

            /// Returns the word used in database columns, files and URLs.
            pub fn as_str(self) -> &'static str {
                match self {
                    $(Self::$variant => $word,)+
                }
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.as_str())
            }
        }

        impl std::str::FromStr for $name {
            type Err = $crate::UnknownWord;

            fn from_str(word: &str) -> Result<Self, Self::Err> {
                match word {
                    $($word => Ok(Self::$variant),)+
                    other => Err($crate::UnknownWord { kind: $kind, word: other.to_owned() }),
                }
            }
        }

        // The store decodes text columns by this conversion.
        impl TryFrom<String> for $name {
            type Error = $crate::UnknownWord;

            fn try_from(word: String) -> Result<Self, Self::Error> {
                word.parse()
            }
        }
    };
}
pub(crate) use words;

#[cfg(test)]
mod tests {
    use super::*;
    use std::{fmt::Debug, str::FromStr};

    fn check_words<T: Copy + Debug + PartialEq + FromStr<Err = UnknownWord>>(
        all: &[T],
        as_str: fn(T) -> &'static str,
    ) {
        for &value in all {
            assert_eq!(as_str(value).parse(), Ok(value));
        }
        let error = "nonsense".parse::<T>().expect_err("no such word").to_string();
        assert!(error.ends_with("'nonsense'"), "{error}");
    }

    #[test]
    fn words_round_trip() {
        check_words(EpisodeState::ALL, EpisodeState::as_str);
        check_words(MethodType::ALL, MethodType::as_str);
        check_words(PhaseState::ALL, PhaseState::as_str);
        check_words(QuotaWindow::ALL, QuotaWindow::as_str);
        check_words(Reference::ALL, Reference::as_str);
        check_words(RunChoice::ALL, RunChoice::as_str);
        check_words(RunState::ALL, RunState::as_str);
        check_words(TokenScope::ALL, TokenScope::as_str);
        check_words(Visibility::ALL, Visibility::as_str);
    }

    #[test]
    fn wire_words_equal_json() {
        for state in RunState::ALL {
            assert_eq!(serde_json::to_value(state).expect("JSON"), state.as_str());
        }
        for visibility in Visibility::ALL {
            assert_eq!(serde_json::to_value(visibility).expect("JSON"), visibility.as_str());
        }
        for method_type in MethodType::ALL {
            assert_eq!(serde_json::to_value(method_type).expect("JSON"), method_type.as_str());
        }
        for reference in Reference::ALL {
            assert_eq!(serde_json::to_value(reference).expect("JSON"), reference.as_str());
        }
    }
}
