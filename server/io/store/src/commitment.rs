//! Commitments: before a phase, the organiser commits to episodes, scorer and secret; afterwards the values
//! are published.

use crate::{
    accounts::{AuditNote, add_notes},
    database::{Store, Transaction},
    error::{Result, StoreError},
    phases::{PublishedSplits, find_phase, has_runs, read_published},
};
use avln_challenge::{CommitmentValues, PhaseSecret, PhaseState, pool_digest};
use serde::Serialize;
use sqlx::{FromRow, types::Json};

/// A phase's commitment.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct Commitment {
    /// BLAKE3 hash over the values, hex.
    pub commitment: String,
    /// Commitment time, milliseconds since 1970-01-01 UTC.
    pub committed_unix_ms: i64,
    /// The values; `None` before they are published.
    pub revealed: Option<CommitmentValues>,
    /// Secret and recipe of a split without a seed, as in `sealed/seed.json`; published with the values.
    #[schema(value_type = Option<Object>)]
    pub seed: Option<serde_json::Value>,
}

#[derive(FromRow)]
struct SecretRow {
    secret: String,
    pool: String,
    scorer: String,
    commitment: String,
    committed_ms: i64,
    revealed_ms: Option<i64>,
    seed: Option<Json<serde_json::Value>>,
}

impl SecretRow {
    fn values(&self) -> CommitmentValues {
        CommitmentValues { pool: self.pool.clone(), scorer: self.scorer.clone(), secret: self.secret.clone() }
    }

    fn into_commitment(self) -> Commitment {
        Commitment {
            revealed: self.revealed_ms.map(|_| self.values()),
            seed: self.seed.map(|seed| seed.0),
            commitment: self.commitment,
            committed_unix_ms: self.committed_ms,
        }
    }
}

impl Store {
    /// Commits a phase to the episodes, to `scorer` and to `secret` (256 random bits as 64 hexadecimal digits). Returns false
    /// if the phase was already committed to the same episodes, or has runs. Fails if the phase is unknown.
    pub async fn commit_phase(
        &self,
        phase: &str,
        secret: &str,
        scorer: &str,
        now_unix_ms: i64,
    ) -> Result<bool> {
        // A malformed secret would surface at the first start of a run only.
        parse(secret)?;
        let mut tx = self.begin().await?;
        let pool = read_pool(&mut tx, phase).await?;
        let before = read_secret(&mut tx, phase).await?;
        let is_current = before.as_ref().is_some_and(|before| before.pool == pool);
        // A secret that has drawn episodes must never change: the draws could not be checked any more.
        if is_current || (before.is_some() && has_runs(&mut tx, phase).await?) {
            return Ok(false);
        }
        let values = CommitmentValues { pool, scorer: scorer.to_owned(), secret: secret.to_owned() };
        let upsert = "INSERT INTO phase_secrets (phase, secret, pool, scorer, commitment, committed_ms) \
             VALUES ($1, $2, $3, $4, $5, $6) ON CONFLICT (phase) DO UPDATE SET secret = excluded.secret, \
             pool = excluded.pool, scorer = excluded.scorer, commitment = excluded.commitment, \
             committed_ms = excluded.committed_ms, revealed_ms = NULL, seed = NULL";
        sqlx::query(upsert)
            .bind(phase)
            .bind(&values.secret)
            .bind(&values.pool)
            .bind(&values.scorer)
            .bind(values.commitment())
            .bind(now_unix_ms)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        Ok(true)
    }

    /// Publishes the values behind a phase's commitment, and the split's `seed` unless another phase still plays the split. Fails
    /// if the phase is unknown, not closed at `now_unix_ms`, still has open runs or was never committed.
    pub async fn reveal_phase(
        &self,
        phase: &str,
        seed: Option<&serde_json::Value>,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<(Commitment, CommitmentValues)> {
        let mut tx = self.begin().await?;
        if !is_closed(&mut tx, phase, now_unix_ms).await? {
            return Err(StoreError::NotClosed(phase.to_owned()));
        }
        // The secret reveals the following episodes to the team with an open run.
        if let Some(until_unix_ms) = last_deadline(&mut tx, phase, now_unix_ms).await? {
            return Err(StoreError::StillPlayed { phase: phase.to_owned(), until_unix_ms });
        }
        let seed = if is_split_played(&mut tx, phase, now_unix_ms).await? { None } else { seed };
        let update = "UPDATE phase_secrets SET revealed_ms = COALESCE(revealed_ms, $2), seed = COALESCE(seed, $3) \
                      WHERE phase = $1 AND (revealed_ms IS NULL OR (seed IS NULL AND $3 IS NOT NULL))";
        let update = sqlx::query(update).bind(phase).bind(now_unix_ms).bind(seed.map(Json));
        let changed = update.execute(&mut *tx).await?;
        if changed.rows_affected() > 0 {
            add_notes(&mut tx, &[note], now_unix_ms).await?;
        }
        let row = read_secret(&mut tx, phase).await?;
        let row = row.ok_or_else(|| StoreError::unknown("commitment of phase", phase))?;
        tx.commit().await?;
        let values = row.values();
        Ok((row.into_commitment(), values))
    }

    /// Returns the digest that agents of a phase see for the split's `digest`; `None` before the phase has a commitment.
    pub async fn agent_digest(&self, phase: &str, digest: &str) -> Result<Option<String>> {
        let mut tx = self.read.begin().await?;
        Ok(read_key(&mut tx, phase).await?.map(|secret| secret.split_digest(digest)))
    }

    /// Returns the splits with a published secret.
    pub async fn published_splits(&self) -> Result<PublishedSplits> {
        let mut tx = self.read.begin().await?;
        read_published(&mut tx).await
    }

    /// Returns a phase's commitment; `None` before it is made.
    pub async fn commitment(&self, phase: &str) -> Result<Option<Commitment>> {
        let mut tx = self.read.begin().await?;
        read_commitment(&mut tx, phase).await
    }
}

async fn is_closed(tx: &mut Transaction<'_>, phase: &str, now_unix_ms: i64) -> Result<bool> {
    Ok(find_phase(tx, phase).await?.schedule.state(now_unix_ms) == PhaseState::Closed)
}

/// Returns true if another phase on the split of `phase` is not closed, or has open runs.
async fn is_split_played(tx: &mut Transaction<'_>, phase: &str, now_unix_ms: i64) -> Result<bool> {
    let select = "SELECT other.id FROM phases p JOIN phases other ON other.split = p.split AND other.id <> p.id \
                  WHERE p.id = $1";
    let others: Vec<String> = sqlx::query_scalar(select).bind(phase).fetch_all(&mut **tx).await?;
    for other in others {
        let is_closed = is_closed(tx, &other, now_unix_ms).await?;
        if !is_closed || last_deadline(tx, &other, now_unix_ms).await?.is_some() {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Returns the latest deadline after `now_unix_ms` among a phase's open runs.
async fn last_deadline(tx: &mut Transaction<'_>, phase: &str, now_unix_ms: i64) -> Result<Option<i64>> {
    let select = "SELECT MAX(deadline_ms) FROM runs \
                  WHERE phase = $1 AND state IN ('created', 'running') AND deadline_ms > $2";
    Ok(sqlx::query_scalar(select).bind(phase).bind(now_unix_ms).fetch_one(&mut **tx).await?)
}

pub(crate) async fn read_commitment(tx: &mut Transaction<'_>, phase: &str) -> Result<Option<Commitment>> {
    Ok(read_secret(tx, phase).await?.map(SecretRow::into_commitment))
}

/// Returns the key for a phase's draws; `None` without commitment.
pub(crate) async fn read_key(tx: &mut Transaction<'_>, phase: &str) -> Result<Option<PhaseSecret>> {
    read_secret(tx, phase).await?.map(|row| parse(&row.secret)).transpose()
}

async fn read_secret(tx: &mut Transaction<'_>, phase: &str) -> Result<Option<SecretRow>> {
    let select = "SELECT secret, pool, scorer, commitment, committed_ms, revealed_ms, seed FROM phase_secrets \
                  WHERE phase = $1";
    Ok(sqlx::query_as(select).bind(phase).fetch_optional(&mut **tx).await?)
}

async fn read_pool(tx: &mut Transaction<'_>, phase: &str) -> Result<String> {
    let select = "SELECT s.digest FROM phases p JOIN splits s ON s.name = p.split WHERE p.id = $1";
    let digest: Option<String> = sqlx::query_scalar(select).bind(phase).fetch_optional(&mut **tx).await?;
    let digest = digest.ok_or_else(|| StoreError::unknown("phase", phase))?;
    let select = "SELECT episode FROM phase_episodes WHERE phase = $1 ORDER BY ordinal";
    let episodes: Vec<String> = sqlx::query_scalar(select).bind(phase).fetch_all(&mut **tx).await?;
    Ok(pool_digest(&digest, episodes.iter().map(String::as_str)))
}

fn parse(secret: &str) -> Result<PhaseSecret> {
    PhaseSecret::from_hex(secret)
        .ok_or_else(|| StoreError::damaged("phase secret", "it is not 64 hexadecimal digits"))
}
