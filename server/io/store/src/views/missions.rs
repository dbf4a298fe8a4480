use super::{Reader, Viewer};
use crate::{GoalText, Phase, SceneMap, StoreError, phases::read_heads, words::from_json};
use avln_episode::Modality;
use serde::Serialize;
use sqlx::{Sqlite, Transaction};
use std::collections::BTreeMap;

/// What the missions of a phase are like, all together.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MissionsView {
    /// Missions by their number of goals.
    pub goals: BTreeMap<u32, u32>,
    /// Goals by how they are told.
    pub modalities: BTreeMap<&'static str, u32>,
    /// Goals that are told by category, by that.
    pub categories: BTreeMap<String, u32>,
    /// Lengths of the reference tours of the run that was completed last, metres, in playing order.
    pub reference_m: Vec<f64>,
    /// Where missions take place, and how many there are in each.
    pub scenes: BTreeMap<String, u32>,
}

impl Reader {
    /// What the missions of a phase are like; `None` where the viewer may not see the replays of everybody.
    ///
    /// # Errors
    /// When the database fails or holds damaged rows.
    pub async fn missions(&self, viewer: &Viewer, phase: &str) -> Result<Option<MissionsView>, StoreError> {
        let mut tx = self.snapshot().await?;
        if !sees_missions(&mut tx, viewer, phase).await? {
            return Ok(None);
        }
        let mut view = MissionsView::default();
        let select = "SELECT scene, goals FROM phase_episodes WHERE phase = $1";
        let rows: Vec<(String, String)> = sqlx::query_as(select).bind(phase).fetch_all(&mut *tx).await?;
        for (scene, goals) in rows {
            view.add(scene, from_json("goals", &goals)?);
        }
        let select = "SELECT reference_m FROM episodes WHERE reference_m IS NOT NULL AND run = \
                      (SELECT id FROM runs WHERE phase = $1 AND state = 'completed' ORDER BY finished_ms DESC, id LIMIT 1) \
                      ORDER BY ordinal";
        view.reference_m = sqlx::query_scalar(select).bind(phase).fetch_all(&mut *tx).await?;
        Ok(Some(view))
    }

    /// The floor plan of a scene of a phase; `None` where there is none yet, or where the viewer may not see the replays of
    /// everybody.
    ///
    /// # Errors
    /// When the database fails or holds a damaged map.
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
        let map: Option<String> =
            sqlx::query_scalar(select).bind(phase).bind(scene).fetch_optional(&mut *tx).await?;
        let map: Option<SceneMap> = map.map(|json| from_json("map", &json)).transpose()?;
        Ok(map.filter(|map| !map.polygons.is_empty()))
    }
}

async fn sees_missions(
    tx: &mut Transaction<'_, Sqlite>,
    viewer: &Viewer,
    phase: &str,
) -> Result<bool, StoreError> {
    let head = read_heads(tx, Some(phase)).await?.pop();
    // As with replays: where scores are hidden, lengths and places would tell of them.
    let all = |phase: &Phase| viewer.sees_all(phase.scores) && viewer.sees_all(phase.replays);
    let sees = |phase: &Phase| viewer.knows(phase) && all(phase);
    Ok(head.is_some_and(|head| sees(&head.phase)))
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
