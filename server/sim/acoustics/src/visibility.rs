//! Visible share of a source: a soft shadow boundary instead of a switch.

use avln_geom::{Point3, RayMesh, Vector3, angle};
use std::f32::consts::TAU;

/// Rays of a bundle.
const RAYS: usize = 32;

/// Radius of the bundle, metres.
const RADIUS_M: f32 = 0.3;

/// Result of a bundle of parallel rays around the straight line.
pub(crate) struct Visibility {
    /// True if the centre line is clear.
    pub(crate) center: bool,
    /// Share of clear rays, 0 to 1, among rays with both ends in the same air as the centre line.
    pub(crate) share: f32,
}

/// Casts a bundle of parallel rays from `listener` to `source`.
pub(crate) fn visibility(rays: &RayMesh, listener: &Point3<f32>, source: &Point3<f32>) -> Visibility {
    let line = source - listener;
    let center = rays.is_clear(listener, source);
    if line.norm() < RADIUS_M {
        return Visibility { center, share: if center { 1.0 } else { 0.0 } };
    }
    let (mut clear, mut counted) = (0, 0);
    for offset in bundle(&line) {
        let (from, to) = (listener + offset, source + offset);
        if rays.is_clear(listener, &from) && rays.is_clear(source, &to) {
            counted += 1;
            clear += usize::from(rays.is_clear(&from, &to));
        }
    }
    let share = if counted == 0 { f32::from(u8::from(center)) } else { clear as f32 / counted as f32 };
    Visibility { center, share }
}

/// Offsets perpendicular to `line`, spread over a disc in a sunflower pattern (Vogel 1979).
fn bundle(line: &Vector3<f32>) -> impl Iterator<Item = Vector3<f32>> + use<> {
    const GOLDEN_SHARE: f32 = 0.381_966;
    let up = if line.x.abs() + line.z.abs() > 1e-3 * line.y.abs() { Vector3::y() } else { Vector3::x() };
    let side = line.cross(&up).normalize();
    let top = side.cross(line).normalize();
    (0..RAYS).map(move |ray| {
        let radius_m = RADIUS_M * ((ray as f32 + 0.5) / RAYS as f32).sqrt();
        let (sin, cos) = angle::sin_cos(TAU * GOLDEN_SHARE * ray as f32);
        (side * cos + top * sin) * radius_m
    })
}
