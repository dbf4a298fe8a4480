//! What need not be kept for ever: facts of old episodes. Results stay.

use crate::{AuditNote, Store, StoreError, audit::add_notes};

/// What was forgotten.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pruned {
    /// Records of episodes.
    pub records: u64,
    /// Truths that no record needs any more.
    pub truths: u64,
}

impl Store {
    /// The runs that ended before `moment_unix_ms`.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn runs_ended_before(&self, moment_unix_ms: i64) -> Result<Vec<String>, StoreError> {
        let select =
            "SELECT id FROM runs WHERE state NOT IN ('created', 'running') AND finished_ms < $1 ORDER BY id";
        Ok(sqlx::query_scalar(select).bind(moment_unix_ms).fetch_all(&self.read).await?)
    }

    /// How many records of episodes the runs that ended before `moment_unix_ms` have.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn old_records(&self, moment_unix_ms: i64) -> Result<u64, StoreError> {
        let select = "SELECT COUNT(*) FROM records WHERE run IN \
                      (SELECT id FROM runs WHERE state NOT IN ('created', 'running') AND finished_ms < $1)";
        let records: i64 = sqlx::query_scalar(select).bind(moment_unix_ms).fetch_one(&self.read).await?;
        Ok(records.unsigned_abs())
    }

    /// Forgets the records of runs that ended before `moment_unix_ms`, with a note in the audit list. Their replays can be
    /// shown and their scores computed again no more; scores stay.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn prune_records(
        &self,
        moment_unix_ms: i64,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<Pruned, StoreError> {
        let mut tx = self.begin().await?;
        let old = "DELETE FROM records WHERE run IN \
                   (SELECT id FROM runs WHERE state NOT IN ('created', 'running') AND finished_ms < $1)";
        let records = sqlx::query(old).bind(moment_unix_ms).execute(&mut *tx).await?.rows_affected();
        let unused = "DELETE FROM truths WHERE digest NOT IN (SELECT truth FROM records)";
        let truths = sqlx::query(unused).execute(&mut *tx).await?.rows_affected();
        if records > 0 {
            add_notes(&mut tx, &[note], now_unix_ms).await?;
        }
        tx.commit().await?;
        Ok(Pruned { records, truths })
    }
}
