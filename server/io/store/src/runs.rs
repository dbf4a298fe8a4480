use crate::{
    NewToken, Phase, Store, StoreError,
    accounts::insert_token,
    admission::refuse_team,
    phases::{has_runs, read_phases, refuse_closed},
    quota::{read_charge, read_quotas, refuse_used_up},
    reveal::read_key,
    words::{self, count, from_json, row, to_json},
};
use avln_challenge::{Charge, PhaseEpisode, Quota, Ruling, RunState, Sampling, TokenScope, draw};
use avln_episode::{Order, Sensors};
use sqlx::{Sqlite, Transaction};
use std::collections::BTreeMap;

impl Run {
    /// Name in [`Run::digests`] under which a sealed run has what was enforced while it was played.
    pub const SEALED: &'static str = "sealed";
    /// Name in [`Run::digests`] under which a sealed run has what could not be enforced; left out where all was.
    pub const UNSEALED: &'static str = "sealed except";

    /// Name in [`Run::digests`] of the version of the benchmark that scores it.
    pub const SCORER: &'static str = "benchmark";

    /// Version of the benchmark that scored it when it was played; empty where nobody noted it.
    pub fn scorer(&self) -> &str {
        self.digests.get(Self::SCORER).map_or("", String::as_str)
    }

    /// Whether the organiser ran the agent, shut off from everything but the server.
    pub fn is_sealed(&self) -> bool {
        self.digests.contains_key(Self::SEALED)
    }
}

impl Run {
    /// Whether its time is over at `now_unix_ms`.
    pub fn is_overdue(&self, now_unix_ms: i64) -> bool {
        self.deadline_unix_ms.is_some_and(|deadline| deadline <= now_unix_ms)
    }
}

/// A run to be started.
#[derive(Clone, Copy, Debug)]
pub struct NewRun<'a> {
    /// Id for the run, if it is new: `run_` and random letters.
    pub id: &'a str,
    /// Random secret that plays the run; only its hash is kept.
    pub token: &'a str,
    /// What is played.
    pub phase: &'a str,
    /// Who plays.
    pub team: &'a str,
    /// Name of the method.
    pub method: &'a str,
    /// Version of the method.
    pub version: &'a str,
    /// How goals count.
    pub order: Order,
    /// The client's own id of this request: asking again with it gives the same run.
    pub client_request_id: Option<&'a str>,
    /// What is in force, by name: digests and versions of the program, the split, the scorer.
    pub digests: &'a BTreeMap<String, String>,
}

/// A run that was started, now or by an earlier request with the same id.
#[derive(Clone, Debug, PartialEq)]
pub struct StartedRun {
    /// The run.
    pub run: Run,
    /// Whether this request made it.
    pub is_new: bool,
    /// What the team has left in the phase afterwards, the total first.
    pub quotas: Vec<Quota>,
}

/// One pass of one method over all episodes of a phase, or a sample of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Its id.
    pub id: String,
    /// What is played.
    pub phase: String,
    /// Who plays.
    pub team: String,
    /// Name of the method.
    pub method: String,
    /// Version of the method.
    pub version: String,
    /// How goals count.
    pub order: Order,
    /// How far it is.
    pub state: RunState,
    /// Episodes in all.
    pub episodes: u32,
    /// Episodes done.
    pub done: u32,
    /// What the agent asked to sense; `None` before it did.
    pub sensors: Option<Sensors>,
    /// The same with every sense that it had in an earlier session.
    pub senses: Option<Sensors>,
    /// What was in force, by name.
    pub digests: BTreeMap<String, String>,
    /// When it was started.
    pub created_unix_ms: i64,
    /// When it ended.
    pub finished_unix_ms: Option<i64>,
    /// When it ends at the latest: with its wall time or, where it has none, with its phase. `None` for never; in the past
    /// where the organiser closed the phase by hand.
    pub deadline_unix_ms: Option<i64>,
    /// What the organiser ruled on it.
    pub ruling: Ruling,
}

row! {
    pub(crate) struct RunRow {
        id: String,
        phase: String,
        team: String,
        method: String,
        version: String,
        mission_order: String,
        state: String,
        sensors: Option<String>,
        senses: Option<String>,
        digests: String,
        created_ms: i64,
        finished_ms: Option<i64>,
        deadline_ms: Option<i64>,
        episodes: i64,
        done: i64,
        verified: bool,
        disqualified: Option<String>,
    }
}

/// When run `r` of phase `p` ends at the latest; null for never.
macro_rules! deadline {
    () => {
        "COALESCE(r.deadline_ms, CASE p.state WHEN 'closed' THEN r.created_ms ELSE p.closes_ms END)"
    };
}

/// Reads runs that are wanted.
macro_rules! select_runs {
    ($wanted:literal) => {
        concat!(
            "SELECT r.id, r.phase, r.team, r.method, r.version, r.mission_order, r.state, r.sensors, r.senses, \
             r.digests, r.created_ms, r.finished_ms, r.episodes, s.scored + s.given_up AS done, \
             COALESCE(g.verified, 0) AS verified, g.disqualified, ",
            deadline!(),
            " AS deadline_ms FROM runs r JOIN run_summaries s ON s.run = r.id JOIN phases p ON p.id = r.phase \
             LEFT JOIN rulings g ON g.run = r.id WHERE ",
            $wanted
        )
    };
}
const SELECT_RUN: &str = select_runs!("r.id = $1");
const SELECT_RUNS: &str = select_runs!(
    "($1 IS NULL OR r.team = $1) AND ($2 IS NULL OR r.phase = $2) AND ($3 IS NULL OR r.state = $3) \
     ORDER BY r.created_ms DESC, r.id"
);

/// Which runs are wanted; `None` for any.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RunFilter<'a> {
    pub(crate) team: Option<&'a str>,
    pub(crate) phase: Option<&'a str>,
    pub(crate) state: Option<RunState>,
}

impl Store {
    /// Starts a run with the episodes that it draws from its phase pending, and stores its token. The quota is checked and
    /// taken in one transaction.
    ///
    /// A request with the `client_request_id` of an earlier one gives the earlier run, which the new token plays too.
    ///
    /// # Errors
    /// When the phase or team is unknown, the team may not play, the phase is not open, not played in this order or for sealed
    /// runs only, a quota is used up, the request id belongs to a different request, or the database fails.
    pub async fn start_run(&self, new: &NewRun<'_>, now_unix_ms: i64) -> Result<StartedRun, StoreError> {
        if self.team(new.team).await?.is_none() {
            return Err(StoreError::unknown("team", new.team));
        }
        let mut tx = self.begin().await?;
        let phase = read_phases(&mut tx, Some(new.phase)).await?.pop();
        let phase = phase.ok_or_else(|| StoreError::unknown("phase", new.phase))?;
        let earlier = earlier_run(&mut tx, new).await?;
        let is_new = earlier.is_none();
        let id = earlier.unwrap_or_else(|| new.id.to_owned());
        if is_new {
            refuse_start(&mut tx, new, &phase, now_unix_ms).await?;
            insert_run(&mut tx, new, &phase, now_unix_ms).await?;
        }
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

    /// Whether anybody started a run in the phase.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn has_runs(&self, phase: &str) -> Result<bool, StoreError> {
        let mut tx = self.read.begin().await?;
        has_runs(&mut tx, phase).await
    }

    /// Whether a run is charged, and why.
    ///
    /// # Errors
    /// When the run is unknown or the database fails.
    pub async fn charge(&self, run: &str) -> Result<Charge, StoreError> {
        let mut tx = self.read.begin().await?;
        let Run { id, team, phase, .. } = read_run(&mut tx, run).await?;
        read_charge(&mut tx, &team, &phase, &id).await
    }

    /// The run called `id`.
    ///
    /// # Errors
    /// When there is none ([`StoreError::Unknown`]) or the database fails.
    pub async fn run(&self, id: &str) -> Result<Run, StoreError> {
        let mut tx = self.read.begin().await?;
        read_run(&mut tx, id).await
    }

    /// The runs of a phase that were completed, the newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn completed_runs(&self, phase: &str) -> Result<Vec<Run>, StoreError> {
        let mut tx = self.read.begin().await?;
        let state = Some(RunState::Completed);
        read_runs(&mut tx, &RunFilter { phase: Some(phase), state, ..RunFilter::default() }).await
    }

    /// The runs of a team, the newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn runs_of(&self, team: &str) -> Result<Vec<Run>, StoreError> {
        let mut tx = self.read.begin().await?;
        read_runs(&mut tx, &RunFilter { team: Some(team), ..RunFilter::default() }).await
    }

    /// The open runs whose time is over, by id.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn overdue(&self, now_unix_ms: i64) -> Result<Vec<String>, StoreError> {
        let select = concat!(
            "SELECT r.id FROM runs r JOIN phases p ON p.id = r.phase WHERE r.state IN ('created', 'running') AND ",
            deadline!(),
            " <= $1 ORDER BY r.id"
        );
        Ok(sqlx::query_scalar(select).bind(now_unix_ms).fetch_all(&self.read).await?)
    }

    /// The runs that may still be played, the newest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn open_runs(&self) -> Result<Vec<Run>, StoreError> {
        let mut tx = self.read.begin().await?;
        let any = read_runs(&mut tx, &RunFilter::default()).await?;
        Ok(any.into_iter().filter(|run| run.state.is_open()).collect())
    }

    /// Notes what the agent of a run asked to sense in a session, and keeps what it had in those before.
    ///
    /// # Errors
    /// When the run is unknown or the database fails.
    pub async fn set_sensors(&self, run: &str, sensors: &Sensors) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        let before = read_run(&mut tx, run).await?.senses;
        let had = |sense: fn(&Sensors) -> bool| sense(sensors) || before.as_ref().is_some_and(sense);
        let (rgb, depth, audio) = (had(|s| s.rgb), had(|s| s.depth), had(|s| s.audio));
        let senses = to_json("senses", &Sensors { rgb, depth, audio, ..sensors.clone() })?;
        let asked = to_json("sensors", sensors)?;
        let update = "UPDATE runs SET sensors = $1, senses = $2 WHERE id = $3";
        sqlx::query(update).bind(asked).bind(senses).bind(run).execute(&mut *tx).await?;
        Ok(tx.commit().await?)
    }

    /// Gives a run up. A run that is over stays as it is; episodes being played may still be recorded.
    ///
    /// # Errors
    /// When the run is unknown or the database fails.
    pub async fn cancel_run(&self, run: &str, now_unix_ms: i64) -> Result<Run, StoreError> {
        self.end_run(run, RunState::Cancelled, now_unix_ms).await
    }

    /// Ends a run that was not played to its end, as `Cancelled`, `Failed` or `Expired`. A run that is over stays as it is;
    /// episodes being played may still be recorded.
    ///
    /// # Errors
    /// When the run is unknown or the database fails.
    pub async fn end_run(&self, run: &str, state: RunState, now_unix_ms: i64) -> Result<Run, StoreError> {
        let mut tx = self.begin().await?;
        let update = "UPDATE runs SET state = $3, finished_ms = $1 \
                      WHERE id = $2 AND state IN ('created', 'running')";
        sqlx::query(update).bind(now_unix_ms).bind(run).bind(state.as_str()).execute(&mut *tx).await?;
        let run = read_run(&mut tx, run).await?;
        tx.commit().await?;
        Ok(run)
    }
}

/// The run that the same request made before; an error when the id was used for something else.
async fn earlier_run(
    tx: &mut Transaction<'_, Sqlite>,
    new: &NewRun<'_>,
) -> Result<Option<String>, StoreError> {
    let Some(request) = new.client_request_id else { return Ok(None) };
    let select = "SELECT id, phase = $3 AND method = $4 AND version = $5 AND mission_order = $6 \
                  FROM runs WHERE team = $1 AND client_request_id = $2";
    let found: Option<(String, bool)> = sqlx::query_as(select)
        .bind(new.team)
        .bind(request)
        .bind(new.phase)
        .bind(new.method)
        .bind(new.version)
        .bind(new.order.as_str())
        .fetch_optional(&mut **tx)
        .await?;
    match found {
        Some((_, false)) => Err(StoreError::Taken { what: "client request id", name: request.to_owned() }),
        found => Ok(found.map(|(id, _)| id)),
    }
}

async fn refuse_start(
    tx: &mut Transaction<'_, Sqlite>,
    new: &NewRun<'_>,
    phase: &Phase,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    refuse_team(tx, phase, new.team).await?;
    refuse_closed(phase, now_unix_ms)?;
    if phase.sealed && !new.digests.contains_key(Run::SEALED) {
        return Err(StoreError::PhaseSealed(phase.id.clone()));
    }
    if !phase.orders.contains(&new.order) {
        return Err(StoreError::OrderNotAllowed { phase: phase.id.clone(), order: new.order.as_str() });
    }
    refuse_used_up(&read_quotas(tx, phase, new.team, now_unix_ms).await?)
}

async fn insert_run(
    tx: &mut Transaction<'_, Sqlite>,
    new: &NewRun<'_>,
    phase: &Phase,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let insert = "INSERT INTO runs (id, phase, team, method, version, mission_order, state, client_request_id, digests, \
                  created_ms, episodes, deadline_ms) VALUES ($1, $2, $3, $4, $5, $6, 'created', $7, $8, $9, $10, $11)";
    let wall_ms = (phase.time.run_s > 0).then(|| 1000 * i64::from(phase.time.run_s));
    sqlx::query(insert)
        .bind(new.id)
        .bind(new.phase)
        .bind(new.team)
        .bind(new.method)
        .bind(new.version)
        .bind(new.order.as_str())
        .bind(new.client_request_id)
        .bind(to_json("digests", new.digests)?)
        .bind(now_unix_ms)
        .bind(phase.episodes_of_run())
        .bind(wall_ms.map(|wall_ms| now_unix_ms.saturating_add(wall_ms)))
        .execute(&mut **tx)
        .await?;
    insert_episodes(tx, new.id, phase).await?;
    sqlx::query("INSERT INTO run_summaries (run) VALUES ($1)").bind(new.id).execute(&mut **tx).await?;
    Ok(())
}

/// Lays out the episodes that the run plays, in its own order.
async fn insert_episodes(
    tx: &mut Transaction<'_, Sqlite>,
    run: &str,
    phase: &Phase,
) -> Result<(), StoreError> {
    if phase.sampling == Sampling::default() {
        let all = "INSERT INTO episodes (run, ordinal, episode, scene, state) \
                   SELECT $1, ordinal, episode, scene, 'pending' FROM phase_episodes WHERE phase = $2";
        sqlx::query(all).bind(run).bind(&phase.id).execute(&mut **tx).await?;
        return Ok(());
    }
    let key = read_key(tx, &phase.id).await?;
    let key = key.ok_or_else(|| StoreError::unknown("secret of phase", &phase.id))?;
    let drawn = draw(&phase.episodes, phase.sampling, &key, run);
    let insert =
        "INSERT INTO episodes (run, ordinal, episode, scene, state) VALUES ($1, $2, $3, $4, 'pending')";
    for (ordinal, index) in drawn.into_iter().enumerate() {
        let PhaseEpisode { episode, scene, .. } = &phase.episodes[index];
        let row = sqlx::query(insert).bind(run).bind(ordinal as i64).bind(episode).bind(scene);
        row.execute(&mut **tx).await?;
    }
    Ok(())
}

pub(crate) async fn read_run(tx: &mut Transaction<'_, Sqlite>, id: &str) -> Result<Run, StoreError> {
    let row: Option<RunRow> = sqlx::query_as(SELECT_RUN).bind(id).fetch_optional(&mut **tx).await?;
    row.ok_or_else(|| StoreError::unknown("run", id))?.into_run()
}

pub(crate) async fn read_runs(
    tx: &mut Transaction<'_, Sqlite>,
    filter: &RunFilter<'_>,
) -> Result<Vec<Run>, StoreError> {
    let rows: Vec<RunRow> = sqlx::query_as(SELECT_RUNS)
        .bind(filter.team)
        .bind(filter.phase)
        .bind(filter.state.map(RunState::as_str))
        .fetch_all(&mut **tx)
        .await?;
    rows.into_iter().map(RunRow::into_run).collect()
}

impl RunRow {
    fn into_run(self) -> Result<Run, StoreError> {
        Ok(Run {
            order: words::order(&self.mission_order)?,
            state: RunState::from_word(&self.state)?,
            sensors: self.sensors.map(|json| from_json("sensors", &json)).transpose()?,
            senses: self.senses.map(|json| from_json("senses", &json)).transpose()?,
            digests: from_json("digests", &self.digests)?,
            episodes: count(self.episodes),
            done: count(self.done),
            id: self.id,
            phase: self.phase,
            team: self.team,
            method: self.method,
            version: self.version,
            created_unix_ms: self.created_ms,
            finished_unix_ms: self.finished_ms,
            deadline_unix_ms: self.deadline_ms,
            ruling: Ruling { verified: self.verified, disqualified: self.disqualified },
        })
    }
}
