use super::{Reader, Viewer};
use crate::{
    PhaseState, Promise, Quota, QuotaLimits, Ranking, StoreError, Visibility,
    phases::{PhaseHead, read_heads},
    quota::read_quotas,
};
use avln_episode::{FeedbackRule, Order, Rules, Sensors, TimeLimits};
use serde::Serialize;

/// A phase as pages show it. Everybody may know that a phase exists and how it is played, unless it is for some teams only.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhaseView {
    /// Id in URLs.
    pub id: String,
    /// Heading.
    pub title: String,
    /// Text for people; may be empty.
    pub description: String,
    /// Whether runs may start now.
    pub state: PhaseState,
    /// Why it is paused, where it is.
    pub state_reason: Option<String>,
    /// From when runs may start, milliseconds since 1970-01-01 UTC; `None` for at once.
    pub opens_unix_ms: Option<i64>,
    /// From when no more; `None` for never.
    pub closes_unix_ms: Option<i64>,
    /// Orders that a run may choose.
    pub orders: Vec<Order>,
    /// The rules, with every option.
    pub rules: Rules,
    /// What agents learn from a Submit.
    pub feedback: FeedbackRule,
    /// The most that an agent may ask for.
    pub sensors: Sensors,
    /// Episodes of a run.
    pub episodes: u32,
    /// Scenes that they are drawn from.
    pub scenes: u32,
    /// Episodes that a run may play side by side.
    pub max_slots: u32,
    /// How many runs a team may start.
    pub quotas: QuotaLimits,
    /// Wall time that agents have.
    pub time: TimeLimits,
    /// How runs are ranked unless somebody asks otherwise.
    pub ranking: Ranking,
    /// Whether only sealed runs may be played.
    pub sealed: bool,
    /// What the organiser promised before the phase, and published after it; `None` before that.
    pub promise: Option<Promise>,
    /// Who may see scores.
    pub scores: Visibility,
    /// Who may see paths, maps and targets.
    pub replays: Visibility,
    /// Whether this viewer sees the scores of all teams.
    pub all_scores_visible: bool,
}

impl PhaseView {
    pub(super) fn new(head: PhaseHead, viewer: &Viewer, now_unix_ms: i64) -> Self {
        let PhaseHead { phase, episodes, scenes, promise } = head;
        let state = phase.schedule.state(now_unix_ms);
        Self {
            scenes,
            episodes: phase.sampling.episodes_of_run(episodes),
            promise,
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

impl Reader {
    /// The phases that the viewer may know of, as they are at `now_unix_ms`, in the organiser's order.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn phases(&self, viewer: &Viewer, now_unix_ms: i64) -> Result<Vec<PhaseView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let heads = read_heads(&mut tx, None).await?;
        let known = heads.into_iter().filter(|head| viewer.knows(&head.phase));
        Ok(known.map(|head| PhaseView::new(head, viewer, now_unix_ms)).collect())
    }

    /// What a team has left in each phase that it may know of; nothing for other viewers, who start no runs.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn quotas(&self, viewer: &Viewer, now_unix_ms: i64) -> Result<Vec<Quota>, StoreError> {
        let Viewer::Team(team) = viewer else { return Ok(vec![]) };
        let mut tx = self.snapshot().await?;
        let mut quotas = Vec::new();
        for head in read_heads(&mut tx, None).await?.iter().filter(|head| viewer.knows(&head.phase)) {
            quotas.extend(read_quotas(&mut tx, &head.phase, team, now_unix_ms).await?);
        }
        Ok(quotas)
    }

    /// The phase called `id` as it is at `now_unix_ms`; `None` when there is none that the viewer may know of.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn phase(
        &self,
        viewer: &Viewer,
        id: &str,
        now_unix_ms: i64,
    ) -> Result<Option<PhaseView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let head = read_heads(&mut tx, Some(id)).await?.pop();
        let known = head.filter(|head| viewer.knows(&head.phase));
        Ok(known.map(|head| PhaseView::new(head, viewer, now_unix_ms)))
    }
}
