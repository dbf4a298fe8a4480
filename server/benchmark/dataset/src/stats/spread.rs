use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How values are spread: their number, sum, extremes and a histogram.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// How many.
    pub count: u64,
    /// Their sum.
    pub sum: f64,
    /// The least; 0 when there are none.
    pub min: f64,
    /// The greatest; 0 when there are none.
    pub max: f64,
    /// Width of a bin of the histogram.
    pub bin: f64,
    /// Values in `[n * bin, (n + 1) * bin)`, by n.
    pub bins: BTreeMap<u32, u64>,
}

impl Spread {
    /// Nothing, with bins of width `bin`.
    pub fn new(bin: f64) -> Self {
        Self { count: 0, sum: 0.0, min: 0.0, max: 0.0, bin, bins: BTreeMap::new() }
    }

    /// Adds a value, 0 or more.
    pub fn note(&mut self, value: f64) {
        self.min = if self.count == 0 { value } else { self.min.min(value) };
        self.max = if self.count == 0 { value } else { self.max.max(value) };
        self.count += 1;
        self.sum += value;
        *self.bins.entry((value / self.bin).floor().max(0.0) as u32).or_default() += 1;
    }

    /// Adds the values of another spread with bins of the same width.
    pub fn add(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        self.min = if self.count == 0 { other.min } else { self.min.min(other.min) };
        self.max = if self.count == 0 { other.max } else { self.max.max(other.max) };
        self.count += other.count;
        self.sum += other.sum;
        for (bin, count) in &other.bins {
            *self.bins.entry(*bin).or_default() += count;
        }
    }

    /// The mean; 0 when there are none.
    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_spreads_add_up_to_the_spread_of_all() {
        let of = |values: &[f64]| {
            let mut spread = Spread::new(5.0);
            values.iter().for_each(|&value| spread.note(value));
            spread
        };
        let mut sum = of(&[1.0, 4.0]);
        sum.add(&of(&[5.0, 12.0]));
        sum.add(&of(&[]));
        assert_eq!(sum, of(&[1.0, 4.0, 5.0, 12.0]));
        assert_eq!((sum.mean(), sum.min, sum.max), (5.5, 1.0, 12.0));
        assert_eq!(sum.bins, BTreeMap::from([(0, 2), (1, 1), (2, 1)]));
    }
}
