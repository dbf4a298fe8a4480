//! The audit list: lines are only added. Database triggers reject updates and deletions.

use crate::{
    database::{Store, Transaction},
    error::Result,
};
use serde::Serialize;
use sqlx::FromRow;

/// A change to be recorded in the audit list.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AuditNote {
    /// Author.
    pub actor: String,
    /// Changed object: `phase practice`, `team red`.
    pub subject: String,
    /// Setting or action: `quota.day`, `paused`, `granted`.
    pub what: String,
    /// Value before the change; `None` for no value.
    pub before: Option<String>,
    /// Value after the change; `None` for no value.
    pub after: Option<String>,
    /// Reason; may be empty.
    pub reason: String,
}

/// An audit line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, FromRow)]
pub struct AuditLine {
    /// Ascending number.
    pub id: i64,
    /// Time, milliseconds since 1970-01-01 UTC.
    pub at_ms: i64,
    /// Author.
    pub actor: String,
    /// Changed object.
    pub subject: String,
    /// Setting or action.
    pub what: String,
    /// Value before the change; `None` for no value.
    pub before: Option<String>,
    /// Value after the change; `None` for no value.
    pub after: Option<String>,
    /// Reason; may be empty.
    pub reason: String,
}

impl Store {
    /// Returns the audit list, oldest line first.
    pub async fn audit(&self) -> Result<Vec<AuditLine>> {
        let select = "SELECT id, at_ms, actor, subject, what, before, after, reason FROM audit ORDER BY id";
        Ok(sqlx::query_as(select).fetch_all(&self.read).await?)
    }

    /// Adds a line to the audit list.
    pub async fn add_audit_note(&self, note: AuditNote, now_unix_ms: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        add_notes(&mut tx, &[note], now_unix_ms).await?;
        Ok(tx.commit().await?)
    }

    /// Returns the newest audit line's id, 0 for an empty list. It grows with every change by an organiser.
    pub async fn newest_audit_id(&self) -> Result<i64> {
        Ok(sqlx::query_scalar("SELECT COALESCE(MAX(id), 0) FROM audit").fetch_one(&self.read).await?)
    }
}

pub(crate) async fn add_notes(tx: &mut Transaction<'_>, notes: &[AuditNote], now_unix_ms: i64) -> Result<()> {
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
