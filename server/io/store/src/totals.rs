//! Sums over the scored episodes of a run, and the scores behind them.

use crate::{
    Finished, StoreError,
    words::{self, count, from_json, row, to_json},
};
use avln_episode::{Modality, Order};
use avln_scoring::{EpisodeScore, Metrics, summarise};
use sqlx::{Sqlite, Transaction};

/// Seed of every interval and test on pages, so that they never change between two looks.
pub(crate) const INTERVAL_SEED: u64 = 0x4156_4C4E;

/// Adds a result to the sums of its run.
pub(crate) async fn add_to_totals(
    tx: &mut Transaction<'_, Sqlite>,
    finished: &Finished<'_>,
) -> Result<(), StoreError> {
    let m = finished.metrics;
    let [category, description, image] = by_modality(finished);
    let update = "UPDATE run_summaries SET scored = scored + 1, goals = goals + $2, found = found + $3, sr = sr + $4, \
         isr = isr + $5, osr = osr + $6, spl = spl + $7, soft_spl = soft_spl + $8, steps = steps + $9, \
         category_goals = category_goals + $10, category_found = category_found + $11, \
         description_goals = description_goals + $12, description_found = description_found + $13, \
         image_goals = image_goals + $14, image_found = image_found + $15 WHERE run = $1";
    sqlx::query(update)
        .bind(finished.run)
        .bind(m.goals)
        .bind(m.found)
        .bind(m.sr)
        .bind(m.isr)
        .bind(m.osr)
        .bind(m.spl)
        .bind(m.soft_spl)
        .bind(m.steps)
        .bind(category.0)
        .bind(category.1)
        .bind(description.0)
        .bind(description.1)
        .bind(image.0)
        .bind(image.1)
        .execute(&mut **tx)
        .await?;
    Ok(())
}

/// Goals told in each way and how many of them were found: category, description, image.
fn by_modality(finished: &Finished<'_>) -> [(u32, u32); 3] {
    let found_at = |goal: usize| finished.metrics.steps_to_goal.get(goal).copied().flatten();
    [Modality::Category, Modality::Description, Modality::Image].map(|modality| {
        let goals =
            finished.truth.targets.iter().enumerate().filter(|(_, target)| target.modality == modality);
        goals.fold((0, 0), |(all, found), (goal, _)| (all + 1, found + u32::from(found_at(goal).is_some())))
    })
}

/// Counts an attempt that the server lost, and whether it was the episode's last.
pub(crate) async fn count_fault(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    last: bool,
) -> Result<(), StoreError> {
    let update =
        "UPDATE run_summaries SET server_faults = server_faults + 1, given_up = given_up + $2 WHERE run = $1";
    sqlx::query(update).bind(run).bind(last).execute(&mut **tx).await?;
    Ok(())
}

/// Completes an open run that has no open episode left, with its means and intervals.
pub(crate) async fn settle_run(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let complete = "UPDATE runs SET state = 'completed', finished_ms = $2 \
         WHERE id = $1 AND state = 'running' \
         AND NOT EXISTS (SELECT 1 FROM episodes WHERE run = $1 AND state IN ('pending', 'running'))";
    let completed =
        sqlx::query(complete).bind(run).bind(now_unix_ms).execute(&mut **tx).await?.rows_affected();
    if completed == 0 {
        return Ok(());
    }
    let summary = summarise(&full_scores(tx, run).await?, INTERVAL_SEED);
    let json = summary.as_ref().map(|summary| to_json("summary", summary)).transpose()?;
    let update = "UPDATE run_summaries SET summary = $2 WHERE run = $1";
    sqlx::query(update).bind(run).bind(json).execute(&mut **tx).await?;
    Ok(())
}

/// The scored episodes of a run with all of their metrics.
pub(crate) async fn full_scores(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
) -> Result<Vec<EpisodeScore>, StoreError> {
    let select = "SELECT e.episode, e.scene, r.mission_order, e.metrics FROM episodes e JOIN runs r ON r.id = e.run \
                  WHERE e.run = $1 AND e.metrics IS NOT NULL ORDER BY e.ordinal";
    let rows: Vec<(String, String, String, String)> =
        sqlx::query_as(select).bind(run).fetch_all(&mut **tx).await?;
    let read = |(episode, scene, order, metrics): (String, String, String, String)| {
        let (order, metrics) = (words::order(&order)?, from_json("metrics", &metrics)?);
        Ok(EpisodeScore { episode, scene, order, metrics })
    };
    rows.into_iter().map(read).collect()
}

row! {
    struct ScoreRow {
        episode: String,
        scene: String,
        goals: i64,
        found: i64,
        sr: f64,
        isr: f64,
        osr: f64,
        osr_all: f64,
        spl: f64,
        soft_spl: f64,
        sna: f64,
        steps: i64,
        path_m: f64,
        reference_m: f64,
        collisions: i64,
        wrong_submits: i64,
        wrong_instance_submits: i64,
    }
}

/// The scored episodes of a run without the numbers of each goal: enough to compare runs, and quick to read.
pub(crate) async fn plain_scores(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    order: Order,
) -> Result<Vec<EpisodeScore>, StoreError> {
    let select = "SELECT episode, scene, goals, found, sr, isr, osr, osr_all, spl, soft_spl, sna, steps, path_m, \
                  reference_m, collisions, wrong_submits, \
                  COALESCE(json_extract(metrics, '$.wrong_instance_submits'), 0) AS wrong_instance_submits \
                  FROM episodes WHERE run = $1 AND metrics IS NOT NULL ORDER BY ordinal";
    let rows: Vec<ScoreRow> = sqlx::query_as(select).bind(run).fetch_all(&mut **tx).await?;
    Ok(rows.into_iter().map(|row| row.into_score(order)).collect())
}

impl ScoreRow {
    fn into_score(self, order: Order) -> EpisodeScore {
        let metrics = Metrics {
            goals: count(self.goals),
            found: count(self.found),
            sr: self.sr,
            isr: self.isr,
            osr: self.osr,
            osr_all: self.osr_all,
            spl: self.spl,
            soft_spl: self.soft_spl,
            sna: self.sna,
            steps: count(self.steps),
            path_m: self.path_m,
            reference_m: self.reference_m,
            collisions: count(self.collisions),
            wrong_submits: count(self.wrong_submits),
            wrong_instance_submits: count(self.wrong_instance_submits),
            steps_to_goal: vec![],
            final_distance_m: vec![],
        };
        EpisodeScore { episode: self.episode, scene: self.scene, order, metrics }
    }
}
