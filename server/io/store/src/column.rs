//! Conversions between column values and domain types.

use avln_challenge::{EpisodeState, Reference, RunState, TokenScope, UnknownWord, Visibility};
use avln_episode::{EndReason, Order};
use sqlx::{
    Database, Decode, Sqlite, Type,
    error::BoxDynError,
    sqlite::{SqliteTypeInfo, SqliteValueRef},
};

/// A text column with an enum's word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Word<T>(pub(crate) T);

/// An enum with words for database columns.
pub(crate) trait FromWord: Sized {
    fn from_word(word: &str) -> Result<Self, UnknownWord>;
}

/// Implements [`FromWord`] by the inherent method.
macro_rules! from_word {
    ($($name:ident),+) => {
        $(impl FromWord for $name {
            fn from_word(word: &str) -> Result<Self, UnknownWord> {
                $name::from_word(word)
            }
        })+
    };
}
from_word!(EpisodeState, Reference, RunState, TokenScope, Visibility);

impl FromWord for Order {
    fn from_word(word: &str) -> Result<Self, UnknownWord> {
        word.parse().map_err(|_| UnknownWord { kind: "order", word: word.to_owned() })
    }
}

impl FromWord for EndReason {
    fn from_word(word: &str) -> Result<Self, UnknownWord> {
        let found = Self::ALL.into_iter().find(|reason| reason.as_str() == word);
        found.ok_or_else(|| UnknownWord { kind: "end reason", word: word.to_owned() })
    }
}

impl<T> Type<Sqlite> for Word<T> {
    fn type_info() -> SqliteTypeInfo {
        <str as Type<Sqlite>>::type_info()
    }

    fn compatible(column: &<Sqlite as Database>::TypeInfo) -> bool {
        <str as Type<Sqlite>>::compatible(column)
    }
}

impl<'r, T: FromWord> Decode<'r, Sqlite> for Word<T> {
    fn decode(value: SqliteValueRef<'r>) -> Result<Self, BoxDynError> {
        // An unknown word comes from a newer program or a damaged file: the whole row is rejected.
        let word = <&str as Decode<Sqlite>>::decode(value)?;
        Ok(Self(T::from_word(word)?))
    }
}

/// Unwraps an optional word.
pub(crate) fn value<T>(word: Option<Word<T>>) -> Option<T> {
    word.map(|word| word.0)
}
