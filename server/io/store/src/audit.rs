//! The audit list: what was changed, by whom and why. Rows are added and nothing else; the database refuses the rest.

use crate::{Store, StoreError, words::row};
use serde::Serialize;
use sqlx::{Sqlite, Transaction};

/// A change to be noted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AuditNote {
    /// Who changed it.
    pub actor: String,
    /// Of what: `phase practice`, `team red`.
    pub subject: String,
    /// The setting or the deed: `quota.day`, `paused`, `granted`.
    pub what: String,
    /// What it was; `None` for nothing.
    pub before: Option<String>,
    /// What it is; `None` for nothing.
    pub after: Option<String>,
    /// Why; may be empty.
    pub reason: String,
}

row! {
    /// A line of the audit list.
    #[derive(Clone, Debug, PartialEq, Eq, Serialize)]
    pub struct AuditLine {
        /// Counts up.
        pub id: i64,
        /// When, milliseconds since 1970-01-01 UTC.
        pub at_ms: i64,
        /// Who.
        pub actor: String,
        /// Of what.
        pub subject: String,
        /// The setting or the deed.
        pub what: String,
        /// What it was; `None` for nothing.
        pub before: Option<String>,
        /// What it is; `None` for nothing.
        pub after: Option<String>,
        /// Why; may be empty.
        pub reason: String,
    }
}

impl Store {
    /// The audit list, the oldest line first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn audit(&self) -> Result<Vec<AuditLine>, StoreError> {
        let select = "SELECT id, at_ms, actor, subject, what, before, after, reason FROM audit ORDER BY id";
        Ok(sqlx::query_as(select).fetch_all(&self.read).await?)
    }

    /// Adds a line to the audit list.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn note(&self, note: AuditNote, now_unix_ms: i64) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        add_notes(&mut tx, &[note], now_unix_ms).await?;
        Ok(tx.commit().await?)
    }

    /// Number of the newest line of the audit list, 0 for none: it tells whether the organiser changed anything.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn newest_change(&self) -> Result<i64, StoreError> {
        Ok(sqlx::query_scalar("SELECT COALESCE(MAX(id), 0) FROM audit").fetch_one(&self.read).await?)
    }
}

pub(crate) async fn add_notes(
    tx: &mut Transaction<'_, Sqlite>,
    notes: &[AuditNote],
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let insert = "INSERT INTO audit (at_ms, actor, subject, what, before, after, reason) \
                  VALUES ($1, $2, $3, $4, $5, $6, $7)";
    for note in notes {
        sqlx::query(insert)
            .bind(now_unix_ms)
            .bind(&note.actor)
            .bind(&note.subject)
            .bind(&note.what)
            .bind(&note.before)
            .bind(&note.after)
            .bind(&note.reason)
            .execute(&mut **tx)
            .await?;
    }
    Ok(())
}
