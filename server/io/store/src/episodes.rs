//! Episode assignment and results.

use crate::{
    commitment::read_key,
    database::{Store, Transaction, Word, value},
    error::{Result, StoreError},
    facts::pack,
    runs::{Run, read_run},
    scores::{add_to_totals, complete_run, count_fault},
};
use avln_challenge::{EpisodeState, RunState, TimeAccount};
use avln_episode::EndReason;
use avln_scoring::Metrics;
use avln_truth::{EpisodeTruth, Record};
use sqlx::{FromRow, types::Json};

/// Server failures that end an episode.
const MAX_FAULTS: i64 = 3;

/// An assigned episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AssignedEpisode {
    /// Agent-visible name.
    pub handle: String,
    /// Index in the run, from 0.
    pub ordinal: u32,
    /// Episode id inside the split.
    pub episode: String,
    /// Scene name.
    pub scene: String,
}

/// An episode in progress, possibly interrupted by a server stop.
#[derive(Clone, Debug, PartialEq, Eq, FromRow)]
pub struct RunningEpisode {
    /// Run id.
    pub run: String,
    /// Agent-visible name.
    pub handle: String,
    /// Episode id inside the split.
    pub episode: String,
}

/// An assigned episode's status.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeStatus {
    /// Episode state.
    pub state: EpisodeState,
    /// End reason; `None` before the end.
    pub end: Option<EndReason>,
    /// Metrics; `None` if it was not scored.
    pub metrics: Option<Metrics>,
}

/// An episode's result.
#[derive(Clone, Copy, Debug)]
pub struct EpisodeResult<'a> {
    /// Run id.
    pub run: &'a str,
    /// Agent-visible attempt name.
    pub handle: &'a str,
    /// Ground truth.
    pub truth: &'a EpisodeTruth,
    /// Facts.
    pub record: &'a Record,
    /// Metrics.
    pub metrics: &'a Metrics,
    /// Wall-clock time by activity.
    pub time: &'a TimeAccount,
}

/// The effect from [`Store::record_result`].
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedResult {
    /// False if the episode had a result before, which is kept.
    pub is_new: bool,
    /// False if a server failure ended the attempt; the episode is reopened or abandoned.
    pub counts: bool,
    /// The run afterwards; completed by the last episode.
    pub run: Run,
}

/// A [`RecordedResult`] without the run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WrittenResult {
    pub(crate) is_new: bool,
    pub(crate) counts: bool,
}

#[derive(FromRow)]
struct AttemptRow {
    ordinal: i64,
    state: Word<EpisodeState>,
    interruptions: i64,
}

impl Store {
    /// Assigns a run's next pending episode; `None` if none is pending. The phase's secret draws the name, which otherwise is
    /// the random `handle`. Fails if the run is unknown, over or past the deadline, or the handle was used before.
    pub async fn assign_next_episode(
        &self,
        run: &str,
        handle: &str,
        now_unix_ms: i64,
    ) -> Result<Option<AssignedEpisode>> {
        let mut tx = self.begin().await?;
        let found = read_run(&mut tx, run).await?;
        // A completed run has no pending episodes: the agent gets `None` and no error.
        if !found.state.is_open() && found.state != RunState::Completed {
            return Err(StoreError::RunOver { run: run.to_owned(), state: found.state.as_str() });
        }
        if found.state.is_open() && found.is_overdue(now_unix_ms) {
            return Err(StoreError::RunOver { run: run.to_owned(), state: RunState::Expired.as_str() });
        }
        // Agents see this name only: ids inside the split would let them recognise an episode.
        let drawn = draw_handle(&mut tx, &found).await?;
        let handle = drawn.as_deref().unwrap_or(handle);
        let take = "UPDATE episodes SET state = 'running', handle = $2, attempts = attempts + 1, started_ms = $3 \
                    WHERE run = $1 AND ordinal = (SELECT MIN(ordinal) FROM episodes WHERE run = $1 AND state = 'pending') \
                    RETURNING ordinal, episode, scene";
        let taken: Option<(u32, String, String)> =
            sqlx::query_as(take).bind(run).bind(handle).bind(now_unix_ms).fetch_optional(&mut *tx).await?;
        let Some((ordinal, episode, scene)) = taken else { return Ok(None) };
        let update = "UPDATE runs SET state = 'running' WHERE id = $1 AND state = 'created'";
        sqlx::query(update).bind(run).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(Some(AssignedEpisode { handle: handle.to_owned(), ordinal, episode, scene }))
    }

    /// Returns the next episode for [`Store::assign_next_episode`], by id.
    pub async fn next_pending(&self, run: &str) -> Result<Option<String>> {
        let select =
            "SELECT episode FROM episodes WHERE run = $1 AND state = 'pending' ORDER BY ordinal LIMIT 1";
        Ok(sqlx::query_scalar(select).bind(run).fetch_optional(&self.read).await?)
    }

    /// Stores an episode's result, adds it to the run's totals and completes the run with the last episode, in one transaction.
    /// A second result has no effect. A server failure reopens the episode, the third ends it. Fails if it is not running.
    pub async fn record_result(
        &self,
        result: &EpisodeResult<'_>,
        now_unix_ms: i64,
    ) -> Result<RecordedResult> {
        let mut tx = self.begin().await?;
        let WrittenResult { is_new, counts } = write_result(&mut tx, result, now_unix_ms).await?;
        let run = read_run(&mut tx, result.run).await?;
        tx.commit().await?;
        Ok(RecordedResult { is_new, counts, run })
    }

    /// Completes a run if all episodes are over. An incomplete run is not changed. Fails if the run is unknown.
    pub async fn finish_run(&self, run: &str, now_unix_ms: i64) -> Result<Run> {
        let mut tx = self.begin().await?;
        complete_run(&mut tx, run, now_unix_ms).await?;
        let run = read_run(&mut tx, run).await?;
        tx.commit().await?;
        Ok(run)
    }

    /// Returns all running episodes by run and handle. After a restart these are the interrupted ones.
    pub async fn running_episodes(&self) -> Result<Vec<RunningEpisode>> {
        let select = "SELECT run, handle, episode FROM episodes WHERE state = 'running' ORDER BY run, handle";
        Ok(sqlx::query_as(select).fetch_all(&self.read).await?)
    }

    /// Returns an attempt's status; `None` if there is none, or a later attempt replaced it.
    pub async fn episode_status(&self, run: &str, handle: &str) -> Result<Option<EpisodeStatus>> {
        let select = "SELECT state, end_reason, metrics FROM episodes WHERE run = $1 AND handle = $2";
        let row: Option<(Word<_>, Option<Word<_>>, Option<Json<_>>)> =
            sqlx::query_as(select).bind(run).bind(handle).fetch_optional(&self.read).await?;
        Ok(row.map(|(Word(state), end, metrics)| EpisodeStatus {
            state,
            end: value(end),
            metrics: metrics.map(|Json(metrics)| metrics),
        }))
    }

    /// Returns an episode that could not begin, without a fault. Returns false if the attempt is not running.
    pub async fn return_episode(&self, run: &str, handle: &str) -> Result<bool> {
        let mut tx = self.begin().await?;
        let update =
            "UPDATE episodes SET state = 'pending' WHERE state = 'running' AND run = $1 AND handle = $2";
        let changed = sqlx::query(update).bind(run).bind(handle).execute(&mut *tx).await?.rows_affected();
        tx.commit().await?;
        Ok(changed > 0)
    }

    /// Reopens an episode after a lost attempt; the third loss ends it. Returns false if the attempt is not running.
    pub async fn reopen_episode(&self, run: &str, handle: &str, now_unix_ms: i64) -> Result<bool> {
        let mut tx = self.begin().await?;
        let reopen = "UPDATE episodes SET interruptions = interruptions + 1, \
             state = CASE WHEN interruptions + 1 >= $1 THEN 'infra' ELSE 'pending' END, \
             end_reason = CASE WHEN interruptions + 1 >= $1 THEN 'server_fault' END, \
             finished_ms = CASE WHEN interruptions + 1 >= $1 THEN $2 END \
             WHERE state = 'running' AND run = $3 AND handle = $4 RETURNING state = 'infra'";
        let abandoned: Option<bool> = sqlx::query_scalar(reopen)
            .bind(MAX_FAULTS)
            .bind(now_unix_ms)
            .bind(run)
            .bind(handle)
            .fetch_optional(&mut *tx)
            .await?;
        let Some(abandoned) = abandoned else { return Ok(false) };
        count_fault(&mut tx, run, abandoned).await?;
        complete_run(&mut tx, run, now_unix_ms).await?;
        tx.commit().await?;
        Ok(true)
    }
}

/// Draws the next attempt's name; `None` if the phase has no secret or no episode is pending.
async fn draw_handle(tx: &mut Transaction<'_>, run: &Run) -> Result<Option<String>> {
    let Some(key) = read_key(tx, &run.phase).await? else { return Ok(None) };
    let select = "SELECT ordinal, attempts FROM episodes WHERE run = $1 AND state = 'pending' ORDER BY ordinal LIMIT 1";
    let next: Option<(i64, i64)> = sqlx::query_as(select).bind(&run.id).fetch_optional(&mut **tx).await?;
    Ok(next.map(|(ordinal, attempts)| key.handle(&run.id, ordinal, attempts + 1)))
}

pub(crate) async fn write_result(
    tx: &mut Transaction<'_>,
    result: &EpisodeResult<'_>,
    now_unix_ms: i64,
) -> Result<WrittenResult> {
    let counts = result.record.end != EndReason::ServerFault;
    let attempt = find_attempt(tx, result).await?;
    match attempt.state.0 {
        EpisodeState::Running => {}
        EpisodeState::Pending => return Err(StoreError::unknown("running episode", result.handle)),
        // The client repeats a result if the answer to the first was lost.
        _ => return Ok(WrittenResult { is_new: false, counts }),
    }
    let retry = !counts && attempt.interruptions + 1 < MAX_FAULTS;
    if counts {
        add_to_totals(tx, result.run, result.truth, result.metrics).await?;
    } else {
        count_fault(tx, result.run, !retry).await?;
    }
    close_episode(tx, result, attempt.ordinal, retry, now_unix_ms).await?;
    if !retry {
        write_facts(tx, result, attempt.ordinal).await?;
    }
    complete_run(tx, result.run, now_unix_ms).await?;
    Ok(WrittenResult { is_new: true, counts })
}

async fn find_attempt(tx: &mut Transaction<'_>, result: &EpisodeResult<'_>) -> Result<AttemptRow> {
    let select = "SELECT ordinal, state, interruptions FROM episodes WHERE run = $1 AND handle = $2";
    let found = sqlx::query_as(select).bind(result.run).bind(result.handle).fetch_optional(&mut **tx).await?;
    found.ok_or_else(|| StoreError::unknown("episode", result.handle))
}

async fn close_episode(
    tx: &mut Transaction<'_>,
    result: &EpisodeResult<'_>,
    ordinal: i64,
    retry: bool,
    now_unix_ms: i64,
) -> Result<()> {
    let end = result.record.end;
    let is_fault = end == EndReason::ServerFault;
    let state = match end {
        EndReason::ServerFault if retry => EpisodeState::Pending,
        EndReason::ServerFault => EpisodeState::Infra,
        end if end.is_terminated() => EpisodeState::Terminated,
        _ => EpisodeState::Truncated,
    };
    let update = "UPDATE episodes SET state = $3, end_reason = $4, finished_ms = $5, time_account = $6, \
                  interruptions = interruptions + $7, metrics = $8 WHERE run = $1 AND ordinal = $2";
    sqlx::query(update)
        .bind(result.run)
        .bind(ordinal)
        .bind(state.as_str())
        .bind((!retry).then(|| end.as_str()))
        .bind((!retry).then_some(now_unix_ms))
        .bind(Json(result.time))
        .bind(i64::from(is_fault))
        .bind((!is_fault).then_some(Json(result.metrics)))
        .execute(&mut **tx)
        .await?;
    Ok(())
}

async fn write_facts(tx: &mut Transaction<'_>, result: &EpisodeResult<'_>, ordinal: i64) -> Result<()> {
    let truth = serde_json::to_vec(result.truth).map_err(|error| StoreError::damaged("truth", error))?;
    // All runs in a phase share an episode's truth: rows are stored once, by hash.
    let digest = blake3::hash(&truth).to_hex().to_string();
    let insert = "INSERT INTO truths (digest, body) VALUES ($1, $2) ON CONFLICT DO NOTHING";
    sqlx::query(insert).bind(&digest).bind(truth).execute(&mut **tx).await?;
    let insert = "INSERT INTO records (run, ordinal, truth, body) VALUES ($1, $2, $3, $4)";
    sqlx::query(insert)
        .bind(result.run)
        .bind(ordinal)
        .bind(&digest)
        .bind(pack(result.record))
        .execute(&mut **tx)
        .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        admission::NewRun,
        phases::{Phase, Scene, SceneMap, Split},
    };
    use avln_challenge::{GoalText, MethodInfo, PhaseEpisode};
    use avln_episode::{Modality, Order, Rules};
    use std::{collections::BTreeMap, time::Duration};

    const PLACE: &str = "hall";

    async fn store_with_running_episode(folder: &std::path::Path) -> Result<Store> {
        let store = Store::open_with_timeout(&folder.join("arena.db"), Duration::from_millis(1)).await?;
        let split = Split { name: "val".to_owned(), digest: "d".to_owned(), scenes: 1, episodes: 1 };
        store.upsert_split(&split).await?;
        store
            .upsert_scene(&Scene { name: PLACE.to_owned(), digest: "d".to_owned(), map: SceneMap::default() })
            .await?;
        store.create_team("red", None, 1).await?;
        store.upsert_phase(&phase(), 1).await?;
        let new = NewRun {
            id: "run_1",
            token: "t",
            phase: "p",
            team: "red",
            method: &MethodInfo::new("m", "1"),
            order: Order::Ordered,
            client_request_id: None,
            digests: &BTreeMap::new(),
        };
        store.start_run(&new, 1).await?;
        store.assign_next_episode("run_1", "h", 2).await?;
        Ok(store)
    }

    fn phase() -> Phase {
        let goals = vec![GoalText { modality: Modality::Image, text: None }];
        let episodes = vec![PhaseEpisode { episode: "e".to_owned(), scene: PLACE.to_owned(), goals }];
        Phase::new("p", "val", Rules::paper(), episodes)
    }

    fn result() -> (EpisodeTruth, Record, Metrics) {
        let pose = serde_json::json!({ "position": [0.0, 0.0, 0.0], "heading_rad": 0.0 });
        let truth = serde_json::json!({
            "episode": "e", "scene": PLACE, "seed": 1, "start": pose, "order": "ordered", "targets": [],
            "reference_m": 1.0, "reference_path": [],
        });
        let record = serde_json::json!({
            "rules": "lh-avln-v1", "start": pose, "steps": [], "submits": [], "in_region_at_start": [],
            "final_distance_m": [], "end": "stopped",
        });
        let truth: EpisodeTruth = serde_json::from_value(truth).expect("a truth");
        let record: Record = serde_json::from_value(record).expect("a record");
        let metrics = avln_scoring::score(&truth, &record, &Rules::paper());
        (truth, record, metrics)
    }

    async fn count_rows(store: &Store) -> (i64, i64, i64, String) {
        let select = "SELECT (SELECT COUNT(*) FROM records), (SELECT COUNT(*) FROM truths), \
                      (SELECT SUM(scored) FROM run_summaries), (SELECT state FROM episodes)";
        sqlx::query_as(select).fetch_one(&store.read).await.expect("counts")
    }

    #[tokio::test]
    async fn uncommitted_result_leaves_no_trace() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = store_with_running_episode(folder.path()).await.expect("a store");
        let (truth, record, metrics) = result();
        let time = TimeAccount::default();
        let result_of_run = EpisodeResult {
            run: "run_1",
            handle: "h",
            truth: &truth,
            record: &record,
            metrics: &metrics,
            time: &time,
        };
        let mut tx = store.begin().await.expect("a transaction");
        assert_eq!(
            write_result(&mut tx, &result_of_run, 3).await.expect("all written"),
            WrittenResult { is_new: true, counts: true }
        );
        drop(tx);
        assert_eq!(count_rows(&store).await, (0, 0, 0, "running".to_owned()));
        assert!(store.record_result(&result_of_run, 4).await.expect("a second try").is_new);
        assert_eq!(count_rows(&store).await, (1, 1, 1, "terminated".to_owned()));
    }

    #[tokio::test]
    async fn locked_database_is_busy() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = store_with_running_episode(folder.path()).await.expect("a store");
        let other = Store::open_with_timeout(&folder.path().join("arena.db"), Duration::from_millis(1)).await;
        let other = other.expect("a second program");
        let held = other.begin().await.expect("the right to write");
        let refused = store.create_team("blue", None, 5).await;
        assert!(matches!(refused, Err(StoreError::Busy)), "{refused:?}");
        drop(held);
        other.close().await;
        store.create_team("blue", None, 6).await.expect("the right to write");
    }
}
