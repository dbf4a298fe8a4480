use crate::{
    Direction, EpisodeScore, Key, Summary,
    bootstrap::{clusters, intervals},
    compare::pairs,
    standing::rank_intervals,
};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// One line of a leaderboard before it is ranked.
#[derive(Clone, Copy, Debug)]
pub struct Entry<'a> {
    /// The means of the entry.
    pub summary: &'a Summary,
    /// The episodes behind them, for the paired test.
    pub scores: &'a [EpisodeScore],
    /// Whether it competes; other entries are shown among those that do, and have no rank.
    pub is_ranked: bool,
}

/// Where an entry is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Index of the entry in the slice that was ranked.
    pub entry: usize,
    /// Where it stands among those that compete; `None` where it does not.
    pub standing: Option<Standing>,
}

/// Where an entry stands among those that compete.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Standing {
    /// 1 for the best; entries with equal numbers share a rank and the next rank is skipped.
    pub rank: u32,
    /// The best rank of the middle 95 % that it would have with other scenes, at most `rank`.
    pub rank_low: u32,
    /// The worst of them, at least `rank`.
    pub rank_high: u32,
    /// Entries of one group cannot be told apart from the group's first; groups count from 1.
    pub tie_group: u32,
}

/// The metrics that part entries with the same key, in order.
const TIE_BREAKS: [Key; 5] = [Key::Sr, Key::Isr, Key::Spl, Key::SoftSpl, Key::Osr];

/// Indices of `summaries` by `key`, best first; those that agree in it are parted by SR, ISR, SPL, SoftSPL and OSR.
pub fn best_first(summaries: &[&Summary], key: Key) -> Vec<usize> {
    let mut order: Vec<usize> = (0..summaries.len()).collect();
    order.sort_by(|&a, &b| better(summaries[a], summaries[b], key));
    order
}

/// Orders `entries` by `key`, best first, and says where those that compete stand and which of them cannot be told apart.
///
/// Entries that agree in the key and in SR, ISR, SPL, SoftSPL and OSR share a rank. An entry joins the tie group above
/// it unless the 95 % interval of its paired difference in `key` to the group's first entry excludes 0.
pub fn rank(entries: &[Entry<'_>], key: Key, seed: u64) -> Vec<Place> {
    let summaries: Vec<&Summary> = entries.iter().map(|entry| entry.summary).collect();
    let order = best_first(&summaries, key);
    let competing: Vec<usize> = order.iter().copied().filter(|&entry| entries[entry].is_ranked).collect();
    let ranked: Vec<Entry<'_>> = competing.iter().map(|&entry| entries[entry]).collect();
    let mut standings = vec![None; entries.len()];
    for (entry, standing) in competing.into_iter().zip(standings_of(&ranked, key, seed)) {
        standings[entry] = Some(standing);
    }
    order.into_iter().map(|entry| Place { entry, standing: standings[entry] }).collect()
}

/// Where entries stand that come best first.
fn standings_of(sorted: &[Entry<'_>], key: Key, seed: u64) -> Vec<Standing> {
    let scores: Vec<&[EpisodeScore]> = sorted.iter().map(|entry| entry.scores).collect();
    let spans = rank_intervals(&scores, key, seed);
    let mut standings: Vec<Standing> = Vec::with_capacity(sorted.len());
    let mut group_first = 0;
    for (index, (entry, (low, high))) in sorted.iter().zip(spans).enumerate() {
        let above = standings.last().map(|above| (above, &sorted[index - 1]));
        let equal = above.is_some_and(|(_, above)| better(above.summary, entry.summary, key).is_eq());
        let apart = !equal && index > 0 && differ(&sorted[group_first], entry, key, seed);
        let rank = above.filter(|_| equal).map_or(index as u32 + 1, |(above, _)| above.rank);
        let tie_group = above.map_or(1, |(above, _)| above.tie_group + u32::from(apart));
        if apart {
            group_first = index;
        }
        standings.push(Standing { rank, rank_low: low.min(rank), rank_high: high.max(rank), tie_group });
    }
    standings
}

fn better(a: &Summary, b: &Summary, key: Key) -> Ordering {
    let by = |key: Key| {
        let upwards = key.mean_of(a).total_cmp(&key.mean_of(b));
        if key.direction() == Direction::Higher { upwards.reverse() } else { upwards }
    };
    TIE_BREAKS.into_iter().fold(by(key), |so_far, next| so_far.then_with(|| by(next)))
}

/// Whether the paired difference of the key over the episodes that both played is surely not 0.
/// Two episodes at least are needed to be sure of anything.
fn differ(a: &Entry<'_>, b: &Entry<'_>, key: Key, seed: u64) -> bool {
    let less =
        |(of_a, of_b): &(&EpisodeScore, &EpisodeScore)| [key.of(&of_a.metrics) - key.of(&of_b.metrics)];
    let pairs = pairs(a.scores, b.scores);
    let rows: Vec<_> = pairs.iter().map(|pair| (pair.0.scene.as_str(), less(pair))).collect();
    if rows.len() < 2 {
        return false;
    }
    let [(low, high)] = intervals(&clusters(&rows), seed);
    low > 0.0 || high < 0.0
}
