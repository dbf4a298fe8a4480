//! Room acoustic measures from impulse responses (ISO 3382-1).

pub(crate) mod octave;

use crate::impulse::ImpulseResponse;
use crate::surfaces::{SURFACE_BANDS, Surfaces};
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_scene::Scene;
use octave::{Decay, Octaves, core_share, power_share};
use std::f64::consts::TAU;
use std::ops::Range;

/// Direct sound, seconds after the first wave.
const DIRECT_S: f64 = 0.0025;

/// Early sound, seconds after the first wave.
const EARLY_S: f64 = 0.05;

/// Octaves for the direct-to-reverberant ratio: 500, 1000 and 2000 Hz.
pub(crate) const MIDDLE: Range<usize> = 2..5;

/// Room measures; `None` without a decay, for a response too short for it, or for a ratio to silence.
#[derive(Clone, Debug, PartialEq)]
pub struct Measures {
    /// Energy in the first 2.5 ms relative to the rest, decibels: both ears, octaves 500 to 2000 Hz equally.
    pub drr_db: Option<f64>,
    /// 125, 250, 500, 1000, 2000 and 4000 Hz.
    pub bands: [BandMeasures; SURFACE_BANDS],
}

/// Measures in an octave band: a third-order Butterworth band pass, as magnitude, without delay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BandMeasures {
    /// Energy, mean over both ears, relative to the free-field pressure 1 m from the source, decibels.
    pub level_db: Option<f64>,
    /// Reverberation time from the decay between -5 and -25 dB, seconds; both ears added, octave core only.
    pub t20_s: Option<f64>,
    /// As above between -5 and -35 dB.
    pub t30_s: Option<f64>,
    /// Early decay time: down to -10 dB, whole octave, seconds.
    pub edt_s: Option<f64>,
    /// Energy in the first 50 ms relative to the rest, decibels; both ears.
    pub c50_db: Option<f64>,
    /// Left ear energy relative to the right ear, decibels.
    pub ild_db: Option<f64>,
}

impl Measures {
    /// Measures `response`, `length_s` long, with the first wave at the head centre `first_arrival_s` after
    /// emission.
    ///
    /// Decays are straight lines fitted to Schroeder's backward integral (1965, J. Acoust. Soc. Am. 37), if
    /// the response continues for 15 dB below the fit range.
    pub fn of(response: &ImpulseResponse, first_arrival_s: f64, length_s: f64) -> Self {
        let ears = [response.left.as_slice(), response.right.as_slice()];
        let split = |after_s: f64| {
            let end = ((first_arrival_s + after_s) * f64::from(SAMPLE_RATE_HZ)).max(0.0) as usize;
            // The early part is cut before filtering, because the filter would spread it.
            let cut = ears.map(|ear| ear.split_at(end.min(ear.len())));
            let energies = |signal: &[f32]| Octaves::new(signal).energies();
            [cut.map(|(before, _)| energies(before)), cut.map(|(_, after)| energies(after))]
        };
        let [direct, rest] = split(DIRECT_S);
        let [early, late] = split(EARLY_S);
        let middle = |energies: &EarEnergies| MIDDLE.map(|band| both(energies, band)).sum::<f64>();
        let octaves = ears.map(Octaves::new);
        let all = octaves.each_ref().map(Octaves::energies);
        Self {
            drr_db: ratio_db(middle(&direct), middle(&rest)),
            bands: std::array::from_fn(|band| {
                let decay = |share: fn(usize, f64) -> f64| {
                    let squared = octaves.each_ref().map(|ear| ear.squared(|hz| share(band, hz)));
                    Decay::of(&squared, first_arrival_s, length_s, band)
                };
                let (whole, core) = (decay(power_share), decay(core_share));
                BandMeasures {
                    level_db: ratio_db(both(&all, band) / 2.0, 1.0),
                    t20_s: core.time_s(-5.0, -25.0),
                    t30_s: core.time_s(-5.0, -35.0),
                    edt_s: whole.time_s(0.0, -10.0),
                    c50_db: ratio_db(both(&early, band), both(&late, band)),
                    ild_db: ratio_db(all[0][band], all[1][band]),
                }
            }),
        }
    }
}

type EarEnergies = [[f64; SURFACE_BANDS]; 2];

fn both(energies: &EarEnergies, band: usize) -> f64 {
    energies[0][band] + energies[1][band]
}

/// Energy ratio in decibels; `None` unless both are positive.
fn ratio_db(energy: f64, other: f64) -> Option<f64> {
    // Residual from finite-precision filters, relative to a unit pulse.
    const NOTHING: f64 = 1e-16;
    (energy > NOTHING && other > NOTHING).then(|| 10.0 * libm::log10(energy / other))
}

/// Sabine's reverberation time for the bounding box of `scene`, slowest band, seconds: `24 ln 10 V / (c A)`
/// with volume V and absorbing area A (W. C. Sabine 1898). Infinite without absorption, 0 without surfaces.
pub fn expected_reverberation_s(scene: &Scene, surfaces: &Surfaces) -> f32 {
    let Some(bounds) = scene.bounds() else { return 0.0 };
    let mut absorbing_m2 = [0.0; SURFACE_BANDS];
    for triangle in 0..scene.mesh.triangles.len() {
        let [a, b, c] = scene.corners(triangle);
        let area_m2 = (b - a).cross(&(c - a)).norm() / 2.0;
        let surface = surfaces.of(triangle as u32);
        for (band, sum) in absorbing_m2.iter_mut().enumerate() {
            *sum += area_m2 * (surface.absorption[band] + surface.transmission[band]);
        }
    }
    let min_m2 = absorbing_m2.into_iter().fold(f32::INFINITY, f32::min);
    24.0 * std::f32::consts::LN_10 * bounds.size().product() / (SPEED_OF_SOUND_M_S * min_m2)
}

/// Compared frequencies, hertz.
const LOW_HZ: f64 = 100.0;
const HIGH_HZ: f64 = 1500.0;
const STEP_HZ: f64 = 10.0;

/// Longest delay, and the search steps, microseconds.
const MAX_US: f64 = 1000.0;
const COARSE_US: f64 = 10.0;
const FINE_US: f64 = 0.1;

/// Cross spectrum at a frequency: left times conjugate right.
struct CrossSpectrum {
    turn_us: f64,
    re: f64,
    im: f64,
}

/// Interaural delay, seconds, positive if the left ear leads: the cross-correlation peak below 1500 Hz,
/// within 1 ms. `None` if an ear is silent.
pub fn interaural_delay_s(wave: &ImpulseResponse) -> Option<f64> {
    let count = ((HIGH_HZ - LOW_HZ) / STEP_HZ) as usize;
    let products: Vec<CrossSpectrum> =
        (0..=count).map(|index| common(wave, LOW_HZ + STEP_HZ * index as f64)).collect();
    if products.iter().all(|common| common.re == 0.0 && common.im == 0.0) {
        return None;
    }
    let coarse_us = best(&products, 0.0, MAX_US, COARSE_US);
    Some(best(&products, coarse_us, COARSE_US, FINE_US) * 1e-6)
}

fn common(wave: &ImpulseResponse, frequency_hz: f64) -> CrossSpectrum {
    let turn = TAU * frequency_hz / f64::from(SAMPLE_RATE_HZ);
    let ((left_re, left_im), (right_re, right_im)) = (bin(&wave.left, turn), bin(&wave.right, turn));
    CrossSpectrum {
        turn_us: TAU * frequency_hz * 1e-6,
        re: left_re * right_re + left_im * right_im,
        im: left_im * right_re - left_re * right_im,
    }
}

fn bin(ear: &[f32], turn: f64) -> (f64, f64) {
    let heard = ear.iter().enumerate().filter(|(_, tap)| **tap != 0.0);
    heard.fold((0.0, 0.0), |(re, im), (n, tap)| {
        let (tap, phase) = (f64::from(*tap), turn * n as f64);
        (re + tap * libm::cos(phase), im - tap * libm::sin(phase))
    })
}

/// The lead around `middle_us` with the highest correlation.
fn best(products: &[CrossSpectrum], middle_us: f64, reach_us: f64, step_us: f64) -> f64 {
    let correlation = |lead_us: f64| -> f64 {
        let turned = |common: &CrossSpectrum| {
            let phase = common.turn_us * lead_us;
            common.re * libm::cos(phase) + common.im * libm::sin(phase)
        };
        products.iter().map(turned).sum()
    };
    let steps = libm::round(reach_us / step_us) as i32;
    let leads = (-steps..=steps).map(|step| middle_us + f64::from(step) * step_us);
    leads
        .map(|lead| (correlation(lead), lead))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(0.0, |(_, lead)| lead)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bands::BAND_HZ;
    use crate::{Surface, Surfaces};

    const RATE: f64 = SAMPLE_RATE_HZ as f64;

    /// A tone per band that falls by 60 dB in `time_s`, plus a pulse with height `direct`, both at 0.01 s.
    fn room(time_s: f64, direct: f32, length_s: f64) -> ImpulseResponse {
        let first = (0.01 * RATE) as usize;
        let sample = |n: usize| {
            let after_s = (n as f64 - first as f64) / RATE;
            let fall = libm::pow(10.0, -3.0 * after_s / time_s);
            let tones = BAND_HZ[..SURFACE_BANDS].iter().map(|hz| libm::cos(TAU * f64::from(*hz) * after_s));
            if n < first { 0.0 } else { (tones.sum::<f64>() * fall * 0.02) as f32 }
        };
        let mut left: Vec<f32> = (0..(length_s * RATE) as usize).map(sample).collect();
        left[first] += direct;
        ImpulseResponse { right: left.clone(), left }
    }

    #[test]
    fn reverberation_times_match_the_decay() {
        for time_s in [0.15, 0.4, 1.2] {
            let measures = Measures::of(&room(time_s, 0.0, 1.3 * time_s + 0.05), 0.01, 1.3 * time_s + 0.05);
            for (band, measured) in measures.bands.iter().enumerate() {
                let tolerance = if band < 2 { 0.05 } else { 0.01 };
                for found in [measured.t20_s, measured.t30_s] {
                    let found = found.expect("a decay");
                    assert!((found / time_s - 1.0).abs() < tolerance, "{time_s} s, band {band}: {found}");
                }
            }
            let edt_s = measures.bands[4].edt_s.expect("a decay");
            assert!((edt_s / time_s - 1.0).abs() < 0.02, "{edt_s}");
        }
    }

    /// Octaves full of tones with individual decay times.
    fn octaves_that_fall_in(times_s: [f64; SURFACE_BANDS], length_s: f64) -> ImpulseResponse {
        const TONES: i32 = 24;
        let mut left = vec![0.0; (length_s * RATE) as usize];
        for (center_hz, time_s) in BAND_HZ.iter().zip(times_s) {
            for tone in 0..TONES {
                let place = (f64::from(tone) + 0.5) / f64::from(TONES);
                let turn = TAU * f64::from(*center_hz) * libm::exp2(place - 0.5) / RATE;
                let phase = TAU * 0.5 * f64::from(tone * tone) / f64::from(TONES);
                for (n, sample) in left.iter_mut().enumerate() {
                    let fall = libm::pow(10.0, -3.0 * n as f64 / RATE / time_s);
                    *sample += (0.01 * fall * libm::cos(turn * n as f64 + phase)) as f32;
                }
            }
        }
        ImpulseResponse { right: left.clone(), left }
    }

    #[test]
    fn slower_neighbouring_bands_do_not_affect_decay_times() {
        let times_s = [1.2, 1.2, 0.6, 1.2, 0.5, 0.3];
        let measures = Measures::of(&octaves_that_fall_in(times_s, 1.6), 0.0, 1.6);
        for (band, time_s) in times_s.into_iter().enumerate() {
            let found = measures.bands[band].t30_s.expect("a decay");
            assert!((found / time_s - 1.0).abs() < 0.08, "band {band}: {found} s, not {time_s} s");
        }
    }

    #[test]
    fn short_responses_have_no_long_decay_times() {
        // -5 to -25 dB plus 15 dB take two thirds of 0.9 s, to -35 dB five sixths.
        let times = |length_s| {
            let band = Measures::of(&room(0.9, 0.0, length_s), 0.01, length_s).bands[3];
            (band.edt_s.is_some(), band.t20_s.is_some(), band.t30_s.is_some())
        };
        assert_eq!(times(0.3), (false, false, false));
        assert_eq!(times(0.5), (true, false, false));
        assert_eq!(times(0.7), (true, true, false));
        assert_eq!(times(0.9), (true, true, true));
    }

    #[test]
    fn clarity_follows_from_the_decay() {
        // Early over late in an exponential decay: exp(13.8 x 0.05 s / T) - 1.
        let time_s = 0.6;
        let expected_db = 10.0 * libm::log10(libm::exp(6.0 * std::f64::consts::LN_10 * 0.05 / time_s) - 1.0);
        let measures = Measures::of(&room(time_s, 0.0, 1.0), 0.01, 1.0);
        for band in 2..SURFACE_BANDS {
            let found = measures.bands[band].c50_db.expect("early and late sound");
            assert!((found - expected_db).abs() < 0.2, "band {band}: {found}, not {expected_db} dB");
        }
    }

    #[test]
    fn direct_to_reverberant_ratio_compares_energies() {
        let (mut left, first) = (vec![0.0; 4000], 160);
        left[first] = 1.0;
        left[first + 39] = 0.5;
        left[first + 400] = 0.5;
        let response = ImpulseResponse { left, right: Vec::new() };
        let found = Measures::of(&response, 0.01, 0.8).drr_db.expect("a ratio");
        // 39 samples are 2.4 ms: one and a half pulses against half a pulse, with interference in the octaves.
        assert!((found - 10.0 * libm::log10(1.25 / 0.25)).abs() < 0.5, "{found} dB");
        assert_eq!(Measures::of(&ImpulseResponse::default(), 0.01, 0.8).drr_db, None);
    }

    #[test]
    fn pulses_have_a_level_and_no_decay() {
        let mut left = vec![0.0; 1000];
        left[300] = 0.5;
        let mut right = vec![0.0; 900];
        right[310] = 0.25;
        let measures = Measures::of(&ImpulseResponse { left, right }, 300.0 / RATE, 1.0);
        for band in measures.bands {
            let level_db = 10.0 * libm::log10((0.25 + 0.0625) / 2.0);
            assert!((band.level_db.expect("sound") - level_db).abs() < 1e-6, "{band:?}");
            assert!((band.ild_db.expect("sound") - 20.0 * libm::log10(2.0)).abs() < 1e-6);
            assert_eq!(
                (band.t20_s, band.t30_s, band.edt_s, band.c50_db),
                (None, None, None, None),
                "{band:?}"
            );
        }
    }

    #[test]
    fn silent_and_tiny_responses_have_no_measures() {
        for response in [
            ImpulseResponse::default(),
            ImpulseResponse { left: vec![0.0; 50], right: vec![0.0; 70] },
            ImpulseResponse { left: vec![1.0], right: Vec::new() },
        ] {
            for first_arrival_s in [0.0, -1.0, 9.0, f64::NAN] {
                let measures = Measures::of(&response, first_arrival_s, 1.0);
                let numbers = measures.bands.iter().flat_map(|b| [b.level_db, b.t30_s, b.c50_db, b.ild_db]);
                assert!(numbers.chain([measures.drr_db]).flatten().all(f64::is_finite), "{measures:?}");
                assert!(measures.bands.iter().all(|band| band.ild_db.is_none() && band.t20_s.is_none()));
            }
            assert_eq!(interaural_delay_s(&response), None);
        }
    }

    #[test]
    fn octave_filters_separate_tones() {
        let tone = |n: usize| libm::sin(TAU * 1000.0 * n as f64 / RATE) as f32;
        let ear: Vec<f32> = (0..16_000).map(tone).collect();
        let level_db = |band: usize| {
            10.0 * libm::log10(Octaves::new(&ear).energies()[band] * octave::bandwidth_hz(band))
        };
        assert!(level_db(3) - level_db(2) > 18.0 && level_db(3) - level_db(4) > 18.0);
        assert!(level_db(3) - level_db(1) > 35.0 && level_db(3) - level_db(5) > 35.0);
    }

    #[test]
    fn interaural_delay_is_accurate_to_a_microsecond() {
        for lead in [-10.0, -3.3, 0.0, 0.7, 8.25] {
            let ear = |delay: f64| -> Vec<f32> {
                let sinc = |n: usize| {
                    let time = std::f64::consts::PI * (n as f64 - 40.0 - delay);
                    if time.abs() < 1e-9 { 1.0 } else { (libm::sin(time) / time) as f32 }
                };
                (0..400).map(sinc).collect()
            };
            let wave = ImpulseResponse { left: ear(0.0), right: ear(lead) };
            let found = interaural_delay_s(&wave).expect("sound in both ears");
            assert!((found - lead / RATE).abs() < 1e-6, "{lead} samples: {found} s");
        }
    }

    #[test]
    fn expected_reverberation_follows_sabine() {
        let scene = avln_scene::RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room").scene();
        let mut absorption = [0.5; SURFACE_BANDS];
        absorption[1] = 0.1;
        let surface = Surface { absorption, scattering: [0.5; 6], transmission: [0.0; 6] };
        // 0.1611 s/m x 90 m3 / 12.6 m2.
        let expected_s = expected_reverberation_s(&scene, &Surfaces::uniform(&scene, surface));
        assert!((expected_s - 1.1508).abs() < 1e-3, "{expected_s}");
    }
}
