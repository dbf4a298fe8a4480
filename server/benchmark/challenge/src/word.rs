/// A word without a matching enum value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown {kind} '{word}'")]
pub struct UnknownWord {
    /// Enum name, for people: `run state`.
    pub kind: &'static str,
    /// The rejected word.
    pub word: String,
}

/// Implements `ALL`, `as_str`, `from_word`, `Display` and conversions from text for an enum without fields.
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

            /// Parses a word written by [`Self::as_str`].
            ///
            /// # Errors
            /// If the word names no value.
            pub fn from_word(word: &str) -> Result<Self, $crate::UnknownWord> {
                match word {
                    $($word => Ok(Self::$variant),)+
                    other => Err($crate::UnknownWord { kind: $kind, word: other.to_owned() }),
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
                Self::from_word(word)
            }
        }

        // The store decodes text columns by this conversion.
        impl TryFrom<String> for $name {
            type Error = $crate::UnknownWord;

            fn try_from(word: String) -> Result<Self, Self::Error> {
                Self::from_word(&word)
            }
        }
    };
}
pub(crate) use words;

#[cfg(test)]
mod tests {
    use crate::{
        EpisodeState, PhaseState, QuotaWindow, Reference, RunChoice, RunState, TokenScope, Visibility,
    };
    use std::fmt::Debug;

    /// Checks that each word parses back, and that JSON uses the same word where the type is serialised.
    fn round_trip<T: Copy + Debug + PartialEq>(
        all: &[T],
        as_str: fn(T) -> &'static str,
        parse: fn(&str) -> Result<T, crate::UnknownWord>,
    ) {
        for &value in all {
            assert_eq!(parse(as_str(value)), Ok(value));
        }
        let error = parse("nonsense").expect_err("no such word").to_string();
        assert!(error.ends_with("'nonsense'"), "{error}");
    }

    #[test]
    fn words_parse_back() {
        round_trip(EpisodeState::ALL, EpisodeState::as_str, EpisodeState::from_word);
        round_trip(PhaseState::ALL, PhaseState::as_str, PhaseState::from_word);
        round_trip(QuotaWindow::ALL, QuotaWindow::as_str, QuotaWindow::from_word);
        round_trip(Reference::ALL, Reference::as_str, Reference::from_word);
        round_trip(RunChoice::ALL, RunChoice::as_str, RunChoice::from_word);
        round_trip(RunState::ALL, RunState::as_str, RunState::from_word);
        round_trip(TokenScope::ALL, TokenScope::as_str, TokenScope::from_word);
        round_trip(Visibility::ALL, Visibility::as_str, Visibility::from_word);
    }

    #[test]
    fn words_equal_json() {
        for state in RunState::ALL {
            assert_eq!(serde_json::to_value(state).expect("JSON"), state.as_str());
        }
        for visibility in Visibility::ALL {
            assert_eq!(serde_json::to_value(visibility).expect("JSON"), visibility.as_str());
        }
        for reference in Reference::ALL {
            assert_eq!(serde_json::to_value(reference).expect("JSON"), reference.as_str());
        }
    }
}
