//! Server heartbeat, and downtime credit for runs and phases (docs/decisions/0012).

use crate::{
    audit::{AuditNote, add_notes},
    database::{Store, Transaction},
    error::Result,
};
use avln_challenge::calendar::rfc3339;
use sqlx::FromRow;

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
