//! Paired comparison of two runs.

use crate::{
    metrics::Key,
    score::{EpisodeScore, Estimate, FEW_SCENES, clusters, intervals, sorted},
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Paired comparison of two runs over their common episodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Comparison {
    /// Common episodes.
    pub episodes: u32,
    /// Scenes in these episodes.
    pub scenes: u32,
    /// In the order of [`Key::ALL`].
    pub differences: Vec<Difference>,
}

impl Comparison {
    /// Returns true if the intervals are unreliable.
    pub fn has_few_scenes(&self) -> bool {
        self.scenes < FEW_SCENES
    }
}

/// Difference between two runs in a metric.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Difference {
    /// The metric.
    pub key: Key,
    /// Mean for the first run over the common episodes.
    pub first: f64,
    /// Mean for the second run.
    pub second: f64,
    /// Mean difference per episode, first minus second, with the 95 % interval, resampled by scene.
    pub estimate: Estimate,
    /// True if the interval excludes 0; false with fewer than two episodes.
    pub is_sure: bool,
}

/// Compares `first` with `second` over their common episodes; `None` if they have none in common.
pub fn compare(first: &[EpisodeScore], second: &[EpisodeScore], seed: u64) -> Option<Comparison> {
    const COUNT: usize = Key::ALL.len();
    let pairs = pairs(first, second);
    if pairs.is_empty() {
        return None;
    }
    let rows: Vec<(&str, [f64; COUNT])> = pairs
        .iter()
        .map(|(a, b)| (a.scene.as_str(), Key::ALL.map(|key| key.of(&a.metrics) - key.of(&b.metrics))))
        .collect();
    let bounds = intervals(&clusters(&rows), seed);
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / pairs.len() as f64;
    let difference = |(column, key): (usize, Key)| {
        let value = mean(&mut rows.iter().map(|(_, values)| values[column]));
        let (low, high) = bounds[column];
        Difference {
            key,
            first: mean(&mut pairs.iter().map(|(a, _)| key.of(&a.metrics))),
            second: mean(&mut pairs.iter().map(|(_, b)| key.of(&b.metrics))),
            estimate: Estimate { value, low: low.min(value), high: high.max(value) },
            is_sure: pairs.len() > 1 && (low > 0.0 || high < 0.0),
        }
    };
    Some(Comparison {
        episodes: pairs.len() as u32,
        scenes: pairs.chunk_by(|a, b| a.0.scene == b.0.scene).count() as u32,
        differences: Key::ALL.into_iter().enumerate().map(difference).collect(),
    })
}

/// Pairs common episodes, sorted by scene, episode and order.
pub(crate) fn pairs<'a>(
    first: &'a [EpisodeScore],
    second: &'a [EpisodeScore],
) -> Vec<(&'a EpisodeScore, &'a EpisodeScore)> {
    let of_second: BTreeMap<_, _> = second.iter().map(|score| (identity(score), score)).collect();
    let of_both = |score| Some((score, *of_second.get(&identity(score))?));
    sorted(first).into_iter().filter_map(of_both).collect()
}

/// Returns id and goal order: both orders share episodes, but are not comparable.
fn identity(score: &EpisodeScore) -> (&str, &str) {
    (&score.episode, score.order.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::Metrics;
    use avln_episode::Order;

    fn score(episode: u32, found: u32) -> EpisodeScore {
        let (sr, isr) = (if found == 2 { 1.0 } else { 0.0 }, f64::from(found) / 2.0);
        let metrics = Metrics { goals: 2, found, sr, isr, steps: 10 * found, ..Metrics::default() };
        let (episode, scene) = (format!("e{episode}"), format!("s{}", episode / 2));
        EpisodeScore { episode, scene, order: Order::Ordered, metrics }
    }

    fn of(comparison: &Comparison, key: Key) -> Difference {
        *comparison.differences.iter().find(|difference| difference.key == key).expect("all keys")
    }

    #[test]
    fn differences_are_paired_by_episode() {
        let first: Vec<_> = (0..8).map(|episode| score(episode, 2)).collect();
        let second: Vec<_> = (0..6).rev().map(|episode| score(episode, 1)).collect();
        let compared = compare(&first, &second, 1).expect("six pairs");
        assert_eq!((compared.episodes, compared.scenes), (6, 3));
        let isr = of(&compared, Key::Isr);
        assert_eq!((isr.first, isr.second, isr.estimate.low, isr.estimate.high), (1.0, 0.5, 0.5, 0.5));
        assert!(isr.is_sure && of(&compared, Key::Steps).estimate.value == 10.0);
        assert!(!of(&compared, Key::Collisions).is_sure);
    }

    #[test]
    fn cancelling_differences_are_not_sure() {
        let first: Vec<_> = (0..8).map(|episode| score(episode, 2 * (episode / 4))).collect();
        let second: Vec<_> = (0..8).map(|episode| score(episode, 2 - 2 * (episode / 4))).collect();
        let sr = of(&compare(&first, &second, 1).expect("pairs"), Key::Sr);
        assert!(sr.estimate.value == 0.0 && sr.estimate.low < 0.0 && sr.estimate.high > 0.0 && !sr.is_sure);
        assert!(!of(&compare(&first[..1], &second, 1).expect("a pair"), Key::Sr).is_sure);
        assert_eq!(compare(&first, &[], 1), None);
    }
}
