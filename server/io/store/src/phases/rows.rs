use super::Phase;
use crate::{
    AuditNote, Promise, Store, StoreError,
    audit::add_notes,
    reveal::read_promise,
    words::{count, from_json, row, to_json},
};
use avln_challenge::{PhaseEpisode, Schedule, Visibility};
use sqlx::{Sqlite, Transaction};

row! {
    struct PhaseRow {
        id: String,
        title: String,
        description: String,
        position: i64,
        split: String,
        rules: String,
        orders: String,
        sensors: String,
        scores: String,
        replays: String,
        max_slots: i64,
        state: String,
        opens_ms: Option<i64>,
        closes_ms: Option<i64>,
        paused: Option<String>,
        quotas: String,
        time: String,
        ranking: String,
        admission: String,
        sampling: String,
        sealed: bool,
    }
}

/// Words of the column `state`.
const OPEN: &str = "open";
const CLOSED: &str = "closed";

const SELECT_PHASES: &str = "SELECT id, title, description, position, split, rules, orders, sensors, scores, replays, \
     max_slots, state, opens_ms, closes_ms, paused, quotas, time, ranking, admission, sampling, sealed \
     FROM phases WHERE $1 IS NULL OR id = $1 ORDER BY position, created_ms, id";

impl Store {
    /// Adds a phase or changes it, without a note in the audit list. Once it has runs, its split, rules, episodes and
    /// sampling are fixed.
    ///
    /// # Errors
    /// When the split or a scene is unknown, when runs fix what would change, or the database fails.
    pub async fn upsert_phase(&self, phase: &Phase, now_unix_ms: i64) -> Result<(), StoreError> {
        self.change_phases(std::slice::from_ref(phase), &[], now_unix_ms).await
    }

    /// Adds or changes phases as [`Store::upsert_phase`] does and notes what was changed: all of it or nothing.
    ///
    /// # Errors
    /// As for [`Store::upsert_phase`].
    pub async fn change_phases(
        &self,
        phases: &[Phase],
        notes: &[AuditNote],
        now_unix_ms: i64,
    ) -> Result<(), StoreError> {
        let mut tx = self.begin().await?;
        for phase in phases {
            change_phase(&mut tx, phase, now_unix_ms).await?;
        }
        add_notes(&mut tx, notes, now_unix_ms).await?;
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

    /// All phases in the organiser's order.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn phases(&self) -> Result<Vec<Phase>, StoreError> {
        let mut tx = self.read.begin().await?;
        read_phases(&mut tx, None).await
    }
}

async fn change_phase(
    tx: &mut Transaction<'_, Sqlite>,
    phase: &Phase,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    refuse_unknown_parts(tx, phase).await?;
    let before = read_phases(tx, Some(&phase.id)).await?.pop();
    let same = |a: &Phase, b: &Phase| {
        (&a.split, &a.rules, &a.episodes, a.sampling) == (&b.split, &b.rules, &b.episodes, b.sampling)
    };
    let moved = before.as_ref().is_none_or(|before| !same(before, phase));
    if moved && before.is_some() && has_runs(tx, &phase.id).await? {
        return Err(StoreError::Taken { what: "phase with runs", name: phase.id.clone() });
    }
    write_phase(tx, phase, now_unix_ms).await?;
    if moved { write_phase_episodes(tx, phase).await } else { Ok(()) }
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

pub(crate) async fn has_runs(tx: &mut Transaction<'_, Sqlite>, phase: &str) -> Result<bool, StoreError> {
    let select = "SELECT EXISTS (SELECT 1 FROM runs WHERE phase = $1)";
    Ok(sqlx::query_scalar(select).bind(phase).fetch_one(&mut **tx).await?)
}

async fn write_phase(
    tx: &mut Transaction<'_, Sqlite>,
    phase: &Phase,
    now_unix_ms: i64,
) -> Result<(), StoreError> {
    let upsert = "INSERT INTO phases (id, title, description, position, split, rules_name, rules, orders, sensors, scores, \
         replays, max_slots, state, opens_ms, closes_ms, paused, quotas, time, ranking, admission, sampling, created_ms, sealed) \
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17, $18, $19, $20, $21, $22, $23) \
         ON CONFLICT (id) DO UPDATE SET title = excluded.title, description = excluded.description, \
         position = excluded.position, split = excluded.split, rules_name = excluded.rules_name, \
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
        .bind(&phase.rules.name)
        .bind(to_json("rules", &phase.rules)?)
        .bind(to_json("orders", &phase.orders)?)
        .bind(to_json("sensors", &phase.sensors)?)
        .bind(phase.scores.as_str())
        .bind(phase.replays.as_str())
        .bind(phase.max_slots)
        .bind(if phase.schedule.closed { CLOSED } else { OPEN })
        .bind(phase.schedule.opens_unix_ms)
        .bind(phase.schedule.closes_unix_ms)
        .bind(&phase.schedule.paused)
        .bind(to_json("quotas", &phase.quotas)?)
        .bind(to_json("time", &phase.time)?)
        .bind(to_json("ranking", &phase.ranking)?)
        .bind(to_json("admission", &phase.admission)?)
        .bind(to_json("sampling", &phase.sampling)?)
        .bind(now_unix_ms)
        .bind(phase.sealed)
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
    pub(crate) promise: Option<Promise>,
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
            promise: read_promise(tx, &row.id).await?,
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
            position: count(self.position),
            schedule: Schedule {
                opens_unix_ms: self.opens_ms,
                closes_unix_ms: self.closes_ms,
                paused: self.paused,
                closed: self.state == CLOSED,
            },
            quotas: from_json("quotas", &self.quotas)?,
            time: from_json("time", &self.time)?,
            ranking: from_json("ranking", &self.ranking)?,
            admission: from_json("admission", &self.admission)?,
            sampling: from_json("sampling", &self.sampling)?,
            sealed: self.sealed,
            id: self.id,
            title: self.title,
            description: self.description,
            split: self.split,
            episodes,
        })
    }
}
