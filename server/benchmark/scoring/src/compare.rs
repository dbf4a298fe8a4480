//! Paired comparison of two runs, and the smallest difference in SR that it detects.

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

/// Share of episodes in which exactly one of two similar methods succeeds, from the episodes of `docs/results.csv`.
const DISCORDANCE: f64 = 0.25;
/// Correlation of success between episodes in a scene, from the same episodes.
const SCENE_CORRELATION: f64 = 0.1;
/// Squared sum of the normal quantiles for a two-sided 95 % level (1.96) and 80 % power (0.84).
const SQUARED_QUANTILES: f64 = 7.84;

/// Returns the mean number of episodes that two runs share in a phase with `episodes` episodes. `sample` is a run's number of
/// episodes and the number among these that all runs share; `None` for all episodes.
pub fn common_episodes(episodes: u32, sample: Option<(u32, u32)>) -> f64 {
    let Some((drawn, anchors)) = sample.filter(|(_, anchors)| *anchors < episodes) else {
        return f64::from(episodes);
    };
    let [all, drawn, anchors] = [episodes, drawn.clamp(anchors, episodes), anchors].map(f64::from);
    anchors + (drawn - anchors) * (drawn - anchors) / (all - anchors)
}

/// Returns the smallest difference in SR that a paired comparison detects at the 95 % level with 80 % power; `None` if it is
/// above a quarter, as for few episodes or no scene. Episodes in the same scene count less.
pub fn smallest_difference(common_episodes: f64, scenes: u32) -> Option<f64> {
    let others_in_scene = (common_episodes / f64::from(scenes) - 1.0).max(0.0);
    let independent = common_episodes / (1.0 + SCENE_CORRELATION * others_in_scene);
    let difference = (SQUARED_QUANTILES * DISCORDANCE / (independent + SQUARED_QUANTILES)).sqrt();
    // The difference in SR is at most the share of episodes with different success.
    (difference <= DISCORDANCE).then_some(difference)
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

    fn points(common: f64, scenes: u32) -> Option<f64> {
        smallest_difference(common, scenes).map(|share| (1000.0 * share).round() / 10.0)
    }

    #[test]
    fn differences_shrink_with_episodes_and_scenes() {
        let cases = [
            (200.0, 25, Some(12.5)),
            (100.0, 25, Some(15.2)),
            (1000.0, 100, Some(6.1)),
            (16.0, 4, None),
            (1.0, 1, None),
            (100.0, 0, None),
        ];
        for (common, scenes, expected) in cases {
            assert_eq!(points(common, scenes), expected, "{common} episodes, {scenes} scenes");
        }
        assert!(points(100.0, 100) < points(100.0, 10));
    }

    #[test]
    fn samples_share_anchors_and_chance_episodes() {
        assert_eq!(common_episodes(400, None), 400.0);
        assert_eq!(common_episodes(400, Some((100, 100))), 100.0);
        assert_eq!(common_episodes(400, Some((100, 0))), 25.0);
        assert_eq!(common_episodes(420, Some((100, 20))), 36.0);
        assert_eq!(common_episodes(4, Some((4, 4))), 4.0);
    }
}
