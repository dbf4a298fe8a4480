//! Spectral balance, peak limit and loudness for clips.

use crate::SAMPLE_RATE_HZ;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex, num_complex::Complex32};
use std::sync::Arc;

/// Root mean square during peak limiting.
const LEVEL: f32 = 0.05;

/// Largest peak over root mean square: 13 dB.
const CREST: f32 = 4.467;

/// Edges between the low, middle and high parts, hertz.
const LOW_END_HZ: f32 = 1200.0;
const HIGH_START_HZ: f32 = 2000.0;

/// Smallest energy share for the low and the high part.
const MIN_SHARE: f32 = 0.3;

/// Lowest clip frequency, hertz.
const CUT_HZ: f32 = 80.0;

pub(super) struct Mastering {
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
}

impl Mastering {
    pub(super) fn new(length: usize) -> Self {
        let mut planner = RealFftPlanner::<f32>::new();
        Self { forward: planner.plan_fft_forward(length), inverse: planner.plan_fft_inverse(length) }
    }

    pub(super) fn apply(&self, sound: &mut [f32]) {
        const ROUNDS: usize = 4;
        self.balance(sound);
        set_level(sound);
        for _ in 0..ROUNDS {
            limit(sound);
            set_level(sound);
        }
        let audible = self.set_loudness(sound);
        debug_assert!(audible);
    }

    /// Scales a loop to the common loudness. Returns false, without a change, if it is almost silent.
    pub(super) fn set_loudness(&self, sound: &mut [f32]) -> bool {
        // -120 dB for a recording with full-scale samples.
        const SILENCE: f64 = 1e-6;
        let mut spectrum = self.forward.make_output_vec();
        let done = self.forward.process(&mut sound.to_vec(), &mut spectrum);
        debug_assert!(done.is_ok());
        let loudness = weighted_mean_square(&spectrum, sound.len()).sqrt();
        let audible = loudness > SILENCE && loudness.is_finite();
        let gain = if audible { (f64::from(LOUDNESS) / loudness) as f32 } else { 1.0 };
        sound.iter_mut().for_each(|sample| *sample *= gain);
        audible
    }

    /// Weighs the low and high parts, so that both are audible.
    fn balance(&self, sound: &mut [f32]) {
        let mut spectrum = self.forward.make_output_vec();
        let done = self.forward.process(sound, &mut spectrum);
        weigh(&mut spectrum, SAMPLE_RATE_HZ as f32 / sound.len() as f32);
        let done = done.and_then(|()| self.inverse.process(&mut spectrum, sound));
        debug_assert!(done.is_ok());
    }
}

fn weigh(spectrum: &mut [Complex32], bin_hz: f32) {
    let cut = (CUT_HZ / bin_hz) as usize;
    spectrum[..cut].fill(Complex32::default());
    let last = spectrum.len() - 1;
    spectrum[last] = Complex32::default();
    let energy = |from_hz: f32, to_hz: f32| -> f32 {
        let bins = &spectrum[(from_hz / bin_hz) as usize..(to_hz / bin_hz) as usize];
        bins.iter().map(Complex32::norm_sqr).sum::<f32>().max(f32::MIN_POSITIVE)
    };
    let top_hz = last as f32 * bin_hz;
    let parts = [energy(0.0, LOW_END_HZ), energy(LOW_END_HZ, HIGH_START_HZ), energy(HIGH_START_HZ, top_hz)];
    let total: f32 = parts.iter().sum();
    let [low, high] = [parts[0] / total, parts[2] / total].map(|share| share.max(MIN_SHARE));
    let middle = (parts[1] / total).min(1.0 - 2.0 * MIN_SHARE);
    let wanted = [low, middle, high].map(|share| share / (low + middle + high));
    let gains: [f32; 3] = std::array::from_fn(|part| (wanted[part] * total / parts[part]).sqrt());
    for (bin, value) in spectrum.iter_mut().enumerate() {
        *value *= gain_at(bin as f32 * bin_hz, &gains);
    }
}

/// Gain at a frequency, blended over a fifth of an octave around the edges.
fn gain_at(frequency_hz: f32, gains: &[f32; 3]) -> f32 {
    const HALF_WIDTH: f32 = 0.07;
    let passed =
        |border_hz: f32| ((frequency_hz / border_hz - 1.0) / (2.0 * HALF_WIDTH) + 0.5).clamp(0.0, 1.0);
    let lower = gains[0] + (gains[1] - gains[0]) * passed(LOW_END_HZ);
    lower + (gains[2] - lower) * passed(HIGH_START_HZ)
}

fn set_level(sound: &mut [f32]) {
    let mean_square = sound.iter().map(|sample| f64::from(sample * sample)).sum::<f64>() / sound.len() as f64;
    let gain = LEVEL / (mean_square.sqrt() as f32).max(f32::MIN_POSITIVE);
    sound.iter_mut().for_each(|sample| *sample *= gain);
}

/// Limits peaks: linear up to half the maximum, then saturating.
fn limit(sound: &mut [f32]) {
    const KNEE: f32 = 0.5;
    let ceiling = LEVEL * CREST;
    for sample in sound {
        let share = sample.abs() / ceiling;
        if share > KNEE {
            let bent = KNEE + (1.0 - KNEE) * libm::tanhf((share - KNEE) / (1.0 - KNEE));
            *sample = sample.signum() * bent * ceiling;
        }
    }
}

/// A-weighted root mean square for every clip; the unweighted mean over synthesised clips is then 0.05.
pub(super) const LOUDNESS: f32 = 0.0468;

/// A-weighted mean square for `length` samples, from the half spectrum.
pub(super) fn weighted_mean_square(spectrum: &[Complex32], length: usize) -> f64 {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / length as f64;
    let weighted =
        |(bin, value): (usize, &Complex32)| weight(bin as f64 * bin_hz) * f64::from(value.norm_sqr());
    // A bin also represents the mirror image; the weight at both ends is small.
    2.0 * spectrum.iter().enumerate().map(weighted).sum::<f64>() / (length as f64 * length as f64)
}

/// A-weighting as an energy factor, 1 at 1 kHz (IEC 61672-1, annex E).
fn weight(frequency_hz: f64) -> f64 {
    const CORNERS: [f64; 4] = [20.6 * 20.6, 107.7 * 107.7, 737.9 * 737.9, 12_194.0 * 12_194.0];
    const AT_1_KHZ: f64 = 0.630_978;
    let squared = frequency_hz * frequency_hz;
    let [a, b, c, d] = CORNERS.map(|corner| squared + corner);
    let rise = CORNERS[3] * squared * squared / (a * d);
    rise * rise / (b * c) / AT_1_KHZ
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_match_the_standard() {
        // IEC 61672-1, table 3, decibels.
        for (frequency_hz, level_db) in
            [(125.0, -16.1), (500.0, -3.2), (1000.0, 0.0), (4000.0, 1.0), (8000.0, -1.1)]
        {
            let found_db = 10.0 * weight(frequency_hz).log10();
            assert!((found_db - level_db).abs() < 0.1, "{frequency_hz} Hz: {found_db} dB");
        }
    }
}
