//! The ears against the series of the rigid sphere, in the free field.

mod common;

use avln_acoustics::{Head, ImpulseResponse, Listener, SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S, Settings};
use common::{bin, free_field, lag_us, level_db, listener, opaque_building, point};
use std::f64::consts::TAU;

/// Response of a head at the origin to a source `azimuth_deg` to its right, `range_m` away.
fn from_azimuth(azimuth_deg: f32, range_m: f32) -> ImpulseResponse {
    let (sin, cos) = azimuth_deg.to_radians().sin_cos();
    let source = point(range_m * sin, 1.0, -range_m * cos);
    free_field().source(&source).impulse_response(&listener(0.0, 0.0, 0.0))
}

/// Azimuth, interaural delay below 1.5 kHz and below 1 kHz (microseconds), level difference at 500,
/// 2000 and 4000 Hz (decibels): plane wave, radius 8.75 cm, ears at 100 degrees, from an independent evaluation.
const SPHERE: [(f32, f64, f64, [f64; 3]); 5] = [
    (30.0, 341.0, 381.0, [0.9, 5.3, 7.3]),
    (60.0, 616.0, 635.0, [1.4, 6.5, 15.1]),
    (90.0, 691.0, 712.0, [1.8, 4.7, 8.1]),
    (120.0, 572.0, 606.0, [2.3, 9.5, 10.5]),
    (150.0, 289.0, 325.0, [2.0, 4.2, 5.5]),
];

#[test]
fn interaural_delays_are_those_of_the_sphere() {
    for (azimuth_deg, correlated_us, low_us, _) in SPHERE {
        let response = from_azimuth(azimuth_deg, 8.0);
        let measured = lag_us(&response, 100.0, 1500.0);
        assert!((measured - correlated_us).abs() <= 5.0, "{azimuth_deg}: {measured}, not {correlated_us} us");
        let measured = lag_us(&response, 100.0, 1000.0);
        assert!((measured - low_us).abs() <= 5.0, "{azimuth_deg}: {measured}, not {low_us} us");
    }
}

#[test]
fn level_differences_are_those_of_the_sphere() {
    for (azimuth_deg, .., levels_db) in SPHERE {
        let response = from_azimuth(azimuth_deg, 16.0);
        for ((frequency_hz, expected), tolerance) in
            [500.0, 2000.0, 4000.0].into_iter().zip(levels_db).zip([1.0, 1.0, 2.0])
        {
            let measured = level_db(&response.right, frequency_hz) - level_db(&response.left, frequency_hz);
            assert!(
                (measured - expected).abs() <= tolerance,
                "{azimuth_deg}, {frequency_hz} Hz: {measured} dB"
            );
        }
    }
}

#[test]
fn the_nearer_ear_leads_and_is_louder_in_every_octave() {
    for azimuth_deg in (15..=165).step_by(15) {
        for range_m in [0.25, 1.0, 4.0] {
            let response = from_azimuth(azimuth_deg as f32, range_m);
            for center_hz in [125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0] {
                let place = format!("{azimuth_deg} degrees, {range_m} m, {center_hz} Hz");
                let (left, right) =
                    (level_db(&response.left, center_hz), level_db(&response.right, center_hz));
                assert!(right > left, "{place}: {right} and {left} dB");
                let lag = lag_us(&response, center_hz * 0.71, center_hz * 1.41);
                // Above 1.5 kHz the correlation of an octave may slip by a period; its envelope does not.
                let lag = if center_hz > 1500.0 { group_lag_us(&response, center_hz) } else { lag };
                assert!(lag > 20.0, "{place}: {lag} us");
            }
        }
    }
}

/// Lag of the left ear's envelope, microseconds: difference of the group delays, weighted over an octave.
fn group_lag_us(response: &ImpulseResponse, center_hz: f64) -> f64 {
    let delay_s = |ear: &[f32]| {
        let (mut moment, mut energy) = (0.0, 0.0);
        for step in 0..40 {
            let hz = center_hz * (0.71 + 0.7 * f64::from(step) / 40.0);
            let ((re, im), (next_re, next_im)) = (bin(ear, hz), bin(ear, hz + 5.0));
            let turn = (next_im * re - next_re * im).atan2(next_re * re + next_im * im);
            moment += -turn / (TAU * 5.0) * (re * re + im * im);
            energy += re * re + im * im;
        }
        moment / energy
    };
    (delay_s(&response.left) - delay_s(&response.right)) * 1e6
}

#[test]
fn level_difference_grows_with_frequency_off_to_the_side() {
    for azimuth_deg in [30.0, 45.0, 60.0] {
        let response = from_azimuth(azimuth_deg, 4.0);
        let difference = |hz| level_db(&response.right, hz) - level_db(&response.left, hz);
        assert!(difference(4000.0) > difference(1000.0) && difference(1000.0) > difference(250.0));
    }
}

#[test]
fn mirrored_sources_swap_the_ears_to_the_bit() {
    for (azimuth_deg, range_m) in [(0.0, 1.0), (20.0, 0.4), (75.0, 2.0), (143.0, 7.0), (90.0, 0.1)] {
        let (right, left) = (from_azimuth(azimuth_deg, range_m), from_azimuth(-azimuth_deg, range_m));
        assert_eq!((right.left, right.right), (left.right, left.left));
    }
}

#[test]
fn front_and_back_differ_and_turning_tells_them_apart() {
    let lag = |azimuth_deg| lag_us(&from_azimuth(azimuth_deg, 8.0), 100.0, 1500.0);
    assert!((lag(30.0) - lag(150.0) - 52.0).abs() <= 10.0, "{}", lag(30.0) - lag(150.0));
    // The head turns 30 degrees to the left: sources to the right go farther to the right in front, back behind.
    let turned = |azimuth_deg: f32| {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        let source = free_field().source(&point(8.0 * sin, 1.0, -8.0 * cos));
        lag_us(&source.impulse_response(&listener(0.0, 0.0, 30.0)), 100.0, 1500.0)
    };
    assert!(turned(30.0) > lag(30.0) + 100.0 && turned(150.0) < lag(150.0) - 100.0);
    assert!((turned(30.0) - lag(60.0)).abs() < 3.0);
}

#[test]
fn a_source_overhead_is_equal_in_both_ears() {
    let response = free_field().source(&point(0.0, 3.0, 0.0)).impulse_response(&listener(0.0, 0.0, 25.0));
    assert_eq!(response.left, response.right);
}

#[test]
fn pressure_falls_as_one_over_distance() {
    for range_m in [0.5, 1.0, 2.0, 4.0, 8.0, 16.0] {
        // At 125 Hz and perpendicular to the ear axis the head has almost no effect; closer sources have
        // curved waves.
        let response = from_azimuth(10.0, range_m);
        let level = level_db(&response.right, 125.0) + 20.0 * f64::from(range_m).log10();
        let near_field = 0.1 + 0.05 / f64::from(range_m * range_m);
        assert!(level.abs() < near_field, "{range_m} m: {level} dB off");
    }
}

#[test]
fn sound_takes_its_time() {
    // Between two distances the phase at 1 kHz turns by the travel time, to a twentieth of a sample (3 us).
    let phase_s = |range_m: f32| {
        let (re, im) = bin(&from_azimuth(0.0, range_m).left, 1000.0);
        -im.atan2(re) / (TAU * 1000.0)
    };
    for (near_m, far_m) in [(4.0, 9.37), (4.0, 19.99), (5.5, 5.6)] {
        let expected_s = f64::from((far_m - near_m) / SPEED_OF_SOUND_M_S);
        let error_s = (phase_s(far_m) - phase_s(near_m) - expected_s) % 1e-3;
        let error_s = if error_s > 5e-4 {
            error_s - 1e-3
        } else if error_s < -5e-4 {
            error_s + 1e-3
        } else {
            error_s
        };
        assert!(error_s.abs() < 4e-6, "{near_m} to {far_m} m: {error_s} s off");
    }
    // The peak comes within a sample of d / c, corrected for the ear 100 degrees from the front.
    for range_m in [0.25, 1.0, 5.0, 20.0] {
        let ear = from_azimuth(100.0, range_m).right;
        let peak = (0..ear.len()).max_by(|a, b| ear[*a].total_cmp(&ear[*b])).expect("taps") as f32;
        let expected = (range_m - 0.0875) / SPEED_OF_SOUND_M_S * 16_000.0;
        assert!((peak - expected).abs() <= 1.0, "{range_m} m: {peak}, not {expected}");
    }
}

#[test]
fn far_air_dulls_the_sound() {
    // ISO 9613-1, 20 degrees, 50 %: 4.7, 9.9, 29.7 dB a kilometre at 1, 2, 4 kHz.
    let (near, far) = (from_azimuth(100.0, 20.0), from_azimuth(100.0, 320.0));
    for (frequency_hz, db_per_km) in [(1000.0, 4.7), (2000.0, 9.9), (4000.0, 29.7)] {
        let spreading = 20.0 * 16.0_f64.log10();
        let lost = level_db(&near.right, frequency_hz) - level_db(&far.right, frequency_hz) - spreading;
        assert!((lost - 0.3 * db_per_km).abs() < 0.1 * 0.3 * db_per_km + 0.1, "{frequency_hz} Hz: {lost} dB");
    }
}

#[test]
fn a_full_turn_changes_nothing_audible() {
    let source = free_field().source(&point(2.0, 1.5, -3.0));
    let response =
        |heading_rad| source.impulse_response(&Listener { heading_rad, ..listener(0.0, 0.0, 0.0) });
    let (start, end) = (response(0.3), response(0.3 + std::f32::consts::TAU));
    assert!(start.left.iter().zip(&end.left).all(|(a, b)| (a - b).abs() < 1e-4));
}

#[test]
fn without_a_head_both_ears_hear_the_pressure_at_its_centre() {
    let settings = Settings { head: Head::Omni, ..Settings::default() };
    let free_field = opaque_building(&[], settings);
    for (azimuth_deg, range_m) in [(0.0, 0.5), (75.0, 1.0), (160.0, 4.3), (-90.0, 16.0)] {
        let (sin, cos) = f32::to_radians(azimuth_deg).sin_cos();
        let source = free_field.source(&point(range_m * sin, 1.0, -range_m * cos));
        let response = source.impulse_response(&listener(0.0, 0.0, 33.0));
        assert_eq!(response.left, response.right);
        let samples = f64::from(range_m / SPEED_OF_SOUND_M_S) * f64::from(SAMPLE_RATE_HZ);
        for frequency_hz in [200.0, 500.0] {
            let expected_db = -20.0 * f64::from(range_m).log10();
            let measured_db = level_db(&response.left, frequency_hz);
            assert!(
                (measured_db - expected_db).abs() < 0.1,
                "{range_m} m: {measured_db}, not {expected_db} dB"
            );
            let (re, im) = bin(&response.left, frequency_hz);
            let turn = TAU * frequency_hz / f64::from(SAMPLE_RATE_HZ);
            let late = (samples + im.atan2(re) / turn).rem_euclid(TAU / turn);
            let late = late.min(TAU / turn - late);
            // Air absorption adds a tiny delay.
            assert!(late < 0.03 + 0.005 * f64::from(range_m), "{range_m} m: {late} samples late");
        }
    }
}

#[test]
fn the_first_wave_is_told_by_delay_and_bearing() {
    for (azimuth_deg, heading_deg) in [(0.0, 0.0), (40.0, 0.0), (-120.0, 10.0), (90.0, -75.0), (170.0, 20.0)]
    {
        let (sin, cos) = f32::to_radians(azimuth_deg).sin_cos();
        let source = free_field().source(&point(-3.0 * sin, 1.0, -3.0 * cos));
        let first = source.first_wave(&listener(0.0, 0.0, heading_deg)).expect("a wave");
        assert!((first.azimuth_rad.to_degrees() - (azimuth_deg - heading_deg)).abs() < 1e-3, "{azimuth_deg}");
        assert!((first.delay_s - f64::from(3.0 / SPEED_OF_SOUND_M_S)).abs() < 1e-7);
        assert_eq!(first.response, source.impulse_response(&listener(0.0, 0.0, heading_deg)));
    }
}
