use crate::{
    Direction, EpisodeScore, Key, Summary,
    bootstrap::{clusters, intervals},
    compare::pairs,
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
}

/// Where an entry stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Place {
    /// Index of the entry in the slice that was ranked.
    pub entry: usize,
    /// 1 for the best; entries with equal numbers share a rank and the next rank is skipped.
    pub rank: u32,
    /// Entries of one group cannot be told apart from the group's first; groups count from 1.
    pub tie_group: u32,
}

/// The metrics that part entries with the same key, in order.
const TIE_BREAKS: [Key; 5] = [Key::Sr, Key::Isr, Key::Spl, Key::SoftSpl, Key::Osr];

/// Orders `entries` by `key`, best first, and says which cannot be told apart.
///
/// Entries that agree in the key and in SR, ISR, SPL, SoftSPL and OSR share a rank. An entry joins the tie group above
/// it unless the 95 % interval of its paired difference in `key` to the group's first entry excludes 0.
pub fn rank(entries: &[Entry<'_>], key: Key, seed: u64) -> Vec<Place> {
    let mut order: Vec<usize> = (0..entries.len()).collect();
    order.sort_by(|&a, &b| better(entries[a].summary, entries[b].summary, key));
    let mut places: Vec<Place> = Vec::with_capacity(order.len());
    let mut group_first = 0;
    for (index, &entry) in order.iter().enumerate() {
        let place = match places.last() {
            None => Place { entry, rank: 1, tie_group: 1 },
            Some(above) => {
                let equal = better(entries[above.entry].summary, entries[entry].summary, key).is_eq();
                let apart = !equal && differ(&entries[order[group_first]], &entries[entry], key, seed);
                Place {
                    entry,
                    rank: if equal { above.rank } else { index as u32 + 1 },
                    tie_group: above.tie_group + u32::from(apart),
                }
            }
        };
        if places.last().is_some_and(|above| above.tie_group != place.tie_group) {
            group_first = index;
        }
        places.push(place);
    }
    places
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
