//! Where one can walk and how far it is.
//!
//! A [`NavMesh`] is the floor of a scene, eroded by the body that walks it: convex polygons over a 5 cm lattice,
//! joined edge to edge. Whoever stands on it is a [`NavPoint`]: a position and the polygon it belongs to. All movement
//! and all sight lines go from polygon to neighbour, so storeys above each other never mix.
//! Distances are geodesic in the ground plane: exact on the polygons, climbing costs nothing.
//!
//! Start reading at [`NavMesh`]; then `voxels` (how polygons come from triangles), `polygons`, `sight` and `field`.
//!
//! *Never*: knows of missions or sounds; reads a clock, the environment or a file; iterates in hash order.

mod body;
mod corners;
mod error;
mod field;
mod islands;
mod locate;
mod mesh;
mod plane;
mod polygons;
mod regions;
mod sight;
mod surface;
mod voxels;
mod walk;

pub use body::Body;
pub use error::NavMeshError;
pub use field::DistanceField;
pub use mesh::{NavMesh, NavPoint, Slide};
