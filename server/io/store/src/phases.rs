//! Phases as configured by the organiser, and the splits and scenes that they use.

use crate::{
    accounts::{AuditNote, add_notes},
    database::{Store, Transaction, json, word},
    error::{Result, StoreError},
};
use avln_challenge::{
    Admission, PhaseEpisode, PhaseState, QuotaLimits, RunChoice, Sampling, Schedule, Visibility,
};
use avln_episode::{Order, Rules, Sensors, TimeLimits};
use avln_scoring::Key;
use serde::{Deserialize, Serialize};
use sqlx::{FromRow, Row, sqlite::SqliteRow, types::Json};
use std::collections::BTreeMap;

/// A playable part of the challenge: missions, rules, limits and result visibility.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// Id in URLs and requests.
    pub id: String,
    /// Title on pages.
    pub title: String,
    /// Text for people; may be empty.
    pub description: String,
    /// Position in the organiser's list, from 0.
    pub position: u32,
    /// Split name.
    pub split: String,
    /// Rules with all options, including the feedback to a Submit.
    pub rules: Rules,
    /// Playable mission orders.
    pub orders: Vec<Order>,
    /// Available sensors; width and height are maxima.
    pub sensors: Sensors,
    /// Score visibility.
    pub scores: Visibility,
    /// Visibility of paths, maps and targets.
    pub replays: Visibility,
    /// Maximum parallel episodes per run, at least 1.
    pub max_slots: u32,
    /// Period in which runs can start.
    pub schedule: Schedule,
    /// Run limits per team.
    pub quotas: QuotaLimits,
    /// Agent time limits.
    pub time: TimeLimits,
    /// Default ranking.
    pub ranking: Ranking,
    /// Admitted teams.
    pub admission: Admission,
    /// Episode selection and order per run.
    pub sampling: Sampling,
    /// True if the phase accepts sealed runs only.
    pub sealed: bool,
    /// Episodes; runs play them in this order unless `sampling` changes it.
    pub episodes: Vec<PhaseEpisode>,
}

/// A phase's default ranking.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Ranking {
    /// The metric.
    pub key: Key,
    /// Selection rule for a method with several runs.
    pub entry: RunChoice,
}

impl Phase {
    /// Returns a phase without limits: open at any time, for all teams, in both orders, with public results.
    pub fn new(id: &str, split: &str, rules: Rules, episodes: Vec<PhaseEpisode>) -> Self {
        Self {
            id: id.to_owned(),
            title: id.to_owned(),
            description: String::new(),
            position: 0,
            split: split.to_owned(),
            rules,
            orders: vec![Order::Ordered, Order::Unordered],
            sensors: Sensors::all(512, 512),
            scores: Visibility::Public,
            replays: Visibility::Public,
            max_slots: 16,
            schedule: Schedule::default(),
            quotas: QuotaLimits::default(),
            time: TimeLimits::default(),
            ranking: Ranking::default(),
            admission: Admission::default(),
            sampling: Sampling::default(),
            sealed: false,
            episodes,
        }
    }

    /// Returns whether scores or replays are hidden from other teams.
    pub fn is_hidden(&self) -> bool {
        [self.scores, self.replays] != [Visibility::Public; 2]
    }

    /// Counts episodes in a run.
    pub fn episodes_of_run(&self) -> u32 {
        self.sampling.episodes_of_run(self.episodes.len() as u32)
    }

    /// Rejects a start at `now_unix_ms` unless the phase is open.
    pub(crate) fn check_open(&self, now_unix_ms: i64) -> Result<()> {
        let phase = self.id.clone();
        match self.schedule.state(now_unix_ms) {
            PhaseState::Open => Ok(()),
            PhaseState::Closed => Err(StoreError::PhaseClosed(phase)),
            PhaseState::Upcoming => {
                let opens_unix_ms = self.schedule.opens_unix_ms.unwrap_or_default();
                Err(StoreError::PhaseNotOpen { phase, opens_unix_ms })
            }
            PhaseState::Paused => {
                let reason = self.schedule.paused.clone().unwrap_or_default();
                Err(StoreError::PhasePaused { phase, reason })
            }
        }
    }

    /// Returns whether both phases draw the same episodes under the same rules.
    fn plays_as(&self, other: &Self) -> bool {
        self.split == other.split
            && self.rules == other.rules
            && self.episodes == other.episodes
            && self.sampling == other.sampling
    }
}

impl FromRow<'_, SqliteRow> for Phase {
    /// Reads a row, without episodes.
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        Ok(Self {
            id: row.try_get("id")?,
            title: row.try_get("title")?,
            description: row.try_get("description")?,
            position: row.try_get("position")?,
            split: row.try_get("split")?,
            rules: json(row, "rules")?,
            orders: json(row, "orders")?,
            sensors: json(row, "sensors")?,
            scores: word(row, "scores")?,
            replays: word(row, "replays")?,
            max_slots: row.try_get("max_slots")?,
            schedule: Schedule {
                opens_unix_ms: row.try_get("opens_ms")?,
                closes_unix_ms: row.try_get("closes_ms")?,
                paused: row.try_get("paused")?,
                closed: row.try_get::<&str, _>("state")? == CLOSED,
            },
            quotas: json(row, "quotas")?,
            time: json(row, "time")?,
            ranking: json(row, "ranking")?,
            admission: json(row, "admission")?,
            sampling: json(row, "sampling")?,
            sealed: row.try_get("sealed")?,
            episodes: Vec::new(),
        })
    }
}

/// Words of the column `state`, which stores closing by hand only.
const OPEN: &str = "open";
const CLOSED: &str = "closed";

/// Splits with a published secret: the publishing phase by digest of the split.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PublishedSplits(BTreeMap<String, String>);

impl PublishedSplits {
    /// Rejects a hidden phase that would accept runs on one of these splits; `digest` is that of the phase's split.
    pub fn check(&self, phase: &Phase, digest: &str, now_unix_ms: i64) -> Result<()> {
        let accepts_runs = phase.schedule.state(now_unix_ms) != PhaseState::Closed;
        match self.0.get(digest) {
            Some(by) if accepts_runs && phase.is_hidden() => Err(StoreError::SecretPublished {
                phase: phase.id.clone(),
                split: phase.split.clone(),
                by: by.clone(),
            }),
            _ => Ok(()),
        }
    }
}

impl Store {
    /// Adds or changes a phase without an audit line. Runs fix split, rules, episodes and sampling. Fails if the split or a
    /// scene is unknown, runs or a revealed commitment fix a changed value, a revealed phase would accept runs again, or a
    /// hidden phase would accept runs on a split with a published secret.
    pub async fn upsert_phase(&self, phase: &Phase, now_unix_ms: i64) -> Result<()> {
        self.change_phases(std::slice::from_ref(phase), &[], now_unix_ms).await
    }

    /// Adds or changes phases as [`Store::upsert_phase`] does, with audit lines, in one transaction.
    pub async fn change_phases(&self, phases: &[Phase], notes: &[AuditNote], now_unix_ms: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        for phase in phases {
            check_secrets(&mut tx, phase, now_unix_ms).await?;
            change_phase(&mut tx, phase, now_unix_ms).await?;
        }
        add_notes(&mut tx, notes, now_unix_ms).await?;
        Ok(tx.commit().await?)
    }

    /// Returns the phase called `id`. Fails with [`StoreError::Unknown`] if there is none.
    pub async fn phase(&self, id: &str) -> Result<Phase> {
        let mut tx = self.read.begin().await?;
        find_phase(&mut tx, id).await
    }

    /// Returns all phases in the organiser's order.
    pub async fn phases(&self) -> Result<Vec<Phase>> {
        let mut tx = self.read.begin().await?;
        read_phases(&mut tx, None).await
    }

    /// Returns whether the phase has runs.
    pub async fn has_runs(&self, phase: &str) -> Result<bool> {
        let mut tx = self.read.begin().await?;
        has_runs(&mut tx, phase).await
    }
}

/// Returns the splits with a published secret, each with the first phase that published it.
pub(crate) async fn read_published(tx: &mut Transaction<'_>) -> Result<PublishedSplits> {
    let select = "SELECT s.digest, k.phase FROM phase_secrets k JOIN phases p ON p.id = k.phase \
                  JOIN splits s ON s.name = p.split WHERE k.seed IS NOT NULL ORDER BY k.revealed_ms DESC, k.phase DESC";
    let rows: Vec<(String, String)> = sqlx::query_as(select).fetch_all(&mut **tx).await?;
    Ok(PublishedSplits(rows.into_iter().collect()))
}

/// Returns whether the values behind a phase's commitment are published.
async fn is_revealed(tx: &mut Transaction<'_>, phase: &str) -> Result<bool> {
    let select = "SELECT EXISTS (SELECT 1 FROM phase_secrets WHERE phase = $1 AND revealed_ms IS NOT NULL)";
    Ok(sqlx::query_scalar(select).bind(phase).fetch_one(&mut **tx).await?)
}

/// Rejects a phase that would accept runs although published secrets show its episodes.
async fn check_secrets(tx: &mut Transaction<'_>, phase: &Phase, now_unix_ms: i64) -> Result<()> {
    let is_closed = phase.schedule.state(now_unix_ms) == PhaseState::Closed;
    if !is_closed && is_revealed(tx, &phase.id).await? {
        return Err(StoreError::Revealed(phase.id.clone()));
    }
    let select = "SELECT digest FROM splits WHERE name = $1";
    let digest: Option<String> =
        sqlx::query_scalar(select).bind(&phase.split).fetch_optional(&mut **tx).await?;
    match digest {
        Some(digest) => read_published(tx).await?.check(phase, &digest, now_unix_ms),
        None => Err(StoreError::unknown("split", &phase.split)),
    }
}

async fn change_phase(tx: &mut Transaction<'_>, phase: &Phase, now_unix_ms: i64) -> Result<()> {
    check_scenes(tx, phase).await?;
    let before = read_phases(tx, Some(&phase.id)).await?.pop();
    let plays_differently = before.as_ref().is_none_or(|before| !before.plays_as(phase));
    // Runs before and after such a change could not be compared on one leaderboard.
    if plays_differently && before.is_some() && has_runs(tx, &phase.id).await? {
        return Err(StoreError::Taken { what: "phase with runs", name: phase.id.clone() });
    }
    // Other episodes would get another commitment, in place of the published one.
    if plays_differently && is_revealed(tx, &phase.id).await? {
        return Err(StoreError::Revealed(phase.id.clone()));
    }
    write_phase(tx, phase, now_unix_ms).await?;
    if plays_differently { write_phase_episodes(tx, phase).await } else { Ok(()) }
}

async fn check_scenes(tx: &mut Transaction<'_>, phase: &Phase) -> Result<()> {
    let known: Vec<String> =
        sqlx::query_scalar("SELECT name FROM scenes ORDER BY name").fetch_all(&mut **tx).await?;
    let missing = phase.episodes.iter().find(|episode| known.binary_search(&episode.scene).is_err());
    missing.map_or(Ok(()), |episode| Err(StoreError::unknown("scene", &episode.scene)))
}

pub(crate) async fn has_runs(tx: &mut Transaction<'_>, phase: &str) -> Result<bool> {
    let select = "SELECT EXISTS (SELECT 1 FROM runs WHERE phase = $1)";
    Ok(sqlx::query_scalar(select).bind(phase).fetch_one(&mut **tx).await?)
}

async fn write_phase(tx: &mut Transaction<'_>, phase: &Phase, now_unix_ms: i64) -> Result<()> {
    // `created_ms` is not updated: it orders phases with equal positions.
    let upsert = "INSERT INTO phases (id, title, description, position, split, rules, orders, sensors, scores, \
         replays, max_slots, state, opens_ms, closes_ms, paused, quotas, time, ranking, admission, sampling, created_ms, sealed) \
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17, $18, $19, $20, $21, $22) \
         ON CONFLICT (id) DO UPDATE SET title = excluded.title, description = excluded.description, \
         position = excluded.position, split = excluded.split, \
         rules = excluded.rules, orders = excluded.orders, sensors = excluded.sensors, scores = excluded.scores, \
         replays = excluded.replays, max_slots = excluded.max_slots, state = excluded.state, \
         opens_ms = excluded.opens_ms, closes_ms = excluded.closes_ms, paused = excluded.paused, \
         quotas = excluded.quotas, time = excluded.time, ranking = excluded.ranking, \
         admission = excluded.admission, sampling = excluded.sampling, sealed = excluded.sealed";
    sqlx::query(upsert)
        .bind(&phase.id)
        .bind(&phase.title)
        .bind(&phase.description)
        .bind(phase.position)
        .bind(&phase.split)
        .bind(Json(&phase.rules))
        .bind(Json(&phase.orders))
        .bind(Json(&phase.sensors))
        .bind(phase.scores.as_str())
        .bind(phase.replays.as_str())
        .bind(phase.max_slots)
        .bind(if phase.schedule.closed { CLOSED } else { OPEN })
        .bind(phase.schedule.opens_unix_ms)
        .bind(phase.schedule.closes_unix_ms)
        .bind(&phase.schedule.paused)
        .bind(Json(&phase.quotas))
        .bind(Json(&phase.time))
        .bind(Json(&phase.ranking))
        .bind(Json(&phase.admission))
        .bind(Json(&phase.sampling))
        .bind(now_unix_ms)
        .bind(phase.sealed)
        .execute(&mut **tx)
        .await?;
    Ok(())
}

async fn write_phase_episodes(tx: &mut Transaction<'_>, phase: &Phase) -> Result<()> {
    sqlx::query("DELETE FROM phase_episodes WHERE phase = $1").bind(&phase.id).execute(&mut **tx).await?;
    let insert =
        "INSERT INTO phase_episodes (phase, ordinal, episode, scene, goals) VALUES ($1, $2, $3, $4, $5)";
    for (ordinal, episode) in phase.episodes.iter().enumerate() {
        sqlx::query(insert)
            .bind(&phase.id)
            .bind(ordinal as i64)
            .bind(&episode.episode)
            .bind(&episode.scene)
            .bind(Json(&episode.goals))
            .execute(&mut **tx)
            .await?;
    }
    Ok(())
}

/// A phase without episodes, for lists and pages.
#[derive(Clone, Debug)]
pub(crate) struct PhaseHead {
    pub(crate) phase: Phase,
    pub(crate) episodes: u32,
    pub(crate) scenes: u32,
}

/// Returns the head for phase `id`, or for all phases.
pub(crate) async fn read_heads(tx: &mut Transaction<'_>, id: Option<&str>) -> Result<Vec<PhaseHead>> {
    let counts = "SELECT COUNT(*), COUNT(DISTINCT scene) FROM phase_episodes WHERE phase = $1";
    let mut heads = Vec::new();
    for phase in read_rows(tx, id).await? {
        let (episodes, scenes) = sqlx::query_as(counts).bind(&phase.id).fetch_one(&mut **tx).await?;
        heads.push(PhaseHead { phase, episodes, scenes });
    }
    Ok(heads)
}

/// Returns the phase called `id`, or all phases.
pub(crate) async fn read_phases(tx: &mut Transaction<'_>, id: Option<&str>) -> Result<Vec<Phase>> {
    let mut phases = read_rows(tx, id).await?;
    for phase in &mut phases {
        phase.episodes = read_phase_episodes(tx, &phase.id).await?;
    }
    Ok(phases)
}

pub(crate) async fn find_phase(tx: &mut Transaction<'_>, id: &str) -> Result<Phase> {
    read_phases(tx, Some(id)).await?.pop().ok_or_else(|| StoreError::unknown("phase", id))
}

async fn read_rows(tx: &mut Transaction<'_>, id: Option<&str>) -> Result<Vec<Phase>> {
    let select = "SELECT id, title, description, position, split, rules, orders, sensors, scores, replays, \
         max_slots, state, opens_ms, closes_ms, paused, quotas, time, ranking, admission, sampling, sealed \
         FROM phases WHERE $1 IS NULL OR id = $1 ORDER BY position, created_ms, id";
    Ok(sqlx::query_as(select).bind(id).fetch_all(&mut **tx).await?)
}

async fn read_phase_episodes(tx: &mut Transaction<'_>, phase: &str) -> Result<Vec<PhaseEpisode>> {
    let select = "SELECT episode, scene, goals FROM phase_episodes WHERE phase = $1 ORDER BY ordinal";
    let rows: Vec<(String, String, Json<_>)> =
        sqlx::query_as(select).bind(phase).fetch_all(&mut **tx).await?;
    let episode = |(episode, scene, Json(goals))| PhaseEpisode { episode, scene, goals };
    Ok(rows.into_iter().map(episode).collect())
}

/// A set of missions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Split name.
    pub name: String,
    /// Hash over all episodes.
    pub digest: String,
    /// Scene count.
    pub scenes: u32,
    /// Episode count.
    pub episodes: u32,
}

/// A scene's public part.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Scene name.
    pub name: String,
    /// Content hash.
    pub digest: String,
    /// Floor plan.
    pub map: SceneMap,
}

/// A floor plan in the world frame (Y up), metres.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct SceneMap {
    /// Building minimum corner: x, y, z.
    pub min: [f32; 3],
    /// Building maximum corner: x, y, z.
    pub max: [f32; 3],
    /// Walkable polygons, each a closed ring of x, y, z.
    pub polygons: Vec<Vec<[f32; 3]>>,
}

impl Store {
    /// Adds a split. A repeated call has no effect. Fails if a split with this name has another digest.
    pub async fn upsert_split(&self, split: &Split) -> Result<()> {
        let insert = "INSERT INTO splits (name, digest, scenes, episodes) VALUES ($1, $2, $3, $4) ON CONFLICT DO NOTHING";
        sqlx::query(insert)
            .bind(&split.name)
            .bind(&split.digest)
            .bind(split.scenes)
            .bind(split.episodes)
            .execute(&self.write)
            .await?;
        let select = "SELECT digest FROM splits WHERE name = $1";
        let stored: String = sqlx::query_scalar(select).bind(&split.name).fetch_one(&self.read).await?;
        check_digest("split", &split.name, &stored, &split.digest)
    }

    /// Returns all split names.
    pub async fn split_names(&self) -> Result<Vec<String>> {
        Ok(sqlx::query_scalar("SELECT name FROM splits ORDER BY name").fetch_all(&self.read).await?)
    }

    /// Returns a split's digest; `None` if there is no split with this name.
    pub async fn split_digest(&self, name: &str) -> Result<Option<String>> {
        let select = "SELECT digest FROM splits WHERE name = $1";
        Ok(sqlx::query_scalar(select).bind(name).fetch_optional(&self.read).await?)
    }

    /// Adds a scene or replaces the map, never by one without polygons. Fails if a scene with this name has another digest.
    pub async fn upsert_scene(&self, scene: &Scene) -> Result<()> {
        let mut tx = self.begin().await?;
        let select = "SELECT digest FROM scenes WHERE name = $1";
        let stored: Option<String> =
            sqlx::query_scalar(select).bind(&scene.name).fetch_optional(&mut *tx).await?;
        if let Some(stored) = stored {
            check_digest("scene", &scene.name, &stored, &scene.digest)?;
        }
        let upsert = "INSERT INTO scenes (name, digest, map) VALUES ($1, $2, $3) \
                      ON CONFLICT (name) DO UPDATE SET map = excluded.map WHERE $4";
        sqlx::query(upsert)
            .bind(&scene.name)
            .bind(&scene.digest)
            .bind(Json(&scene.map))
            .bind(!scene.map.polygons.is_empty())
            .execute(&mut *tx)
            .await?;
        Ok(tx.commit().await?)
    }
}

fn check_digest(what: &'static str, name: &str, stored: &str, given: &str) -> Result<()> {
    if stored == given { Ok(()) } else { Err(StoreError::Taken { what, name: name.to_owned() }) }
}
