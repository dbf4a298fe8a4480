use super::*;
use crate::bands::BAND_HZ;
use crate::{Surface, Surfaces};
use std::f64::consts::TAU;

const RATE: f64 = SAMPLE_RATE_HZ as f64;

/// A tone per band that falls by 60 dB in `time_s`, plus a pulse of height `direct`, both at 0.01 s.
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
fn reverberation_times_are_those_of_the_decay() {
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
fn a_band_is_not_taken_for_its_slower_neighbour() {
    let times_s = [1.2, 1.2, 0.6, 1.2, 0.5, 0.3];
    let measures = Measures::of(&octaves_that_fall_in(times_s, 1.6), 0.0, 1.6);
    for (band, time_s) in times_s.into_iter().enumerate() {
        let found = measures.bands[band].t30_s.expect("a decay");
        assert!((found / time_s - 1.0).abs() < 0.08, "band {band}: {found} s, not {time_s} s");
    }
}

#[test]
fn a_response_that_is_cut_short_shows_no_long_decay() {
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
    // Early over late of an exponential decay: exp(13.8 x 0.05 s / T) - 1.
    let time_s = 0.6;
    let expected_db = 10.0 * libm::log10(libm::exp(6.0 * std::f64::consts::LN_10 * 0.05 / time_s) - 1.0);
    let measures = Measures::of(&room(time_s, 0.0, 1.0), 0.01, 1.0);
    for band in 2..SURFACE_BANDS {
        let found = measures.bands[band].c50_db.expect("early and late sound");
        assert!((found - expected_db).abs() < 0.2, "band {band}: {found}, not {expected_db} dB");
    }
}

#[test]
fn direct_sound_is_weighed_against_the_rest() {
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
fn a_pulse_has_its_level_and_no_decay() {
    let mut left = vec![0.0; 1000];
    left[300] = 0.5;
    let mut right = vec![0.0; 900];
    right[310] = 0.25;
    let measures = Measures::of(&ImpulseResponse { left, right }, 300.0 / RATE, 1.0);
    for band in measures.bands {
        let level_db = 10.0 * libm::log10((0.25 + 0.0625) / 2.0);
        assert!((band.level_db.expect("sound") - level_db).abs() < 1e-6, "{band:?}");
        assert!((band.ild_db.expect("sound") - 20.0 * libm::log10(2.0)).abs() < 1e-6);
        assert_eq!((band.t20_s, band.t30_s, band.edt_s, band.c50_db), (None, None, None, None), "{band:?}");
    }
}

#[test]
fn silence_and_oddities_have_no_measures() {
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
fn bands_do_not_leak_into_each_other() {
    let tone = |n: usize| libm::sin(TAU * 1000.0 * n as f64 / RATE) as f32;
    let ear: Vec<f32> = (0..16_000).map(tone).collect();
    let level_db = |band: usize| 10.0 * libm::log10(band_energies(&ear)[band] * octave::bandwidth_hz(band));
    assert!(level_db(3) - level_db(2) > 18.0 && level_db(3) - level_db(4) > 18.0);
    assert!(level_db(3) - level_db(1) > 35.0 && level_db(3) - level_db(5) > 35.0);
}

#[test]
fn the_ear_that_leads_is_told_to_a_microsecond() {
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
fn a_box_is_expected_to_ring_as_sabine_says() {
    let scene = avln_scene::RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room").scene();
    let mut absorption = [0.5; SURFACE_BANDS];
    absorption[1] = 0.1;
    let surface = Surface { absorption, scattering: [0.5; 6], transmission: [0.0; 6] };
    // 0.1611 s/m x 90 m3 / 12.6 m2.
    let expected_s = expected_reverberation_s(&scene, &Surfaces::uniform(&scene, surface));
    assert!((expected_s - 1.1508).abs() < 1e-3, "{expected_s}");
}
