use crate::{
    Store, StoreError,
    words::{count, from_json, row, to_json, words},
};
use avln_episode::{Modality, Order, Rules, Sensors};
use serde::{Deserialize, Serialize};
use sqlx::{Sqlite, Transaction};

/// A set of missions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// Its name.
    pub name: String,
    /// Hash of all of its episodes.
    pub digest: String,
    /// Scenes that occur in it.
    pub scenes: u32,
    /// Episodes in it.
    pub episodes: u32,
}

/// A building, as far as pages show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Its name.
    pub name: String,
    /// Hash of its content.
    pub digest: String,
    /// Its floor plan.
    pub map: SceneMap,
}

/// A floor plan in the world frame (Y up), metres.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneMap {
    /// Smallest corner of the building: x, y, z.
    pub min: [f32; 3],
    /// Largest corner of the building: x, y, z.
    pub max: [f32; 3],
    /// Walkable polygons, each a closed ring of x, y, z.
    pub polygons: Vec<Vec<[f32; 3]>>,
}

/// Who may see something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Visibility {
    /// Everybody.
    Public,
    /// The team whose run it is.
    Team,
    /// The organiser alone.
    Organiser,
}
words!(Visibility, "visibility", { Public => "public", Team => "team", Organiser => "organiser" });

/// Whether runs may start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PhaseState {
    /// Runs may start.
    Open,
    /// Runs that were started may go on, none may start.
    Closed,
}
words!(PhaseState, "phase state", { Open => "open", Closed => "closed" });

/// What can be played, under which rules, and who may see the results.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// Id in URLs and requests.
    pub id: String,
    /// Heading on pages.
    pub title: String,
    /// The missions' split.
    pub split: String,
    /// The rules, with every option; what agents learn from a Submit is one of them.
    pub rules: Rules,
    /// Orders that a run may choose.
    pub orders: Vec<Order>,
    /// The most that an agent may ask for.
    pub sensors: Sensors,
    /// Who may see scores.
    pub scores: Visibility,
    /// Who may see paths, maps and targets.
    pub replays: Visibility,
    /// Episodes that a run may play side by side, at least 1.
    pub max_slots: u32,
    /// Runs that a team may start; `None` for any number.
    pub quota: Option<u32>,
    /// Whether runs may start.
    pub state: PhaseState,
    /// The episodes in playing order.
    pub episodes: Vec<PhaseEpisode>,
}

/// One episode of a phase.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhaseEpisode {
    /// Id of the episode inside the split.
    pub episode: String,
    /// Name of the scene.
    pub scene: String,
    /// The goals in the order of the mission.
    pub goals: Vec<GoalText>,
}

/// How a goal is told, in words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct GoalText {
    /// Which kind of cue the agent gets.
    pub modality: Modality,
    /// The category's label or the sentence; `None` for a picture.
    pub text: Option<String>,
}

row! {
    struct PhaseRow {
        id: String,
        title: String,
        split: String,
        rules: String,
        orders: String,
        sensors: String,
        scores: String,
        replays: String,
        max_slots: i64,
        quota: Option<i64>,
        state: String,
    }
}

const SELECT_PHASES: &str = "SELECT id, title, split, rules, orders, sensors, scores, replays, max_slots, quota, state \
                             FROM phases WHERE $1 IS NULL OR id = $1 ORDER BY created_ms, id";

impl Store {
    /// Adds a split; adding the same one again changes nothing.
    ///
    /// # Errors
    /// When the name is taken by a split with another digest, or the database fails.
    pub async fn upsert_split(&self, split: &Split) -> Result<(), StoreError> {
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
        same_digest("split", &split.name, &stored, &split.digest)
    }

    /// Adds a scene, or gives the same scene a new map; a map without polygons leaves the one that is there.
    ///
    /// # Errors
    /// When the name is taken by a scene with another digest, or the database fails.
    pub async fn upsert_scene(&self, scene: &Scene) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        let select = "SELECT digest FROM scenes WHERE name = $1";
        let stored: Option<String> =
            sqlx::query_scalar(select).bind(&scene.name).fetch_optional(&mut *tx).await?;
        if let Some(stored) = stored {
            same_digest("scene", &scene.name, &stored, &scene.digest)?;
        }
        let upsert = "INSERT INTO scenes (name, digest, map) VALUES ($1, $2, $3) \
                      ON CONFLICT (name) DO UPDATE SET map = excluded.map WHERE $4";
        let map = to_json("map", &scene.map)?;
        let drawn = !scene.map.polygons.is_empty();
        let insert = sqlx::query(upsert).bind(&scene.name).bind(&scene.digest).bind(map).bind(drawn);
        insert.execute(&mut *tx).await?;
        Ok(tx.commit().await?)
    }

    /// Adds a phase or changes it. Once it has runs, its split, rules and episodes are fixed.
    ///
    /// # Errors
    /// When the split or a scene is unknown, when runs fix what would change, or the database fails.
    pub async fn upsert_phase(&self, phase: &Phase, now_unix_ms: i64) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        refuse_unknown_parts(&mut tx, phase).await?;
        let before = read_phases(&mut tx, Some(&phase.id)).await?.pop();
        let fixed = |p: &Phase| (p.split.clone(), p.rules.clone(), p.episodes.clone());
        let moved = before.as_ref().is_none_or(|before| fixed(before) != fixed(phase));
        if moved && before.is_some() && has_runs(&mut tx, &phase.id).await? {
            return Err(StoreError::Taken { what: "phase with runs", name: phase.id.clone() });
        }
        write_phase(&mut tx, phase, now_unix_ms).await?;
        if moved {
            write_phase_episodes(&mut tx, phase).await?;
        }
        Ok(tx.commit().await?)
    }

    /// The phase called `id`.
    ///
    /// # Errors
    /// When there is none ([`StoreError::Unknown`]) or the database fails.
    pub async fn phase(&self, id: &str) -> Result<Phase, StoreError> {
        let mut tx = self.read.begin().await?;
        read_phases(&mut tx, Some(id)).await?.pop().ok_or_else(|| StoreError::unknown("phase", id))
    }

    /// All phases, the oldest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn phases(&self) -> Result<Vec<Phase>, StoreError> {
        let mut tx = self.read.begin().await?;
        read_phases(&mut tx, None).await
    }
}

fn same_digest(what: &'static str, name: &str, stored: &str, given: &str) -> Result<(), StoreError> {
    if stored == given { Ok(()) } else { Err(StoreError::Taken { what, name: name.to_owned() }) }
}

async fn refuse_unknown_parts(tx: &mut Transaction<'_, Sqlite>, phase: &Phase) -> Result<(), StoreError> {
    let split: Option<i64> = sqlx::query_scalar("SELECT 1 FROM splits WHERE name = $1")
        .bind(&phase.split)
        .fetch_optional(&mut **tx)
        .await?;
    split.ok_or_else(|| StoreError::unknown("split", &phase.split))?;
    let known: Vec<String> =
        sqlx::query_scalar("SELECT name FROM scenes ORDER BY name").fetch_all(&mut **tx).await?;
    let missing = phase.episodes.iter().find(|e| known.binary_search(&e.scene).is_err());
    missing.map_or(Ok(()), |episode| Err(StoreError::unknown("scene", &episode.scene)))
}

async fn has_runs(tx: &mut Transaction<'_, Sqlite>, phase: &str) -> Result<bool, StoreError> {
    let select = "SELECT EXISTS (SELECT 1 FROM runs WHERE phase = $1)";
    Ok(sqlx::query_scalar(select).bind(phase).fetch_one(&mut **tx).await?)
}

async fn write_phase(
    tx: &mut Transaction<'_, Sqlite>,
    phase: &Phase,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let upsert = "INSERT INTO phases (id, title, split, rules_name, rules, orders, sensors, scores, replays, max_slots, \
                  quota, state, created_ms) VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13) \
                  ON CONFLICT (id) DO UPDATE SET title = excluded.title, split = excluded.split, \
                  rules_name = excluded.rules_name, rules = excluded.rules, orders = excluded.orders, \
                  sensors = excluded.sensors, scores = excluded.scores, replays = excluded.replays, \
                  max_slots = excluded.max_slots, quota = excluded.quota, state = excluded.state";
    sqlx::query(upsert)
        .bind(&phase.id)
        .bind(&phase.title)
        .bind(&phase.split)
        .bind(&phase.rules.name)
        .bind(to_json("rules", &phase.rules)?)
        .bind(to_json("orders", &phase.orders)?)
        .bind(to_json("sensors", &phase.sensors)?)
        .bind(phase.scores.as_str())
        .bind(phase.replays.as_str())
        .bind(phase.max_slots)
        .bind(phase.quota)
        .bind(phase.state.as_str())
        .bind(now_unix_ms)
        .execute(&mut **tx)
        .await?;
    Ok(())
}

async fn write_phase_episodes(tx: &mut Transaction<'_, Sqlite>, phase: &Phase) -> Result<(), StoreError> {
    sqlx::query("DELETE FROM phase_episodes WHERE phase = $1").bind(&phase.id).execute(&mut **tx).await?;
    let insert =
        "INSERT INTO phase_episodes (phase, ordinal, episode, scene, goals) VALUES ($1, $2, $3, $4, $5)";
    for (ordinal, episode) in phase.episodes.iter().enumerate() {
        sqlx::query(insert)
            .bind(&phase.id)
            .bind(ordinal as i64)
            .bind(&episode.episode)
            .bind(&episode.scene)
            .bind(to_json("goals", &episode.goals)?)
            .execute(&mut **tx)
            .await?;
    }
    Ok(())
}

/// A phase without its episodes, and how many there are.
#[derive(Clone, Debug)]
pub(crate) struct PhaseHead {
    pub(crate) phase: Phase,
    pub(crate) episodes: u32,
    pub(crate) scenes: u32,
}

/// The head of the phase called `id`, or of all phases.
pub(crate) async fn read_heads(
    tx: &mut Transaction<'_, Sqlite>,
    id: Option<&str>,
) -> Result<Vec<PhaseHead>, StoreError> {
    let rows: Vec<PhaseRow> = sqlx::query_as(SELECT_PHASES).bind(id).fetch_all(&mut **tx).await?;
    let counts = "SELECT COUNT(*), COUNT(DISTINCT scene) FROM phase_episodes WHERE phase = $1";
    let mut heads = Vec::with_capacity(rows.len());
    for row in rows {
        let (episodes, scenes): (i64, i64) =
            sqlx::query_as(counts).bind(&row.id).fetch_one(&mut **tx).await?;
        heads.push(PhaseHead {
            phase: row.into_phase(vec![])?,
            episodes: count(episodes),
            scenes: count(scenes),
        });
    }
    Ok(heads)
}

/// The phase called `id`, or all of them.
pub(crate) async fn read_phases(
    tx: &mut Transaction<'_, Sqlite>,
    id: Option<&str>,
) -> Result<Vec<Phase>, StoreError> {
    let rows: Vec<PhaseRow> = sqlx::query_as(SELECT_PHASES).bind(id).fetch_all(&mut **tx).await?;
    let mut phases = Vec::with_capacity(rows.len());
    for row in rows {
        let episodes = read_phase_episodes(tx, &row.id).await?;
        phases.push(row.into_phase(episodes)?);
    }
    Ok(phases)
}

async fn read_phase_episodes(
    tx: &mut Transaction<'_, Sqlite>,
    phase: &str,
) -> Result<Vec<PhaseEpisode>, StoreError> {
    let select = "SELECT episode, scene, goals FROM phase_episodes WHERE phase = $1 ORDER BY ordinal";
    let rows: Vec<(String, String, String)> = sqlx::query_as(select).bind(phase).fetch_all(&mut **tx).await?;
    let read = |(episode, scene, goals): (String, String, String)| {
        Ok(PhaseEpisode { episode, scene, goals: from_json("goals", &goals)? })
    };
    rows.into_iter().map(read).collect()
}

impl PhaseRow {
    fn into_phase(self, episodes: Vec<PhaseEpisode>) -> Result<Phase, StoreError> {
        Ok(Phase {
            rules: from_json("rules", &self.rules)?,
            orders: from_json("orders", &self.orders)?,
            sensors: from_json("sensors", &self.sensors)?,
            scores: Visibility::from_word(&self.scores)?,
            replays: Visibility::from_word(&self.replays)?,
            max_slots: count(self.max_slots),
            quota: self.quota.map(count),
            state: PhaseState::from_word(&self.state)?,
            id: self.id,
            title: self.title,
            split: self.split,
            episodes,
        })
    }
}
