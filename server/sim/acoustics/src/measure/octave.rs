//! Octave bands of a signal.

use crate::bands::BAND_HZ;
use crate::{SAMPLE_RATE_HZ, SURFACE_BANDS};
use realfft::RealFftPlanner;
use realfft::num_complex::Complex64;

/// Silence around a signal, samples: longer than the filter response.
const SILENCE: usize = 4096;

/// Bandwidth of an octave, hertz.
pub(super) fn bandwidth_hz(band: usize) -> f64 {
    f64::from(BAND_HZ[band]) * std::f64::consts::FRAC_1_SQRT_2
}

/// Power transmission of a third-order band pass at `frequency_hz` (Butterworth 1930, as in IEC 61260-1):
/// half at the octave edges.
pub(super) fn power_share(band: usize, frequency_hz: f64) -> f64 {
    let center_hz = f64::from(BAND_HZ[band]);
    if frequency_hz <= 0.0 {
        return 0.0;
    }
    let detuning = (frequency_hz / center_hz - center_hz / frequency_hz) * std::f64::consts::SQRT_2;
    let squared = detuning * detuning;
    1.0 / (1.0 + squared * squared * squared)
}

/// Power transmission of the octave core at `frequency_hz`: 1 up to a tenth of an octave from the centre, 0
/// from 0.45 octaves, a squared sine in between.
///
/// Neighbouring bands may decay at different speeds. Through the flanks of an octave filter the slower band
/// would dominate before the band itself has fallen by 35 dB.
pub(super) fn core_share(band: usize, frequency_hz: f64) -> f64 {
    const WHOLE_OCTAVES: f64 = 0.1;
    const NOTHING_OCTAVES: f64 = 0.45;
    let octaves = libm::fabs(libm::log2(frequency_hz.max(f64::MIN_POSITIVE) / f64::from(BAND_HZ[band])));
    let share = (NOTHING_OCTAVES - octaves) / (NOTHING_OCTAVES - WHOLE_OCTAVES);
    let sine = libm::sin(std::f64::consts::FRAC_PI_2 * share.clamp(0.0, 1.0));
    sine * sine
}

/// A spectrum for band-wise analysis.
pub(super) struct Octaves {
    spectrum: Vec<Complex64>,
    samples: usize,
}

impl Octaves {
    pub(super) fn new(signal: &[f32]) -> Self {
        let length = (signal.len() + SILENCE).next_power_of_two();
        let forward = RealFftPlanner::<f64>::new().plan_fft_forward(length);
        let mut padded = forward.make_input_vec();
        padded.iter_mut().zip(signal).for_each(|(to, from)| *to = f64::from(*from));
        let mut spectrum = forward.make_output_vec();
        // The lengths match the plan, so no call fails.
        let done = forward.process(&mut padded, &mut spectrum);
        debug_assert!(done.is_ok());
        Self { spectrum, samples: signal.len() }
    }

    fn bin_hz(&self) -> f64 {
        f64::from(SAMPLE_RATE_HZ) / 2.0 / (self.spectrum.len() - 1) as f64
    }

    /// Squared signal, sample by sample, filtered with the power transmission `share` (by frequency in
    /// hertz).
    pub(super) fn squared(&self, share: impl Fn(f64) -> f64) -> Vec<f64> {
        let length = 2 * (self.spectrum.len() - 1);
        let inverse = RealFftPlanner::<f64>::new().plan_fft_inverse(length);
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
    fn energies(&self) -> [f64; SURFACE_BANDS] {
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

/// Energy of a signal by band, relative to a unit pulse.
pub(super) fn band_energies(signal: &[f32]) -> [f64; SURFACE_BANDS] {
    Octaves::new(signal).energies()
}
