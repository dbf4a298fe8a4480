//! Sound pressure on a rigid sphere, from the series of Duda and Martens (1998), "Range dependence of the
//! response of a spherical head model", J. Acoust. Soc. Am. 104, in the time convention exp(+j w t).

use crate::SPEED_OF_SOUND_M_S;
use realfft::num_complex::Complex64;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Radius of the head, metres.
pub(crate) const HEAD_RADIUS_M: f64 = 0.0875;

/// Terms of the series: the last one is below 1e-15 for ka < 13 and ranges from 0.25 m.
const ORDERS: usize = 46;

/// The sphere response at a frequency and range for any angle of incidence.
pub(crate) struct SphereResponse {
    /// Coefficient of each Legendre polynomial.
    coefficients: [Complex64; ORDERS],
}

impl SphereResponse {
    /// The response at `frequency_hz` (20 to 8000) to a point source at `range_m` from the centre, or to a
    /// plane wave when `range_m` is infinite.
    pub(crate) fn new(frequency_hz: f64, range_m: f64) -> Self {
        let wave_number = TAU * frequency_hz / f64::from(SPEED_OF_SOUND_M_S);
        let ka = wave_number * HEAD_RADIUS_M;
        let surface_slopes = hankel_slopes(ka);
        let incident = incident_terms(wave_number, range_m);
        // Both Hankel lists lack their factor exp(-j x); the one of the range cancels against the free field.
        let scale = -Complex64::from_polar_libm(ka);
        let coefficients = std::array::from_fn(|order| {
            let weight = (2 * order + 1) as f64;
            scale * weight * incident[order] / surface_slopes[order]
        });
        Self { coefficients }
    }

    /// Pressure at a surface point by the cosine of the angle between its radius and the source direction;
    /// relative to the free-field pressure at the centre, including phase.
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

/// `exp(j angle)` with equal bits on every platform.
trait FromPolarLibm {
    fn from_polar_libm(angle_rad: f64) -> Self;
}

impl FromPolarLibm for Complex64 {
    fn from_polar_libm(angle_rad: f64) -> Self {
        Complex64::new(libm::cos(angle_rad), libm::sin(angle_rad))
    }
}

/// `h_m(k r) r / (k a^2)` without the factor exp(-j k r), for every order; its limit for a plane wave.
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

/// Spherical Hankel functions of the second kind without their factor exp(-j x), by upward recurrence.
fn scaled_hankel(x: f64) -> [Complex64; ORDERS + 1] {
    let mut hankel = [Complex64::default(); ORDERS + 1];
    hankel[0] = Complex64::new(0.0, 1.0 / x);
    hankel[1] = Complex64::new(-1.0 / x, 1.0 / (x * x));
    for order in 1..ORDERS {
        hankel[order + 1] = hankel[order] * ((2 * order + 1) as f64 / x) - hankel[order - 1];
    }
    hankel
}

/// Derivatives of [`scaled_hankel`]'s functions, without the same factor.
fn hankel_slopes(x: f64) -> [Complex64; ORDERS] {
    let hankel = scaled_hankel(x);
    std::array::from_fn(|order| match order {
        0 => -hankel[1],
        _ => hankel[order - 1] - hankel[order] * ((order + 1) as f64 / x),
    })
}

/// Delay of the wave front at the surface point, seconds after the free-field centre: straight if the source
/// is visible, otherwise tangential and around the sphere (Woodworth's geometry).
///
/// `range_m` must exceed the radius, and may be infinite.
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
    fn a_sphere_much_smaller_than_the_wave_is_not_there() {
        let response = SphereResponse::new(20.0, f64::INFINITY);
        assert!((response.pressure(0.3).norm() - 1.0).abs() < 1e-3);
    }

    #[test]
    fn high_frequencies_double_in_front_and_stay_up_in_the_bright_spot_behind() {
        let response = SphereResponse::new(8000.0, f64::INFINITY);
        assert!((response.pressure(1.0).norm() - 2.0).abs() < 0.1, "{}", response.pressure(1.0).norm());
        assert!(response.pressure(-1.0).norm() > 2.0 * response.pressure(-0.8).norm());
    }

    #[test]
    fn a_far_point_source_is_a_plane_wave() {
        for frequency_hz in [100.0, 1000.0, 6000.0] {
            let (far, plane) =
                (SphereResponse::new(frequency_hz, 500.0), SphereResponse::new(frequency_hz, f64::INFINITY));
            for cos_incidence in [-1.0, -0.4, 0.2, 1.0] {
                assert!((far.pressure(cos_incidence) - plane.pressure(cos_incidence)).norm() < 5e-3);
            }
        }
    }

    #[test]
    fn low_frequency_delay_is_one_and_a_half_radii() {
        // Kuhn 1977: below 500 Hz the phase delay at incidence t is -(3 a / 2 c) cos t.
        let frequency_hz = 100.0;
        let pressure = SphereResponse::new(frequency_hz, f64::INFINITY).pressure(0.5);
        let delay_s = -libm::atan2(pressure.im, pressure.re) / (TAU * frequency_hz);
        assert!((delay_s + 0.75 * HEAD_RADIUS_M / 343.0).abs() < 5e-6, "{delay_s}");
    }

    #[test]
    fn the_front_reaches_the_near_point_first_and_is_continuous_at_the_tangent() {
        assert!((onset_delay_s(1.0, f64::INFINITY) + HEAD_RADIUS_M / 343.0).abs() < 1e-9);
        assert!((onset_delay_s(1.0, 1.0) + HEAD_RADIUS_M / 343.0).abs() < 1e-9);
        let tangent = HEAD_RADIUS_M / 0.5;
        let step = onset_delay_s(tangent - 1e-6, 0.5) - onset_delay_s(tangent + 1e-6, 0.5);
        assert!(step.abs() < 1e-8);
    }
}
