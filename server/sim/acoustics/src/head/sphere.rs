//! Head filters for a rigid sphere.
//!
//! Source: Duda and Martens (1998), "Range dependence of the response of a spherical head model", J. Acoust.
//! Soc. Am. 104, in the time convention exp(+j w t).

use super::filter::{DESIGN_BIN_HZ, DESIGN_POINTS, EarResponse, HEAD_TAPS, HeadFilter, design_from};
use crate::SPEED_OF_SOUND_M_S;
use crate::bands::BANDS;
use crate::late::diffuse::band_energies;
use crate::transform::unit_phasor;
use avln_geom::{Vector3, angle};
use realfft::num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::OnceLock;

/// Ear azimuth, degrees from straight ahead.
const EAR_AZIMUTH_DEG: f32 = 100.0;

/// Table ranges, per metre: 0.25, 0.5, 1, 2, 4 metres and a plane wave.
const INVERSE_RANGES: [f32; 6] = [4.0, 2.0, 1.0, 0.5, 0.25, 0.0];

/// Table angles: 0 to 180 degrees, one degree apart.
const ANGLES: usize = 181;

/// Unit vectors out of the left and the right ear, world frame.
pub(crate) fn ear_axes(heading_rad: f32) -> [Vector3<f32>; 2] {
    let (sin, cos) = angle::sin_cos(heading_rad);
    let (forward, left) = (Vector3::new(-sin, 0.0, -cos), Vector3::new(-cos, 0.0, sin));
    let (ear_sin, ear_cos) = angle::sin_cos(EAR_AZIMUTH_DEG.to_radians());
    [forward * ear_cos + left * ear_sin, forward * ear_cos - left * ear_sin]
}

/// `INVERSE_RANGES × ANGLES`, row by row, aligned on the wave front.
fn filters() -> &'static [HeadFilter] {
    static FILTERS: OnceLock<Vec<HeadFilter>> = OnceLock::new();
    let design = |inverse: &f32| design_range(1.0 / f64::from(*inverse));
    FILTERS.get_or_init(|| INVERSE_RANGES.iter().flat_map(design).collect())
}

/// Returns the four table entries around an incidence and range, with weights that add up to 1.
fn corners(cos_incidence: f32, range_m: f32) -> [(usize, f32); 4] {
    let (row, row_weight) = range_position(range_m);
    let degrees = libm::acosf(cos_incidence.clamp(-1.0, 1.0)).to_degrees().clamp(0.0, 180.0);
    let column = (degrees as usize).min(ANGLES - 2);
    let column_weight = degrees - column as f32;
    let first = row * ANGLES + column;
    [
        (first, (1.0 - row_weight) * (1.0 - column_weight)),
        (first + 1, (1.0 - row_weight) * column_weight),
        (first + ANGLES, row_weight * (1.0 - column_weight)),
        (first + ANGLES + 1, row_weight * column_weight),
    ]
}

/// Response to a source at `range_m` (at least 0.1) by the cosine to the ear axis, re the head centre.
pub(crate) fn ear_response(cos_incidence: f32, range_m: f32) -> EarResponse {
    let cos_incidence = cos_incidence.clamp(-1.0, 1.0);
    let filters = filters();
    let mut filter = [0.0; HEAD_TAPS];
    for (place, weight) in corners(cos_incidence, range_m) {
        filter.iter_mut().zip(&filters[place]).for_each(|(sum, tap)| *sum += weight * tap);
    }
    EarResponse { filter, delay_s: onset_delay_s(f64::from(cos_incidence), f64::from(range_m)) }
}

/// Energy of [`ear_response`] by band, relative to the free field.
pub(crate) fn ear_energy(cos_incidence: f32, range_m: f32) -> [f32; BANDS] {
    static ENERGIES: OnceLock<Vec<[f32; BANDS]>> = OnceLock::new();
    let energies = ENERGIES.get_or_init(|| filters().iter().map(band_energies).collect());
    let corners = corners(cos_incidence, range_m);
    std::array::from_fn(|band| corners.iter().map(|(place, weight)| weight * energies[*place][band]).sum())
}

/// The table row on the near side, and the next row's weight.
fn range_position(range_m: f32) -> (usize, f32) {
    let inverse = (1.0 / range_m).clamp(0.0, INVERSE_RANGES[0]);
    let row = (0..INVERSE_RANGES.len() - 2).find(|row| inverse >= INVERSE_RANGES[row + 1]);
    let row = row.unwrap_or(INVERSE_RANGES.len() - 2);
    (row, (INVERSE_RANGES[row] - inverse) / (INVERSE_RANGES[row] - INVERSE_RANGES[row + 1]))
}

fn design_range(range_m: f64) -> Vec<HeadFilter> {
    let responses: Vec<_> = (0..=DESIGN_POINTS / 2)
        .map(|bin| SphereResponse::new((bin as f64 * DESIGN_BIN_HZ).max(20.0), range_m))
        .collect();
    let at_angle = |degrees: usize| {
        let cos_incidence = libm::cos((degrees as f64).to_radians());
        let spectrum: Vec<_> = responses.iter().map(|response| response.pressure(cos_incidence)).collect();
        design_from(&spectrum, onset_delay_s(cos_incidence, range_m))
    };
    (0..ANGLES).map(at_angle).collect()
}

pub(crate) const HEAD_RADIUS_M: f64 = 0.0875;

// The last series term is below 1e-15 for ka < 13 and ranges from 0.25 m.
const ORDERS: usize = 46;

/// Pressure on the sphere at a frequency and range.
pub(crate) struct SphereResponse {
    /// A coefficient per Legendre polynomial.
    coefficients: [Complex64; ORDERS],
}

impl SphereResponse {
    /// Expands the field at `frequency_hz` (20 to 8000) for a source at `range_m`; infinite for a plane wave.
    pub(crate) fn new(frequency_hz: f64, range_m: f64) -> Self {
        let wave_number = TAU * frequency_hz / f64::from(SPEED_OF_SOUND_M_S);
        let ka = wave_number * HEAD_RADIUS_M;
        let surface_slopes = hankel_slopes(ka);
        let incident = incident_terms(wave_number, range_m);
        // Both Hankel lists lack the factor exp(-j x); for the range it cancels against the free field.
        let scale = -unit_phasor(ka);
        let coefficients = std::array::from_fn(|order| {
            let weight = (2 * order + 1) as f64;
            scale * weight * incident[order] / surface_slopes[order]
        });
        Self { coefficients }
    }

    /// Pressure by the cosine between surface point and source direction, relative to the free field.
    pub(crate) fn pressure(&self, cos_incidence: f64) -> Complex64 {
        let (mut previous, mut current) = (1.0, cos_incidence);
        let mut sum = self.coefficients[0];
        for (order, coefficient) in self.coefficients.iter().enumerate().skip(1) {
            sum += coefficient * current;
            let n = order as f64;
            let next = ((2.0 * n + 1.0) * cos_incidence * current - n * previous) / (n + 1.0);
            (previous, current) = (current, next);
        }
        sum
    }
}

/// `h_m(k r) r / (k a^2)` without the factor exp(-j k r), for every order, or the plane wave limit.
fn incident_terms(wave_number: f64, range_m: f64) -> [Complex64; ORDERS] {
    let a = HEAD_RADIUS_M;
    if range_m.is_infinite() {
        let scale = 1.0 / (wave_number * a * wave_number * a);
        return std::array::from_fn(|order| power_of_j(order + 1) * scale);
    }
    let hankel = scaled_hankel(wave_number * range_m);
    std::array::from_fn(|order| hankel[order] * (range_m / (wave_number * a * a)))
}

fn power_of_j(exponent: usize) -> Complex64 {
    [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)].map(|(re, im)| Complex64::new(re, im))[exponent % 4]
}

/// Spherical Hankel functions, second kind, without the factor exp(-j x), by upward recurrence.
fn scaled_hankel(x: f64) -> [Complex64; ORDERS + 1] {
    let mut hankel = [Complex64::default(); ORDERS + 1];
    hankel[0] = Complex64::new(0.0, 1.0 / x);
    hankel[1] = Complex64::new(-1.0 / x, 1.0 / (x * x));
    for order in 1..ORDERS {
        hankel[order + 1] = hankel[order] * ((2 * order + 1) as f64 / x) - hankel[order - 1];
    }
    hankel
}

/// Derivatives of the same functions, without the same factor.
fn hankel_slopes(x: f64) -> [Complex64; ORDERS] {
    let hankel = scaled_hankel(x);
    std::array::from_fn(|order| match order {
        0 => -hankel[1],
        _ => hankel[order - 1] - hankel[order] * ((order + 1) as f64 / x),
    })
}

/// Wave-front delay at a surface point relative to the free-field centre, seconds: straight if the source is
/// visible, otherwise around the sphere (Woodworth). `range_m` must exceed the radius, and may be infinite.
pub(crate) fn onset_delay_s(cos_incidence: f64, range_m: f64) -> f64 {
    let a = HEAD_RADIUS_M;
    let speed = f64::from(SPEED_OF_SOUND_M_S);
    let incidence = libm::acos(cos_incidence.clamp(-1.0, 1.0));
    if range_m.is_infinite() {
        let lit = cos_incidence >= 0.0;
        return if lit { -a * cos_incidence } else { a * (incidence - FRAC_PI_2) } / speed;
    }
    let tangent_angle = libm::acos(a / range_m);
    let path_m = if incidence <= tangent_angle {
        (range_m * range_m + a * a - 2.0 * range_m * a * cos_incidence).sqrt()
    } else {
        (range_m * range_m - a * a).sqrt() + a * (incidence - tangent_angle)
    };
    (path_m - range_m) / speed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_spheres_do_not_affect_long_waves() {
        let response = SphereResponse::new(20.0, f64::INFINITY);
        assert!((response.pressure(0.3).norm() - 1.0).abs() < 1e-3);
    }

    #[test]
    fn high_frequencies_double_in_front_and_brighten_behind() {
        let response = SphereResponse::new(8000.0, f64::INFINITY);
        assert!((response.pressure(1.0).norm() - 2.0).abs() < 0.1, "{}", response.pressure(1.0).norm());
        assert!(response.pressure(-1.0).norm() > 2.0 * response.pressure(-0.8).norm());
    }

    #[test]
    fn distant_point_sources_equal_plane_waves() {
        for frequency_hz in [100.0, 1000.0, 6000.0] {
            let (far, plane) =
                (SphereResponse::new(frequency_hz, 500.0), SphereResponse::new(frequency_hz, f64::INFINITY));
            for cos_incidence in [-1.0, -0.4, 0.2, 1.0] {
                assert!((far.pressure(cos_incidence) - plane.pressure(cos_incidence)).norm() < 5e-3);
            }
        }
    }

    #[test]
    fn low_frequency_delay_is_1_5_radii() {
        // Kuhn 1977: below 500 Hz the phase delay at incidence t is -(3 a / 2 c) cos t.
        let frequency_hz = 100.0;
        let pressure = SphereResponse::new(frequency_hz, f64::INFINITY).pressure(0.5);
        let delay_s = -libm::atan2(pressure.im, pressure.re) / (TAU * frequency_hz);
        assert!((delay_s + 0.75 * HEAD_RADIUS_M / 343.0).abs() < 5e-6, "{delay_s}");
    }

    #[test]
    fn onset_delay_is_continuous_at_the_tangent() {
        assert!((onset_delay_s(1.0, f64::INFINITY) + HEAD_RADIUS_M / 343.0).abs() < 1e-9);
        assert!((onset_delay_s(1.0, 1.0) + HEAD_RADIUS_M / 343.0).abs() < 1e-9);
        let tangent = HEAD_RADIUS_M / 0.5;
        let step = onset_delay_s(tangent - 1e-6, 0.5) - onset_delay_s(tangent + 1e-6, 0.5);
        assert!(step.abs() < 1e-8);
    }
}
