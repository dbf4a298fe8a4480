//! Runs that were scored again: what they were worth by each scorer, side by side.

use crate::{
    Facts, Store, StoreError,
    facts::read_facts,
    runs::read_run,
    totals::{INTERVAL_SEED, full_scores},
    words::{from_json, to_json},
};
use avln_scoring::{EpisodeScore, Metrics, Summary, summarise};
use serde::Serialize;
use sqlx::{Sqlite, Transaction};
use std::collections::BTreeMap;

/// An episode that counts.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoredEpisode {
    /// Its place in the run.
    pub ordinal: u32,
    /// What it was worth when it was played.
    pub metrics: Metrics,
    /// All that scoring it again needs; `None` when that was pruned.
    pub facts: Option<Facts>,
}

/// What a run was worth when it was played, and by another scorer.
#[derive(Clone, Debug, PartialEq)]
pub struct Rescored {
    /// When it was played; `None` when no episode counts.
    pub before: Option<Summary>,
    /// By the other scorer.
    pub after: Option<Summary>,
    /// Whether the other scores were stored now; they may have been before.
    pub is_new: bool,
}

/// A run by another scorer than the one that scored it first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rescore {
    /// Version of the benchmark that scored it.
    pub scorer: String,
    /// When, milliseconds since 1970-01-01 UTC.
    pub scored_unix_ms: i64,
    /// Means and intervals; `None` when no episode counts.
    pub summary: Option<Summary>,
}

impl Store {
    /// The episodes of a run that count, in playing order.
    ///
    /// # Errors
    /// When stored bytes are damaged or the database fails.
    pub async fn scored_episodes(&self, run: &str) -> Result<Vec<ScoredEpisode>, StoreError> {
        let mut tx = self.read.begin().await?;
        let select =
            "SELECT ordinal, metrics FROM episodes WHERE run = $1 AND metrics IS NOT NULL ORDER BY ordinal";
        let rows: Vec<(u32, String)> = sqlx::query_as(select).bind(run).fetch_all(&mut *tx).await?;
        let mut episodes = Vec::with_capacity(rows.len());
        for (ordinal, metrics) in rows {
            let facts = read_facts(&mut tx, run, ordinal).await?;
            episodes.push(ScoredEpisode { ordinal, metrics: from_json("metrics", &metrics)?, facts });
        }
        Ok(episodes)
    }

    /// Compares what a run was worth with `again`, which is what `scorer` says of its episodes by place, and keeps both where
    /// `keep` says so. What was stored before is never changed.
    ///
    /// # Errors
    /// When the run is unknown, `again` has other episodes than those that count, the same scorer said something else before,
    /// or the database fails.
    pub async fn rescore(
        &self,
        run: &str,
        scorer: &str,
        again: &BTreeMap<u32, Metrics>,
        keep: bool,
        now_unix_ms: i64,
    ) -> Result<Rescored, StoreError> {
        let mut tx = self.begin().await?;
        read_run(&mut tx, run).await?;
        let scores = full_scores(&mut tx, run).await?;
        if scores.len() != again.len() {
            return Err(StoreError::damaged(
                "run",
                format!("{} episodes count, {} were scored again", scores.len(), again.len()),
            ));
        }
        let before = summarise(&scores, INTERVAL_SEED);
        let other =
            |(score, metrics): (EpisodeScore, &Metrics)| EpisodeScore { metrics: metrics.clone(), ..score };
        let scores: Vec<_> = scores.into_iter().zip(again.values()).map(other).collect();
        let after = summarise(&scores, INTERVAL_SEED);
        let earlier = read_episodes(&mut tx, run, scorer).await?;
        let is_new = keep && earlier.is_none();
        match earlier {
            Some(earlier) if earlier != *again => {
                return Err(StoreError::ScoresDiffer { run: run.to_owned(), scorer: scorer.to_owned() });
            }
            None if keep => write(&mut tx, (run, scorer), again, after.as_ref(), now_unix_ms).await?,
            _ => {}
        }
        tx.commit().await?;
        Ok(Rescored { before, after, is_new })
    }
}

async fn read_episodes(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    scorer: &str,
) -> Result<Option<BTreeMap<u32, Metrics>>, StoreError> {
    let known = "SELECT 1 FROM rescores WHERE run = $1 AND scorer = $2";
    let known: Option<i64> =
        sqlx::query_scalar(known).bind(run).bind(scorer).fetch_optional(&mut **tx).await?;
    if known.is_none() {
        return Ok(None);
    }
    let select = "SELECT ordinal, metrics FROM rescored_episodes WHERE run = $1 AND scorer = $2";
    let rows: Vec<(u32, String)> = sqlx::query_as(select).bind(run).bind(scorer).fetch_all(&mut **tx).await?;
    let read = |(ordinal, json): (u32, String)| Ok((ordinal, from_json("metrics", &json)?));
    rows.into_iter().map(read).collect::<Result<_, _>>().map(Some)
}

async fn write(
    tx: &mut Transaction<'_, Sqlite>,
    (run, scorer): (&str, &str),
    again: &BTreeMap<u32, Metrics>,
    summary: Option<&Summary>,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let summary = summary.map(|summary| to_json("summary", summary)).transpose()?;
    let insert = "INSERT INTO rescores (run, scorer, scored_ms, summary) VALUES ($1, $2, $3, $4)";
    sqlx::query(insert).bind(run).bind(scorer).bind(now_unix_ms).bind(summary).execute(&mut **tx).await?;
    let insert = "INSERT INTO rescored_episodes (run, scorer, ordinal, metrics) VALUES ($1, $2, $3, $4)";
    for (ordinal, metrics) in again {
        let row = sqlx::query(insert).bind(run).bind(scorer).bind(*ordinal);
        row.bind(to_json("metrics", metrics)?).execute(&mut **tx).await?;
    }
    Ok(())
}

/// By which other scorers a run was scored, and what it was worth by each.
pub(crate) async fn read_rescores(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
) -> Result<Vec<Rescore>, StoreError> {
    let select = "SELECT scorer, scored_ms, summary FROM rescores WHERE run = $1 ORDER BY scored_ms, scorer";
    let rows: Vec<(String, i64, Option<String>)> =
        sqlx::query_as(select).bind(run).fetch_all(&mut **tx).await?;
    let read = |(scorer, scored_unix_ms, summary): (String, i64, Option<String>)| {
        let summary = summary.map(|json| from_json("summary", &json)).transpose()?;
        Ok(Rescore { scorer, scored_unix_ms, summary })
    };
    rows.into_iter().map(read).collect()
}
