//! Admission of teams and their runs: approvals, members, quotas, granted runs, and the start of runs.

use crate::{
    accounts::{AuditNote, NewToken, add_notes, insert_token},
    commitment::read_key,
    database::{Store, Transaction, word},
    error::{Result, StoreError},
    phases::{Phase, find_phase, read_heads},
    runs::{Run, read_run},
};
use avln_challenge::{
    Charge, MethodInfo, MethodType, PhaseEpisode, Quota, RunGrant, RunUse, Sampling, TokenScope, draw, quotas,
};
use avln_episode::Order;
use serde::Serialize;
use sqlx::{FromRow, Row, sqlite::SqliteRow, types::Json};
use std::collections::BTreeMap;

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

    /// Returns a run's charge to the team quota. Fails if the run is unknown.
    pub async fn charge(&self, run: &str) -> Result<Charge> {
        let mut tx = self.read.begin().await?;
        let Run { id, team, phase, .. } = read_run(&mut tx, run).await?;
        let runs = read_uses(&mut tx, &team, &phase, Some(&id)).await?;
        runs.first().map(RunUse::charge).ok_or_else(|| StoreError::unknown("run", &id))
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

async fn check_admission(tx: &mut Transaction<'_>, phase: &Phase, team: &str) -> Result<()> {
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
fn check_quotas(quotas: &[Quota]) -> Result<()> {
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

/// A request for a run.
#[derive(Clone, Copy, Debug)]
pub struct NewRun<'a> {
    /// Id for a new run: `run_` and random digits.
    pub id: &'a str,
    /// Random secret that plays the run. Only a hash is stored.
    pub token: &'a str,
    /// Phase id.
    pub phase: &'a str,
    /// Team name.
    pub team: &'a str,
    /// The method.
    pub method: &'a MethodInfo,
    /// Mission order.
    pub order: Order,
    /// The client's request id. A repeated request returns the same run.
    pub client_request_id: Option<&'a str>,
    /// Digests and versions in force, by name: program, split, scorer.
    pub digests: &'a BTreeMap<String, String>,
}

/// A run started by this request or an earlier one with the same id.
#[derive(Clone, Debug, PartialEq)]
pub struct StartedRun {
    /// The run.
    pub run: Run,
    /// True if this request started it.
    pub is_new: bool,
    /// The team's quotas in the phase after the start, the total first.
    pub quotas: Vec<Quota>,
}

impl Store {
    /// Starts a run with drawn episodes, and stores the token. One transaction checks and takes the quota. A request with an
    /// earlier `client_request_id` returns the earlier run; the new token plays it as well. Fails if the phase or team is
    /// unknown, the team is not admitted, the phase is not open, does not allow the order or requires a sealed run, a quota
    /// is used up, or the request id belongs to a different request.
    pub async fn start_run(&self, new: &NewRun<'_>, now_unix_ms: i64) -> Result<StartedRun> {
        if self.team(new.team).await?.is_none() {
            return Err(StoreError::unknown("team", new.team));
        }
        let mut tx = self.begin().await?;
        let phase = find_phase(&mut tx, new.phase).await?;
        let earlier = find_earlier_run(&mut tx, new).await?;
        let is_new = earlier.is_none();
        let id = earlier.unwrap_or_else(|| new.id.to_owned());
        if is_new {
            check_start(&mut tx, new, &phase, now_unix_ms).await?;
            insert_run(&mut tx, new, &phase, now_unix_ms).await?;
        }
        // The answer to the first request may be lost, so the client never saw its token. A repeated request gets a new one.
        let token = NewToken {
            secret: new.token,
            kind: TokenScope::Run,
            name: "",
            team: Some(new.team),
            expires_unix_ms: None,
        };
        insert_token(&mut tx, &token, Some(&id), now_unix_ms).await?;
        let run = read_run(&mut tx, &id).await?;
        let quotas = read_quotas(&mut tx, &phase, new.team, now_unix_ms).await?;
        tx.commit().await?;
        Ok(StartedRun { run, is_new, quotas })
    }
}

/// Returns the run from an earlier request with the same id. A different request with this id is an error.
async fn find_earlier_run(tx: &mut Transaction<'_>, new: &NewRun<'_>) -> Result<Option<String>> {
    let Some(request) = new.client_request_id else { return Ok(None) };
    let select = "SELECT id, phase = $3 AND method = $4 AND version = $5 AND mission_order = $6 \
                  FROM runs WHERE team = $1 AND client_request_id = $2";
    let found: Option<(String, bool)> = sqlx::query_as(select)
        .bind(new.team)
        .bind(request)
        .bind(new.phase)
        .bind(&new.method.name)
        .bind(&new.method.version)
        .bind(new.order.as_str())
        .fetch_optional(&mut **tx)
        .await?;
    match found {
        Some((_, false)) => Err(StoreError::Taken { what: "client request id", name: request.to_owned() }),
        found => Ok(found.map(|(id, _)| id)),
    }
}

async fn check_start(
    tx: &mut Transaction<'_>,
    new: &NewRun<'_>,
    phase: &Phase,
    now_unix_ms: i64,
) -> Result<()> {
    // Quotas are tested last: waiting helps against a used-up quota, so lasting reasons are reported first.
    check_admission(tx, phase, new.team).await?;
    phase.check_open(now_unix_ms)?;
    if phase.sealed && !new.digests.contains_key(Run::SEALED) {
        return Err(StoreError::PhaseSealed(phase.id.clone()));
    }
    if !phase.orders.contains(&new.order) {
        return Err(StoreError::OrderNotAllowed { phase: phase.id.clone(), order: new.order.as_str() });
    }
    check_quotas(&read_quotas(tx, phase, new.team, now_unix_ms).await?)
}

async fn insert_run(
    tx: &mut Transaction<'_>,
    new: &NewRun<'_>,
    phase: &Phase,
    now_unix_ms: i64,
) -> Result<()> {
    let insert = "INSERT INTO runs (id, phase, team, method, version, mission_order, state, client_request_id, digests, \
                  created_ms, episodes, deadline_ms, method_description, method_code_url, method_paper_url, \
                  method_weights_licence, method_external_data, method_type) \
                  VALUES ($1, $2, $3, $4, $5, $6, 'created', $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17)";
    // A limit of 0 s means no wall time; the run then ends with its phase.
    let wall_ms = (phase.time.run_s > 0).then(|| 1000 * i64::from(phase.time.run_s));
    let method = new.method;
    sqlx::query(insert)
        .bind(new.id)
        .bind(new.phase)
        .bind(new.team)
        .bind(&method.name)
        .bind(&method.version)
        .bind(new.order.as_str())
        .bind(new.client_request_id)
        .bind(Json(new.digests))
        .bind(now_unix_ms)
        .bind(phase.episodes_of_run())
        .bind(wall_ms.map(|wall_ms| now_unix_ms.saturating_add(wall_ms)))
        .bind(filled(&method.description))
        .bind(filled(&method.code_url))
        .bind(filled(&method.paper_url))
        .bind(filled(&method.weights_licence))
        .bind(filled(&method.external_data))
        .bind(method.method_type.map(MethodType::as_str))
        .execute(&mut **tx)
        .await?;
    insert_episodes(tx, new.id, phase).await?;
    sqlx::query("INSERT INTO run_summaries (run) VALUES ($1)").bind(new.id).execute(&mut **tx).await?;
    Ok(())
}

/// Returns `None` for an empty text, stored as null.
fn filled(text: &str) -> Option<&str> {
    Some(text).filter(|text| !text.is_empty())
}

async fn insert_episodes(tx: &mut Transaction<'_>, run: &str, phase: &Phase) -> Result<()> {
    if phase.sampling == Sampling::default() {
        // One statement copies the whole list.
        let all = "INSERT INTO episodes (run, ordinal, episode, scene, state) \
                   SELECT $1, ordinal, episode, scene, 'pending' FROM phase_episodes WHERE phase = $2";
        sqlx::query(all).bind(run).bind(&phase.id).execute(&mut **tx).await?;
        return Ok(());
    }
    let key = read_key(tx, &phase.id).await?;
    let key = key.ok_or_else(|| StoreError::unknown("secret of phase", &phase.id))?;
    let insert =
        "INSERT INTO episodes (run, ordinal, episode, scene, state) VALUES ($1, $2, $3, $4, 'pending')";
    for (ordinal, index) in draw(&phase.episodes, phase.sampling, &key, run).into_iter().enumerate() {
        let PhaseEpisode { episode, scene, .. } = &phase.episodes[index];
        let row = sqlx::query(insert).bind(run).bind(ordinal as i64).bind(episode).bind(scene);
        row.execute(&mut **tx).await?;
    }
    Ok(())
}
