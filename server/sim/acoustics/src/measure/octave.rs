//! Octave bands, and their energy decay.

use crate::SAMPLE_RATE_HZ;
use crate::bands::BAND_HZ;
use crate::surfaces::SURFACE_BANDS;
use realfft::{ComplexToReal, RealFftPlanner, num_complex::Complex64};
use std::sync::{Arc, OnceLock};

/// Padding, samples: longer than the filter response.
const SILENCE: usize = 4096;

pub(super) fn bandwidth_hz(band: usize) -> f64 {
    f64::from(BAND_HZ[band]) * std::f64::consts::FRAC_1_SQRT_2
}

/// Power transmission of a third-order band pass (Butterworth 1930, IEC 61260-1): half at the octave edges.
pub(crate) fn power_share(band: usize, frequency_hz: f64) -> f64 {
    let center_hz = f64::from(BAND_HZ[band]);
    if frequency_hz <= 0.0 {
        return 0.0;
    }
    let detuning = (frequency_hz / center_hz - center_hz / frequency_hz) * std::f64::consts::SQRT_2;
    let squared = detuning * detuning;
    1.0 / (1.0 + squared * squared * squared)
}

/// Power transmission in the octave core: 1 up to 0.1 octaves, 0 from 0.45 octaves, squared sine between.
pub(super) fn core_share(band: usize, frequency_hz: f64) -> f64 {
    // Through the flanks of an octave filter, a slower neighbour would dominate before the band falls by 35 dB.
    const WHOLE_OCTAVES: f64 = 0.1;
    const NOTHING_OCTAVES: f64 = 0.45;
    let octaves = libm::fabs(libm::log2(frequency_hz.max(f64::MIN_POSITIVE) / f64::from(BAND_HZ[band])));
    let share = (NOTHING_OCTAVES - octaves) / (NOTHING_OCTAVES - WHOLE_OCTAVES);
    let sine = libm::sin(std::f64::consts::FRAC_PI_2 * share.clamp(0.0, 1.0));
    sine * sine
}

pub(crate) struct Octaves {
    spectrum: Vec<Complex64>,
    samples: usize,
    /// Planned on first use, which takes longer than a transform.
    inverse: OnceLock<Arc<dyn ComplexToReal<f64>>>,
}

impl Octaves {
    pub(crate) fn new(signal: &[f32]) -> Self {
        let length = (signal.len() + SILENCE).next_power_of_two();
        let forward = RealFftPlanner::<f64>::new().plan_fft_forward(length);
        let mut padded = forward.make_input_vec();
        padded.iter_mut().zip(signal).for_each(|(to, from)| *to = f64::from(*from));
        let mut spectrum = forward.make_output_vec();
        // The lengths match the plan, so no call fails.
        let done = forward.process(&mut padded, &mut spectrum);
        debug_assert!(done.is_ok());
        Self { spectrum, samples: signal.len(), inverse: OnceLock::new() }
    }

    fn bin_hz(&self) -> f64 {
        f64::from(SAMPLE_RATE_HZ) / 2.0 / (self.spectrum.len() - 1) as f64
    }

    /// Squared signal, filtered with the power transmission `share` (by frequency in hertz).
    pub(crate) fn squared(&self, share: impl Fn(f64) -> f64) -> Vec<f64> {
        let length = 2 * (self.spectrum.len() - 1);
        let plan = || RealFftPlanner::<f64>::new().plan_fft_inverse(length);
        let inverse = self.inverse.get_or_init(plan);
        let bin_hz = self.bin_hz();
        let gain = |bin: usize| share(bin as f64 * bin_hz).sqrt() / length as f64;
        let mut spectrum: Vec<_> =
            self.spectrum.iter().enumerate().map(|(bin, value)| value * gain(bin)).collect();
        if let Some(last) = spectrum.last_mut() {
            last.im = 0.0;
        }
        let mut filtered = inverse.make_output_vec();
        let done = inverse.process(&mut spectrum, &mut filtered);
        debug_assert!(done.is_ok());
        filtered.truncate(self.samples);
        filtered.iter_mut().for_each(|sample| *sample *= *sample);
        filtered
    }

    /// Energy by band, relative to a unit pulse.
    pub(super) fn energies(&self) -> [f64; SURFACE_BANDS] {
        let bin_hz = self.bin_hz();
        std::array::from_fn(|band| {
            let shares = (0..self.spectrum.len()).map(|bin| power_share(band, bin as f64 * bin_hz));
            let (energy, pulse) =
                self.spectrum.iter().zip(shares).fold((0.0, 0.0), |sum, (value, share)| {
                    (sum.0 + share * value.norm_sqr(), sum.1 + share)
                });
            energy / pulse
        })
    }
}

// A cut this far below the fit range moves the range's end by 0.14 dB.
const BEYOND_DB: f64 = 15.0;

// Bandwidth times decay time distinguishable from the filter: a pulse has 10.8.
const MIN_BANDWIDTH_TIME: f64 = 11.0;

/// Shortest plausible decay, seconds.
const MIN_TIME_S: f64 = 0.02;

/// Remaining band energy over time.
pub(super) struct Decay {
    /// Remaining energy relative to the total, decibels, per sample from the first wave.
    left_db: Vec<f64>,
    /// Response end, seconds after the first wave.
    end_s: f64,
    min_time_s: f64,
}

impl Decay {
    /// Decay over both ears' squared signals.
    pub(super) fn of(squared: &[Vec<f64>; 2], first_arrival_s: f64, length_s: f64, band: usize) -> Self {
        let samples = squared[0].len().max(squared[1].len());
        let at = |sample: usize| squared.iter().filter_map(|ear| ear.get(sample)).sum::<f64>();
        let mut left = vec![0.0; samples];
        let mut sum = 0.0;
        for sample in (0..samples).rev() {
            sum += at(sample);
            left[sample] = sum;
        }
        let first = ((first_arrival_s * f64::from(SAMPLE_RATE_HZ)).max(0.0) as usize).min(samples);
        let level_db = |energy: &f64| 10.0 * libm::log10(*energy / sum);
        let left_db = left[first..].iter().take_while(|energy| **energy > 0.0).map(level_db).collect();
        let min_time_s = (MIN_BANDWIDTH_TIME / bandwidth_hz(band)).max(MIN_TIME_S);
        Self { left_db, end_s: length_s - first_arrival_s, min_time_s }
    }

    /// Seconds for 60 dB, on the line through the curve between two levels.
    pub(super) fn time_s(&self, from_db: f64, to_db: f64) -> Option<f64> {
        let first_below = |level_db: f64| self.left_db.iter().position(|db| *db < level_db);
        let start = if from_db < 0.0 { first_below(from_db)? } else { 0 };
        let end = first_below(to_db)?;
        let (level_db, slope_db_s) = line(self.left_db.get(start..end)?, start)?;
        let time_s = -60.0 / slope_db_s;
        let shown_s = (to_db - BEYOND_DB - level_db) / slope_db_s;
        (slope_db_s < 0.0 && time_s >= self.min_time_s && shown_s <= self.end_s).then_some(time_s)
    }
}

/// Least-squares line through `levels_db` from sample `start`: level at time 0 and slope per second.
fn line(levels_db: &[f64], start: usize) -> Option<(f64, f64)> {
    let count = levels_db.len() as f64;
    let mean_time = start as f64 + (count - 1.0) / 2.0;
    let mean_db = levels_db.iter().sum::<f64>() / count;
    let (mut both, mut times) = (0.0, 0.0);
    for (offset, db) in levels_db.iter().enumerate() {
        let time = (start + offset) as f64 - mean_time;
        both += time * (db - mean_db);
        times += time * time;
    }
    let slope_db = both / times;
    (times > 0.0).then(|| (mean_db - slope_db * mean_time, slope_db * f64::from(SAMPLE_RATE_HZ)))
}
