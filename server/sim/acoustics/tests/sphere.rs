//! Both ears against a series for the rigid sphere that is written down here anew: the incident wave of a point
//! source and what the sphere scatters, each with its own Bessel functions (Bowman, Senior and Uslenghi 1969,
//! "Electromagnetic and acoustic scattering by simple shapes", chapter 10).

mod common;

use avln_acoustics::{ImpulseResponse, SPEED_OF_SOUND_M_S};
use common::{free_field, lag_of_spectra_us, lag_us, level_db, listener, point};
use std::f64::consts::{FRAC_PI_2, TAU};

const RADIUS_M: f64 = 0.0875;
const EAR_DEG: f64 = 100.0;
const ORDERS: usize = 36;

/// Spherical Bessel functions of the first kind: recurrence downwards from far above, scaled by the first one.
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

/// Spherical Bessel functions of the second kind: recurrence upwards.
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

/// Pressure on the sphere `incidence_deg` from the direction to a point source of unit pressure at 1 m.
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

/// The left and the right ear, the source `azimuth_deg` to the right.
fn ears(hz: f64, range_m: f64, azimuth_deg: f64) -> [Complex; 2] {
    [-EAR_DEG, EAR_DEG].map(|ear_deg| on_sphere(hz, range_m, azimuth_deg - ear_deg))
}

fn db(value: Complex) -> f64 {
    10.0 * (value.0 * value.0 + value.1 * value.1).log10()
}

/// Our response to the same source.
fn response(range_m: f64, azimuth_deg: f64) -> ImpulseResponse {
    let (sin, cos) = azimuth_deg.to_radians().sin_cos();
    let source = point((range_m * sin) as f32, 1.0, (-range_m * cos) as f32);
    free_field().source(&source).impulse_response(&listener(0.0, 0.0, 0.0))
}

/// 0.5, 1 and 3 m, and so far that it is a plane wave.
const RANGES_M: [f64; 4] = [0.5, 1.0, 3.0, 16.0];

#[test]
fn the_series_is_that_of_a_small_sphere_and_of_a_wall() {
    // At 20 Hz the sphere is not there; at the near pole of a sphere large against the wave pressure doubles.
    assert!((db(on_sphere(20.0, 50.0, 50.0)) + 20.0 * 50.0_f64.log10()).abs() < 0.05);
    assert!((db(on_sphere(8000.0, 4.0, 0.0)) + 20.0 * (4.0 - RADIUS_M).log10() - 6.02).abs() < 0.5);
}

#[test]
fn delays_between_the_ears_are_those_of_the_series() {
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
fn levels_at_the_ears_are_those_of_the_series() {
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
fn onsets_at_the_ears_follow_the_straight_and_the_creeping_wave() {
    // Woodworth's geometry for ears at 100 degrees; an onset is where a third of the peak is reached.
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

/// When a response first reaches a third of its peak, microseconds, between samples.
fn onset_us(ear: &[f32]) -> f64 {
    let threshold = ear.iter().fold(0.0_f32, |peak, tap| peak.max(tap.abs())) / 3.0;
    let after = ear.iter().position(|tap| *tap >= threshold).expect("a peak");
    let share = (threshold - ear[after - 1]) / (ear[after] - ear[after - 1]);
    (after as f64 - 1.0 + f64::from(share)) * 62.5
}
