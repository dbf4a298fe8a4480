//! Run comparison.

use crate::{
    error::StoreError,
    scores::INTERVAL_SEED,
    views::{
        Reader, Viewer,
        run::{EpisodeLine, RunLine, RunView},
    },
};
use avln_scoring::{Comparison, EpisodeScore, Metrics, compare};
use serde::Serialize;
use std::collections::BTreeMap;

/// Two runs with equal phase and order, over common episodes.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct CompareView {
    /// The first run.
    pub first: RunLine,
    /// The second run.
    pub second: RunLine,
    /// Paired differences; `None` without episodes scored in both runs.
    pub comparison: Option<Comparison>,
    /// Episodes scored in both runs, in the first run's playing order.
    pub episodes: Vec<PairView>,
}

/// An episode scored in both runs.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct PairView {
    /// Episode id inside the split.
    pub episode: String,
    /// Scene name.
    pub scene: String,
    /// Position in the first run, from 0.
    pub first_ordinal: u32,
    /// Position in the second run.
    pub second_ordinal: u32,
    /// Metrics in the first run.
    pub first: Metrics,
    /// Metrics in the second run.
    pub second: Metrics,
}

/// A reason against a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Incomparable {
    /// The runs have different phases or orders.
    Apart,
    /// Single episodes' metrics are hidden from the viewer.
    Hidden,
}

impl Reader {
    /// Compares two runs; `None` if one is unknown or hidden from the viewer.
    ///
    /// # Errors
    /// If the database fails or contains damaged rows.
    pub async fn compare(
        &self,
        viewer: &Viewer,
        [first, second]: [&str; 2],
    ) -> Result<Option<Result<CompareView, Incomparable>>, StoreError> {
        let Some(first) = self.run(viewer, first).await? else { return Ok(None) };
        let Some(second) = self.run(viewer, second).await? else { return Ok(None) };
        if first.line.phase != second.line.phase || first.line.order != second.line.order {
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
