use super::{Reader, Viewer};
use crate::{
    PhaseState, StoreError, Visibility,
    catalogue::{PhaseHead, read_heads},
};
use avln_episode::{FeedbackRule, Order, Rules, Sensors};
use serde::Serialize;

/// A phase as pages show it. Everybody may know that a phase exists and how it is played.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PhaseView {
    /// Id in URLs.
    pub id: String,
    /// Heading.
    pub title: String,
    /// Whether runs may start.
    pub state: PhaseState,
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
    /// Scenes that they take place in.
    pub scenes: u32,
    /// Episodes that a run may play side by side.
    pub max_slots: u32,
    /// Runs that a team may start; `None` for any number.
    pub quota: Option<u32>,
    /// Who may see scores.
    pub scores: Visibility,
    /// Who may see paths, maps and targets.
    pub replays: Visibility,
    /// Whether this viewer sees the scores of all teams.
    pub all_scores_visible: bool,
}

impl PhaseView {
    pub(super) fn new(head: PhaseHead, viewer: &Viewer) -> Self {
        let PhaseHead { phase, episodes, scenes } = head;
        Self {
            scenes,
            episodes,
            feedback: phase.rules.feedback,
            all_scores_visible: viewer.sees_all(phase.scores),
            id: phase.id,
            title: phase.title,
            state: phase.state,
            orders: phase.orders,
            rules: phase.rules,
            sensors: phase.sensors,
            max_slots: phase.max_slots,
            quota: phase.quota,
            scores: phase.scores,
            replays: phase.replays,
        }
    }
}

impl Reader {
    /// All phases, the oldest first.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn phases(&self, viewer: &Viewer) -> Result<Vec<PhaseView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let phases = read_heads(&mut tx, None).await?;
        Ok(phases.into_iter().map(|phase| PhaseView::new(phase, viewer)).collect())
    }

    /// The phase called `id`; `None` when there is none.
    ///
    /// # Errors
    /// When the database fails.
    pub async fn phase(&self, viewer: &Viewer, id: &str) -> Result<Option<PhaseView>, StoreError> {
        let mut tx = self.snapshot().await?;
        let phase = read_heads(&mut tx, Some(id)).await?.pop();
        Ok(phase.map(|phase| PhaseView::new(phase, viewer)))
    }
}
