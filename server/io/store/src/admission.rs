//! Approved teams, team members, quotas and granted runs.

use crate::{
    audit::{AuditNote, add_notes},
    database::{Store, Transaction, word},
    error::{Result, StoreError},
    phases::{Phase, find_phase, read_heads},
};
use avln_challenge::{Charge, Quota, RunGrant, RunUse, quotas};
use serde::Serialize;
use sqlx::{FromRow, Row, sqlite::SqliteRow};

/// A person in a phase's team.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, FromRow)]
pub struct Member {
    /// Phase id.
    pub phase: String,
    /// Team name.
    pub team: String,
    /// The person.
    pub person: String,
}

/// Runs granted by the organiser beyond a team's quota.
#[derive(Clone, Copy, Debug)]
pub struct NewGrant<'a> {
    /// Phase id.
    pub phase: &'a str,
    /// Team name.
    pub team: &'a str,
    /// Run count, at least 1.
    pub runs: u32,
    /// Reason.
    pub reason: &'a str,
}

impl Store {
    /// Approves a team for a phase, or withdraws that. Returns whether it changed anything. Fails if either is unknown.
    pub async fn approve(
        &self,
        phase: &str,
        team: &str,
        approved: bool,
        note: AuditNote,
        now_unix_ms: i64,
    ) -> Result<bool> {
        let mut tx = self.begin().await?;
        find_phase(&mut tx, phase).await?;
        find_team(&mut tx, team).await?;
        let change = if approved {
            "INSERT INTO approvals (phase, team, approved_ms) VALUES ($1, $2, $3) ON CONFLICT DO NOTHING"
        } else {
            "DELETE FROM approvals WHERE phase = $1 AND team = $2 AND $3 IS NOT NULL"
        };
        let changed = sqlx::query(change).bind(phase).bind(team).bind(now_unix_ms).execute(&mut *tx).await?;
        let changed = changed.rows_affected() > 0;
        if changed {
            add_notes(&mut tx, &[note], now_unix_ms).await?;
        }
        tx.commit().await?;
        Ok(changed)
    }

    /// Adds a person to a team; false if already in it. Fails if the phase or team is unknown, or the person in another team.
    pub async fn add_member(&self, member: &Member, note: AuditNote, now_unix_ms: i64) -> Result<bool> {
        let mut tx = self.begin().await?;
        find_phase(&mut tx, &member.phase).await?;
        find_team(&mut tx, &member.team).await?;
        let select = "SELECT team FROM members WHERE phase = $1 AND person = $2";
        let team: Option<String> = sqlx::query_scalar(select)
            .bind(&member.phase)
            .bind(&member.person)
            .fetch_optional(&mut *tx)
            .await?;
        match team {
            Some(team) if team == member.team => return Ok(false),
            Some(team) => {
                let Member { phase, person, .. } = member.clone();
                return Err(StoreError::InAnotherTeam { person, phase, team });
            }
            None => {}
        }
        let insert = "INSERT INTO members (phase, person, team, added_ms) VALUES ($1, $2, $3, $4)";
        let insert = sqlx::query(insert).bind(&member.phase).bind(&member.person).bind(&member.team);
        insert.bind(now_unix_ms).execute(&mut *tx).await?;
        add_notes(&mut tx, &[note], now_unix_ms).await?;
        tx.commit().await?;
        Ok(true)
    }

    /// Removes a person from a team. Returns whether that changed anything.
    pub async fn remove_member(&self, member: &Member, note: AuditNote, now_unix_ms: i64) -> Result<bool> {
        let mut tx = self.begin().await?;
        let delete = "DELETE FROM members WHERE phase = $1 AND person = $2 AND team = $3";
        let delete = sqlx::query(delete).bind(&member.phase).bind(&member.person).bind(&member.team);
        let changed = delete.execute(&mut *tx).await?.rows_affected() > 0;
        if changed {
            add_notes(&mut tx, &[note], now_unix_ms).await?;
        }
        tx.commit().await?;
        Ok(changed)
    }

    /// Returns a team's members, by phase and person.
    pub async fn members(&self, team: &str) -> Result<Vec<Member>> {
        let select = "SELECT phase, team, person FROM members WHERE team = $1 ORDER BY phase, person";
        Ok(sqlx::query_as(select).bind(team).fetch_all(&self.read).await?)
    }

    /// Grants runs to a team beyond the quota. Fails if the phase or the team is unknown.
    pub async fn grant(&self, grant: &NewGrant<'_>, note: AuditNote, now_unix_ms: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        find_phase(&mut tx, grant.phase).await?;
        find_team(&mut tx, grant.team).await?;
        let insert = "INSERT INTO grants (phase, team, runs, reason, granted_ms) VALUES ($1, $2, $3, $4, $5)";
        let insert = sqlx::query(insert).bind(grant.phase).bind(grant.team).bind(grant.runs);
        insert.bind(grant.reason).bind(now_unix_ms).execute(&mut *tx).await?;
        add_notes(&mut tx, &[note], now_unix_ms).await?;
        Ok(tx.commit().await?)
    }

    /// Returns a team's quotas in a phase, or in all visible phases. Fails if the phase is unknown or hidden from the team.
    pub async fn quotas(&self, team: &str, phase: Option<&str>, now_unix_ms: i64) -> Result<Vec<Quota>> {
        let mut tx = self.read.begin().await?;
        let phases = match phase {
            Some(id) => {
                let phase = find_phase(&mut tx, id).await?;
                reject_hidden(&phase, team)?;
                vec![phase]
            }
            None => read_heads(&mut tx, None).await?.into_iter().map(|head| head.phase).collect(),
        };
        let mut quotas = Vec::new();
        for phase in phases.iter().filter(|phase| phase.admission.shows_to(Some(team))) {
            quotas.extend(read_quotas(&mut tx, phase, team, now_unix_ms).await?);
        }
        Ok(quotas)
    }
}

async fn find_team(tx: &mut Transaction<'_>, name: &str) -> Result<()> {
    let select = "SELECT 1 FROM teams WHERE name = $1";
    let found: Option<i64> = sqlx::query_scalar(select).bind(name).fetch_optional(&mut **tx).await?;
    found.map(drop).ok_or_else(|| StoreError::unknown("team", name))
}

fn reject_hidden(phase: &Phase, team: &str) -> Result<()> {
    if phase.admission.shows_to(Some(team)) {
        return Ok(());
    }
    Err(StoreError::PhaseNotVisible { phase: phase.id.clone(), team: team.to_owned() })
}

pub(crate) async fn check_admission(tx: &mut Transaction<'_>, phase: &Phase, team: &str) -> Result<()> {
    reject_hidden(phase, team)?;
    let rejected =
        |why| Err(StoreError::TeamNotApproved { phase: phase.id.clone(), team: team.to_owned(), why });
    if phase.admission.deny.iter().any(|denied| denied == team) {
        return rejected("the organiser excluded it");
    }
    let select = "SELECT 1 FROM approvals WHERE phase = $1 AND team = $2";
    let approved: Option<i64> =
        sqlx::query_scalar(select).bind(&phase.id).bind(team).fetch_optional(&mut **tx).await?;
    match approved {
        None if phase.admission.approval => rejected("the organiser has not approved it yet"),
        _ => Ok(()),
    }
}

fn run_use(row: SqliteRow) -> Result<RunUse, sqlx::Error> {
    Ok(RunUse {
        run: row.try_get("id")?,
        state: word(&row, "state")?,
        created_unix_ms: row.try_get("created_ms")?,
        scored: row.try_get("scored")?,
        given_up: row.try_get("given_up")?,
        server_faults: row.try_get("server_faults")?,
        in_progress: row.try_get("in_progress")?,
    })
}

pub(crate) async fn read_charge(
    tx: &mut Transaction<'_>,
    team: &str,
    phase: &str,
    run: &str,
) -> Result<Charge> {
    let runs = read_uses(tx, team, phase, Some(run)).await?;
    runs.first().map(RunUse::charge).ok_or_else(|| StoreError::unknown("run", run))
}

/// Returns a team's quotas in a phase, the total first.
pub(crate) async fn read_quotas(
    tx: &mut Transaction<'_>,
    phase: &Phase,
    team: &str,
    now_unix_ms: i64,
) -> Result<Vec<Quota>> {
    let runs = read_uses(tx, team, &phase.id, None).await?;
    let grants = read_grants(tx, team, &phase.id).await?;
    Ok(quotas(&phase.id, &phase.quotas, &phase.schedule, &runs, &grants, now_unix_ms))
}

/// Rejects a start if a window has no runs left. The error names the window that lasts longest.
pub(crate) fn check_quotas(quotas: &[Quota]) -> Result<()> {
    match quotas.iter().find(|quota| quota.remaining == Some(0)) {
        Some(quota) => Err(StoreError::QuotaUsed(Box::new(quota.clone()))),
        None => Ok(()),
    }
}

/// Returns the run called `run`, or all a team's runs in a phase, oldest first.
async fn read_uses(
    tx: &mut Transaction<'_>,
    team: &str,
    phase: &str,
    run: Option<&str>,
) -> Result<Vec<RunUse>> {
    // An episode in progress at the end of its run is scored a moment later, or at the next start of the server.
    let select = "SELECT r.id, r.state, r.created_ms, s.scored, s.given_up, s.server_faults, \
         EXISTS (SELECT 1 FROM episodes e WHERE e.run = r.id AND e.state = 'running') AS in_progress \
         FROM runs r JOIN run_summaries s ON s.run = r.id \
         WHERE r.team = $1 AND r.phase = $2 AND ($3 IS NULL OR r.id = $3) ORDER BY r.created_ms, r.id";
    let select = sqlx::query(select).bind(team).bind(phase).bind(run).try_map(run_use);
    Ok(select.fetch_all(&mut **tx).await?)
}

async fn read_grants(tx: &mut Transaction<'_>, team: &str, phase: &str) -> Result<Vec<RunGrant>> {
    let select = "SELECT runs, granted_ms FROM grants WHERE team = $1 AND phase = $2 ORDER BY id";
    let rows: Vec<(u32, i64)> = sqlx::query_as(select).bind(team).bind(phase).fetch_all(&mut **tx).await?;
    Ok(rows.into_iter().map(|(runs, granted_unix_ms)| RunGrant { runs, granted_unix_ms }).collect())
}
