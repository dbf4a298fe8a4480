//! Episode scores, running totals, the final summary and rescoring.

use crate::{
    database::{Store, Transaction, Word},
    error::{Result, StoreError},
    runs::read_run,
};
use avln_episode::{Modality, Order};
use avln_scoring::{EpisodeScore, Metrics, Summary, summarise};
use avln_truth::EpisodeTruth;
use serde::Serialize;
use sqlx::{FromRow, types::Json};
use std::collections::BTreeMap;

/// Seed for all resampled intervals and tests: equal data gives equal pages.
pub(crate) const INTERVAL_SEED: u64 = 0x4156_4C4E;

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
#[derive(Clone, Debug, PartialEq, Serialize, FromRow, utoipa::ToSchema)]
pub struct Rescore {
    /// Benchmark version.
    pub scorer: String,
    /// Scoring time, milliseconds since 1970-01-01 UTC.
    #[sqlx(rename = "scored_ms")]
    pub scored_unix_ms: i64,
    /// Means and intervals; `None` without scored episodes.
    #[sqlx(json(nullable))]
    pub summary: Option<Summary>,
}

#[derive(Clone, Copy, Default)]
struct ModalityCount {
    goals: u32,
    found: u32,
}

impl Store {
    /// Compares a run's stored scores with `rescored`: `scorer`'s metrics for all scored episodes, by ordinal. Stores them if
    /// `keep` is set. Stored scores are never changed. Fails if the run is unknown, `rescored` has other episodes than the
    /// scored ones, or the same scorer gave different metrics before.
    pub async fn rescore(
        &self,
        run: &str,
        scorer: &str,
        rescored: &BTreeMap<u32, Metrics>,
        keep: bool,
        now_unix_ms: i64,
    ) -> Result<Rescored> {
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
}

pub(crate) async fn add_to_totals(
    tx: &mut Transaction<'_>,
    run: &str,
    truth: &EpisodeTruth,
    metrics: &Metrics,
) -> Result<()> {
    let category = count_goals(truth, metrics, Modality::Category);
    let description = count_goals(truth, metrics, Modality::Description);
    let image = count_goals(truth, metrics, Modality::Image);
    let update = "UPDATE run_summaries SET scored = scored + 1, isr = isr + $2, \
         category_goals = category_goals + $3, category_found = category_found + $4, \
         description_goals = description_goals + $5, description_found = description_found + $6, \
         image_goals = image_goals + $7, image_found = image_found + $8 WHERE run = $1";
    sqlx::query(update)
        .bind(run)
        .bind(metrics.isr)
        .bind(category.goals)
        .bind(category.found)
        .bind(description.goals)
        .bind(description.found)
        .bind(image.goals)
        .bind(image.found)
        .execute(&mut **tx)
        .await?;
    Ok(())
}

fn count_goals(truth: &EpisodeTruth, metrics: &Metrics, modality: Modality) -> ModalityCount {
    let mut count = ModalityCount::default();
    for (goal, target) in truth.targets.iter().enumerate() {
        if target.modality == modality {
            count.goals += 1;
            let step = metrics.steps_to_goal.get(goal).copied().flatten();
            count.found += u32::from(step.is_some());
        }
    }
    count
}

/// Counts an attempt lost by the server; `abandoned` if it was the last one.
pub(crate) async fn count_fault(tx: &mut Transaction<'_>, run: &str, abandoned: bool) -> Result<()> {
    let update =
        "UPDATE run_summaries SET server_faults = server_faults + 1, given_up = given_up + $2 WHERE run = $1";
    sqlx::query(update).bind(run).bind(abandoned).execute(&mut **tx).await?;
    Ok(())
}

/// Completes a running run without open episodes, and stores means and intervals.
pub(crate) async fn complete_run(tx: &mut Transaction<'_>, run: &str, now_unix_ms: i64) -> Result<()> {
    // In the transaction of the last result: a crash between the two would leave a finished run open. Late results of a cancelled
    // run do not complete it.
    let complete = "UPDATE runs SET state = 'completed', finished_ms = $2 \
         WHERE id = $1 AND state = 'running' \
         AND NOT EXISTS (SELECT 1 FROM episodes WHERE run = $1 AND state IN ('pending', 'running'))";
    let completed = sqlx::query(complete).bind(run).bind(now_unix_ms).execute(&mut **tx).await?;
    if completed.rows_affected() == 0 {
        return Ok(());
    }
    let summary = summarise(&read_scores(tx, run).await?, INTERVAL_SEED);
    let update = "UPDATE run_summaries SET summary = $2 WHERE run = $1";
    sqlx::query(update).bind(run).bind(summary.map(Json)).execute(&mut **tx).await?;
    Ok(())
}

/// Returns the scored episodes of a run in playing order.
pub(crate) async fn read_scores(tx: &mut Transaction<'_>, run: &str) -> Result<Vec<EpisodeScore>> {
    let select = "SELECT e.episode, e.scene, r.mission_order, e.metrics FROM episodes e JOIN runs r ON r.id = e.run \
                  WHERE e.run = $1 AND e.metrics IS NOT NULL ORDER BY e.ordinal";
    let rows: Vec<(String, String, Word<Order>, Json<Metrics>)> =
        sqlx::query_as(select).bind(run).fetch_all(&mut **tx).await?;
    let score =
        |(episode, scene, Word(order), Json(metrics))| EpisodeScore { episode, scene, order, metrics };
    Ok(rows.into_iter().map(score).collect())
}

/// Returns a run's metrics by another scorer; `None` if that scorer never scored it.
async fn read_rescored_metrics(
    tx: &mut Transaction<'_>,
    run: &str,
    scorer: &str,
) -> Result<Option<BTreeMap<u32, Metrics>>> {
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
    tx: &mut Transaction<'_>,
    run: &str,
    scorer: &str,
    rescored: &BTreeMap<u32, Metrics>,
    summary: Option<&Summary>,
    now_unix_ms: i64,
) -> Result<()> {
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
pub(crate) async fn read_rescores(tx: &mut Transaction<'_>, run: &str) -> Result<Vec<Rescore>> {
    let select = "SELECT scorer, scored_ms, summary FROM rescores WHERE run = $1 ORDER BY scored_ms, scorer";
    Ok(sqlx::query_as(select).bind(run).fetch_all(&mut **tx).await?)
}
