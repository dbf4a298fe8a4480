//! Frames, poses, angles, boxes, rays, mesh queries and the seeded random generator.
//!
//! World frame (Habitat's): right-handed, Y up, metres, radians. A body with heading 0 faces -Z;
//! a positive rotation about +Y is a left turn. Quaternions are written `x, y, z, w`.
//!
//! Start reading at [`Pose`], [`Aabb`] and [`RayMesh`]. [`QueryMesh`] has the queries without a hot loop: distances, bodies, and a
//! second opinion on rays.
//!
//! This crate never reads a clock, the environment or a file or iterates in hash order.

mod aabb;
pub mod angle;
mod pose;
mod query_mesh;
mod ray_mesh;
mod rng;

pub use aabb::Aabb;
pub use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector2, Vector3};
pub use pose::Pose;
pub use query_mesh::{Capsule, QueryMesh};
pub use ray_mesh::{Hit, RayMesh, Visitor};
pub use rng::{Rng, SplitMix64};

/// Conversions between nalgebra points and the vectors of parry and rerecast (glam).
pub mod convert {
    use nalgebra::{Point3, Vector3};
    pub use parry3d::math::Vec3 as GlamVec3;

    /// Converts a point for parry.
    pub fn glam_from_point(point: &Point3<f32>) -> GlamVec3 {
        GlamVec3::new(point.x, point.y, point.z)
    }

    /// Converts a direction for parry.
    pub fn glam_from_vector(vector: &Vector3<f32>) -> GlamVec3 {
        GlamVec3::new(vector.x, vector.y, vector.z)
    }

    /// Converts a point from parry.
    pub fn point_from_glam(point: GlamVec3) -> Point3<f32> {
        Point3::new(point.x, point.y, point.z)
    }
}
