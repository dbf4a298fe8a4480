/// Resamples behind an interval.
pub(crate) const RESAMPLES: usize = 1000;

/// SplitMix64 (Steele, Lea and Flood 2014): a stream fixed by its seed, enough to draw indices.
pub(crate) struct SplitMix(u64);

impl SplitMix {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// An index below `count`, which must not be 0.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        ((u128::from(self.next()) * count as u128) >> 64) as usize
    }
}

/// The clusters that are drawn together: one of sums over its values, and how many there are.
pub(crate) struct Cluster<const K: usize> {
    pub(crate) sums: [f64; K],
    pub(crate) count: usize,
}

/// Groups rows by scene, or one by one when there is a single scene. Rows of a scene must be neighbours.
pub(crate) fn clusters<const K: usize>(rows: &[(&str, [f64; K])]) -> Vec<Cluster<K>> {
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

/// Means of the clusters drawn with replacement, sorted upwards, for each of the `K` columns.
fn resampled_means<const K: usize>(clusters: &[Cluster<K>], seed: u64) -> [Vec<f64>; K] {
    let mut draw = SplitMix(seed);
    let mut means: [Vec<f64>; K] = std::array::from_fn(|_| Vec::with_capacity(RESAMPLES));
    for _ in 0..RESAMPLES {
        let (mut sums, mut count) = ([0.0; K], 0);
        for _ in clusters {
            let drawn = &clusters[draw.below(clusters.len())];
            count += drawn.count;
            sums.iter_mut().zip(&drawn.sums).for_each(|(sum, value)| *sum += value);
        }
        means.iter_mut().zip(sums).for_each(|(column, sum)| column.push(sum / count as f64));
    }
    means.iter_mut().for_each(|column| column.sort_by(f64::total_cmp));
    means
}

/// The middle 95 % of the resampled means of each column (percentile bootstrap, Efron 1979), as (low, high).
/// `clusters` must not be empty.
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
    fn the_stream_of_seed_zero_is_the_published_one() {
        let mut stream = SplitMix(0);
        assert_eq!([stream.next(), stream.next()], [0xe220_a839_7b1d_cdaf, 0x6e78_9e6a_a1b9_65f4]);
    }

    #[test]
    fn two_scenes_that_disagree_span_everything() {
        let rows = [("a", [0.0]), ("a", [0.0]), ("b", [1.0]), ("b", [1.0])];
        let grouped = clusters(&rows);
        assert_eq!(grouped.len(), 2);
        assert_eq!(intervals(&grouped, 1), [(0.0, 1.0)]);
    }

    #[test]
    fn the_interval_of_a_fair_coin_agrees_with_the_normal_approximation() {
        // 100 episodes of one scene, half of them 1: 0.5 ± 1.96 × sqrt(0.25 / 100) = 0.402 to 0.598.
        let rows: Vec<_> = (0..100).map(|i| ("a", [f64::from(i % 2)])).collect();
        let [(low, high)] = intervals(&clusters(&rows), 9);
        assert!((low - 0.402).abs() < 0.02 && (high - 0.598).abs() < 0.02, "{low} to {high}");
    }
}
