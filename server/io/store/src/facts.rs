//! Stored episode facts: rescoring and pruning.

use crate::{
    audit::{AuditNote, add_notes},
    database::Store,
    error::StoreError,
    packed,
    runs::read_run,
    scores::{INTERVAL_SEED, read_scores},
};
use avln_scoring::{EpisodeScore, Metrics, Summary, summarise};
use avln_truth::{EpisodeTruth, Record};
use serde::Serialize;
use sqlx::{Sqlite, Transaction, types::Json};
use std::collections::BTreeMap;

/// An episode's ground truth and facts: the input for scoring.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// Ground truth.
    pub truth: EpisodeTruth,
    /// Facts.
    pub record: Record,
}

/// An episode with a score.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoredEpisode {
    /// Index in the run, from 0.
    pub ordinal: u32,
    /// Metrics computed when it was played.
    pub metrics: Metrics,
    /// Facts; `None` if they were pruned.
    pub facts: Option<Facts>,
}

/// A run's means by the first scorer and by another one.
#[derive(Clone, Debug, PartialEq)]
pub struct Rescored {
    /// Means by the first scorer; `None` without scored episodes.
    pub before: Option<Summary>,
    /// Means by the other scorer.
    pub after: Option<Summary>,
    /// True if the new scores were stored by this call.
    pub is_new: bool,
}

/// A run's stored means by another scorer than the first.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct Rescore {
    /// Benchmark version.
    pub scorer: String,
    /// Scoring time, milliseconds since 1970-01-01 UTC.
    pub scored_unix_ms: i64,
    /// Means and intervals; `None` without scored episodes.
    pub summary: Option<Summary>,
}

/// Deleted rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pruned {
    /// Episode records.
    pub records: u64,
    /// Truths without a record.
    pub truths: u64,
}

impl Store {
    /// Returns an episode's facts; `None` if it has none.
    ///
    /// # Errors
    /// If the stored bytes are damaged or the database fails.
    pub async fn facts(&self, run: &str, ordinal: u32) -> Result<Option<Facts>, StoreError> {
        let mut tx = self.read.begin().await?;
        read_facts(&mut tx, run, ordinal).await
    }

    /// Returns the scored episodes of a run in playing order.
    ///
    /// # Errors
    /// If stored bytes are damaged or the database fails.
    pub async fn scored_episodes(&self, run: &str) -> Result<Vec<ScoredEpisode>, StoreError> {
        let mut tx = self.read.begin().await?;
        let select =
            "SELECT ordinal, metrics FROM episodes WHERE run = $1 AND metrics IS NOT NULL ORDER BY ordinal";
        let rows: Vec<(u32, Json<Metrics>)> = sqlx::query_as(select).bind(run).fetch_all(&mut *tx).await?;
        let mut episodes = Vec::with_capacity(rows.len());
        for (ordinal, Json(metrics)) in rows {
            let facts = read_facts(&mut tx, run, ordinal).await?;
            episodes.push(ScoredEpisode { ordinal, metrics, facts });
        }
        Ok(episodes)
    }

    /// Compares a run's stored scores with `rescored`: `scorer`'s metrics for all scored episodes, by ordinal. Stores
    /// them if `keep` is set. Stored scores are never changed.
    ///
    /// # Errors
    /// If the run is unknown, `rescored` has other episodes than the scored ones, the same scorer gave different metrics before,
    /// or the database fails.
    pub async fn rescore(
        &self,
        run: &str,
        scorer: &str,
        rescored: &BTreeMap<u32, Metrics>,
        keep: bool,
        now_unix_ms: i64,
    ) -> Result<Rescored, StoreError> {
        let mut tx = self.begin().await?;
        read_run(&mut tx, run).await?;
        let scores = read_scores(&mut tx, run).await?;
        if scores.len() != rescored.len() {
            let counts = format!("{} episodes are scored, {} were rescored", scores.len(), rescored.len());
            return Err(StoreError::damaged("run", counts));
        }
        let before = summarise(&scores, INTERVAL_SEED);
        let scores_after: Vec<EpisodeScore> = scores
            .into_iter()
            .zip(rescored.values())
            .map(|(score, metrics)| EpisodeScore { metrics: metrics.clone(), ..score })
            .collect();
        let after = summarise(&scores_after, INTERVAL_SEED);
        let earlier = read_rescored_metrics(&mut tx, run, scorer).await?;
        let is_new = keep && earlier.is_none();
        // One version must always give the same scores. A difference means that formulas changed without a new version.
        if earlier.is_some_and(|earlier| earlier != *rescored) {
            return Err(StoreError::ScoresDiffer { run: run.to_owned(), scorer: scorer.to_owned() });
        }
        if is_new {
            write_rescore(&mut tx, run, scorer, rescored, after.as_ref(), now_unix_ms).await?;
        }
        tx.commit().await?;
        Ok(Rescored { before, after, is_new })
    }

    /// Returns the runs that ended before `moment_unix_ms`, by id.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn runs_ended_before(&self, moment_unix_ms: i64) -> Result<Vec<String>, StoreError> {
        let select =
            "SELECT id FROM runs WHERE state NOT IN ('created', 'running') AND finished_ms < $1 ORDER BY id";
        Ok(sqlx::query_scalar(select).bind(moment_unix_ms).fetch_all(&self.read).await?)
    }

    /// Counts records that [`Store::prune_records`] would delete.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn old_records(&self, moment_unix_ms: i64) -> Result<u64, StoreError> {
        let select = "SELECT COUNT(*) FROM records WHERE run IN \
                      (SELECT id FROM runs WHERE state NOT IN ('created', 'running') AND finished_ms < $1)";
        let records: i64 = sqlx::query_scalar(select).bind(moment_unix_ms).fetch_one(&self.read).await?;
        Ok(records.unsigned_abs())
    }

    /// Deletes records from runs that ended before `moment_unix_ms`, with an audit line. Scores stay; replays
    /// and rescoring become impossible.
    ///
    /// # Errors
    /// If the database fails.
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
        // Truths are shared between runs, so a truth goes with its last record.
        let unused = "DELETE FROM truths WHERE digest NOT IN (SELECT truth FROM records)";
        let truths = sqlx::query(unused).execute(&mut *tx).await?.rows_affected();
        if records > 0 {
            add_notes(&mut tx, &[note], now_unix_ms).await?;
        }
        tx.commit().await?;
        Ok(Pruned { records, truths })
    }
}

pub(crate) async fn read_facts(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    ordinal: u32,
) -> Result<Option<Facts>, StoreError> {
    let select = "SELECT t.body, r.body FROM records r JOIN truths t ON t.digest = r.truth \
                  WHERE r.run = $1 AND r.ordinal = $2";
    let row: Option<(Vec<u8>, Vec<u8>)> =
        sqlx::query_as(select).bind(run).bind(ordinal).fetch_optional(&mut **tx).await?;
    let Some((truth, record)) = row else { return Ok(None) };
    let truth = serde_json::from_slice(&truth).map_err(|error| StoreError::damaged("truth", error))?;
    Ok(Some(Facts { truth, record: packed::unpack(&record)? }))
}

/// Returns a run's metrics by another scorer; `None` if that scorer never scored it.
async fn read_rescored_metrics(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    scorer: &str,
) -> Result<Option<BTreeMap<u32, Metrics>>, StoreError> {
    let select = "SELECT 1 FROM rescores WHERE run = $1 AND scorer = $2";
    let found: Option<i64> =
        sqlx::query_scalar(select).bind(run).bind(scorer).fetch_optional(&mut **tx).await?;
    if found.is_none() {
        return Ok(None);
    }
    let select = "SELECT ordinal, metrics FROM rescored_episodes WHERE run = $1 AND scorer = $2";
    let rows: Vec<(u32, Json<Metrics>)> =
        sqlx::query_as(select).bind(run).bind(scorer).fetch_all(&mut **tx).await?;
    Ok(Some(rows.into_iter().map(|(ordinal, Json(metrics))| (ordinal, metrics)).collect()))
}

async fn write_rescore(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    scorer: &str,
    rescored: &BTreeMap<u32, Metrics>,
    summary: Option<&Summary>,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let insert = "INSERT INTO rescores (run, scorer, scored_ms, summary) VALUES ($1, $2, $3, $4)";
    let row = sqlx::query(insert).bind(run).bind(scorer).bind(now_unix_ms);
    row.bind(summary.map(Json)).execute(&mut **tx).await?;
    let insert = "INSERT INTO rescored_episodes (run, scorer, ordinal, metrics) VALUES ($1, $2, $3, $4)";
    for (ordinal, metrics) in rescored {
        let row = sqlx::query(insert).bind(run).bind(scorer).bind(*ordinal);
        row.bind(Json(metrics)).execute(&mut **tx).await?;
    }
    Ok(())
}

/// Returns a run's stored means by other scorers, oldest first.
pub(crate) async fn read_rescores(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
) -> Result<Vec<Rescore>, StoreError> {
    let select = "SELECT scorer, scored_ms, summary FROM rescores WHERE run = $1 ORDER BY scored_ms, scorer";
    let rows: Vec<(String, i64, Option<Json<Summary>>)> =
        sqlx::query_as(select).bind(run).fetch_all(&mut **tx).await?;
    let rescore = |(scorer, scored_unix_ms, summary): (_, _, Option<Json<Summary>>)| Rescore {
        scorer,
        scored_unix_ms,
        summary: summary.map(|Json(summary)| summary),
    };
    Ok(rows.into_iter().map(rescore).collect())
}
