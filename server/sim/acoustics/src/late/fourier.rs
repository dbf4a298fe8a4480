//! A discrete Fourier transform with equal bits on every processor.

use realfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// A transform of a power of two of points.
pub(super) struct Fourier {
    /// `exp(-2 pi i k / points)` for the first half of k.
    turns: Vec<Complex64>,
}

impl Fourier {
    /// Plans a transform; `points` must be a power of two.
    pub(super) fn new(points: usize) -> Self {
        let step_rad = TAU / points as f64;
        let turn = |k: usize| Complex64::new(libm::cos(k as f64 * step_rad), -libm::sin(k as f64 * step_rad));
        Self { turns: (0..points / 2).map(turn).collect() }
    }

    /// Replaces values by `sum over n of values[n] exp(-2 pi i k n / points)`.
    pub(super) fn forward(&self, values: &mut [Complex64]) {
        let points = values.len();
        reverse_bits(values);
        let mut half = 1;
        while half < points {
            let stride = points / (2 * half);
            for pair in values.chunks_exact_mut(2 * half) {
                let (low, high) = pair.split_at_mut(half);
                for ((a, b), turn) in low.iter_mut().zip(high).zip(self.turns.iter().step_by(stride)) {
                    let turned = *b * turn;
                    (*a, *b) = (*a + turned, *a - turned);
                }
            }
            half *= 2;
        }
    }

    /// The opposite sign of the exponent; not divided by the number of points.
    pub(super) fn backward(&self, values: &mut [Complex64]) {
        values.iter_mut().for_each(|value| *value = value.conj());
        self.forward(values);
        values.iter_mut().for_each(|value| *value = value.conj());
    }
}

fn reverse_bits(values: &mut [Complex64]) {
    let bits = values.len().trailing_zeros();
    for index in 0..values.len() {
        let other = index.reverse_bits().checked_shr(usize::BITS - bits).unwrap_or(0);
        if index < other {
            values.swap(index, other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;

    #[test]
    fn the_transform_is_the_plain_sum() {
        let mut rng = Rng::new(9);
        for points in [1, 2, 8, 32] {
            let values: Vec<_> = (0..points).map(|_| Complex64::new(rng.unit(), rng.unit())).collect();
            let (mut there, fourier) = (values.clone(), Fourier::new(points));
            fourier.forward(&mut there);
            for (k, value) in there.iter().enumerate() {
                let term = |(n, v): (usize, &Complex64)| {
                    let turn = TAU * (k * n) as f64 / points as f64;
                    v * Complex64::new(libm::cos(turn), -libm::sin(turn))
                };
                let plain: Complex64 = values.iter().enumerate().map(term).sum();
                assert!((plain - value).norm() < 1e-12, "{points}: {plain} and {value}");
            }
            fourier.backward(&mut there);
            let back = there.iter().zip(&values).map(|(a, b)| (a / points as f64 - b).norm());
            assert!(back.fold(0.0, f64::max) < 1e-12);
        }
    }
}
