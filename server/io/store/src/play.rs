use crate::{
    Run, Store, StoreError, packed,
    reveal::read_key,
    runs::read_run,
    totals::{add_to_totals, count_fault, settle_run},
    words::{count, end_reason, from_json, row, to_json},
};
use avln_challenge::{EpisodeState, RunState, TimeAccount};
use avln_episode::EndReason;
use avln_scoring::Metrics;
use avln_truth::{EpisodeTruth, Record};
use sqlx::{Sqlite, Transaction};

/// Attempts after which an episode that the server keeps losing is given up.
const MAX_ATTEMPTS: i64 = 3;

/// An episode that was handed out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Assigned {
    /// The name that the agent sees.
    pub handle: String,
    /// Place in the phase's list, from 0.
    pub ordinal: u32,
    /// Id of the episode inside the split.
    pub episode: String,
    /// Name of the scene.
    pub scene: String,
}

/// An episode that is being played, or was when the server stopped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Underway {
    /// The run.
    pub run: String,
    /// The name that the agent sees.
    pub handle: String,
    /// Id of the episode inside the split.
    pub episode: String,
}

/// How an episode that was handed out stands.
#[derive(Clone, Debug, PartialEq)]
pub struct HandedOut {
    /// How far it is.
    pub state: EpisodeState,
    /// Why it ended; `None` before.
    pub end: Option<EndReason>,
    /// What it was worth; `None` when it was not scored.
    pub metrics: Option<Metrics>,
}

/// What is known of an episode when it ends.
#[derive(Clone, Copy, Debug)]
pub struct Finished<'a> {
    /// The run.
    pub run: &'a str,
    /// The name under which the episode was handed out.
    pub handle: &'a str,
    /// What was hidden.
    pub truth: &'a EpisodeTruth,
    /// What happened.
    pub record: &'a Record,
    /// What it was worth.
    pub metrics: &'a Metrics,
    /// Where the time went.
    pub time: &'a TimeAccount,
}

/// What became of a result.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// False when the episode had a result already, which stays.
    pub is_new: bool,
    /// False when the server's fault ended the episode, which is then pending again or given up.
    pub counts: bool,
    /// The run afterwards; completed with its last episode.
    pub run: Run,
}

row! {
    struct OpenEpisode {
        ordinal: i64,
        state: String,
        attempts: i64,
    }
}

impl Store {
    /// Hands out the next pending episode of a run; `None` when none is pending. Its name is drawn by the phase's secret;
    /// in a phase without one it is `handle`, a random one.
    ///
    /// # Errors
    /// When the run is unknown, over or out of time, the handle was used before, or the database fails.
    pub async fn assign_next_episode(
        &self,
        run: &str,
        handle: &str,
        now_unix_ms: i64,
    ) -> Result<Option<Assigned>, StoreError> {
        let mut tx = self.begin().await?;
        let found = read_run(&mut tx, run).await?;
        if !found.state.is_open() && found.state != RunState::Completed {
            return Err(StoreError::RunOver { run: run.to_owned(), state: found.state.as_str() });
        }
        if found.state.is_open() && found.is_overdue(now_unix_ms) {
            return Err(StoreError::RunOver { run: run.to_owned(), state: RunState::Expired.as_str() });
        }
        let drawn = drawn_handle(&mut tx, &found).await?;
        let handle = drawn.as_deref().unwrap_or(handle);
        let take = "UPDATE episodes SET state = 'running', handle = $2, attempts = attempts + 1, started_ms = $3 \
                    WHERE run = $1 AND ordinal = (SELECT MIN(ordinal) FROM episodes WHERE run = $1 AND state = 'pending') \
                    RETURNING ordinal, episode, scene";
        let taken: Option<(i64, String, String)> =
            sqlx::query_as(take).bind(run).bind(handle).bind(now_unix_ms).fetch_optional(&mut *tx).await?;
        let Some((ordinal, episode, scene)) = taken else { return Ok(None) };
        let update = "UPDATE runs SET state = 'running' WHERE id = $1 AND state = 'created'";
        sqlx::query(update).bind(run).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(Some(Assigned { handle: handle.to_owned(), ordinal: count(ordinal), episode, scene }))
    }

    /// The mission that [`Store::assign_next_episode`] would hand out now.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn next_pending(&self, run: &str) -> Result<Option<String>, StoreError> {
        let select =
            "SELECT episode FROM episodes WHERE run = $1 AND state = 'pending' ORDER BY ordinal LIMIT 1";
        Ok(sqlx::query_scalar(select).bind(run).fetch_optional(&self.read).await?)
    }

    /// Stores the result of an episode, adds it to the run's sums and completes the run with its last episode, all in
    /// one transaction. A result for an episode that has one changes nothing. An episode that ended by the server's fault
    /// becomes pending again, up to three attempts.
    ///
    /// # Errors
    /// When no such episode is being played or the database fails; then nothing was stored.
    pub async fn record_result(
        &self,
        finished: &Finished<'_>,
        now_unix_ms: i64,
    ) -> Result<Recorded, StoreError> {
        let mut tx = self.begin().await?;
        let (is_new, counts) = write_result(&mut tx, finished, now_unix_ms).await?;
        let run = read_run(&mut tx, finished.run).await?;
        tx.commit().await?;
        Ok(Recorded { is_new, counts, run })
    }

    /// Completes a run whose episodes are all done; any other run stays as it is, to be played on.
    ///
    /// # Errors
    /// When the run is unknown or the database fails.
    pub async fn finish_run(&self, run: &str, now_unix_ms: i64) -> Result<Run, StoreError> {
        let mut tx = self.begin().await?;
        settle_run(&mut tx, run, now_unix_ms).await?;
        let run = read_run(&mut tx, run).await?;
        tx.commit().await?;
        Ok(run)
    }

    /// The episodes that are being played, or were when the server stopped, by run and handle.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn underway(&self) -> Result<Vec<Underway>, StoreError> {
        let select = "SELECT run, handle, episode FROM episodes WHERE state = 'running' ORDER BY run, handle";
        let rows: Vec<(String, String, String)> = sqlx::query_as(select).fetch_all(&self.read).await?;
        Ok(rows.into_iter().map(|(run, handle, episode)| Underway { run, handle, episode }).collect())
    }

    /// How the episode stands that was handed out under `handle`; `None` when there is none, or when it was handed out again
    /// since.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn handed_out(&self, run: &str, handle: &str) -> Result<Option<HandedOut>, StoreError> {
        let select = "SELECT state, end_reason, metrics FROM episodes WHERE run = $1 AND handle = $2";
        let row: Option<(String, Option<String>, Option<String>)> =
            sqlx::query_as(select).bind(run).bind(handle).fetch_optional(&self.read).await?;
        let Some((state, end, metrics)) = row else { return Ok(None) };
        Ok(Some(HandedOut {
            state: EpisodeState::from_word(&state)?,
            end: end.map(|end| end_reason(&end)).transpose()?,
            metrics: metrics.map(|json| from_json("metrics", &json)).transpose()?,
        }))
    }

    /// Takes back an episode that was handed out and lost by the server: it is pending again, or given up after three
    /// attempts. One that is not being played stays as it is; says whether this one was.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn take_back(&self, run: &str, handle: &str, now_unix_ms: i64) -> Result<bool, StoreError> {
        let mut tx = self.begin().await?;
        let reopen = "UPDATE episodes SET interruptions = interruptions + 1, \
             state = CASE WHEN attempts >= $1 THEN 'infra' ELSE 'pending' END, \
             end_reason = CASE WHEN attempts >= $1 THEN 'server_fault' END, \
             finished_ms = CASE WHEN attempts >= $1 THEN $2 END \
             WHERE state = 'running' AND run = $3 AND handle = $4 RETURNING state = 'infra'";
        let lost: Option<bool> = sqlx::query_scalar(reopen)
            .bind(MAX_ATTEMPTS)
            .bind(now_unix_ms)
            .bind(run)
            .bind(handle)
            .fetch_optional(&mut *tx)
            .await?;
        let Some(given_up) = lost else { return Ok(false) };
        count_fault(&mut tx, run, given_up).await?;
        settle_run(&mut tx, run, now_unix_ms).await?;
        tx.commit().await?;
        Ok(true)
    }
}

/// The name of the next attempt by the phase's secret; `None` when there is no secret, or no attempt.
async fn drawn_handle(tx: &mut Transaction<'_, Sqlite>, run: &Run) -> Result<Option<String>, StoreError> {
    let Some(key) = read_key(tx, &run.phase).await? else { return Ok(None) };
    let select = "SELECT ordinal, attempts FROM episodes WHERE run = $1 AND state = 'pending' ORDER BY ordinal LIMIT 1";
    let next: Option<(i64, i64)> = sqlx::query_as(select).bind(&run.id).fetch_optional(&mut **tx).await?;
    Ok(next.map(|(ordinal, attempts)| key.handle(&run.id, ordinal, attempts + 1)))
}

/// Writes all that a result changes; says whether it was new and whether it counts.
pub(crate) async fn write_result(
    tx: &mut Transaction<'_, Sqlite>,
    finished: &Finished<'_>,
    now_unix_ms: i64,
) -> Result<(bool, bool), StoreError> {
    let counts = finished.record.end != EndReason::ServerFault;
    let episode = find_episode(tx, finished).await?;
    match EpisodeState::from_word(&episode.state)? {
        EpisodeState::Running => {}
        EpisodeState::Pending => return Err(StoreError::unknown("running episode", finished.handle)),
        _ => return Ok((false, counts)),
    }
    let again = !counts && episode.attempts < MAX_ATTEMPTS;
    if counts {
        write_metrics(tx, finished, episode.ordinal).await?;
        add_to_totals(tx, finished).await?;
    } else {
        count_fault(tx, finished.run, !again).await?;
    }
    close_episode(tx, finished, episode.ordinal, again, now_unix_ms).await?;
    if !again {
        write_facts(tx, finished, episode.ordinal).await?;
    }
    settle_run(tx, finished.run, now_unix_ms).await?;
    Ok((true, counts))
}

async fn find_episode(
    tx: &mut Transaction<'_, Sqlite>,
    finished: &Finished<'_>,
) -> Result<OpenEpisode, StoreError> {
    let select = "SELECT ordinal, state, attempts FROM episodes WHERE run = $1 AND handle = $2";
    let found =
        sqlx::query_as(select).bind(finished.run).bind(finished.handle).fetch_optional(&mut **tx).await?;
    found.ok_or_else(|| StoreError::unknown("episode", finished.handle))
}

async fn close_episode(
    tx: &mut Transaction<'_, Sqlite>,
    finished: &Finished<'_>,
    ordinal: i64,
    again: bool,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let end = finished.record.end;
    let state = match end {
        EndReason::ServerFault if again => EpisodeState::Pending,
        EndReason::ServerFault => EpisodeState::Infra,
        end if end.is_terminated() => EpisodeState::Terminated,
        _ => EpisodeState::Truncated,
    };
    let update = "UPDATE episodes SET state = $3, end_reason = $4, finished_ms = $5, time_account = $6, \
                  interruptions = interruptions + $7 WHERE run = $1 AND ordinal = $2";
    sqlx::query(update)
        .bind(finished.run)
        .bind(ordinal)
        .bind(state.as_str())
        .bind((!again).then(|| end.as_str()))
        .bind((!again).then_some(now_unix_ms))
        .bind(to_json("time account", finished.time)?)
        .bind(i64::from(end == EndReason::ServerFault))
        .execute(&mut **tx)
        .await?;
    Ok(())
}

async fn write_metrics(
    tx: &mut Transaction<'_, Sqlite>,
    finished: &Finished<'_>,
    ordinal: i64,
) -> Result<(), StoreError> {
    let m = finished.metrics;
    let update = "UPDATE episodes SET goals = $3, found = $4, sr = $5, isr = $6, osr = $7, osr_all = $8, spl = $9, \
                  soft_spl = $10, sna = $11, steps = $12, path_m = $13, reference_m = $14, collisions = $15, \
                  wrong_submits = $16, metrics = $17 WHERE run = $1 AND ordinal = $2";
    sqlx::query(update)
        .bind(finished.run)
        .bind(ordinal)
        .bind(m.goals)
        .bind(m.found)
        .bind(m.sr)
        .bind(m.isr)
        .bind(m.osr)
        .bind(m.osr_all)
        .bind(m.spl)
        .bind(m.soft_spl)
        .bind(m.sna)
        .bind(m.steps)
        .bind(m.path_m)
        .bind(m.reference_m)
        .bind(m.collisions)
        .bind(m.wrong_submits)
        .bind(to_json("metrics", m)?)
        .execute(&mut **tx)
        .await?;
    Ok(())
}

async fn write_facts(
    tx: &mut Transaction<'_, Sqlite>,
    finished: &Finished<'_>,
    ordinal: i64,
) -> Result<(), StoreError> {
    let truth = to_json("truth", finished.truth)?;
    let digest = blake3::hash(truth.as_bytes()).to_hex().to_string();
    let keep = "INSERT INTO truths (digest, body) VALUES ($1, $2) ON CONFLICT DO NOTHING";
    sqlx::query(keep).bind(&digest).bind(truth.into_bytes()).execute(&mut **tx).await?;
    let insert = "INSERT INTO records (run, ordinal, truth, body) VALUES ($1, $2, $3, $4)";
    sqlx::query(insert)
        .bind(finished.run)
        .bind(ordinal)
        .bind(&digest)
        .bind(packed::pack(finished.record))
        .execute(&mut **tx)
        .await?;
    Ok(())
}

#[cfg(test)]
mod tests;
