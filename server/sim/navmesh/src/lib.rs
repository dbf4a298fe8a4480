//! Walkable area and geodesic distances.
//!
//! A [`NavMesh`] is a scene's floor, eroded by the body: convex polygons over a lattice, joined at edges. A
//! [`NavPoint`] is a position with a polygon. Movement and lines of sight pass from polygon to neighbour, so
//! storeys above each other never mix. Shortest paths are exact in the ground plane.
//!
//! Meshes have the arena's settings ([`NavMesh::build`]), other settings, by default Habitat's
//! ([`NavMesh::build_with`]), or come from Habitat files ([`NavMesh::from_detour`]).
//!
//! Start reading at [`NavMesh`]; then `voxels` (triangles to polygons), `sight`, `field`, `habitat`.
//!
//! This crate never depends on missions or sounds, reads a clock, the environment or a file, or iterates in
//! hash order.

mod detour;
mod field;
mod habitat;
mod mesh;
mod plane;
mod polygons;
mod raster;
mod settings;
mod sight;
mod surface;
mod voxels;

pub use detour::DetourError;
pub use field::{CornerWays, DistanceField, Exit, Exits, Outlook, Places};
pub use mesh::{NavMesh, NavPoint, Slide};
pub use settings::{Body, Finish, NavMeshError, NavMeshSettings};

#[cfg(test)]
mod fixtures {
    use crate::plane::{LatticePoint, Spot};
    use crate::polygons::{Polygons, RawPolygon};

    /// A square with sides of 10 cells at a height, as outline and two triangles.
    fn square(x: f64, z: f64, height_m: f64) -> RawPolygon {
        let corner = |dx, dz| LatticePoint { spot: Spot::new(x + dx, z + dz), height_m };
        let corners = vec![corner(0.0, 0.0), corner(10.0, 0.0), corner(10.0, 10.0), corner(0.0, 10.0)];
        let detail = vec![[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]];
        RawPolygon { corners, region: 1, detail }
    }

    /// An L of three squares (right of the origin, above the first, right of the first) and a separate square
    /// 3 m above the first; the second is clockwise.
    pub(crate) fn letter_l() -> Polygons {
        let mut second = square(0.0, 10.0, 0.1);
        second.corners.reverse();
        Polygons::new(&[square(0.0, 0.0, 0.0), second, square(10.0, 0.0, 0.0), square(0.0, 0.0, 3.0)], 0.2)
    }
}
