//! Ears against the rigid sphere series, in the free field.

use crate::common::{bin, free_field, lag_of_spectra_us, lag_us, level_db, listener, opaque_building, point};
use avln_acoustics::{Head, ImpulseResponse, Listener, SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S, Settings};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Head response at the origin to a source `azimuth_deg` to the right at `range_m`.
fn from_azimuth(azimuth_deg: f32, range_m: f32) -> ImpulseResponse {
    let (sin, cos) = azimuth_deg.to_radians().sin_cos();
    let source = point(range_m * sin, 1.0, -range_m * cos);
    free_field().source(&source).impulse_response(&listener(0.0, 0.0, 0.0))
}

/// Azimuth, interaural delay below 1.5 kHz and below 1 kHz (microseconds), level difference at 500, 2000 and
/// 4000 Hz (decibels): plane wave, radius 8.75 cm, ears at 100 degrees, from an independent evaluation.
const SPHERE: [(f32, f64, f64, [f64; 3]); 5] = [
    (30.0, 341.0, 381.0, [0.9, 5.3, 7.3]),
    (60.0, 616.0, 635.0, [1.4, 6.5, 15.1]),
    (90.0, 691.0, 712.0, [1.8, 4.7, 8.1]),
    (120.0, 572.0, 606.0, [2.3, 9.5, 10.5]),
    (150.0, 289.0, 325.0, [2.0, 4.2, 5.5]),
];

#[test]
fn interaural_delays_match_the_sphere() {
    for (azimuth_deg, correlated_us, low_us, _) in SPHERE {
        let response = from_azimuth(azimuth_deg, 8.0);
        let measured = lag_us(&response, 100.0, 1500.0);
        assert!((measured - correlated_us).abs() <= 5.0, "{azimuth_deg}: {measured}, not {correlated_us} us");
        let measured = lag_us(&response, 100.0, 1000.0);
        assert!((measured - low_us).abs() <= 5.0, "{azimuth_deg}: {measured}, not {low_us} us");
    }
}

#[test]
fn level_differences_match_the_sphere() {
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
fn nearer_ear_leads_and_is_louder_per_octave() {
    for azimuth_deg in (15..=165).step_by(15) {
        for range_m in [0.25, 1.0, 4.0] {
            let response = from_azimuth(azimuth_deg as f32, range_m);
            for center_hz in [125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0] {
                let place = format!("{azimuth_deg} degrees, {range_m} m, {center_hz} Hz");
                let (left, right) =
                    (level_db(&response.left, center_hz), level_db(&response.right, center_hz));
                assert!(right > left, "{place}: {right} and {left} dB");
                let lag = lag_us(&response, center_hz * 0.71, center_hz * 1.41);
                // Above 1.5 kHz the octave's correlation may slip by a period; the envelope does not.
                let lag = if center_hz > 1500.0 { group_lag_us(&response, center_hz) } else { lag };
                assert!(lag > 20.0, "{place}: {lag} us");
            }
        }
    }
}

/// Lag of the left ear's envelope, microseconds: group delay difference, weighted over an octave.
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
fn lateral_level_differences_grow_with_frequency() {
    for azimuth_deg in [30.0, 45.0, 60.0] {
        let response = from_azimuth(azimuth_deg, 4.0);
        let difference = |hz| level_db(&response.right, hz) - level_db(&response.left, hz);
        assert!(difference(4000.0) > difference(1000.0) && difference(1000.0) > difference(250.0));
    }
}

#[test]
fn mirrored_sources_swap_the_ears_exactly() {
    for (azimuth_deg, range_m) in [(0.0, 1.0), (20.0, 0.4), (75.0, 2.0), (143.0, 7.0), (90.0, 0.1)] {
        let (right, left) = (from_azimuth(azimuth_deg, range_m), from_azimuth(-azimuth_deg, range_m));
        assert_eq!((right.left, right.right), (left.right, left.left));
    }
}

#[test]
fn turning_separates_front_and_back() {
    let lag = |azimuth_deg| lag_us(&from_azimuth(azimuth_deg, 8.0), 100.0, 1500.0);
    assert!((lag(30.0) - lag(150.0) - 52.0).abs() <= 10.0, "{}", lag(30.0) - lag(150.0));
    // After a turn to the left, sources on the right move further right in front, and back behind the head.
    let turned = |azimuth_deg: f32| {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        let source = free_field().source(&point(8.0 * sin, 1.0, -8.0 * cos));
        lag_us(&source.impulse_response(&listener(0.0, 0.0, 30.0)), 100.0, 1500.0)
    };
    assert!(turned(30.0) > lag(30.0) + 100.0 && turned(150.0) < lag(150.0) - 100.0);
    assert!((turned(30.0) - lag(60.0)).abs() < 3.0);
}

#[test]
fn overhead_sources_are_equal_at_both_ears() {
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
fn delay_matches_distance() {
    // The phase at 1 kHz turns by the travel time between two distances, to a twentieth of a sample (3 us).
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
fn air_absorption_grows_with_distance() {
    // ISO 9613-1, 20 degrees, 50 %: 4.7, 9.9, 29.7 dB per kilometre at 1, 2, 4 kHz.
    let (near, far) = (from_azimuth(100.0, 20.0), from_azimuth(100.0, 320.0));
    for (frequency_hz, db_per_km) in [(1000.0, 4.7), (2000.0, 9.9), (4000.0, 29.7)] {
        let spreading = 20.0 * 16.0_f64.log10();
        let lost = level_db(&near.right, frequency_hz) - level_db(&far.right, frequency_hz) - spreading;
        assert!((lost - 0.3 * db_per_km).abs() < 0.1 * 0.3 * db_per_km + 0.1, "{frequency_hz} Hz: {lost} dB");
    }
}

#[test]
fn full_turns_do_not_change_the_response() {
    let source = free_field().source(&point(2.0, 1.5, -3.0));
    let response =
        |heading_rad| source.impulse_response(&Listener { heading_rad, ..listener(0.0, 0.0, 0.0) });
    let (start, end) = (response(0.3), response(0.3 + std::f32::consts::TAU));
    assert!(start.left.iter().zip(&end.left).all(|(a, b)| (a - b).abs() < 1e-4));
}

#[test]
fn omni_ears_receive_the_centre_pressure() {
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
fn first_wave_has_delay_and_azimuth() {
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

// An independent series for the rigid sphere: the incident wave from a point source and the scattered wave,
// with separate Bessel functions (Bowman, Senior and Uslenghi 1969, "Electromagnetic and acoustic scattering
// by simple shapes", chapter 10).

const RADIUS_M: f64 = 0.0875;
const EAR_DEG: f64 = 100.0;
const ORDERS: usize = 36;

/// Spherical Bessel functions, first kind: downward recurrence from a high order, scaled by the first.
fn bessel_j(x: f64) -> Vec<f64> {
    let top = ORDERS + 30 + x as usize;
    let mut values = vec![0.0; top + 2];
    values[top] = 1e-280;
    for n in (1..=top).rev() {
        values[n - 1] = (2 * n + 1) as f64 / x * values[n] - values[n + 1];
        if values[n - 1].abs() > 1e200 {
            values.iter_mut().for_each(|value| *value *= 1e-250);
        }
    }
    let (first, second) = (x.sin() / x, x.sin() / (x * x) - x.cos() / x);
    let scale = if first.abs() > second.abs() { first / values[0] } else { second / values[1] };
    values.iter().take(ORDERS + 1).map(|value| value * scale).collect()
}

/// Spherical Bessel functions, second kind: upward recurrence.
fn bessel_y(x: f64) -> Vec<f64> {
    let mut values = vec![-x.cos() / x, -x.cos() / (x * x) - x.sin() / x];
    for n in 1..ORDERS {
        values.push((2 * n + 1) as f64 / x * values[n] - values[n - 1]);
    }
    values
}

fn slope(values: &[f64], n: usize, x: f64) -> f64 {
    n as f64 / x * values[n] - values[n + 1]
}

type Complex = (f64, f64);

fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

fn over(a: Complex, b: Complex) -> Complex {
    let size = b.0 * b.0 + b.1 * b.1;
    times(a, (b.0 / size, -b.1 / size))
}

/// Pressure on the sphere `incidence_deg` from the direction to a point source with unit pressure at 1 m.
fn on_sphere(hz: f64, range_m: f64, incidence_deg: f64) -> Complex {
    let k = TAU * hz / f64::from(SPEED_OF_SOUND_M_S);
    let (ka, kr) = (k * RADIUS_M, k * range_m);
    let (j, y, j_far, y_far) = (bessel_j(ka), bessel_y(ka), bessel_j(kr), bessel_y(kr));
    let cosine = incidence_deg.to_radians().cos();
    let (mut before, mut legendre) = (0.0, 1.0);
    let mut sum = (0.0, 0.0);
    for n in 0..ORDERS - 1 {
        let hankel = (j[n], -y[n]);
        let scattered = over((slope(&j, n, ka), 0.0), (slope(&j, n, ka), -slope(&y, n, ka)));
        let scattered = times(scattered, hankel);
        let here = times((j[n] - scattered.0, -scattered.1), (j_far[n], -y_far[n]));
        let weight = (2 * n + 1) as f64 * legendre;
        sum = (sum.0 + weight * here.0, sum.1 + weight * here.1);
        let next = ((2 * n + 1) as f64 * cosine * legendre - n as f64 * before) / (n + 1) as f64;
        (before, legendre) = (legendre, next);
    }
    times((0.0, -k), sum)
}

/// Left and right ear, with the source `azimuth_deg` to the right.
fn ears(hz: f64, range_m: f64, azimuth_deg: f64) -> [Complex; 2] {
    [-EAR_DEG, EAR_DEG].map(|ear_deg| on_sphere(hz, range_m, azimuth_deg - ear_deg))
}

fn db(value: Complex) -> f64 {
    10.0 * (value.0 * value.0 + value.1 * value.1).log10()
}

/// The crate's response to the same source.
fn response(range_m: f64, azimuth_deg: f64) -> ImpulseResponse {
    let (sin, cos) = azimuth_deg.to_radians().sin_cos();
    let source = point((range_m * sin) as f32, 1.0, (-range_m * cos) as f32);
    free_field().source(&source).impulse_response(&listener(0.0, 0.0, 0.0))
}

/// Near ranges, and a plane wave.
const RANGES_M: [f64; 4] = [0.5, 1.0, 3.0, 16.0];

#[test]
fn series_has_the_small_and_large_sphere_limits() {
    // At 20 Hz the sphere has no effect; at the near pole of a large sphere the pressure doubles.
    assert!((db(on_sphere(20.0, 50.0, 50.0)) + 20.0 * 50.0_f64.log10()).abs() < 0.05);
    assert!((db(on_sphere(8000.0, 4.0, 0.0)) + 20.0 * (4.0 - RADIUS_M).log10() - 6.02).abs() < 0.5);
}

#[test]
fn interaural_delays_match_the_series() {
    for range_m in RANGES_M {
        for azimuth_deg in (0..=180).step_by(15).map(f64::from) {
            let expected = lag_of_spectra_us(|hz| ears(hz, range_m, azimuth_deg), 100.0, 1500.0);
            let found = lag_us(&response(range_m, azimuth_deg), 100.0, 1500.0);
            assert!(
                (found - expected).abs() <= 5.0,
                "{azimuth_deg} degrees, {range_m} m: {found}, not {expected} us"
            );
        }
    }
}

#[test]
fn ear_levels_match_the_series() {
    for range_m in [0.25].into_iter().chain(RANGES_M) {
        for azimuth_deg in (0..=180).step_by(15).map(f64::from) {
            let found = response(range_m, azimuth_deg);
            for (hz, tolerance_db) in
                [(125.0, 0.5), (250.0, 0.5), (500.0, 0.5), (1000.0, 1.0), (2000.0, 1.0), (4000.0, 2.0)]
            {
                let [left, right] = ears(hz, range_m, azimuth_deg).map(db);
                let found = [level_db(&found.left, hz), level_db(&found.right, hz)];
                let place = format!("{azimuth_deg} degrees, {range_m} m, {hz} Hz");
                let difference = (found[1] - found[0]) - (right - left);
                assert!(difference.abs() <= tolerance_db, "{place}: level difference off by {difference} dB");
                assert!(
                    (found[1] - right).abs() <= tolerance_db,
                    "{place}: right ear {} dB, not {right}",
                    found[1]
                );
            }
        }
    }
}

#[test]
fn onsets_follow_straight_and_creeping_waves() {
    // Woodworth's geometry for ears at 100 degrees; the onset is a third of the peak.
    let arrival_us = |incidence_deg: f64| {
        let incidence = incidence_deg.to_radians().abs();
        let path = if incidence <= FRAC_PI_2 { -incidence.cos() } else { incidence - FRAC_PI_2 };
        1e6 * path * RADIUS_M / f64::from(SPEED_OF_SOUND_M_S)
    };
    for azimuth_deg in [15.0, 30.0, 45.0, 60.0, 120.0, 150.0] {
        let found = response(16.0, azimuth_deg);
        let wrapped = |deg: f64| if deg > 180.0 { 360.0 - deg } else { deg };
        let expected = arrival_us(wrapped(azimuth_deg + EAR_DEG)) - arrival_us(azimuth_deg - EAR_DEG);
        let lag = onset_us(&found.left) - onset_us(&found.right);
        assert!((lag - expected).abs() <= 40.0, "{azimuth_deg}: {lag}, not {expected} us");
    }
}

/// Time at which a response first reaches a third of the peak, microseconds, interpolated.
fn onset_us(ear: &[f32]) -> f64 {
    let threshold = ear.iter().fold(0.0_f32, |peak, tap| peak.max(tap.abs())) / 3.0;
    let after = ear.iter().position(|tap| *tap >= threshold).expect("a peak");
    let share = (threshold - ear[after - 1]) / (ear[after] - ear[after - 1]);
    (after as f64 - 1.0 + f64::from(share)) * 62.5
}
