//! Two agents on the same episodes.

use avln_geom::Rng;

/// Draws of signs.
const DRAWS: u32 = 20_000;

/// Result of a paired test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Paired {
    /// Pairs.
    pub(super) pairs: usize,
    /// Mean of the differences.
    pub(super) difference: f64,
    /// Probability of a mean as far from 0 or farther, if the sign of each difference were a coin's; two-sided.
    pub(super) p: f64,
}

/// The sign-flip permutation test of paired differences (Fisher 1935), by draws with `seed`; scenes are flipped as one, since
/// their episodes are alike. `None` without pairs.
pub(super) fn sign_flip(differences: &[(&str, f64)], seed: u64) -> Option<Paired> {
    if differences.is_empty() {
        return None;
    }
    let mut sorted = differences.to_vec();
    sorted.sort_by(|a, b| a.0.cmp(b.0).then(a.1.total_cmp(&b.1)));
    let sums: Vec<f64> =
        sorted.chunk_by(|a, b| a.0 == b.0).map(|scene| scene.iter().map(|(_, value)| value).sum()).collect();
    let total: f64 = sums.iter().sum();
    let mut rng = Rng::new(seed);
    let mut flipped =
        || sums.iter().map(|sum| if rng.next_u64() >> 63 == 0 { *sum } else { -sum }).sum::<f64>();
    let as_far = (0..DRAWS).filter(|_| flipped().abs() >= total.abs() - 1e-9).count();
    let p = (as_far as f64 + 1.0) / (f64::from(DRAWS) + 1.0);
    Some(Paired { pairs: sorted.len(), difference: total / sorted.len() as f64, p })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_scenes_that_agree_are_one_case_in_128() {
        let names = ["a", "b", "c", "d", "e", "f", "g", "h"];
        let differences: Vec<_> = names.iter().map(|name| (*name, 0.5)).collect();
        let paired = sign_flip(&differences, 1).unwrap();
        // Both signs count: 2 of 2^8.
        assert!((paired.p - 2.0 / 256.0).abs() < 2e-3 && paired.difference == 0.5, "{paired:?}");
    }

    #[test]
    fn differences_that_cancel_say_nothing() {
        let paired = sign_flip(&[("a", 1.0), ("b", -1.0)], 1).unwrap();
        assert_eq!((paired.pairs, paired.p), (2, 1.0));
        assert_eq!(sign_flip(&[], 1), None);
    }
}
