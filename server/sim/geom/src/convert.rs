//! Conversions between nalgebra points and the vectors of parry and rerecast (glam).

use nalgebra::{Point3, Vector3};
pub use parry3d::math::Vec3 as GlamVec3;

/// A point as parry writes it.
pub fn glam_from_point(point: &Point3<f32>) -> GlamVec3 {
    GlamVec3::new(point.x, point.y, point.z)
}

/// A direction as parry writes it.
pub fn glam_from_vector(vector: &Vector3<f32>) -> GlamVec3 {
    GlamVec3::new(vector.x, vector.y, vector.z)
}

/// A point of parry's in nalgebra's words.
pub fn point_from_glam(point: GlamVec3) -> Point3<f32> {
    Point3::new(point.x, point.y, point.z)
}
