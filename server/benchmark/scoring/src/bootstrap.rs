//! Percentile bootstrap over scenes (Efron 1979).

use avln_geom::SplitMix64;

/// Resamples per interval.
pub(crate) const RESAMPLES: usize = 1000;

/// Cluster drawn as a whole: sums per column, and the episode count.
pub(crate) struct Cluster<const K: usize> {
    sums: [f64; K],
    count: usize,
}

/// Groups rows by scene; with a single scene every row is a cluster. Rows with equal scenes must be adjacent.
pub(crate) fn clusters<const K: usize>(rows: &[(&str, [f64; K])]) -> Vec<Cluster<K>> {
    // Episodes in a scene are correlated, so scenes are resampled. A single scene leaves only episodes to resample.
    let one_scene = rows.windows(2).all(|pair| pair[0].0 == pair[1].0);
    let same = |a: &(&str, [f64; K]), b: &(&str, [f64; K])| !one_scene && a.0 == b.0;
    rows.chunk_by(same).map(total).collect()
}

fn total<const K: usize>(rows: &[(&str, [f64; K])]) -> Cluster<K> {
    let mut sums = [0.0; K];
    for (_, values) in rows {
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value;
        }
    }
    Cluster { sums, count: rows.len() }
}

/// Sorted means per column over clusters drawn with replacement.
fn resampled_means<const K: usize>(clusters: &[Cluster<K>], seed: u64) -> [Vec<f64>; K] {
    let mut draw = SplitMix64::new(seed);
    let mut means: [Vec<f64>; K] = std::array::from_fn(|_| Vec::with_capacity(RESAMPLES));
    for _ in 0..RESAMPLES {
        let mut sums = [0.0; K];
        let mut count = 0;
        for _ in clusters {
            let drawn = &clusters[draw.below(clusters.len())];
            count += drawn.count;
            for (sum, value) in sums.iter_mut().zip(&drawn.sums) {
                *sum += value;
            }
        }
        for (column, sum) in means.iter_mut().zip(sums) {
            column.push(sum / count as f64);
        }
    }
    for column in &mut means {
        column.sort_by(f64::total_cmp);
    }
    means
}

/// Returns the middle 95 % of resampled means per column, as (low, high). `clusters` must not be empty.
pub(crate) fn intervals<const K: usize>(clusters: &[Cluster<K>], seed: u64) -> [(f64, f64); K] {
    let means = resampled_means(clusters, seed);
    std::array::from_fn(|column| {
        (means[column][RESAMPLES / 40 - 1], means[column][RESAMPLES - RESAMPLES / 40 - 1])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_scenes_give_the_full_interval() {
        let rows = [("a", [0.0]), ("a", [0.0]), ("b", [1.0]), ("b", [1.0])];
        let grouped = clusters(&rows);
        assert_eq!(grouped.len(), 2);
        assert_eq!(intervals(&grouped, 1), [(0.0, 1.0)]);
    }

    #[test]
    fn fair_coin_interval_matches_normal_approximation() {
        // 100 episodes in a scene, half with 1: 0.5 ± 1.96 × sqrt(0.25 / 100) = 0.402 to 0.598.
        let rows: Vec<_> = (0..100).map(|i| ("a", [f64::from(i % 2)])).collect();
        let [(low, high)] = intervals(&clusters(&rows), 9);
        assert!((low - 0.402).abs() < 0.02 && (high - 0.598).abs() < 0.02, "{low} to {high}");
    }
}
