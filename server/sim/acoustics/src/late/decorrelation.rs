//! Interaural decorrelation of late noise in every 32 ms, as in a diffuse field.

use crate::transform::Fourier;
use realfft::num_complex::Complex64;
use std::f64::consts::{FRAC_PI_4, PI};

/// Noise period, samples: about a second. A power of two.
pub(super) const PERIOD: usize = 16_384;

/// Analysed parts per period: 32 ms long, with half overlap.
const PARTS: usize = 32;

/// Longest lag perceived as a direction, samples: 1 ms.
const HEARD_SAMPLES: usize = 16;

// About half of a correction returns, because lags in a band are not sharp.
const STEP: f64 = 2.0;

/// Target interaural correlation for a noise band.
pub(super) struct Lags {
    fourier: Fourier,
    window: Vec<f64>,
    /// Per frequency in a part: mean cosine of the interaural phase; `None` outside the band.
    cosines: Vec<Option<f64>>,
    /// Last relevant lag, points.
    last: usize,
}

impl Lags {
    /// Creates targets for noise with `points` points per period; `coherence` (-1 to 1) by bin over the whole
    /// period, inside the band.
    pub(super) fn new(points: usize, coherence: impl Fn(usize) -> Option<f64>) -> Self {
        let length = points / PARTS;
        let window = |n| libm::sin(PI * (n as f64 + 0.5) / length as f64);
        Self {
            fourier: Fourier::new(length),
            window: (0..length).map(window).collect(),
            cosines: (0..length).map(|bin| coherence(bin * PARTS).map(mean_cosine)).collect(),
            last: (HEARD_SAMPLES * points / PERIOD).max(1),
        }
    }

    /// Rotates the phases at both ears, a period each, towards the target correlation.
    pub(super) fn decorrelate(&self, ears: &mut [Vec<Complex64>; 2]) {
        let (length, points) = (self.window.len(), ears[0].len());
        let mut sums = [(); 2].map(|()| vec![Complex64::default(); points]);
        for start in (0..points).step_by(length / 2) {
            let mut parts = ears.each_ref().map(|ear| self.part(ear, start));
            self.turn(&mut parts);
            for (sum, part) in sums.iter_mut().zip(&mut parts) {
                self.fourier.backward(part);
                for (n, (value, window)) in part.iter().zip(&self.window).enumerate() {
                    sum[(start + n) % points] += value * (window / length as f64);
                }
            }
        }
        *ears = sums;
    }

    /// Spectrum from point `start`.
    fn part(&self, ear: &[Complex64], start: usize) -> Vec<Complex64> {
        let value = |(n, window): (usize, &f64)| ear[(start + n) % ear.len()] * *window;
        let mut part: Vec<_> = self.window.iter().enumerate().map(value).collect();
        self.fourier.forward(&mut part);
        part
    }

    /// Removes excess correlation at relevant lags, half at each ear.
    fn turn(&self, parts: &mut [Vec<Complex64>; 2]) {
        let [left, right] = parts;
        let phases: Vec<_> = left.iter().zip(right.iter()).map(|(l, r)| unit(r * l.conj())).collect();
        let excess =
            |(phase, cosine): (&Complex64, &Option<f64>)| cosine.map_or(Complex64::default(), |c| phase - c);
        let mut surplus: Vec<_> = phases.iter().zip(&self.cosines).map(excess).collect();
        self.keep_short_lags(&mut surplus);
        for (bin, phase) in phases.iter().enumerate().filter(|(bin, _)| self.cosines[*bin].is_some()) {
            let turn = unit(phase - surplus[bin] * STEP) * phase.conj();
            let half = unit(turn + 1.0);
            (left[bin], right[bin]) = (left[bin] * half.conj(), right[bin] * half);
        }
    }

    fn keep_short_lags(&self, surplus: &mut [Complex64]) {
        let length = surplus.len();
        self.fourier.backward(surplus);
        for (lag, value) in surplus.iter_mut().enumerate() {
            let heard = lag.min(length - lag) <= self.last;
            *value *= if heard { 1.0 / length as f64 } else { 0.0 };
        }
        self.fourier.forward(surplus);
    }
}

/// Mean phase cosine between two Gaussian noises with real coherence: within 0.05 of `pi/4 c F(1/2, 1/2; 2;
/// c^2)`, from the phase density (Goodman 2007, "Speckle Phenomena in Optics").
fn mean_cosine(coherence: f64) -> f64 {
    FRAC_PI_4 * coherence + (1.0 - FRAC_PI_4) * coherence * coherence * coherence
}

fn unit(value: Complex64) -> Complex64 {
    let norm = value.norm_sqr().sqrt();
    if norm > 0.0 { value / norm } else { Complex64::new(1.0, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;

    /// Two independent white noises, a period long.
    fn two_noises() -> [Vec<Complex64>; 2] {
        let mut rng = Rng::new(4);
        let mut ear = || (0..PERIOD).map(|_| Complex64::new(rng.unit() - 0.5, rng.unit() - 0.5)).collect();
        [ear(), ear()]
    }

    /// Highest phase correlation at relevant lags, mean over parts, 0 to 1.
    fn peak(lags: &Lags, ears: &[Vec<Complex64>; 2]) -> f64 {
        let length = lags.window.len();
        let of_part = |start| {
            let [left, right] = ears.each_ref().map(|ear| lags.part(ear, start));
            let mut phases: Vec<_> = left.iter().zip(&right).map(|(l, r)| unit(r * l.conj())).collect();
            lags.keep_short_lags(&mut phases);
            lags.fourier.backward(&mut phases);
            phases.iter().map(|value| value.norm_sqr()).fold(0.0, f64::max).sqrt() / length as f64
        };
        (0..PERIOD).step_by(length).map(of_part).sum::<f64>() / PARTS as f64
    }

    #[test]
    fn noise_has_no_direction_by_chance() {
        let (lags, mut ears) = (Lags::new(PERIOD, |_| Some(0.0)), two_noises());
        let before = peak(&lags, &ears);
        (0..8).for_each(|_| lags.decorrelate(&mut ears));
        let after = peak(&lags, &ears);
        assert!(before > 0.06 && after < 0.4 * before, "from {before} to {after}");
    }

    #[test]
    fn the_mean_cosine_is_that_of_the_series() {
        for coherence in [-0.9, -0.3, 0.0, 0.2, 0.5, 0.8, 1.0_f64] {
            let (mut term, mut sum) = (1.0, 1.0);
            for n in 0..100_000 {
                let n = f64::from(n);
                term *= (n + 0.5) * (n + 0.5) / ((n + 2.0) * (n + 1.0)) * coherence * coherence;
                sum += term;
            }
            assert!((mean_cosine(coherence) - FRAC_PI_4 * coherence * sum).abs() < 0.05, "{coherence}");
        }
    }
}
