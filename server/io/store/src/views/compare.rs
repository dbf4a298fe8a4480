use super::{EpisodeLine, Reader, RunLine, RunView, Viewer};
use crate::{StoreError, totals::INTERVAL_SEED};
use avln_scoring::{Comparison, EpisodeScore, Metrics, compare};
use serde::Serialize;
use std::collections::BTreeMap;

/// Two runs of one phase and order, over the episodes that both played.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CompareView {
    /// The first run.
    pub first: RunLine,
    /// The second run.
    pub second: RunLine,
    /// How they differ; `None` where no episode was scored in both.
    pub comparison: Option<Comparison>,
    /// The episodes that were scored in both, in playing order of the first.
    pub episodes: Vec<PairView>,
}

/// An episode that two runs played.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairView {
    /// Id of the episode inside the split.
    pub episode: String,
    /// Name of the scene.
    pub scene: String,
    /// Place in the first run, from 0.
    pub first_ordinal: u32,
    /// Place in the second run.
    pub second_ordinal: u32,
    /// What it was worth in the first run.
    pub first: Metrics,
    /// What it was worth in the second.
    pub second: Metrics,
}

/// Why two runs cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Incomparable {
    /// They are of different phases or orders of goals.
    Apart,
    /// The viewer may not see what single episodes of one of them were worth.
    Hidden,
}

impl Reader {
    /// Two runs side by side; `None` when the viewer may not know of one of them.
    ///
    /// # Errors
    /// When the database fails or holds damaged rows.
    pub async fn compare(
        &self,
        viewer: &Viewer,
        [first, second]: [&str; 2],
    ) -> Result<Option<Result<CompareView, Incomparable>>, StoreError> {
        let (first, second) = (self.run(viewer, first).await?, self.run(viewer, second).await?);
        let (Some(first), Some(second)) = (first, second) else { return Ok(None) };
        let place = |run: &RunView| (run.line.phase.clone(), run.line.order);
        if place(&first) != place(&second) {
            return Ok(Some(Err(Incomparable::Apart)));
        }
        if !(first.replays_visible && second.replays_visible) {
            return Ok(Some(Err(Incomparable::Hidden)));
        }
        let comparison = compare(&scores(&first), &scores(&second), INTERVAL_SEED);
        let episodes = pairs(&first.episodes, &second.episodes);
        Ok(Some(Ok(CompareView { first: first.line, second: second.line, comparison, episodes })))
    }
}

fn scores(run: &RunView) -> Vec<EpisodeScore> {
    let score = |line: &EpisodeLine| {
        Some(EpisodeScore {
            episode: line.episode.clone()?,
            scene: line.scene.clone()?,
            order: run.line.order,
            metrics: line.metrics.clone()?,
        })
    };
    run.episodes.iter().filter_map(score).collect()
}

fn pairs(first: &[EpisodeLine], second: &[EpisodeLine]) -> Vec<PairView> {
    let others: BTreeMap<&str, (u32, &Metrics)> = second
        .iter()
        .filter_map(|line| Some((line.episode.as_deref()?, (line.ordinal, line.metrics.as_ref()?))))
        .collect();
    let pair = |line: &EpisodeLine| {
        let (second_ordinal, second) = *others.get(line.episode.as_deref()?)?;
        Some(PairView {
            episode: line.episode.clone()?,
            scene: line.scene.clone()?,
            first_ordinal: line.ordinal,
            second_ordinal,
            first: line.metrics.clone()?,
            second: second.clone(),
        })
    };
    first.iter().filter_map(pair).collect()
}
