//! Lag between two ears.

use realfft::{RealFftPlanner, num_complex::Complex32};
use std::ops::RangeInclusive;

/// A quarter of a second: a step of an episode.
pub(crate) const FRAME: usize = 4000;

/// Parts of a sample in which lags are found.
const FINE: usize = 8;

/// The longest lag of a head, samples.
const LONGEST_LAG: i32 = 13;

/// Transforms.
#[derive(Default)]
pub(crate) struct Fourier(RealFftPlanner<f32>);

impl Fourier {
    pub(crate) fn spectrum(&mut self, signal: &[f32], length: usize) -> Vec<Complex32> {
        let mut padded = signal.to_vec();
        padded.resize(length, 0.0);
        let forward = self.0.plan_fft_forward(length);
        let mut spectrum = forward.make_output_vec();
        forward.process(&mut padded, &mut spectrum).expect("lengths agree");
        spectrum
    }

    pub(crate) fn signal(&mut self, mut spectrum: Vec<Complex32>, length: usize) -> Vec<f32> {
        spectrum.resize(length / 2 + 1, Complex32::default());
        (spectrum[0].im, spectrum[length / 2].im) = (0.0, 0.0);
        let inverse = self.0.plan_fft_inverse(length);
        let mut signal = inverse.make_output_vec();
        inverse.process(&mut spectrum, &mut signal).expect("lengths agree");
        signal
    }

    /// Samples by which the right ear hears later, by generalised cross-correlation with phase transform
    /// (Knapp and Carter 1976) of all frequencies.
    pub(crate) fn lag(&mut self, left: &[f32], right: &[f32]) -> f32 {
        self.lag_within(left, right, 0.0..=8000.0)
    }

    /// Lag within `band_hz`, with equal weights.
    pub(crate) fn lag_within(&mut self, left: &[f32], right: &[f32], band_hz: RangeInclusive<f32>) -> f32 {
        let length = 2 * FRAME;
        let (left, right) = (self.spectrum(left, length), self.spectrum(right, length));
        let phase = |(bin, (l, r)): (usize, (&Complex32, &Complex32))| {
            let cross = r * l.conj();
            let counts = band_hz.contains(&(bin as f32 * 16_000.0 / length as f32));
            if counts { cross / cross.norm().max(1e-12) } else { Complex32::default() }
        };
        let fine = FINE as i32;
        let phases = left.iter().zip(&right).enumerate().map(phase).collect();
        let correlation = self.signal(phases, FINE * length);
        let at = |lag: i32| correlation[lag.rem_euclid(correlation.len() as i32) as usize];
        let lags = -LONGEST_LAG * fine..=LONGEST_LAG * fine;
        lags.max_by(|&a, &b| at(a).total_cmp(&at(b))).expect("a lag") as f32 / fine as f32
    }
}
