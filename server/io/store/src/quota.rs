use crate::{column::Word, error::StoreError, phases::Phase};
use avln_challenge::{Charge, Quota, RunGrant, RunState, RunUse, quotas};
use sqlx::{FromRow, Sqlite, Transaction};

#[derive(FromRow)]
struct UseRow {
    id: String,
    state: Word<RunState>,
    created_ms: i64,
    scored: u32,
    given_up: u32,
    server_faults: u32,
    stepped: bool,
}

impl From<UseRow> for RunUse {
    fn from(row: UseRow) -> Self {
        Self {
            run: row.id,
            state: row.state.0,
            created_unix_ms: row.created_ms,
            scored: row.scored,
            given_up: row.given_up,
            server_faults: row.server_faults,
            stepped: row.stepped,
        }
    }
}

/// Returns a run's charge.
pub(crate) async fn read_charge(
    tx: &mut Transaction<'_, Sqlite>,
    team: &str,
    phase: &str,
    run: &str,
) -> Result<Charge, StoreError> {
    let runs = read_uses(tx, team, phase, Some(run)).await?;
    runs.first().map(RunUse::charge).ok_or_else(|| StoreError::unknown("run", run))
}

/// Returns a team's quotas in a phase, the total first.
pub(crate) async fn read_quotas(
    tx: &mut Transaction<'_, Sqlite>,
    phase: &Phase,
    team: &str,
    now_unix_ms: i64,
) -> Result<Vec<Quota>, StoreError> {
    let runs = read_uses(tx, team, &phase.id, None).await?;
    let grants = read_grants(tx, team, &phase.id).await?;
    Ok(quotas(&phase.id, &phase.quotas, &phase.schedule, &runs, &grants, now_unix_ms))
}

/// Rejects a start if a window has no runs left. The error names the window that lasts longest.
pub(crate) fn check_quotas(quotas: &[Quota]) -> Result<(), StoreError> {
    match quotas.iter().find(|quota| quota.remaining == Some(0)) {
        Some(quota) => Err(StoreError::QuotaUsed(Box::new(quota.clone()))),
        None => Ok(()),
    }
}

/// Returns the run called `run`, or all a team's runs in a phase, oldest first.
async fn read_uses(
    tx: &mut Transaction<'_, Sqlite>,
    team: &str,
    phase: &str,
    run: Option<&str>,
) -> Result<Vec<RunUse>, StoreError> {
    // Only scored episodes have metrics. Attempts lost by the server have none, so they charge nothing.
    let select = "SELECT r.id, r.state, r.created_ms, s.scored, s.given_up, s.server_faults, \
         EXISTS (SELECT 1 FROM episodes e WHERE e.run = r.id AND e.metrics ->> '$.steps' > 0) AS stepped \
         FROM runs r JOIN run_summaries s ON s.run = r.id \
         WHERE r.team = $1 AND r.phase = $2 AND ($3 IS NULL OR r.id = $3) ORDER BY r.created_ms, r.id";
    let rows: Vec<UseRow> =
        sqlx::query_as(select).bind(team).bind(phase).bind(run).fetch_all(&mut **tx).await?;
    Ok(rows.into_iter().map(RunUse::from).collect())
}

async fn read_grants(
    tx: &mut Transaction<'_, Sqlite>,
    team: &str,
    phase: &str,
) -> Result<Vec<RunGrant>, StoreError> {
    let select = "SELECT runs, granted_ms FROM grants WHERE team = $1 AND phase = $2 ORDER BY id";
    let rows: Vec<(u32, i64)> = sqlx::query_as(select).bind(team).bind(phase).fetch_all(&mut **tx).await?;
    Ok(rows.into_iter().map(|(runs, granted_unix_ms)| RunGrant { runs, granted_unix_ms }).collect())
}
