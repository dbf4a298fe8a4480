//! Octave bands, propagation losses, and short filters with these losses.

use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use std::f32::consts::{LN_10, PI};
use std::sync::OnceLock;

pub(crate) const BANDS: usize = 7;
pub(crate) const BAND_HZ: [f32; BANDS] = [125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0];
pub(crate) const LOSS_TAPS: usize = 48;

/// Loss per band, decibels.
pub(crate) type BandLoss = [f32; BANDS];

pub(crate) const SILENT_DB: f32 = 100.0;

/// Air absorption at 20 degrees Celsius, 50 % humidity and 101.325 kPa, decibels per metre (ISO 9613-1).
const AIR_DB_PER_M: BandLoss = [0.000_44, 0.001_31, 0.002_73, 0.004_67, 0.009_89, 0.0297, 0.105];

/// Largest effective detour, metres: 25 dB diffraction loss at 4 kHz, less in lower bands.
const MAX_DETOUR_M: f32 = 0.68;

pub(crate) fn air_loss(length_m: f32) -> BandLoss {
    AIR_DB_PER_M.map(|db| db * length_m)
}

/// Diffraction loss for a detour in metres: 5 dB at the shadow boundary, more in deeper shadows and higher
/// bands, at most 25 dB at 4 kHz.
///
/// Source: Kurze and Anderson (1971), "Sound attenuation by barriers", Applied Acoustics 4.
pub(crate) fn diffraction_loss(detour_m: f32) -> BandLoss {
    let detour_m = detour_m.clamp(0.0, 1e3);
    let deep = detour_m / MAX_DETOUR_M;
    let detour_m = detour_m / (1.0 + deep * deep * deep * deep).sqrt().sqrt();
    BAND_HZ.map(|frequency_hz| {
        let fresnel_number = 2.0 * detour_m * frequency_hz / SPEED_OF_SOUND_M_S;
        let x = (2.0 * PI * fresnel_number).sqrt();
        // x / tanh x approaches 1 at the shadow boundary.
        let ratio = if x < 1e-3 { 1.0 } else { x / libm::tanhf(x) };
        5.0 + 20.0 * libm::log10f(ratio)
    })
}

pub(crate) fn both(first: &BandLoss, second: &BandLoss) -> BandLoss {
    std::array::from_fn(|band| first[band] + second[band])
}

/// Returns the minimum-phase filter with magnitude `loss`, linear in decibels over log frequency.
pub(crate) fn loss_filter(loss: &BandLoss) -> [f32; LOSS_TAPS] {
    // The log magnitude is linear in the losses, and so is the minimum-phase cepstrum.
    let mut cepstrum = [0.0_f32; LOSS_TAPS];
    for (db, known) in loss.iter().zip(band_cepstra()) {
        let nepers = -db * LN_10 / 20.0;
        cepstrum.iter_mut().zip(known).for_each(|(sum, value)| *sum += nepers * value);
    }
    // Oppenheim and Schafer, "Discrete-Time Signal Processing", chapter 13: n h[n] = sum over k of k c[k] h[n - k].
    let mut taps = [0.0; LOSS_TAPS];
    taps[0] = libm::expf(cepstrum[0]);
    for n in 1..LOSS_TAPS {
        let sum: f32 = (1..=n).map(|k| k as f32 * cepstrum[k] * taps[n - k]).sum();
        taps[n] = sum / n as f32;
    }
    taps
}

fn band_cepstra() -> &'static [[f32; LOSS_TAPS]; BANDS] {
    static CEPSTRA: OnceLock<[[f32; LOSS_TAPS]; BANDS]> = OnceLock::new();
    CEPSTRA.get_or_init(|| std::array::from_fn(band_cepstrum))
}

fn band_cepstrum(band: usize) -> [f32; LOSS_TAPS] {
    const POINTS: usize = 1024;
    let step_rad = std::f64::consts::PI / POINTS as f64;
    let nyquist_hz = f64::from(SAMPLE_RATE_HZ) / 2.0;
    let shares: Vec<f64> =
        (0..POINTS).map(|i| band_share(band, (i as f64 + 0.5) / POINTS as f64 * nyquist_hz)).collect();
    std::array::from_fn(|n| {
        let cosines = (0..POINTS).map(|i| libm::cos((i as f64 + 0.5) * step_rad * n as f64));
        let mean =
            shares.iter().zip(cosines).map(|(share, cosine)| share * cosine).sum::<f64>() / POINTS as f64;
        // Folding the negative half of the cepstrum onto the positive one makes the filter minimum-phase.
        (if n == 0 { mean } else { 2.0 * mean }) as f32
    })
}

/// Weight for `band` at `frequency_hz`: a triangle over octaves, flat below the first centre.
fn band_share(band: usize, frequency_hz: f64) -> f64 {
    let octaves = libm::log2(frequency_hz.max(f64::from(BAND_HZ[0])) / f64::from(BAND_HZ[band]));
    (1.0 - octaves.abs()).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn magnitude_db(taps: &[f32], frequency_hz: f32) -> f32 {
        let turn = 2.0 * PI * frequency_hz / SAMPLE_RATE_HZ as f32;
        let sum =
            |f: fn(f32) -> f32| taps.iter().enumerate().map(|(n, tap)| tap * f(turn * n as f32)).sum::<f32>();
        let (re, im) = (sum(libm::cosf), sum(libm::sinf));
        10.0 * libm::log10f(re * re + im * im)
    }

    #[test]
    fn no_loss_is_a_single_tap() {
        let taps = loss_filter(&[0.0; BANDS]);
        assert_eq!(taps[0], 1.0);
        assert!(taps[1..].iter().all(|tap| *tap == 0.0));
    }

    #[test]
    fn loss_filters_match_the_loss_in_every_band() {
        for loss in [
            diffraction_loss(0.02),
            diffraction_loss(1.5),
            both(&air_loss(20.0), &[24.0, 30.0, 36.0, 42.0, 48.0, 54.0, 60.0]),
        ] {
            let taps = loss_filter(&loss);
            for (db, frequency_hz) in loss.iter().zip(BAND_HZ).take(BANDS - 1) {
                let taken = -magnitude_db(&taps, frequency_hz);
                assert!((taken - db).abs() < 1.5, "{taken} instead of {db} dB at {frequency_hz} Hz");
            }
        }
    }

    #[test]
    fn air_absorption_matches_the_standard() {
        // ISO 9613-1, equations 3 to 5, at the reference temperature and pressure; molar water share in per
        // cent.
        let water = 50.0 * libm::exp10(-6.8346 * libm::pow(273.16 / 293.15, 1.261) + 4.6151);
        let oxygen_hz = 24.0 + 4.04e4 * water * (0.02 + water) / (0.391 + water);
        let nitrogen_hz = 9.0 + 280.0 * water;
        for (db_per_m, hz) in
            AIR_DB_PER_M.into_iter().zip(BAND_HZ).map(|(db, hz)| (f64::from(db), f64::from(hz)))
        {
            let relaxation = |share: f64, at_k: f64, at_hz: f64| {
                share * libm::exp(-at_k / 293.15) / (at_hz + hz * hz / at_hz)
            };
            let both = relaxation(0.01275, 2239.1, oxygen_hz) + relaxation(0.1068, 3352.0, nitrogen_hz);
            let due = 8.686 * hz * hz * (1.84e-11 + both);
            assert!((db_per_m / due - 1.0).abs() < 0.02, "{hz} Hz: {db_per_m}, not {due} dB a metre");
        }
    }

    #[test]
    fn diffraction_starts_at_five_decibels_and_grows() {
        assert_eq!(diffraction_loss(0.0), [5.0; BANDS]);
        // N = 2 x 0.1715 x 1000 / 343 = 1: x = 2.5066, tanh x = 0.9868, 5 + 20 lg 2.540 = 13.10 dB.
        assert!((diffraction_loss(0.1715)[3] - 13.10).abs() < 0.02);
        let tilts: Vec<_> =
            [0.05, 0.2, 0.5, 1.0, 3.0].map(diffraction_loss).map(|loss| loss[5] - loss[0]).into();
        assert!(tilts.is_sorted_by(|a, b| a < b), "{tilts:?}");
        assert!((diffraction_loss(50.0)[5] - 25.0).abs() < 0.1);
    }
}
