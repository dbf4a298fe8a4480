//! Words and JSON in columns.

use crate::StoreError;
use avln_episode::{EndReason, Order};
use serde::{Serialize, de::DeserializeOwned};

/// A struct that is read from the columns with the names of its fields.
macro_rules! row {
    ($(#[$attribute:meta])* $vis:vis struct $name:ident {
        $($(#[$field_attribute:meta])* $field_vis:vis $field:ident: $type:ty),+ $(,)?
    }) => {
        $(#[$attribute])*
        $vis struct $name {
            $($(#[$field_attribute])* $field_vis $field: $type,)+
        }

        impl sqlx::FromRow<'_, sqlx::sqlite::SqliteRow> for $name {
            fn from_row(row: &sqlx::sqlite::SqliteRow) -> Result<Self, sqlx::Error> {
                Ok(Self { $($field: sqlx::Row::try_get(row, stringify!($field))?,)+ })
            }
        }
    };
}
pub(crate) use row;

pub(crate) fn order(word: &str) -> Result<Order, StoreError> {
    word.parse().map_err(|error| StoreError::damaged("order", error))
}

pub(crate) fn end_reason(word: &str) -> Result<EndReason, StoreError> {
    let found = EndReason::ALL.into_iter().find(|reason| reason.as_str() == word);
    found.ok_or_else(|| StoreError::damaged("end reason", format!("unknown word '{word}'")))
}

pub(crate) fn to_json<T: Serialize>(what: &'static str, value: &T) -> Result<String, StoreError> {
    serde_json::to_string(value).map_err(|error| StoreError::damaged(what, error))
}

pub(crate) fn from_json<T: DeserializeOwned>(what: &'static str, text: &str) -> Result<T, StoreError> {
    serde_json::from_str(text).map_err(|error| StoreError::damaged(what, error))
}

/// A count from a column; SQLite's integers are signed.
pub(crate) fn count(value: i64) -> u32 {
    u32::try_from(value).unwrap_or(if value < 0 { 0 } else { u32::MAX })
}
