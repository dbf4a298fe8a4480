//! Ranks that entries would have with other scenes.

use crate::{
    Direction, EpisodeScore, Key,
    bootstrap::{RESAMPLES, SplitMix},
    summary::sorted,
};
use std::collections::{BTreeMap, BTreeSet};

/// The middle 95 % of each entry's ranks when scenes are drawn anew with replacement, the same for all entries, as
/// (best, worst). With one scene episodes are drawn. Entries with equal means share a rank.
pub(crate) fn rank_intervals(entries: &[&[EpisodeScore]], key: Key, seed: u64) -> Vec<(u32, u32)> {
    let sums = ClusterSums::new(entries, key);
    let mut ranks: Vec<Vec<u32>> = vec![Vec::with_capacity(RESAMPLES); entries.len()];
    let mut draw = SplitMix::new(seed);
    for _ in 0..RESAMPLES {
        let means = sums.means(&sums.drawn(&mut draw));
        for (place, rank) in shared_ranks(&means) {
            ranks[place].push(rank);
        }
    }
    let middle = |mut ranks: Vec<u32>| {
        ranks.sort_unstable();
        (ranks[RESAMPLES / 40 - 1], ranks[RESAMPLES - RESAMPLES / 40 - 1])
    };
    ranks.into_iter().map(middle).collect()
}

/// What each entry reached in each cluster of episodes.
struct ClusterSums {
    clusters: usize,
    /// For each entry and cluster the sum of the key, small for good, and how many episodes there are.
    sums: Vec<Vec<(f64, u32)>>,
}

impl ClusterSums {
    fn new(entries: &[&[EpisodeScore]], key: Key) -> Self {
        let all = || entries.iter().flat_map(|scores| scores.iter());
        let scenes: BTreeSet<&str> = all().map(|score| score.scene.as_str()).collect();
        let name = if scenes.len() > 1 { scene_of } else { episode_of };
        let names: BTreeSet<&str> = all().map(name).collect();
        let places: BTreeMap<&str, usize> = names.into_iter().zip(0..).collect();
        let sums = entries.iter().map(|scores| sums(scores, key, &|score| places[name(score)], places.len()));
        Self { clusters: places.len(), sums: sums.collect() }
    }

    /// How often each cluster is drawn.
    fn drawn(&self, draw: &mut SplitMix) -> Vec<u32> {
        let mut times = vec![0; self.clusters];
        for _ in 0..self.clusters {
            times[draw.below(self.clusters)] += 1;
        }
        times
    }

    /// The entries' means over the clusters that were drawn; infinite for one that played none of them.
    fn means(&self, times: &[u32]) -> Vec<f64> {
        let mean = |sums: &Vec<(f64, u32)>| {
            let drawn = sums.iter().zip(times).filter(|(_, times)| **times > 0);
            let (sum, count) = drawn.fold((0.0, 0), |(sum, count), ((value, episodes), times)| {
                (sum + value * f64::from(*times), count + episodes * times)
            });
            if count == 0 { f64::INFINITY } else { sum / f64::from(count) }
        };
        self.sums.iter().map(mean).collect()
    }
}

fn scene_of(score: &EpisodeScore) -> &str {
    &score.scene
}

fn episode_of(score: &EpisodeScore) -> &str {
    &score.episode
}

/// For each of `clusters` the sum of the key, small for good, over the episodes in it, and their number.
fn sums(
    scores: &[EpisodeScore],
    key: Key,
    cluster: &dyn Fn(&EpisodeScore) -> usize,
    clusters: usize,
) -> Vec<(f64, u32)> {
    let sign = if key.direction() == Direction::Higher { -1.0 } else { 1.0 };
    let mut sums = vec![(0.0, 0); clusters];
    // Sums must not depend on the order in which episodes were played.
    for score in sorted(scores) {
        let (sum, count) = &mut sums[cluster(score)];
        *sum += sign * key.of(&score.metrics);
        *count += 1;
    }
    sums
}

/// Each place of `means` with its rank, 1 for the smallest; equal ones share a rank.
fn shared_ranks(means: &[f64]) -> Vec<(usize, u32)> {
    let mut order: Vec<usize> = (0..means.len()).collect();
    order.sort_by(|&a, &b| means[a].total_cmp(&means[b]));
    let mut ranks: Vec<(usize, u32)> = Vec::with_capacity(means.len());
    for (index, place) in order.into_iter().enumerate() {
        let shared = ranks.last().filter(|(above, _)| means[*above].total_cmp(&means[place]).is_eq());
        ranks.push((place, shared.map_or(index as u32 + 1, |(_, rank)| *rank)));
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Metrics;
    use avln_episode::Order;

    /// Ten episodes in five scenes; `found` says in which of them everything is found.
    fn scores(found: impl Fn(u32) -> bool) -> Vec<EpisodeScore> {
        (0..10)
            .map(|episode| EpisodeScore {
                episode: format!("e{episode}"),
                scene: format!("s{}", episode / 2),
                order: Order::Ordered,
                metrics: Metrics { isr: f64::from(u8::from(found(episode))), ..Metrics::default() },
            })
            .collect()
    }

    #[test]
    fn who_is_better_in_every_scene_has_one_rank_and_others_have_several() {
        let all = scores(|_| true);
        let (early, late) = (scores(|episode| episode < 4), scores(|episode| episode >= 6));
        let ranks = rank_intervals(&[&early, &all, &late], Key::Isr, 1);
        assert_eq!(ranks, [(2, 3), (1, 1), (2, 3)]);
    }

    #[test]
    fn equal_entries_share_their_rank_and_the_order_of_episodes_changes_nothing() {
        let mut entries = [scores(|episode| episode % 2 == 0), scores(|episode| episode % 2 == 0)];
        let told =
            |entries: &[Vec<EpisodeScore>; 2]| rank_intervals(&[&entries[0], &entries[1]], Key::Isr, 3);
        assert_eq!(told(&entries), [(1, 1), (1, 1)]);
        entries[1].reverse();
        assert_eq!(told(&entries), [(1, 1), (1, 1)]);
    }

    #[test]
    fn fewer_steps_are_better_and_nothing_played_is_last() {
        let steps = |steps| {
            let mut scores = scores(|_| true);
            scores.iter_mut().for_each(|score| score.metrics.steps = steps);
            scores
        };
        assert_eq!(rank_intervals(&[&steps(9), &[], &steps(3)], Key::Steps, 1), [(2, 2), (3, 3), (1, 1)]);
        assert!(rank_intervals(&[], Key::Steps, 1).is_empty());
    }

    #[test]
    fn episodes_of_a_single_scene_are_drawn_one_by_one() {
        let mut entries = [scores(|episode| episode < 6), scores(|episode| episode >= 5)];
        entries.iter_mut().flatten().for_each(|score| "only".clone_into(&mut score.scene));
        assert_eq!(rank_intervals(&[&entries[0], &entries[1]], Key::Isr, 1), [(1, 2), (1, 2)]);
    }
}
