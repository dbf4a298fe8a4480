use avln_geom::Rng;
use std::sync::LazyLock;

const BITS: u32 = 12;
const COUNT: usize = 1 << BITS;

/// Deviates of the normal distribution with mean 0 and deviation 1, drawn from a table of 4,096 equally likely values up
/// to 3.67: their deviation is 0.999.
pub(super) struct Normal {
    quantiles: Box<[f32; COUNT]>,
}

static NORMAL: LazyLock<Normal> = LazyLock::new(Normal::new);

impl Normal {
    /// The table, made once.
    pub(super) fn table() -> &'static Self {
        &NORMAL
    }

    fn new() -> Self {
        let mut quantiles = Box::new([0.0; COUNT]);
        for index in COUNT / 2..COUNT {
            let value = quantile((index as f64 + 0.5) / COUNT as f64) as f32;
            quantiles[index] = value;
            quantiles[COUNT - 1 - index] = -value;
        }
        Self { quantiles }
    }

    /// Three independent deviates for the place `index` of the stream of `key`.
    #[inline]
    pub(super) fn three(&self, key: u64, index: usize) -> [f32; 3] {
        let bits = Rng::word(key, index as u64);
        [0, BITS, 2 * BITS].map(|shift| self.quantiles[(bits >> shift) as usize % COUNT])
    }
}

/// The value that a normal deviate stays below with probability `share`, from 0.5 to 0.9999: halves an interval until it is
/// below 2^-40.
fn quantile(share: f64) -> f64 {
    let (mut low, mut high) = (0.0, 4.0);
    for _ in 0..42 {
        let middle = 0.5 * (low + high);
        let below = 0.5 * libm::erfc(-middle * std::f64::consts::FRAC_1_SQRT_2);
        if below < share { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_holds_the_quantiles_of_the_normal_distribution() {
        // From printed tables.
        for (share, value) in [(0.5, 0.0), (0.841_344_75, 1.0), (0.975, 1.959_964), (0.999, 3.090_232)] {
            assert!((quantile(share) - value).abs() < 1e-5, "{share}");
        }
        let table = Normal::table();
        assert!(table.quantiles.windows(2).all(|pair| pair[0] < pair[1]));
        let moment = |power: i32| {
            let sum: f64 = table.quantiles.iter().map(|value| f64::from(*value).powi(power)).sum();
            sum / COUNT as f64
        };
        assert!(
            moment(1).abs() < 1e-9
                && (moment(2).sqrt() - 0.999).abs() < 1e-3
                && (moment(4) - 3.0).abs() < 0.05
        );
        assert!((table.quantiles[COUNT - 1] - 3.67).abs() < 0.01);
    }

    #[test]
    fn the_three_deviates_of_a_place_are_independent() {
        let table = Normal::table();
        let mut products = [0.0_f64; 4];
        for index in 0..100_000 {
            let [a, b, c] = table.three(5, index).map(f64::from);
            let [next, ..] = table.three(5, index + 1).map(f64::from);
            for (sum, product) in products.iter_mut().zip([a * b, a * c, b * c, a * next]) {
                *sum += product / 100_000.0;
            }
        }
        assert!(products.iter().all(|mean| mean.abs() < 0.015), "{products:?}");
    }
}
