//! Angles in radians. Sines and cosines come from `libm`: the bits are equal on every platform.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::f32::consts::{PI, TAU};

/// Returns sine and cosine, with equal bits on every platform.
pub fn sin_cos(angle_rad: f32) -> (f32, f32) {
    (libm::sinf(angle_rad), libm::cosf(angle_rad))
}

/// Returns the rotation by `heading_rad` about +Y.
pub fn about_up(heading_rad: f32) -> UnitQuaternion<f32> {
    let (sin, cos) = sin_cos(heading_rad * 0.5);
    UnitQuaternion::new_unchecked(Quaternion::new(cos, 0.0, sin, 0.0))
}

/// Returns the rotation by `pitch_rad` about +X; positive looks up from -Z.
pub fn about_right(pitch_rad: f32) -> UnitQuaternion<f32> {
    let (sin, cos) = sin_cos(pitch_rad * 0.5);
    UnitQuaternion::new_unchecked(Quaternion::new(cos, sin, 0.0, 0.0))
}

/// Normalises the quaternion x, y, z, w; `None` if zero or not finite.
pub fn rotation(quaternion: [f64; 4]) -> Option<UnitQuaternion<f32>> {
    let largest = quaternion.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
    if largest == 0.0 || !quaternion.iter().all(|value| value.is_finite()) {
        return None;
    }
    // Squares of values divided by the largest can neither overflow nor vanish.
    let scaled = quaternion.map(|value| value / largest);
    let length = scaled.iter().map(|value| value * value).sum::<f64>().sqrt();
    let [x, y, z, w] = scaled.map(|value| (value / length) as f32);
    Some(UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z)))
}

/// Returns the angle from the +x axis to (`x`, `y`), in (-pi, pi].
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// Wraps `angle_rad` into (-pi, pi].
pub fn wrap(angle_rad: f32) -> f32 {
    let positive = angle_rad.rem_euclid(TAU);
    if positive > PI { positive - TAU } else { positive }
}

/// Returns unit vector `index` from `count` evenly spread directions.
///
/// Source: González (2010), "Measurement of areas on a sphere using Fibonacci and latitude-longitude
/// lattices".
pub fn spread_direction(index: usize, count: usize) -> Vector3<f32> {
    const GOLDEN_SHARE: f64 = 0.381_966_011_250_105_1;
    let height = 1.0 - (2 * index + 1) as f32 / count as f32;
    let turns = index as f64 * GOLDEN_SHARE;
    let (sin, cos) = sin_cos(TAU * (turns - libm::floor(turns)) as f32);
    let radius = (1.0 - height * height).max(0.0).sqrt();
    Vector3::new(radius * cos, height, radius * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapped_angles_are_in_the_half_open_interval() {
        for (angle, wrapped) in [(0.0, 0.0), (PI, PI), (-PI, PI), (3.0 * PI, PI), (TAU, 0.0), (-0.5, -0.5)] {
            assert!((wrap(angle) - wrapped).abs() < 1e-5, "wrap({angle}) = {}", wrap(angle));
        }
    }

    #[test]
    fn quaternion_length_does_not_change_the_rotation() {
        let wanted = about_up(1.0) * about_right(0.5);
        let [x, y, z, w] = <[f32; 4]>::from(wanted.coords).map(f64::from);
        for scale in [-1.0, 1e-300, 1e-20, 3.0, 1e300] {
            let scaled = rotation([x, y, z, w].map(|value| value * scale)).expect("a rotation");
            assert!(scaled.angle_to(&wanted) < 1e-3 && (scaled.norm() - 1.0).abs() < 1e-6, "{scale}");
        }
        for none in [[0.0; 4], [f64::NAN, 0.0, 0.0, 1.0], [0.0, f64::INFINITY, 0.0, 1.0]] {
            assert_eq!(rotation(none), None);
        }
    }

    #[test]
    fn positive_pitch_looks_up() {
        let ahead = about_right(0.5) * -nalgebra::Vector3::z();
        assert!((ahead.y - 0.5_f32.sin()).abs() < 1e-6 && (ahead.z + 0.5_f32.cos()).abs() < 1e-6, "{ahead}");
    }

    #[test]
    fn spread_directions_are_even() {
        let sum: Vector3<f32> = (0..1000).map(|index| spread_direction(index, 1000)).sum();
        assert!(sum.norm() < 1.0, "{sum}");
        for axis in [Vector3::x(), Vector3::y(), Vector3::new(0.6, 0.0, 0.8)] {
            let inside = (0..1000).filter(|index| spread_direction(*index, 1000).dot(&axis) > 0.8).count();
            assert!((95..=105).contains(&inside), "{inside} of 1000 in a cap of a tenth of the sphere");
        }
    }
}
