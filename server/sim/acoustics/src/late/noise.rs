//! Noise for late energy, the same at every position, so that positions are coherent.
//!
//! Source: "low-noise noise" (Pumplin 1985, J. Acoust. Soc. Am. 78), by repeated division by the envelope and
//! restoration of the spectrum (Kohlrausch and others 1997, Acta Acustica 83).

use super::cells::BLOCK;
use crate::SAMPLE_RATE_HZ;
use crate::bands::{BAND_HZ, BANDS};
use crate::transform::{Fourier, unit_phasor};
use avln_geom::Rng;
use realfft::num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Noise period, samples: about a second. A power of two.
pub(super) const PERIOD: usize = 16_384;

/// Iterations of envelope flattening.
const ROUNDS: usize = 12;

const BORDER_OCTAVES: f64 = 0.25;

// Lower frequencies are inaudible.
const LOWEST_HZ: f64 = 40.0;

/// A head's diffuse-field response at a frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DiffuseResponse {
    /// Energy at an ear relative to the free field.
    pub(super) energy: f64,
    /// Interaural coherence, real part, -1 to 1.
    pub(super) coherence: f64,
}

/// Noise with unit spectral density by band, a period and a block long: diffuse at both ears, and at a point.
#[derive(Default)]
pub(super) struct Noise {
    pub(super) left: [Vec<f32>; BANDS],
    pub(super) right: [Vec<f32>; BANDS],
    pub(super) point: [Vec<f32>; BANDS],
}

impl Noise {
    /// Creates noise for ears with the response `diffuse` (by frequency in hertz).
    pub(super) fn new(diffuse: impl Fn(f64) -> DiffuseResponse) -> Self {
        let mut noise = Self::default();
        for band in 0..BANDS {
            let ears = EarPair::new(band, &diffuse, &mut Rng::new(band as u64).fork("ears"));
            [noise.left[band], noise.right[band]] = ears.samples();
            let everywhere = |_| DiffuseResponse { energy: 1.0, coherence: 1.0 };
            let point = EarPair::new(band, everywhere, &mut Rng::new(band as u64).fork("point"));
            [noise.point[band], _] = point.samples();
        }
        noise
    }
}

/// Half sum and half difference between two ears' noise in a band, as positive-frequency spectra.
#[derive(Default)]
struct EarPair {
    sum: Vec<Complex64>,
    difference: Vec<Complex64>,
    sum_size: Vec<f64>,
    difference_size: Vec<f64>,
}

impl EarPair {
    fn new(band: usize, diffuse: impl Fn(f64) -> DiffuseResponse, rng: &mut Rng) -> Self {
        let bins = 1 + highest_bin(band);
        let mut pair = Self::default();
        for bin in 0..bins {
            let frequency_hz = bin_hz(bin);
            let DiffuseResponse { energy, coherence } = diffuse(frequency_hz);
            let energy = energy * PERIOD as f64 * band_energy(band, frequency_hz);
            pair.sum_size.push((0.5 * energy * (1.0 + coherence).max(0.0)).sqrt());
            pair.difference_size.push((0.5 * energy * (1.0 - coherence).max(0.0)).sqrt());
            for spectrum in [&mut pair.sum, &mut pair.difference] {
                spectrum.push(unit_phasor(TAU * rng.unit()));
            }
        }
        let coherence = |bin: usize| {
            let is_inside = bin < bins && band_energy(band, bin_hz(bin)) > 0.0;
            is_inside.then(|| diffuse(bin_hz(bin)).coherence)
        };
        pair.restore_magnitudes();
        pair.flatten_envelopes(coherence);
        pair
    }

    /// Restores spectral magnitudes, without the phases.
    fn restore_magnitudes(&mut self) {
        let sizes = [(&mut self.sum, &self.sum_size), (&mut self.difference, &self.difference_size)];
        for (spectrum, sizes) in sizes {
            for (value, size) in spectrum.iter_mut().zip(sizes) {
                let norm = value.norm_sqr().sqrt();
                *value = if norm > 0.0 { *value * (size / norm) } else { Complex64::new(*size, 0.0) };
            }
        }
    }

    /// Flattens both envelopes within the given spectra.
    fn flatten_envelopes(&mut self, coherence: impl Fn(usize) -> Option<f64>) {
        // A band's envelope needs at most twice as many points as bins.
        let points = (2 * self.sum.len()).next_power_of_two().min(PERIOD);
        let (fourier, lags) = (Fourier::new(points), Lags::new(points, coherence));
        for _ in 0..ROUNDS {
            let mut ears = [1.0, -1.0].map(|sign| {
                let mut ear = self.ear(sign, points);
                fourier.backward(&mut ear);
                ear.iter_mut().for_each(|value| *value /= value.norm_sqr().sqrt().max(f64::MIN_POSITIVE));
                ear
            });
            lags.decorrelate(&mut ears);
            ears.iter_mut().for_each(|ear| fourier.forward(ear));
            let [left, right] = ears;
            for (bin, (sum, difference)) in self.sum.iter_mut().zip(&mut self.difference).enumerate() {
                (*sum, *difference) = (left[bin] + right[bin], left[bin] - right[bin]);
            }
            self.restore_magnitudes();
        }
    }

    /// An ear's spectrum: `sign` is 1 for the left ear, -1 for the right ear.
    fn ear(&self, sign: f64, points: usize) -> Vec<Complex64> {
        let mut ear: Vec<_> =
            self.sum.iter().zip(&self.difference).map(|(sum, difference)| sum + difference * sign).collect();
        ear.resize(points, Complex64::default());
        ear
    }

    fn samples(&self) -> [Vec<f32>; 2] {
        let fourier = Fourier::new(PERIOD);
        // A real signal has half its spectrum at negative frequencies.
        let scale = 2.0 / PERIOD as f64;
        [1.0, -1.0].map(|sign| {
            let mut ear = self.ear(sign, PERIOD);
            fourier.backward(&mut ear);
            let period = ear.iter().map(|value| (value.re * scale) as f32);
            let mut samples: Vec<f32> = period.collect();
            samples.extend_from_within(..BLOCK);
            samples
        })
    }
}

fn bin_hz(bin: usize) -> f64 {
    bin as f64 * f64::from(SAMPLE_RATE_HZ) / PERIOD as f64
}

fn highest_bin(band: usize) -> usize {
    let edge_hz = f64::from(BAND_HZ[band]) * libm::exp2(0.5 + 0.5 * BORDER_OCTAVES);
    let bin = edge_hz * PERIOD as f64 / f64::from(SAMPLE_RATE_HZ);
    (bin as usize).min(PERIOD / 2 - 1)
}

/// Energy share in `band` at `frequency_hz`; all shares add up to 1.
fn band_energy(band: usize, frequency_hz: f64) -> f64 {
    if frequency_hz < LOWEST_HZ {
        return 0.0;
    }
    let octaves = libm::log2(frequency_hz / f64::from(BAND_HZ[band]));
    let above = if band == 0 { 1.0 } else { rise(octaves + 0.5) };
    let below = if band == BANDS - 1 { 1.0 } else { 1.0 - rise(octaves - 0.5) };
    above * below
}

/// Transition from 0 to 1 across a band edge, `octaves` from the middle.
fn rise(octaves: f64) -> f64 {
    let share = (octaves / BORDER_OCTAVES + 0.5).clamp(0.0, 1.0);
    let sine = libm::sin(FRAC_PI_2 * share);
    sine * sine
}

/// Analysed parts per period: 32 ms long, with half overlap.
const PARTS: usize = 32;

/// Longest lag perceived as a direction, samples: 1 ms.
const HEARD_SAMPLES: usize = 16;

// About half of a correction returns, because lags in a band are not sharp.
const STEP: f64 = 2.0;

/// Target interaural correlation for a noise band.
struct Lags {
    fourier: Fourier,
    window: Vec<f64>,
    /// Per frequency in a part: mean cosine of the interaural phase; `None` outside the band.
    cosines: Vec<Option<f64>>,
    /// Last relevant lag, points.
    last: usize,
}

impl Lags {
    /// Creates targets for `points` points per period; `coherence` (-1 to 1) by bin, `None` outside the band.
    fn new(points: usize, coherence: impl Fn(usize) -> Option<f64>) -> Self {
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
    // Two independent noises correlate by chance at some lag, and all positions would share that direction.
    fn decorrelate(&self, ears: &mut [Vec<Complex64>; 2]) {
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

    fn plain(_: f64) -> DiffuseResponse {
        DiffuseResponse { energy: 1.0, coherence: 0.3 }
    }

    #[test]
    fn band_shares_add_up_to_one() {
        for frequency_hz in [60.0, 125.0, 177.0, 400.0, 1400.0, 5600.0, 7900.0] {
            let sum: f64 = (0..BANDS).map(|band| band_energy(band, frequency_hz)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{frequency_hz} Hz: {sum}");
        }
    }

    #[test]
    fn noise_has_even_energy_and_the_requested_coherence() {
        let noise = Noise::new(plain);
        for (band, center_hz) in BAND_HZ.iter().enumerate().skip(1) {
            let (left, right) = (&noise.left[band][..PERIOD], &noise.right[band][..PERIOD]);
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            let energy = (dot(left, left) * dot(right, right)).sqrt();
            assert!((dot(left, right) / energy - 0.3).abs() < 0.1, "band {band}");
            let bandwidth = f64::from(*center_hz) * std::f64::consts::FRAC_1_SQRT_2 / 8000.0;
            let expected = PERIOD as f64 * if band == BANDS - 1 { 0.293 } else { bandwidth };
            assert!((energy / expected - 1.0).abs() < 0.05, "band {band}: {energy} of {expected}");
            // 10 ms slices: plain noise with a bandwidth of 90 Hz would vary by 75 %.
            let slices = left.chunks(160).map(|slice| dot(slice, slice) * PERIOD as f64 / 160.0 / energy);
            let spread = slices.clone().map(|share| (share - 1.0) * (share - 1.0)).sum::<f64>();
            let spread = (spread / slices.count() as f64).sqrt();
            assert!(spread < 0.35, "band {band}: {spread}");
        }
    }

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
    fn decorrelated_noise_has_no_random_direction() {
        let (lags, mut ears) = (Lags::new(PERIOD, |_| Some(0.0)), two_noises());
        let before = peak(&lags, &ears);
        (0..8).for_each(|_| lags.decorrelate(&mut ears));
        let after = peak(&lags, &ears);
        assert!(before > 0.06 && after < 0.4 * before, "from {before} to {after}");
    }

    #[test]
    fn mean_cosine_approximates_the_series() {
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
