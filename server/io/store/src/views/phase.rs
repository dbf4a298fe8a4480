//! Phase and mission pages.

use crate::{
    admission::read_quotas,
    commitment::{Commitment, read_commitment},
    database::Transaction,
    error::Result,
    phases::{PhaseHead, Ranking, SceneMap, read_heads},
    views::{Reader, Viewer},
};
use avln_challenge::{GoalText, PhaseState, Quota, QuotaLimits, Visibility};
use avln_episode::{FeedbackRule, Modality, Order, Rules, Sensors, TimeLimits};
use avln_scoring::Metrics;
use serde::Serialize;
use sqlx::types::Json;
use std::collections::BTreeMap;

/// A phase on pages, public unless it is restricted to some teams. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct PhaseView {
    /// Id in URLs.
    pub id: String,
    /// Title.
    pub title: String,
    /// Text for people; may be empty.
    pub description: String,
    /// State at request time.
    pub state: PhaseState,
    /// Pause reason; `None` in other states.
    pub state_reason: Option<String>,
    /// True if the organiser closed the phase by hand; its closing date then has no effect.
    pub closed_by_hand: bool,
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
    /// Episodes per run.
    pub episodes: u32,
    /// Scene count.
    pub scenes: u32,
    /// Maximum parallel episodes per run.
    pub max_slots: u32,
    /// Run limits per team.
    pub quotas: QuotaLimits,
    /// Agent time limits.
    pub time: TimeLimits,
    /// Default ranking.
    pub ranking: Ranking,
    /// True if the phase accepts sealed runs only.
    pub sealed: bool,
    /// The commitment, with values after publication; `None` before the commitment.
    pub promise: Option<Commitment>,
    /// Score visibility.
    pub scores: Visibility,
    /// Visibility of paths, maps and targets.
    pub replays: Visibility,
    /// True if the viewer sees all teams' scores.
    pub all_scores_visible: bool,
}

impl PhaseView {
    pub(crate) async fn read(
        tx: &mut Transaction<'_>,
        head: PhaseHead,
        viewer: &Viewer,
        now_unix_ms: i64,
    ) -> Result<Self> {
        let PhaseHead { phase, episodes, scenes } = head;
        let state = phase.schedule.state(now_unix_ms);
        Ok(Self {
            scenes,
            episodes: phase.sampling.episodes_of_run(episodes),
            promise: read_commitment(tx, &phase.id).await?,
            state,
            closed_by_hand: phase.schedule.closed,
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
        })
    }
}

/// Mission statistics for a phase.
#[derive(Clone, Debug, Default, PartialEq, Serialize, utoipa::ToSchema)]
pub struct MissionsView {
    /// Missions by goal count.
    pub goals: BTreeMap<u32, u32>,
    /// Goals by modality.
    pub modalities: BTreeMap<&'static str, u32>,
    /// Category goals by category.
    pub categories: BTreeMap<String, u32>,
    /// Reference path lengths in the latest completed run, metres, in playing order.
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
    pub async fn phases(&self, viewer: &Viewer, now_unix_ms: i64) -> Result<Vec<PhaseView>> {
        let mut tx = self.snapshot().await?;
        let mut views = Vec::new();
        for head in read_heads(&mut tx, None).await? {
            if viewer.knows(&head.phase) {
                views.push(PhaseView::read(&mut tx, head, viewer, now_unix_ms).await?);
            }
        }
        Ok(views)
    }

    /// Returns the phase called `id` at `now_unix_ms`; `None` if there is none visible to the viewer.
    pub async fn phase(&self, viewer: &Viewer, id: &str, now_unix_ms: i64) -> Result<Option<PhaseView>> {
        let mut tx = self.snapshot().await?;
        let head = read_heads(&mut tx, Some(id)).await?.pop();
        match head.filter(|head| viewer.knows(&head.phase)) {
            Some(head) => PhaseView::read(&mut tx, head, viewer, now_unix_ms).await.map(Some),
            None => Ok(None),
        }
    }

    /// Returns the team's quotas in all visible phases; empty for other viewers.
    pub async fn quotas(&self, viewer: &Viewer, now_unix_ms: i64) -> Result<Vec<Quota>> {
        let Viewer::Team(team) = viewer else { return Ok(vec![]) };
        let mut tx = self.snapshot().await?;
        let mut quotas = Vec::new();
        for head in read_heads(&mut tx, None).await?.iter().filter(|head| viewer.knows(&head.phase)) {
            quotas.extend(read_quotas(&mut tx, &head.phase, team, now_unix_ms).await?);
        }
        Ok(quotas)
    }

    /// Returns a phase's mission statistics; `None` unless the viewer sees all teams' replays.
    pub async fn missions(&self, viewer: &Viewer, phase: &str) -> Result<Option<MissionsView>> {
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

    /// Returns a scene's floor plan; `None` if there is none yet, or the viewer does not see all teams' replays.
    pub async fn scene_map(&self, viewer: &Viewer, phase: &str, scene: &str) -> Result<Option<SceneMap>> {
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

async fn sees_missions(tx: &mut Transaction<'_>, viewer: &Viewer, phase: &str) -> Result<bool> {
    let head = read_heads(tx, Some(phase)).await?.pop();
    Ok(head.is_some_and(|PhaseHead { phase, .. }| {
        // As for replays: lengths and positions would reveal hidden scores.
        viewer.knows(&phase) && viewer.sees_all(phase.scores) && viewer.sees_all(phase.replays)
    }))
}
