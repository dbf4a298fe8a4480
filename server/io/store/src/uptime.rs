//! When the server was there. What its absence took from runs and phases is given back when the next one starts.

use crate::{AuditNote, Store, StoreError, audit::add_notes, words::row};
use avln_challenge::calendar::rfc3339;
use sqlx::{Sqlite, Transaction};

/// Absences shorter than this are not worth a line, milliseconds.
const SHORTEST_MS: i64 = 1000;

/// What was given back.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MadeUp {
    /// For how long no run could be played, milliseconds.
    pub away_ms: i64,
    /// Open runs that end later by that.
    pub runs: u64,
    /// Phases that close later by that.
    pub phases: Vec<String>,
}

row! {
    struct UptimeRow {
        alive_ms: i64,
        drain_ms: Option<i64>,
        drain_reason: Option<String>,
    }
}

impl Store {
    /// Notes that the server is there: should it die, its absence began now.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn note_alive(&self, now_unix_ms: i64) -> Result<(), StoreError> {
        let upsert = "INSERT INTO uptime (id, alive_ms) VALUES (1, $1) \
                      ON CONFLICT (id) DO UPDATE SET alive_ms = excluded.alive_ms";
        sqlx::query(upsert).bind(now_unix_ms).execute(&self.write).await?;
        Ok(())
    }

    /// Notes in the audit list that the server begins to stop for maintenance, which lasts until the next
    /// [`Store::make_up`]. The first note of a maintenance counts.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn note_drain(&self, reason: &str, now_unix_ms: i64) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        let upsert = "INSERT INTO uptime (id, alive_ms, drain_ms, drain_reason) VALUES (1, $1, $1, $2) ON CONFLICT (id) \
                      DO UPDATE SET drain_ms = excluded.drain_ms, drain_reason = excluded.drain_reason \
                      WHERE drain_ms IS NULL";
        let begun = sqlx::query(upsert).bind(now_unix_ms).bind(reason).execute(&mut *tx).await?;
        if begun.rows_affected() > 0 {
            let note = server_note("drain", "server", None, Some(rfc3339(now_unix_ms)), reason);
            add_notes(&mut tx, &[note], now_unix_ms).await?;
        }
        Ok(tx.commit().await?)
    }

    /// A server starts: open runs with a wall time end later by the time for which there was none. After a maintenance that
    /// was announced ([`Store::note_drain`]) it counts from the announcement, and phases close later by as much too. Each
    /// change is a line of the audit list, in the same transaction.
    ///
    /// # Errors
    /// When the database fails; then nothing was changed.
    pub async fn make_up(&self, now_unix_ms: i64) -> Result<MadeUp, StoreError> {
        let mut tx = self.begin().await?;
        let select = "SELECT alive_ms, drain_ms, drain_reason FROM uptime";
        let last: Option<UptimeRow> = sqlx::query_as(select).fetch_optional(&mut *tx).await?;
        let mut made_up = MadeUp::default();
        if let Some(last) = last {
            let since = last.drain_ms.unwrap_or(last.alive_ms);
            made_up.away_ms = (now_unix_ms - since).max(0);
            if made_up.away_ms >= SHORTEST_MS {
                let why = last.drain_reason.as_deref().map_or("the server was away", |reason| reason);
                made_up.runs = postpone_runs(&mut tx, made_up.away_ms, why, now_unix_ms).await?;
                if last.drain_ms.is_some() {
                    made_up.phases =
                        postpone_phases(&mut tx, since, made_up.away_ms, why, now_unix_ms).await?;
                }
            }
        }
        let here = "INSERT INTO uptime (id, alive_ms) VALUES (1, $1) ON CONFLICT (id) \
                    DO UPDATE SET alive_ms = excluded.alive_ms, drain_ms = NULL, drain_reason = NULL";
        sqlx::query(here).bind(now_unix_ms).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(made_up)
    }

    /// The clock was set by `by_ms`, forwards or, where that is negative, backwards: open runs keep the wall time that they
    /// had left. Says how many there are.
    ///
    /// # Errors
    /// When the database fails; then nothing was changed.
    pub async fn follow_clock(&self, by_ms: i64, now_unix_ms: i64) -> Result<u64, StoreError> {
        let mut tx = self.begin().await?;
        let runs = postpone_runs(&mut tx, by_ms, "the clock was set", now_unix_ms).await?;
        tx.commit().await?;
        Ok(runs)
    }
}

async fn postpone_runs(
    tx: &mut Transaction<'_, Sqlite>,
    by_ms: i64,
    why: &str,
    now_unix_ms: i64,
) -> Result<u64, StoreError> {
    let update = "UPDATE runs SET deadline_ms = deadline_ms + $1 \
                  WHERE state IN ('created', 'running') AND deadline_ms IS NOT NULL";
    let runs = sqlx::query(update).bind(by_ms).execute(&mut **tx).await?.rows_affected();
    if runs > 0 {
        let after = format!("{:+} s for {runs} open runs", by_ms / 1000);
        add_notes(tx, &[server_note("deadline", "runs", None, Some(after), why)], now_unix_ms).await?;
    }
    Ok(runs)
}

/// Postpones the closing of phases that were not closed at `since_unix_ms`.
async fn postpone_phases(
    tx: &mut Transaction<'_, Sqlite>,
    since_unix_ms: i64,
    by_ms: i64,
    why: &str,
    now_unix_ms: i64,
) -> Result<Vec<String>, StoreError> {
    let update = "UPDATE phases SET closes_ms = closes_ms + $1 WHERE state = 'open' AND closes_ms > $2 \
                  AND COALESCE(opens_ms, 0) < $3 RETURNING id, closes_ms";
    let mut moved: Vec<(String, i64)> =
        sqlx::query_as(update).bind(by_ms).bind(since_unix_ms).bind(now_unix_ms).fetch_all(&mut **tx).await?;
    moved.sort();
    let note = |(phase, closes): &(String, i64)| {
        let (before, after) = (Some(rfc3339(closes - by_ms)), Some(rfc3339(*closes)));
        server_note("closes", &format!("phase {phase}"), before, after, why)
    };
    let notes: Vec<_> = moved.iter().map(note).collect();
    add_notes(tx, &notes, now_unix_ms).await?;
    Ok(moved.into_iter().map(|(phase, _)| phase).collect())
}

/// A change that the server made by itself.
fn server_note(
    what: &str,
    subject: &str,
    before: Option<String>,
    after: Option<String>,
    reason: &str,
) -> AuditNote {
    AuditNote {
        actor: "server".to_owned(),
        subject: subject.to_owned(),
        what: what.to_owned(),
        before,
        after,
        reason: reason.to_owned(),
    }
}
