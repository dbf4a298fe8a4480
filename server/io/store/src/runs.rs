//! Runs in the database: reading, ending, rulings; server heartbeat, and downtime credit for runs and phases
//! (docs/decisions/0012).

use crate::{
    accounts::{AuditNote, add_notes},
    database::{Store, Transaction, json, optional_json, value, word},
    error::{Result, StoreError},
};
use avln_challenge::{MethodInfo, Ruling, RunState, calendar::rfc3339};
use avln_episode::{Order, Sensors};
use sqlx::{FromRow, Row, sqlite::SqliteRow, types::Json};
use std::collections::BTreeMap;

/// A method's pass over a phase's episodes, or a sample. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Run id.
    pub id: String,
    /// Phase id.
    pub phase: String,
    /// Team name.
    pub team: String,
    /// The method.
    pub method: MethodInfo,
    /// Mission order.
    pub order: Order,
    /// Run state.
    pub state: RunState,
    /// Episode count.
    pub episodes: u32,
    /// Episodes that are over.
    pub done: u32,
    /// Sensors requested in the last session; `None` before the first session.
    pub sensors: Option<Sensors>,
    /// Sensors requested in any session.
    pub senses: Option<Sensors>,
    /// Digests and versions in force at the start, by name.
    pub digests: BTreeMap<String, String>,
    /// Start time.
    pub created_unix_ms: i64,
    /// End time.
    pub finished_unix_ms: Option<i64>,
    /// End of the wall time or, without one, of the phase; in the past if the organiser closed the phase by hand.
    pub deadline_unix_ms: Option<i64>,
    /// The organiser's ruling.
    pub ruling: Ruling,
}

impl Run {
    /// Key in [`Run::digests`] for restrictions enforced on a sealed run.
    pub const SEALED: &'static str = "sealed";
    /// Key in [`Run::digests`] for restrictions that could not be enforced; absent if there are none.
    pub const UNSEALED: &'static str = "sealed except";
    /// Key in [`Run::digests`] for the benchmark version.
    pub const SCORER: &'static str = "benchmark";
    /// Key in [`Run::digests`] for the split.
    pub const SPLIT: &'static str = "split";

    /// Returns the benchmark version that scored the run first; empty if it was not recorded.
    pub fn scorer(&self) -> &str {
        self.digests.get(Self::SCORER).map_or("", String::as_str)
    }

    /// Returns whether the organiser ran the agent without network access.
    pub fn is_sealed(&self) -> bool {
        self.digests.contains_key(Self::SEALED)
    }

    /// Returns whether the deadline has passed at `now_unix_ms`.
    pub fn is_overdue(&self, now_unix_ms: i64) -> bool {
        self.deadline_unix_ms.is_some_and(|deadline| deadline <= now_unix_ms)
    }
}

impl FromRow<'_, SqliteRow> for Run {
    /// Reads a `run_overview` row.
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        let text = |column| Ok::<_, sqlx::Error>(row.try_get::<Option<_>, _>(column)?.unwrap_or_default());
        Ok(Self {
            id: row.try_get("id")?,
            phase: row.try_get("phase")?,
            team: row.try_get("team")?,
            method: MethodInfo {
                name: row.try_get("method")?,
                version: row.try_get("version")?,
                method_type: value(row.try_get("method_type")?),
                description: text("method_description")?,
                code_url: text("method_code_url")?,
                paper_url: text("method_paper_url")?,
                weights_licence: text("method_weights_licence")?,
                external_data: text("method_external_data")?,
            },
            order: word(row, "mission_order")?,
            state: word(row, "state")?,
            episodes: row.try_get("episodes")?,
            done: row.try_get("done")?,
            sensors: optional_json(row, "sensors")?,
            senses: optional_json(row, "senses")?,
            digests: json(row, "digests")?,
            created_unix_ms: row.try_get("created_ms")?,
            finished_unix_ms: row.try_get("finished_ms")?,
            deadline_unix_ms: row.try_get("ends_ms")?,
            ruling: Ruling { verified: row.try_get("verified")?, disqualified: row.try_get("disqualified")? },
        })
    }
}

/// A run selection; `None` for no restriction.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RunFilter<'a> {
    pub(crate) team: Option<&'a str>,
    pub(crate) phase: Option<&'a str>,
    pub(crate) state: Option<RunState>,
}

impl Store {
    /// Returns the run called `id`. Fails with [`StoreError::Unknown`] if there is none.
    pub async fn run(&self, id: &str) -> Result<Run> {
        let mut tx = self.read.begin().await?;
        read_run(&mut tx, id).await
    }

    /// Returns a phase's completed runs, newest first.
    pub async fn completed_runs(&self, phase: &str) -> Result<Vec<Run>> {
        let mut tx = self.read.begin().await?;
        let state = Some(RunState::Completed);
        read_runs(&mut tx, &RunFilter { phase: Some(phase), state, ..RunFilter::default() }).await
    }

    /// Returns a team's runs, newest first.
    pub async fn runs_of(&self, team: &str) -> Result<Vec<Run>> {
        let mut tx = self.read.begin().await?;
        read_runs(&mut tx, &RunFilter { team: Some(team), ..RunFilter::default() }).await
    }

    /// Returns the open runs past the deadline, by id.
    pub async fn overdue(&self, now_unix_ms: i64) -> Result<Vec<String>> {
        let select =
            "SELECT id FROM run_overview WHERE state IN ('created', 'running') AND ends_ms <= $1 ORDER BY id";
        Ok(sqlx::query_scalar(select).bind(now_unix_ms).fetch_all(&self.read).await?)
    }

    /// Returns the open runs, newest first.
    pub async fn open_runs(&self) -> Result<Vec<Run>> {
        let mut tx = self.read.begin().await?;
        // Open runs have two states, and the filter takes one.
        let runs = read_runs(&mut tx, &RunFilter::default()).await?;
        Ok(runs.into_iter().filter(|run| run.state.is_open()).collect())
    }

    /// Records a session's requested sensors, and adds them to those from earlier sessions. Fails if the run is unknown.
    pub async fn set_sensors(&self, run: &str, sensors: &Sensors) -> Result<()> {
        let mut tx = self.begin().await?;
        // An agent may reconnect with fewer sensors; the leaderboard must show all sensors it ever used.
        let mut senses = sensors.clone();
        if let Some(before) = read_run(&mut tx, run).await?.senses {
            senses.rgb |= before.rgb;
            senses.depth |= before.depth;
            senses.audio |= before.audio;
        }
        let update = "UPDATE runs SET sensors = $1, senses = $2 WHERE id = $3";
        sqlx::query(update).bind(Json(sensors)).bind(Json(&senses)).bind(run).execute(&mut *tx).await?;
        Ok(tx.commit().await?)
    }

    /// Cancels a run if it is open; results from running episodes can still be recorded. Fails if the run is unknown.
    pub async fn cancel_run(&self, run: &str, now_unix_ms: i64) -> Result<Run> {
        self.end_run(run, RunState::Cancelled, now_unix_ms).await
    }

    /// Ends an incomplete run as `Cancelled`, `Failed` or `Expired`. A run that is over is not changed; results from its
    /// running episodes can still be recorded. Fails if the run is unknown.
    pub async fn end_run(&self, run: &str, state: RunState, now_unix_ms: i64) -> Result<Run> {
        let mut tx = self.begin().await?;
        // The last result may complete the run at the same moment: the first end wins.
        let update = "UPDATE runs SET state = $3, finished_ms = $1 \
                      WHERE id = $2 AND state IN ('created', 'running')";
        sqlx::query(update).bind(now_unix_ms).bind(run).bind(state.as_str()).execute(&mut *tx).await?;
        let run = read_run(&mut tx, run).await?;
        tx.commit().await?;
        Ok(run)
    }

    /// Marks a run as verified, or removes the mark. Returns whether that changed. Fails if the run is unknown or not over.
    pub async fn verify_run(
        &self,
        run: &str,
        verified: bool,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<bool> {
        let mut tx = self.begin().await?;
        let found = read_run(&mut tx, run).await?;
        if verified && found.state.is_open() {
            return Err(StoreError::RunOpen(run.to_owned()));
        }
        let after = Ruling { verified, ..found.ruling.clone() };
        write_ruling(tx, run, &found.ruling, &after, note, now_unix_ms).await
    }

    /// Removes a run from all leaderboards for a public reason, or readmits it with `None`. Returns whether the ruling
    /// changed. Fails if the run is unknown.
    pub async fn disqualify_run(
        &self,
        run: &str,
        reason: Option<&str>,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<bool> {
        let mut tx = self.begin().await?;
        let before = read_run(&mut tx, run).await?.ruling;
        let after = Ruling { disqualified: reason.map(str::to_owned), ..before.clone() };
        write_ruling(tx, run, &before, &after, note, now_unix_ms).await
    }
}

/// Writes a changed ruling with its audit note and commits.
async fn write_ruling(
    mut tx: Transaction<'_>,
    run: &str,
    before: &Ruling,
    after: &Ruling,
    note: AuditNote,
    now_unix_ms: i64,
) -> Result<bool> {
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

pub(crate) async fn read_run(tx: &mut Transaction<'_>, id: &str) -> Result<Run> {
    let select = "SELECT * FROM run_overview WHERE id = $1";
    let run = sqlx::query_as(select).bind(id).fetch_optional(&mut **tx).await?;
    run.ok_or_else(|| StoreError::unknown("run", id))
}

/// Returns the selected runs, newest first.
pub(crate) async fn read_runs(tx: &mut Transaction<'_>, filter: &RunFilter<'_>) -> Result<Vec<Run>> {
    let select = "SELECT * FROM run_overview WHERE ($1 IS NULL OR team = $1) AND ($2 IS NULL OR phase = $2) \
                  AND ($3 IS NULL OR state = $3) ORDER BY created_ms DESC, id";
    let state = filter.state.map(RunState::as_str);
    Ok(sqlx::query_as(select).bind(filter.team).bind(filter.phase).bind(state).fetch_all(&mut **tx).await?)
}

/// Shortest downtime that is credited, milliseconds. Shorter ones would fill the audit list.
const SHORTEST_MS: i64 = 1000;

/// The effect from [`Store::credit_downtime`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DowntimeCredit {
    /// Downtime, milliseconds.
    pub away_ms: i64,
    /// Open runs with a later deadline.
    pub runs: u64,
    /// Phases with a later closing time.
    pub phases: Vec<String>,
}

#[derive(FromRow)]
struct UptimeRow {
    alive_ms: i64,
    drain_ms: Option<i64>,
    drain_reason: Option<String>,
}

impl Store {
    /// Records that the server is alive. After a crash, the downtime starts at the last heartbeat.
    pub async fn record_heartbeat(&self, now_unix_ms: i64) -> Result<()> {
        let upsert = "INSERT INTO uptime (id, alive_ms) VALUES (1, $1) \
                      ON CONFLICT (id) DO UPDATE SET alive_ms = excluded.alive_ms";
        sqlx::query(upsert).bind(now_unix_ms).execute(&self.write).await?;
        Ok(())
    }

    /// Records a maintenance until the next [`Store::credit_downtime`], with an audit line. The first call counts.
    pub async fn record_drain(&self, reason: &str, now_unix_ms: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        // A second announcement must not shorten the maintenance.
        let upsert = "INSERT INTO uptime (id, alive_ms, drain_ms, drain_reason) VALUES (1, $1, $1, $2) ON CONFLICT (id) \
                      DO UPDATE SET drain_ms = excluded.drain_ms, drain_reason = excluded.drain_reason \
                      WHERE drain_ms IS NULL";
        let begun = sqlx::query(upsert).bind(now_unix_ms).bind(reason).execute(&mut *tx).await?;
        if begun.rows_affected() > 0 {
            let after = Some(rfc3339(now_unix_ms));
            let note = AuditNote { after, ..server_note("drain", "server", reason) };
            add_notes(&mut tx, &[note], now_unix_ms).await?;
        }
        Ok(tx.commit().await?)
    }

    /// Extends open runs' deadlines by the downtime when a server starts, with audit lines. An announced maintenance
    /// ([`Store::record_drain`]) counts from the announcement, and extends closing times as well.
    pub async fn credit_downtime(&self, now_unix_ms: i64) -> Result<DowntimeCredit> {
        let mut tx = self.begin().await?;
        let select = "SELECT alive_ms, drain_ms, drain_reason FROM uptime";
        let last: Option<UptimeRow> = sqlx::query_as(select).fetch_optional(&mut *tx).await?;
        let mut credit = DowntimeCredit::default();
        if let Some(last) = last {
            let since = last.drain_ms.unwrap_or(last.alive_ms);
            // The clock may have been set back while the server was down.
            credit.away_ms = (now_unix_ms - since).max(0);
            if credit.away_ms >= SHORTEST_MS {
                let why = last.drain_reason.as_deref().unwrap_or("the server was away");
                credit.runs = extend_runs(&mut tx, credit.away_ms, why, now_unix_ms).await?;
                if last.drain_ms.is_some() {
                    credit.phases = extend_phases(&mut tx, since, credit.away_ms, why, now_unix_ms).await?;
                }
            }
        }
        let alive = "INSERT INTO uptime (id, alive_ms) VALUES (1, $1) ON CONFLICT (id) \
                     DO UPDATE SET alive_ms = excluded.alive_ms, drain_ms = NULL, drain_reason = NULL";
        sqlx::query(alive).bind(now_unix_ms).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(credit)
    }

    /// Moves all open runs' deadlines, and the start of a downtime, by `by_ms` after the system clock was set. Returns the run count.
    pub async fn follow_clock(&self, by_ms: i64, now_unix_ms: i64) -> Result<u64> {
        let mut tx = self.begin().await?;
        let runs = extend_runs(&mut tx, by_ms, "the clock was set", now_unix_ms).await?;
        // The downtime counts from these times: by the old clock, the next start would credit the change a second time.
        let uptime = "UPDATE uptime SET alive_ms = alive_ms + $1, drain_ms = drain_ms + $1";
        sqlx::query(uptime).bind(by_ms).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(runs)
    }
}

async fn extend_runs(tx: &mut Transaction<'_>, by_ms: i64, why: &str, now_unix_ms: i64) -> Result<u64> {
    let update = "UPDATE runs SET deadline_ms = deadline_ms + $1 \
                  WHERE state IN ('created', 'running') AND deadline_ms IS NOT NULL";
    let runs = sqlx::query(update).bind(by_ms).execute(&mut **tx).await?.rows_affected();
    if runs > 0 {
        let after = Some(format!("{:+} s for {runs} open runs", by_ms / 1000));
        let note = AuditNote { after, ..server_note("deadline", "runs", why) };
        add_notes(tx, &[note], now_unix_ms).await?;
    }
    Ok(runs)
}

/// Extends closing times after `since_unix_ms`.
async fn extend_phases(
    tx: &mut Transaction<'_>,
    since_unix_ms: i64,
    by_ms: i64,
    why: &str,
    now_unix_ms: i64,
) -> Result<Vec<String>> {
    // A phase that closed before the maintenance stays closed, and one that opens later lost no time.
    let update = "UPDATE phases SET closes_ms = closes_ms + $1 WHERE state = 'open' AND closes_ms > $2 \
                  AND COALESCE(opens_ms, 0) < $3 RETURNING id, closes_ms";
    let mut moved: Vec<(String, i64)> =
        sqlx::query_as(update).bind(by_ms).bind(since_unix_ms).bind(now_unix_ms).fetch_all(&mut **tx).await?;
    // RETURNING has no defined order; equal changes must give equal audit lines.
    moved.sort();
    let note = |(phase, closes): &(String, i64)| AuditNote {
        before: Some(rfc3339(closes - by_ms)),
        after: Some(rfc3339(*closes)),
        ..server_note("closes", &format!("phase {phase}"), why)
    };
    let notes: Vec<_> = moved.iter().map(note).collect();
    add_notes(tx, &notes, now_unix_ms).await?;
    Ok(moved.into_iter().map(|(phase, _)| phase).collect())
}

fn server_note(what: &str, subject: &str, reason: &str) -> AuditNote {
    AuditNote {
        actor: "server".to_owned(),
        subject: subject.to_owned(),
        what: what.to_owned(),
        reason: reason.to_owned(),
        ..AuditNote::default()
    }
}
