//! Where one can walk and how far it is.
//!
//! A [`NavMesh`] is the floor of a scene, eroded by the body that walks it: convex polygons over a lattice of cells,
//! joined edge to edge. Whoever stands on it is a [`NavPoint`]: a position and the polygon it belongs to. All movement
//! and all sight lines go from polygon to neighbour, so storeys above each other never mix.
//! Shortest paths are exact in the ground plane of the polygons; their legs are measured in space.
//!
//! Meshes are built with the arena's own settings ([`NavMesh::build`]) or with any, by default Habitat's
//! ([`NavMesh::build_with`]), or read from Habitat's files ([`NavMesh::from_detour`]). `habitat` answers as Habitat does.
//!
//! Start reading at [`NavMesh`]; then `voxels` (how polygons come from triangles), `polygons`, `sight`, `route`, `field`.
//!
//! *Never*: knows of missions or sounds; reads a clock, the environment or a file; iterates in hash order.

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
