//! The audit list and the organiser's rulings on runs. Triggers of the database reject changes of audit lines.

use crate::{database::Store, error::StoreError, runs::read_run};
use avln_challenge::Ruling;
use serde::Serialize;
use sqlx::{FromRow, Sqlite, Transaction};

/// A change to be recorded in the audit list.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AuditNote {
    /// Author of the change.
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

/// A line of the audit list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, FromRow)]
pub struct AuditLine {
    /// Ascending number.
    pub id: i64,
    /// Time, milliseconds since 1970-01-01 UTC.
    pub at_ms: i64,
    /// Author of the change.
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
    ///
    /// # Errors
    /// If the database fails.
    pub async fn audit(&self) -> Result<Vec<AuditLine>, StoreError> {
        let select = "SELECT id, at_ms, actor, subject, what, before, after, reason FROM audit ORDER BY id";
        Ok(sqlx::query_as(select).fetch_all(&self.read).await?)
    }

    /// Adds a line to the audit list.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn add_audit_note(&self, note: AuditNote, now_unix_ms: i64) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        add_notes(&mut tx, &[note], now_unix_ms).await?;
        Ok(tx.commit().await?)
    }

    /// Returns the id of the newest audit line, 0 for an empty list. It grows with every change by an organiser.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn newest_audit_id(&self) -> Result<i64, StoreError> {
        Ok(sqlx::query_scalar("SELECT COALESCE(MAX(id), 0) FROM audit").fetch_one(&self.read).await?)
    }

    /// Marks a run as verified by the organiser, or removes the mark. Returns whether the ruling changed.
    ///
    /// # Errors
    /// If the run is unknown or not over, or the database fails.
    pub async fn verify_run(
        &self,
        run: &str,
        verified: bool,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let found = read_run(&mut tx, run).await?;
        if verified && found.state.is_open() {
            return Err(StoreError::RunOpen(run.to_owned()));
        }
        let after = Ruling { verified, ..found.ruling.clone() };
        write_ruling(tx, run, &found.ruling, &after, note, now_unix_ms).await
    }

    /// Removes a run from all leaderboards for a public reason, or readmits it with `None`. Returns whether the ruling
    /// changed.
    ///
    /// # Errors
    /// If the run is unknown or the database fails.
    pub async fn disqualify_run(
        &self,
        run: &str,
        reason: Option<&str>,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let before = read_run(&mut tx, run).await?.ruling;
        let after = Ruling { disqualified: reason.map(str::to_owned), ..before.clone() };
        write_ruling(tx, run, &before, &after, note, now_unix_ms).await
    }
}

/// Writes a changed ruling with its audit note and commits.
async fn write_ruling(
    mut tx: Transaction<'_, Sqlite>,
    run: &str,
    before: &Ruling,
    after: &Ruling,
    note: AuditNote,
    now_unix_ms: i64,
) -> Result<bool, StoreError> {
    if before == after {
        return Ok(false);
    }
    let upsert = "INSERT INTO rulings (run, verified, disqualified, ruled_ms) VALUES ($1, $2, $3, $4) \
                  ON CONFLICT (run) DO UPDATE SET verified = excluded.verified, \
                  disqualified = excluded.disqualified, ruled_ms = excluded.ruled_ms";
    let upsert = sqlx::query(upsert).bind(run).bind(after.verified).bind(&after.disqualified);
    upsert.bind(now_unix_ms).execute(&mut *tx).await?;
    add_notes(&mut tx, &[note], now_unix_ms).await?;
    tx.commit().await?;
    Ok(true)
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
