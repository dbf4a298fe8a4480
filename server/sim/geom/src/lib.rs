//! Frames, poses, angles, boxes, rays and the seeded random generator.
//!
//! World frame (Habitat's): right-handed, Y up, metres, radians. A body with heading 0 looks along -Z;
//! a positive rotation about +Y is a left turn. Quaternions are written `x, y, z, w`.
//!
//! Start reading at [`Pose`], [`Aabb`] and [`RayMesh`].
//!
//! *Never*: reads a clock, the environment or a file; iterates in hash order.

mod aabb;
pub mod angle;
pub mod convert;
mod pose;
mod ray_mesh;
mod rng;

pub use aabb::Aabb;
pub use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector2, Vector3};
pub use pose::Pose;
pub use ray_mesh::{Hit, RayMesh, Visitor};
pub use rng::{Rng, SplitMix64};
