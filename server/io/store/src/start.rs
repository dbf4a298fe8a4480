//! Start of runs.

use crate::{
    accounts::{NewToken, insert_token},
    admission::{check_admission, check_quotas, read_quotas},
    commitment::read_key,
    database::{Store, Transaction},
    error::{Result, StoreError},
    phases::{Phase, find_phase},
    runs::{Run, read_run},
};
use avln_challenge::{MethodInfo, MethodType, PhaseEpisode, Quota, Sampling, TokenScope, draw};
use avln_episode::Order;
use sqlx::types::Json;
use std::collections::BTreeMap;

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
