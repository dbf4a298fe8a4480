//! Walkable area and geodesic distances.
//!
//! A [`NavMesh`] is the floor of a scene, eroded by the body: convex polygons over a lattice of cells, joined
//! at edges. A [`NavPoint`] is a position with its polygon. Movement and lines of sight go from polygon to
//! neighbour, so storeys above each other never mix. Shortest paths are exact in the ground plane of the
//! polygons; their legs are measured in space.
//!
//! Meshes are built with the arena's settings ([`NavMesh::build`]), with other settings, by default Habitat's
//! ([`NavMesh::build_with`]), or read from Habitat files ([`NavMesh::from_detour`]). `habitat` contains
//! Habitat-compatible queries.
//!
//! Start reading at [`NavMesh`]; then `voxels` (triangles to polygons), `polygons`, `sight`, `route`,
//! `field`.
//!
//! *Never*: depends on missions or sounds; reads a clock, the environment or a file; iterates in hash order.

mod body;
mod corners;
mod corridor;
mod detail;
mod detour;
mod error;
mod exits;
mod field;
mod habitat;
mod islands;
mod locate;
mod mesh;
mod outlook;
mod plane;
mod polygons;
mod raster;
mod regions;
mod route;
mod settings;
mod sight;
mod stop;
mod surface;
mod voxels;
mod waiting;
mod walk;

pub use body::Body;
pub use detour::DetourError;
pub use error::NavMeshError;
pub use exits::{CornerWays, Exit, Exits, Places};
pub use field::DistanceField;
pub use mesh::{NavMesh, NavPoint, Slide};
pub use outlook::Outlook;
pub use settings::{Finish, NavMeshSettings};
