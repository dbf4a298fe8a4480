//! Episode scores, running totals and the final summary.

use crate::{column::Word, error::StoreError};
use avln_episode::{Modality, Order};
use avln_scoring::{EpisodeScore, Metrics, summarise};
use avln_truth::EpisodeTruth;
use sqlx::{Sqlite, Transaction, types::Json};

/// Seed for all resampled intervals and tests: equal data gives equal pages.
pub(crate) const INTERVAL_SEED: u64 = 0x4156_4C4E;

/// Goals with one modality.
#[derive(Clone, Copy, Default)]
struct ModalityCount {
    goals: u32,
    found: u32,
}

/// Adds a result to the run's totals.
pub(crate) async fn add_to_totals(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    truth: &EpisodeTruth,
    metrics: &Metrics,
) -> Result<(), StoreError> {
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
pub(crate) async fn count_fault(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    abandoned: bool,
) -> Result<(), StoreError> {
    let update =
        "UPDATE run_summaries SET server_faults = server_faults + 1, given_up = given_up + $2 WHERE run = $1";
    sqlx::query(update).bind(run).bind(abandoned).execute(&mut **tx).await?;
    Ok(())
}

/// Completes a running run without open episodes, and stores means and intervals.
pub(crate) async fn complete_run(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
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
pub(crate) async fn read_scores(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
) -> Result<Vec<EpisodeScore>, StoreError> {
    let select = "SELECT e.episode, e.scene, r.mission_order, e.metrics FROM episodes e JOIN runs r ON r.id = e.run \
                  WHERE e.run = $1 AND e.metrics IS NOT NULL ORDER BY e.ordinal";
    let rows: Vec<(String, String, Word<Order>, Json<Metrics>)> =
        sqlx::query_as(select).bind(run).fetch_all(&mut **tx).await?;
    let score =
        |(episode, scene, Word(order), Json(metrics))| EpisodeScore { episode, scene, order, metrics };
    Ok(rows.into_iter().map(score).collect())
}
