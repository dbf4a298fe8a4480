//! Angles in radians. Sines and cosines come from `libm`, so that every platform gets the same bits.

use nalgebra::{Quaternion, UnitQuaternion};
use std::f32::consts::{PI, TAU};

/// Sine and cosine of `angle_rad`, equal bits on every platform.
pub fn sin_cos(angle_rad: f32) -> (f32, f32) {
    (libm::sinf(angle_rad), libm::cosf(angle_rad))
}

/// The rotation by `heading_rad` about +Y, equal bits on every platform.
pub fn about_up(heading_rad: f32) -> UnitQuaternion<f32> {
    let (sin, cos) = sin_cos(heading_rad * 0.5);
    UnitQuaternion::new_unchecked(Quaternion::new(cos, 0.0, sin, 0.0))
}

/// Angle of the vector (`x`, `y`) from the +x axis, in (-pi, pi], equal bits on every platform.
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// `angle_rad` brought into (-pi, pi].
pub fn wrap(angle_rad: f32) -> f32 {
    let positive = angle_rad.rem_euclid(TAU);
    if positive > PI { positive - TAU } else { positive }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrap_keeps_the_half_open_interval() {
        for (angle, wrapped) in [(0.0, 0.0), (PI, PI), (-PI, PI), (3.0 * PI, PI), (TAU, 0.0), (-0.5, -0.5)] {
            assert!((wrap(angle) - wrapped).abs() < 1e-5, "wrap({angle}) = {}", wrap(angle));
        }
    }
}
