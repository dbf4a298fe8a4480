//! Leaderboard ranks: intervals over resampled scenes, and groups without significant differences.

use crate::{
    compare::pairs,
    metrics::{Direction, Key},
    score::{EpisodeScore, RESAMPLES, Summary, clusters, intervals, sorted},
};
use avln_geom::SplitMix64;
use serde::{Deserialize, Serialize};
use std::{
    cmp::Ordering,
    collections::{BTreeMap, BTreeSet},
};

/// Leaderboard entry before ranking.
#[derive(Clone, Copy, Debug)]
pub struct Entry<'a> {
    /// Means.
    pub summary: &'a Summary,
    /// Episodes, for the paired test.
    pub scores: &'a [EpisodeScore],
    /// True if it competes. Other entries are listed in between, without a rank.
    pub is_ranked: bool,
}

/// Row in a ranked leaderboard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RankedEntry {
    /// Entry index in the ranked slice.
    pub entry: usize,
    /// Standing among the competing entries; `None` for the others.
    pub standing: Option<Standing>,
}

/// Standing among the competing entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Standing {
    /// Rank from 1; equal entries share a rank, and the next rank is skipped.
    pub rank: u32,
    /// Best rank in the middle 95 % over resampled scenes, at most `rank`.
    pub rank_low: u32,
    /// Worst rank in the middle 95 %, at least `rank`.
    pub rank_high: u32,
    /// Tie group from 1. No entry differs significantly from the group's first.
    pub tie_group: u32,
}

/// Tie breaks for equal keys, in order.
const TIE_BREAKS: [Key; 5] = [Key::Sr, Key::Isr, Key::Spl, Key::SoftSpl, Key::Osr];

/// Returns indices into `summaries` by `key`, best first. SR, ISR, SPL, SoftSPL and OSR break ties.
pub fn best_first(summaries: &[&Summary], key: Key) -> Vec<usize> {
    let mut order: Vec<usize> = (0..summaries.len()).collect();
    order.sort_by(|&a, &b| better(summaries[a], summaries[b], key));
    order
}

/// Sorts `entries` by `key`, best first, with standings for competing entries. Entries equal in the key and in SR, ISR, SPL,
/// SoftSPL and OSR share a rank. An entry joins the tie group above it unless the 95 % interval for its paired difference in
/// `key` to the group's first entry excludes 0.
pub fn rank(entries: &[Entry<'_>], key: Key, seed: u64) -> Vec<RankedEntry> {
    let summaries: Vec<&Summary> = entries.iter().map(|entry| entry.summary).collect();
    let order = best_first(&summaries, key);
    let competing: Vec<usize> = order.iter().copied().filter(|&entry| entries[entry].is_ranked).collect();
    let ranked: Vec<Entry<'_>> = competing.iter().map(|&entry| entries[entry]).collect();
    let mut standings = vec![None; entries.len()];
    for (entry, standing) in competing.into_iter().zip(standings_of(&ranked, key, seed)) {
        standings[entry] = Some(standing);
    }
    order.into_iter().map(|entry| RankedEntry { entry, standing: standings[entry] }).collect()
}

/// Returns standings for entries sorted best first.
fn standings_of(sorted: &[Entry<'_>], key: Key, seed: u64) -> Vec<Standing> {
    let scores: Vec<&[EpisodeScore]> = sorted.iter().map(|entry| entry.scores).collect();
    let spans = rank_intervals(&scores, key, seed);
    let mut standings: Vec<Standing> = Vec::with_capacity(sorted.len());
    let mut group_first = 0;
    for (index, (entry, (low, high))) in sorted.iter().zip(spans).enumerate() {
        let mut rank = index as u32 + 1;
        let mut tie_group = 1;
        if let Some(above) = standings.last() {
            let is_equal = better(sorted[index - 1].summary, entry.summary, key).is_eq();
            // Tested against the group's first entry: a chain of small differences must not span a large one.
            let is_apart = !is_equal && differ(&sorted[group_first], entry, key, seed);
            if is_equal {
                rank = above.rank;
            }
            tie_group = above.tie_group + u32::from(is_apart);
            if is_apart {
                group_first = index;
            }
        }
        standings.push(Standing { rank, rank_low: low.min(rank), rank_high: high.max(rank), tie_group });
    }
    standings
}

fn better(a: &Summary, b: &Summary, key: Key) -> Ordering {
    let by = |key: Key| {
        let ascending = key.mean_of(a).total_cmp(&key.mean_of(b));
        if key.direction() == Direction::Higher { ascending.reverse() } else { ascending }
    };
    TIE_BREAKS.into_iter().fold(by(key), |ordering, next| ordering.then_with(|| by(next)))
}

/// Returns whether the 95 % interval for the paired difference excludes 0. Needs at least two pairs.
fn differ(a: &Entry<'_>, b: &Entry<'_>, key: Key, seed: u64) -> bool {
    let pairs = pairs(a.scores, b.scores);
    if pairs.len() < 2 {
        return false;
    }
    let rows: Vec<_> = pairs
        .iter()
        .map(|(of_a, of_b)| (of_a.scene.as_str(), [key.of(&of_a.metrics) - key.of(&of_b.metrics)]))
        .collect();
    let [(low, high)] = intervals(&clusters(&rows), seed);
    low > 0.0 || high < 0.0
}

/// Returns the middle 95 % of ranks per entry over resampled scenes, as (best, worst). All entries share the resamples. A single
/// scene resamples episodes. Equal means share a rank.
fn rank_intervals(entries: &[&[EpisodeScore]], key: Key, seed: u64) -> Vec<(u32, u32)> {
    let sums = ClusterSums::new(entries, key);
    let mut ranks: Vec<Vec<u32>> = vec![Vec::with_capacity(RESAMPLES); entries.len()];
    let mut rng = SplitMix64::new(seed);
    for _ in 0..RESAMPLES {
        let means = sums.means(&sums.draw(&mut rng));
        for (entry, rank) in shared_ranks(&means) {
            ranks[entry].push(rank);
        }
    }
    let middle = |mut ranks: Vec<u32>| {
        ranks.sort_unstable();
        (ranks[RESAMPLES / 40 - 1], ranks[RESAMPLES - RESAMPLES / 40 - 1])
    };
    ranks.into_iter().map(middle).collect()
}

/// Key sums per entry and cluster.
struct ClusterSums {
    clusters: usize,
    /// Per entry and cluster: key sum (lower is better) and episode count.
    sums: Vec<Vec<(f64, u32)>>,
}

impl ClusterSums {
    fn new(entries: &[&[EpisodeScore]], key: Key) -> Self {
        let all = || entries.iter().flat_map(|scores| scores.iter());
        let scenes: BTreeSet<&str> = all().map(scene_of).collect();
        let name = if scenes.len() > 1 { scene_of } else { episode_of };
        let names: BTreeSet<&str> = all().map(name).collect();
        let indices: BTreeMap<&str, usize> = names.into_iter().zip(0..).collect();
        let sign = if key.direction() == Direction::Higher { -1.0 } else { 1.0 };
        let sums_of = |scores: &&[EpisodeScore]| {
            let mut sums = vec![(0.0, 0); indices.len()];
            for score in sorted(scores) {
                let (sum, count) = &mut sums[indices[name(score)]];
                *sum += sign * key.of(&score.metrics);
                *count += 1;
            }
            sums
        };
        Self { clusters: indices.len(), sums: entries.iter().map(sums_of).collect() }
    }

    /// Draws clusters with replacement; returns draw counts.
    fn draw(&self, rng: &mut SplitMix64) -> Vec<u32> {
        let mut times = vec![0; self.clusters];
        for _ in 0..self.clusters {
            times[rng.below(self.clusters)] += 1;
        }
        times
    }

    /// Returns means over the drawn clusters; infinite for entries without episodes there.
    fn means(&self, times: &[u32]) -> Vec<f64> {
        let mean = |sums: &Vec<(f64, u32)>| {
            let mut total = 0.0;
            let mut count = 0;
            for ((sum, episodes), times) in sums.iter().zip(times) {
                if *times > 0 {
                    total += sum * f64::from(*times);
                    count += episodes * times;
                }
            }
            if count == 0 { f64::INFINITY } else { total / f64::from(count) }
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

/// Returns indices into `means` with their ranks, 1 for the smallest; equal means share a rank.
fn shared_ranks(means: &[f64]) -> Vec<(usize, u32)> {
    let mut order: Vec<usize> = (0..means.len()).collect();
    order.sort_by(|&a, &b| means[a].total_cmp(&means[b]));
    let mut ranks: Vec<(usize, u32)> = Vec::with_capacity(means.len());
    for (index, entry) in order.into_iter().enumerate() {
        let shared = ranks.last().filter(|(above, _)| means[*above].total_cmp(&means[entry]).is_eq());
        ranks.push((entry, shared.map_or(index as u32 + 1, |(_, rank)| *rank)));
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::Metrics;
    use avln_episode::Order;

    /// Ten episodes in five scenes; `found` selects the successful ones.
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
    fn clear_winner_has_one_rank_others_an_interval() {
        let all = scores(|_| true);
        let (early, late) = (scores(|episode| episode < 4), scores(|episode| episode >= 6));
        let ranks = rank_intervals(&[&early, &all, &late], Key::Isr, 1);
        assert_eq!(ranks, [(2, 3), (1, 1), (2, 3)]);
    }

    #[test]
    fn equal_entries_share_ranks_in_any_episode_order() {
        let mut entries = [scores(|episode| episode % 2 == 0), scores(|episode| episode % 2 == 0)];
        let intervals =
            |entries: &[Vec<EpisodeScore>; 2]| rank_intervals(&[&entries[0], &entries[1]], Key::Isr, 3);
        assert_eq!(intervals(&entries), [(1, 1), (1, 1)]);
        entries[1].reverse();
        assert_eq!(intervals(&entries), [(1, 1), (1, 1)]);
    }

    #[test]
    fn fewer_steps_rank_first_and_no_episodes_last() {
        let steps = |steps| {
            let mut scores = scores(|_| true);
            scores.iter_mut().for_each(|score| score.metrics.steps = steps);
            scores
        };
        assert_eq!(rank_intervals(&[&steps(9), &[], &steps(3)], Key::Steps, 1), [(2, 2), (3, 3), (1, 1)]);
        assert!(rank_intervals(&[], Key::Steps, 1).is_empty());
    }

    #[test]
    fn single_scene_resamples_episodes() {
        let mut entries = [scores(|episode| episode < 6), scores(|episode| episode >= 5)];
        entries.iter_mut().flatten().for_each(|score| "only".clone_into(&mut score.scene));
        assert_eq!(rank_intervals(&[&entries[0], &entries[1]], Key::Isr, 1), [(1, 2), (1, 2)]);
    }

    #[test]
    fn rank_intervals_span_25th_to_975th_rank() {
        // A second implementation of the draws counts 975 resamples with the first entry ahead and 25 with the second.
        // Means are never equal: a sum of five odd numbers is not 0.
        let mut entries = [scores(|_| true), scores(|_| true)];
        let leads = [1.0, 5.0, 5.0, 9.0, -3.0];
        for (episode, score) in entries[0].iter_mut().enumerate() {
            score.metrics.isr = 0.5 + leads[episode / 2] / 32.0;
        }
        entries[1].iter_mut().for_each(|score| score.metrics.isr = 0.5);
        assert_eq!(rank_intervals(&[&entries[0], &entries[1]], Key::Isr, 23), [(1, 1), (1, 2)]);
    }

    #[test]
    fn entries_with_more_episodes_gain_no_rank() {
        let entry = |isr: f64, per_scene: u32| -> Vec<EpisodeScore> {
            let episode = |number: u32| EpisodeScore {
                episode: format!("e{number}"),
                scene: format!("s{}", number % 5),
                order: Order::Ordered,
                metrics: Metrics { isr, ..Metrics::default() },
            };
            (0..5 * per_scene).map(episode).collect()
        };
        // Every resample of an entry has the same mean.
        let (worst, middle, best) = (entry(0.5, 1), entry(0.625, 4), entry(0.75, 1));
        assert_eq!(rank_intervals(&[&worst, &middle, &best], Key::Isr, 1), [(3, 3), (2, 2), (1, 1)]);
    }
}
