//! Pages of phases and their missions.

use crate::{
    catalog::SceneMap,
    commitment::Commitment,
    error::StoreError,
    phases::{PhaseHead, Ranking, read_heads},
    quota::read_quotas,
    views::{Reader, Viewer},
};
use avln_challenge::{GoalText, PhaseState, Quota, QuotaLimits, Visibility};
use avln_episode::{FeedbackRule, Modality, Order, Rules, Sensors, TimeLimits};
use avln_scoring::Metrics;
use serde::Serialize;
use sqlx::{Sqlite, Transaction, types::Json};
use std::collections::BTreeMap;

/// A phase on pages. Its existence and rules are public, unless it is restricted to some teams. Times are milliseconds since
/// 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhaseView {
    /// Id in URLs.
    pub id: String,
    /// Title.
    pub title: String,
    /// Text for people; may be empty.
    pub description: String,
    /// State at the time of the request.
    pub state: PhaseState,
    /// Reason of a pause; `None` in other states.
    pub state_reason: Option<String>,
    /// Opening time; `None` if the phase is open from the beginning.
    pub opens_unix_ms: Option<i64>,
    /// Closing time; `None` if it never closes.
    pub closes_unix_ms: Option<i64>,
    /// Playable mission orders.
    pub orders: Vec<Order>,
    /// Rules with all options.
    pub rules: Rules,
    /// Feedback to a Submit.
    pub feedback: FeedbackRule,
    /// Available sensors; width and height are maxima.
    pub sensors: Sensors,
    /// Number of episodes in a run.
    pub episodes: u32,
    /// Number of scenes.
    pub scenes: u32,
    /// Maximum number of parallel episodes of a run.
    pub max_slots: u32,
    /// Maximum numbers of runs of a team.
    pub quotas: QuotaLimits,
    /// Time limits of agents.
    pub time: TimeLimits,
    /// Default ranking.
    pub ranking: Ranking,
    /// Whether the phase accepts sealed runs only.
    pub sealed: bool,
    /// The commitment, and its values after their publication; `None` before the commitment.
    pub promise: Option<Commitment>,
    /// Readers of scores.
    pub scores: Visibility,
    /// Readers of paths, maps and targets.
    pub replays: Visibility,
    /// Whether the viewer sees the scores of all teams.
    pub all_scores_visible: bool,
}

impl PhaseView {
    pub(crate) fn new(head: PhaseHead, viewer: &Viewer, now_unix_ms: i64) -> Self {
        let PhaseHead { phase, episodes, scenes, commitment } = head;
        let state = phase.schedule.state(now_unix_ms);
        Self {
            scenes,
            episodes: phase.sampling.episodes_of_run(episodes),
            promise: commitment,
            state,
            state_reason: phase.schedule.paused.filter(|_| state == PhaseState::Paused),
            opens_unix_ms: phase.schedule.opens_unix_ms,
            closes_unix_ms: phase.schedule.closes_unix_ms,
            description: phase.description,
            feedback: phase.rules.feedback,
            all_scores_visible: viewer.sees_all(phase.scores),
            id: phase.id,
            title: phase.title,
            orders: phase.orders,
            rules: phase.rules,
            sensors: phase.sensors,
            max_slots: phase.max_slots,
            quotas: phase.quotas,
            time: phase.time,
            ranking: phase.ranking,
            sealed: phase.sealed,
            scores: phase.scores,
            replays: phase.replays,
        }
    }
}

/// Statistics of a phase's missions.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MissionsView {
    /// Missions by number of goals.
    pub goals: BTreeMap<u32, u32>,
    /// Goals by modality.
    pub modalities: BTreeMap<&'static str, u32>,
    /// Category goals by category.
    pub categories: BTreeMap<String, u32>,
    /// Lengths of the reference paths in the run completed last, metres, in playing order.
    pub reference_m: Vec<f64>,
    /// Missions by scene.
    pub scenes: BTreeMap<String, u32>,
}

impl MissionsView {
    fn add(&mut self, scene: String, goals: Vec<GoalText>) {
        *self.scenes.entry(scene).or_default() += 1;
        *self.goals.entry(goals.len() as u32).or_default() += 1;
        for GoalText { modality, text } in goals {
            *self.modalities.entry(modality.as_str()).or_default() += 1;
            if modality == Modality::Category {
                *self.categories.entry(text.unwrap_or_default()).or_default() += 1;
            }
        }
    }
}

impl Reader {
    /// Returns the phases visible to the viewer at `now_unix_ms`, in the organiser's order.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn phases(&self, viewer: &Viewer, now_unix_ms: i64) -> Result<Vec<PhaseView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let heads = read_heads(&mut tx, None).await?;
        let visible = heads.into_iter().filter(|head| viewer.knows(&head.phase));
        Ok(visible.map(|head| PhaseView::new(head, viewer, now_unix_ms)).collect())
    }

    /// Returns the phase called `id` at `now_unix_ms`; `None` if there is none visible to the viewer.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn phase(
        &self,
        viewer: &Viewer,
        id: &str,
        now_unix_ms: i64,
    ) -> Result<Option<PhaseView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let head = read_heads(&mut tx, Some(id)).await?.pop();
        let visible = head.filter(|head| viewer.knows(&head.phase));
        Ok(visible.map(|head| PhaseView::new(head, viewer, now_unix_ms)))
    }

    /// Returns the quotas of the viewer's team in each visible phase; empty for other viewers.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn quotas(&self, viewer: &Viewer, now_unix_ms: i64) -> Result<Vec<Quota>, StoreError> {
        let Viewer::Team(team) = viewer else { return Ok(vec![]) };
        let mut tx = self.snapshot().await?;
        let mut quotas = Vec::new();
        for head in read_heads(&mut tx, None).await?.iter().filter(|head| viewer.knows(&head.phase)) {
            quotas.extend(read_quotas(&mut tx, &head.phase, team, now_unix_ms).await?);
        }
        Ok(quotas)
    }

    /// Returns the statistics of a phase's missions; `None` unless the viewer sees the replays of all teams.
    ///
    /// # Errors
    /// If the database fails or contains damaged rows.
    pub async fn missions(&self, viewer: &Viewer, phase: &str) -> Result<Option<MissionsView>, StoreError> {
        let mut tx = self.snapshot().await?;
        if !sees_missions(&mut tx, viewer, phase).await? {
            return Ok(None);
        }
        let mut view = MissionsView::default();
        let select = "SELECT scene, goals FROM phase_episodes WHERE phase = $1";
        let rows: Vec<(String, Json<Vec<GoalText>>)> =
            sqlx::query_as(select).bind(phase).fetch_all(&mut *tx).await?;
        for (scene, Json(goals)) in rows {
            view.add(scene, goals);
        }
        let select = "SELECT metrics FROM episodes WHERE metrics IS NOT NULL AND run = \
                      (SELECT id FROM runs WHERE phase = $1 AND state = 'completed' ORDER BY finished_ms DESC, id LIMIT 1) \
                      ORDER BY ordinal";
        let metrics: Vec<Json<Metrics>> = sqlx::query_scalar(select).bind(phase).fetch_all(&mut *tx).await?;
        view.reference_m = metrics.into_iter().map(|Json(metrics)| metrics.reference_m).collect();
        Ok(Some(view))
    }

    /// Returns the floor plan of a scene of a phase; `None` if there is none yet, or unless the viewer sees the replays of all
    /// teams.
    ///
    /// # Errors
    /// If the database fails or contains a damaged map.
    pub async fn scene_map(
        &self,
        viewer: &Viewer,
        phase: &str,
        scene: &str,
    ) -> Result<Option<SceneMap>, StoreError> {
        let mut tx = self.snapshot().await?;
        if !sees_missions(&mut tx, viewer, phase).await? {
            return Ok(None);
        }
        let select = "SELECT map FROM scenes WHERE name = $2 \
                      AND EXISTS (SELECT 1 FROM phase_episodes WHERE phase = $1 AND scene = $2)";
        let map: Option<Json<SceneMap>> =
            sqlx::query_scalar(select).bind(phase).bind(scene).fetch_optional(&mut *tx).await?;
        Ok(map.map(|Json(map)| map).filter(|map| !map.polygons.is_empty()))
    }
}

async fn sees_missions(
    tx: &mut Transaction<'_, Sqlite>,
    viewer: &Viewer,
    phase: &str,
) -> Result<bool, StoreError> {
    let head = read_heads(tx, Some(phase)).await?.pop();
    Ok(head.is_some_and(|PhaseHead { phase, .. }| {
        // As for replays: lengths and positions would reveal hidden scores.
        viewer.knows(&phase) && viewer.sees_all(phase.scores) && viewer.sees_all(phase.replays)
    }))
}
