//! Predictions of diffuse-field theory.

use crate::{SURFACE_BANDS, Surfaces};
use avln_scene::Scene;

/// Sabine's reverberation time of the bounding box of `scene` with its surfaces, in the slowest band,
/// seconds: `24 ln 10 V / (c A)` with the volume V and the absorbing area A (W. C. Sabine 1898). Infinite
/// without absorption, 0 without surfaces.
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
    let least_m2 = absorbing_m2.into_iter().fold(f32::INFINITY, f32::min);
    24.0 * std::f32::consts::LN_10 * bounds.size().product() / (crate::SPEED_OF_SOUND_M_S * least_m2)
}
