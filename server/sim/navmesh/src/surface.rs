//! Walkable heights: the exact ground height at a point.

use crate::plane::{Lattice, LatticePoint, Spot, nearest_height_m, turn};
use crate::polygons::RawPolygon;
use crate::voxels::Floors;
use avln_geom::{Point3, RayMesh, Vector3};
use avln_scene::Scene;

// Polygon edges deviate less from the raster than this, cells.
const SEARCH_CELLS: i64 = 4;

pub(crate) enum Surface {
    Scene(Box<Ground>),
    Detail(Detail),
}

impl Surface {
    pub(crate) fn byte_count(&self) -> usize {
        match self {
            Self::Scene(ground) => {
                let patches = size_of_val(ground.patches.as_slice());
                ground.faces.byte_count() + ground.floors.byte_count() + patches
            }
            Self::Detail(detail) => detail.byte_count(),
        }
    }

    pub(crate) fn height_m(&self, polygon: u32, spot: &Spot) -> f32 {
        match self {
            Self::Scene(ground) => ground.height_m(polygon, spot),
            Self::Detail(detail) => detail.height_m(polygon, spot) as f32,
        }
    }

    /// Returns [`Surface::height_m`] to within a lattice level, without a ray.
    pub(crate) fn rough_height_m(&self, polygon: u32, spot: &Spot) -> f32 {
        match self {
            Self::Scene(ground) => ground.top_m(polygon, spot) - 0.5 * ground.lattice.level_m,
            Self::Detail(detail) => detail.height_m(polygon, spot) as f32,
        }
    }
}
pub(crate) struct Ground {
    lattice: Lattice,
    floors: Floors,
    /// Region by polygon, and a height for spots outside the lattice floors, metres.
    patches: Vec<(u16, f32)>,
    faces: RayMesh,
}

impl Ground {
    pub(crate) fn new(lattice: Lattice, floors: Floors, patches: Vec<(u16, f32)>, scene: &Scene) -> Self {
        Self { lattice, floors, patches, faces: upward_faces(scene) }
    }

    /// Returns the surface height; half a level below the lattice cell top at gaps.
    fn height_m(&self, polygon: u32, spot: &Spot) -> f32 {
        let level_m = self.lattice.level_m;
        let top = self.top_m(polygon, spot) + level_m;
        let above = self.lattice.point(spot, top);
        let hit = self.faces.cast(&above, &-Vector3::y(), 3.0 * level_m);
        hit.map_or(top - 1.5 * level_m, |hit| top - hit.distance)
    }
    fn top_m(&self, polygon: u32, spot: &Spot) -> f32 {
        let (region, fallback_m) = self.patches[polygon as usize];
        let level = self.level_near(spot.x.floor() as i64, spot.y.floor() as i64, region);
        level.map_or(fallback_m, |level| self.lattice.height_m(level))
    }

    fn level_near(&self, x: i64, z: i64, region: u16) -> Option<u16> {
        let level = |dx: i64, dz: i64| {
            let (x, z) = (usize::try_from(x + dx).ok()?, usize::try_from(z + dz).ok()?);
            let inside = x < self.floors.width && z < self.floors.depth;
            if inside { self.floors.level(x, z, region) } else { None }
        };
        (0..=SEARCH_CELLS).find_map(|ring| square_ring(ring).find_map(|(dx, dz)| level(dx, dz)))
    }
}

/// Returns the offsets at Chebyshev distance `ring`, nearest to an axis first.
fn square_ring(ring: i64) -> impl Iterator<Item = (i64, i64)> {
    (0..=ring).flat_map(move |i| {
        [(ring, i), (i, ring), (-ring, i), (i, -ring), (ring, -i), (-i, ring), (-ring, -i), (-i, -ring)]
    })
}

/// Returns the upward triangles at any slope.
fn upward_faces(scene: &Scene) -> RayMesh {
    let mesh = &scene.mesh;
    let corner = |index: u32| -> &Point3<f32> { &mesh.positions[index as usize] };
    let faces_up = |&&[a, b, c]: &&[u32; 3]| (corner(b) - corner(a)).cross(&(corner(c) - corner(a))).y > 0.0;
    let triangles: Vec<_> = mesh.triangles.iter().filter(faces_up).copied().collect();
    RayMesh::new(&mesh.positions, &triangles)
}

// Rounding can leave a spot on a shared side outside both triangles; share of the triangle area.
const RIM: f64 = 1e-6;

/// Recast's detail mesh: height triangles by polygon.
pub(crate) struct Detail {
    first: Vec<u32>,
    triangles: Vec<[LatticePoint; 3]>,
}

impl Detail {
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.first.as_slice()) + size_of_val(self.triangles.as_slice())
    }

    pub(crate) fn new(polygons: &[RawPolygon]) -> Self {
        let mut detail = Self { first: vec![0], triangles: Vec::new() };
        for polygon in polygons {
            detail.triangles.extend(&polygon.detail);
            detail.first.push(detail.triangles.len() as u32);
        }
        detail
    }

    /// Returns the height in the covering triangle, otherwise on the nearest side.
    pub(crate) fn height_m(&self, polygon: u32, spot: &Spot) -> f64 {
        let triangles = self.of(polygon);
        triangles.iter().find_map(|triangle| height_inside(triangle, spot)).unwrap_or_else(|| {
            nearest_height_m(spot, triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]))
        })
    }

    pub(crate) fn reach_m(&self, polygon: u32) -> (f64, f64) {
        let heights = self.of(polygon).iter().flatten().map(|corner| corner.height_m);
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)))
    }

    fn of(&self, polygon: u32) -> &[[LatticePoint; 3]] {
        let range = |index: usize| self.first[index] as usize;
        &self.triangles[range(polygon as usize)..range(polygon as usize + 1)]
    }
}

/// Returns the height in a covering triangle's plane.
fn height_inside([a, b, c]: &[LatticePoint; 3], spot: &Spot) -> Option<f64> {
    let area = turn(&a.spot, &b.spot, &c.spot);
    if area == 0.0 {
        return None;
    }
    let beta = turn(&a.spot, spot, &c.spot) / area;
    let gamma = turn(&a.spot, &b.spot, spot) / area;
    let inside = beta >= -RIM && gamma >= -RIM && beta + gamma <= 1.0 + RIM;
    let height_m = a.height_m + (b.height_m - a.height_m) * beta + (c.height_m - a.height_m) * gamma;
    inside.then_some(height_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_cover_a_square_once_around() {
        let mut offsets: Vec<_> = (0..=2).flat_map(square_ring).collect();
        offsets.sort_unstable();
        offsets.dedup();
        assert_eq!(offsets.len(), 25);
        assert_eq!(square_ring(1).next(), Some((1, 0)));
    }

    #[test]
    fn heights_follow_triangles_and_extend_outside() {
        let corner = |x, z, height_m| LatticePoint { spot: Spot::new(x, z), height_m };
        let ramp = [corner(0.0, 0.0, 1.0), corner(10.0, 0.0, 2.0), corner(0.0, 10.0, 1.0)];
        let detail = Detail::new(&[RawPolygon { detail: vec![ramp], ..Default::default() }]);
        assert_eq!(detail.height_m(0, &Spot::new(5.0, 2.0)), 1.5);
        assert_eq!(detail.height_m(0, &Spot::new(5.0, -3.0)), 1.5);
        assert_eq!(detail.height_m(0, &Spot::new(12.0, 0.0)), 2.0);
        assert_eq!(detail.reach_m(0), (1.0, 2.0));
    }
}
