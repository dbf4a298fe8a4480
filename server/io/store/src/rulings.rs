//! What the organiser ruled on runs: that they are verified, or on no board. What they are worth stays as it was.

use crate::{
    AuditNote, Store, StoreError,
    audit::add_notes,
    runs::{Run, read_run},
};
use avln_challenge::Ruling;
use sqlx::{Sqlite, Transaction};

impl Store {
    /// Marks a run as verified by the organiser, or no more; whether that changed anything.
    ///
    /// # Errors
    /// When the run is unknown or not over, or the database fails.
    pub async fn verify_run(
        &self,
        run: &str,
        verified: bool,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let Run { state, ruling, .. } = read_run(&mut tx, run).await?;
        if verified && state.is_open() {
            return Err(StoreError::RunOpen(run.to_owned()));
        }
        let after = Ruling { verified, ..ruling.clone() };
        rule(tx, run, [&ruling, &after], note, now_unix_ms).await
    }

    /// Takes a run off all boards for a reason that everybody may read, or puts it back with `None`; whether that changed
    /// anything.
    ///
    /// # Errors
    /// When the run is unknown or the database fails.
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
        rule(tx, run, [&before, &after], note, now_unix_ms).await
    }
}

/// Writes what a ruling has become, with its note, unless it stays as it was.
async fn rule(
    mut tx: Transaction<'_, Sqlite>,
    run: &str,
    [before, after]: [&Ruling; 2],
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
