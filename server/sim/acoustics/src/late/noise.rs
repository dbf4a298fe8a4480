//! Noise for late energy, the same at every position, so that positions are coherent.
//!
//! Source: "low-noise noise" (Pumplin 1985, J. Acoust. Soc. Am. 78), by repeated division by the envelope and
//! restoration of the spectrum (Kohlrausch and others 1997, Acta Acustica 83).

use super::decorrelation::{Lags, PERIOD};
use super::slices::BLOCK;
use crate::SAMPLE_RATE_HZ;
use crate::bands::{BAND_HZ, BANDS};
use crate::transform::{Fourier, unit_phasor};
use avln_geom::Rng;
use realfft::num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Iterations of envelope flattening.
const ROUNDS: usize = 12;

/// Border width between bands, octaves.
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

/// Noise with unit spectral density by band, a period and a block long: at both ears in a diffuse field, and
/// at a point in the free field.
pub(super) struct Noise {
    pub(super) left: [Vec<f32>; BANDS],
    pub(super) right: [Vec<f32>; BANDS],
    pub(super) point: [Vec<f32>; BANDS],
}

impl Noise {
    /// Creates noise for ears with the response `diffuse` (by frequency in hertz).
    pub(super) fn new(diffuse: impl Fn(f64) -> DiffuseResponse) -> Self {
        let mut noise = Self::silent();
        for band in 0..BANDS {
            let ears = EarPair::new(band, &diffuse, &mut Rng::new(band as u64).fork("ears"));
            [noise.left[band], noise.right[band]] = ears.samples();
            let everywhere = |_| DiffuseResponse { energy: 1.0, coherence: 1.0 };
            let point = EarPair::new(band, everywhere, &mut Rng::new(band as u64).fork("point"));
            [noise.point[band], _] = point.samples();
        }
        noise
    }

    fn silent() -> Self {
        let empty = || std::array::from_fn(|_| Vec::new());
        Self { left: empty(), right: empty(), point: empty() }
    }
}

/// Half sum and half difference between two ears' noise in a band, as positive-frequency spectra.
struct EarPair {
    sum: Vec<Complex64>,
    difference: Vec<Complex64>,
    sum_size: Vec<f64>,
    difference_size: Vec<f64>,
}

impl EarPair {
    fn new(band: usize, diffuse: impl Fn(f64) -> DiffuseResponse, rng: &mut Rng) -> Self {
        let bins = 1 + highest_bin(band);
        let mut pair = Self {
            sum: Vec::new(),
            difference: Vec::new(),
            sum_size: Vec::with_capacity(bins),
            difference_size: Vec::with_capacity(bins),
        };
        for bin in 0..bins {
            let frequency_hz = bin as f64 * f64::from(SAMPLE_RATE_HZ) / PERIOD as f64;
            let DiffuseResponse { energy, coherence } = diffuse(frequency_hz);
            let energy = energy * PERIOD as f64 * band_energy(band, frequency_hz);
            pair.sum_size.push((0.5 * energy * (1.0 + coherence).max(0.0)).sqrt());
            pair.difference_size.push((0.5 * energy * (1.0 - coherence).max(0.0)).sqrt());
            for spectrum in [&mut pair.sum, &mut pair.difference] {
                spectrum.push(unit_phasor(TAU * rng.unit()));
            }
        }
        let coherence = |bin: usize| {
            let frequency_hz = bin as f64 * f64::from(SAMPLE_RATE_HZ) / PERIOD as f64;
            let is_there = bin < bins && band_energy(band, frequency_hz) > 0.0;
            is_there.then(|| diffuse(frequency_hz).coherence)
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

    /// Flattens both envelopes as far as the spectra allow.
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

    /// Time signals at both ears.
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

/// Transition from 0 to 1 across a band edge, `octaves` from its centre.
fn rise(octaves: f64) -> f64 {
    let share = (octaves / BORDER_OCTAVES + 0.5).clamp(0.0, 1.0);
    let sine = libm::sin(FRAC_PI_2 * share);
    sine * sine
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(_: f64) -> DiffuseResponse {
        DiffuseResponse { energy: 1.0, coherence: 0.3 }
    }

    #[test]
    fn bands_share_all_energy() {
        for frequency_hz in [60.0, 125.0, 177.0, 400.0, 1400.0, 5600.0, 7900.0] {
            let sum: f64 = (0..BANDS).map(|band| band_energy(band, frequency_hz)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{frequency_hz} Hz: {sum}");
        }
    }

    #[test]
    fn noise_is_even_in_time_and_alike_at_both_ears_as_asked() {
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
}
