//! What a team has left in a phase, and which of its runs were charged and why.
//!
//! Whether a run is charged follows from what the server stored of it, never from what an agent says.

use crate::{
    Phase, StoreError,
    words::{count, row},
};
use avln_challenge::{Charge, Quota, QuotaWindow, RunState, calendar};
use sqlx::{Sqlite, Transaction};

row! {
    /// What is stored of a run that bears on its charge.
    struct Spent {
        id: String,
        state: String,
        created_ms: i64,
        scored: i64,
        given_up: i64,
        server_faults: i64,
        stepped: bool,
    }
}

/// A run with its charge.
struct Charged {
    charge: Charge,
    created_ms: i64,
    is_open: bool,
}

/// What the organiser gave beyond the quota.
struct Grant {
    runs: u32,
    granted_ms: i64,
}

/// Facts of the runs of a team in a phase; `$3` one run, null for all.
const SELECT_SPENT: &str = "SELECT r.id, r.state, r.created_ms, s.scored, s.given_up, s.server_faults, \
     EXISTS (SELECT 1 FROM episodes e WHERE e.run = r.id AND e.steps > 0) AS stepped \
     FROM runs r JOIN run_summaries s ON s.run = r.id \
     WHERE r.team = $1 AND r.phase = $2 AND ($3 IS NULL OR r.id = $3) ORDER BY r.created_ms, r.id";

impl Spent {
    /// Whether the run is charged. An open one is, so that nobody can open more than are left.
    fn charge(self) -> Result<Charged, StoreError> {
        let state = RunState::from_word(&self.state)?;
        let (charged, reason) = match state {
            RunState::Created | RunState::Running => (true, "it is open; it counts until it ends"),
            RunState::Failed => (false, "the server failed"),
            _ if self.given_up > 0 => (false, "the server lost an episode of it for good"),
            RunState::Completed => (true, "all of its episodes were played"),
            _ if self.stepped => (true, "it ended after its first step"),
            _ if self.scored == 0 && self.server_faults > 0 => {
                (false, "the server failed before its first step")
            }
            _ => (false, "it ended before its first step"),
        };
        let charge = Charge { run: self.id, charged, reason };
        Ok(Charged { charge, created_ms: self.created_ms, is_open: state.is_open() })
    }
}

/// Whether one run is charged.
pub(crate) async fn read_charge(
    tx: &mut Transaction<'_, Sqlite>,
    team: &str,
    phase: &str,
    run: &str,
) -> Result<Charge, StoreError> {
    let spent = read_charged(tx, team, phase, Some(run)).await?;
    spent.into_iter().next().map(|one| one.charge).ok_or_else(|| StoreError::unknown("run", run))
}

/// What a team has left in every window of a phase that has a limit, and in the whole phase.
pub(crate) async fn read_quotas(
    tx: &mut Transaction<'_, Sqlite>,
    phase: &Phase,
    team: &str,
    now_unix_ms: i64,
) -> Result<Vec<Quota>, StoreError> {
    let runs = read_charged(tx, team, &phase.id, None).await?;
    let grants = read_grants(tx, team, &phase.id).await?;
    let limits = &phase.quotas;
    let (day, tomorrow) = calendar::day_around(now_unix_ms);
    let (month, next_month) = calendar::month_around(now_unix_ms);
    let opened = phase.schedule.opens_unix_ms.unwrap_or(0);
    let dated = |window, start, end| (window, start, Some(end));
    let windows = [
        (QuotaWindow::Total, opened, None),
        (QuotaWindow::Uncharged, opened, None),
        dated(QuotaWindow::Month, month, next_month),
        dated(QuotaWindow::Day, day, tomorrow),
        (QuotaWindow::Concurrent, opened, None),
    ];
    let of = |(window, start, end): (QuotaWindow, i64, Option<i64>)| {
        let limit = granted(limits.of(window)?, window, start, end, &grants);
        Some(quota(&phase.id, window, limit, start, end, &runs))
    };
    Ok(windows.into_iter().filter_map(of).collect())
}

/// The limit with what was granted in the window; runs at the same time are never more.
fn granted(
    limit: Option<u32>,
    window: QuotaWindow,
    start: i64,
    end: Option<i64>,
    grants: &[Grant],
) -> Option<u32> {
    let inside = |grant: &&Grant| end.is_none_or(|end| (start..end).contains(&grant.granted_ms));
    let extra: u32 = match window {
        QuotaWindow::Concurrent => 0,
        _ => grants.iter().filter(inside).map(|grant| grant.runs).fold(0, u32::saturating_add),
    };
    limit.map(|limit| limit.saturating_add(extra))
}

fn quota(
    phase: &str,
    window: QuotaWindow,
    limit: Option<u32>,
    start: i64,
    end: Option<i64>,
    runs: &[Charged],
) -> Quota {
    let counts = |run: &&Charged| match window {
        QuotaWindow::Concurrent => run.is_open,
        QuotaWindow::Uncharged => !run.charge.charged,
        _ => run.charge.charged && end.is_none_or(|end| (start..end).contains(&run.created_ms)),
    };
    let counted: Vec<&Charged> = runs.iter().filter(counts).collect();
    let used = counted.len() as u32;
    let told = &counted[counted.len().saturating_sub(Charge::MAX_LISTED)..];
    Quota {
        phase: phase.to_owned(),
        window,
        limit,
        used,
        remaining: limit.map(|limit| limit.saturating_sub(used)),
        window_start_unix_ms: start,
        next_increase_unix_ms: end.filter(|_| used > 0),
        charges: told.iter().map(|run| run.charge.clone()).collect(),
    }
}

/// Refuses a start when any window has none left; the one that lasts longest is named.
pub(crate) fn refuse_used_up(quotas: &[Quota]) -> Result<(), StoreError> {
    match quotas.iter().find(|quota| quota.remaining == Some(0)) {
        Some(quota) => Err(StoreError::QuotaUsed(Box::new(quota.clone()))),
        None => Ok(()),
    }
}

async fn read_charged(
    tx: &mut Transaction<'_, Sqlite>,
    team: &str,
    phase: &str,
    run: Option<&str>,
) -> Result<Vec<Charged>, StoreError> {
    let rows: Vec<Spent> =
        sqlx::query_as(SELECT_SPENT).bind(team).bind(phase).bind(run).fetch_all(&mut **tx).await?;
    rows.into_iter().map(Spent::charge).collect()
}

async fn read_grants(
    tx: &mut Transaction<'_, Sqlite>,
    team: &str,
    phase: &str,
) -> Result<Vec<Grant>, StoreError> {
    let select = "SELECT runs, granted_ms FROM grants WHERE team = $1 AND phase = $2 ORDER BY id";
    let rows: Vec<(i64, i64)> = sqlx::query_as(select).bind(team).bind(phase).fetch_all(&mut **tx).await?;
    Ok(rows.into_iter().map(|(runs, granted_ms)| Grant { runs: count(runs), granted_ms }).collect())
}
