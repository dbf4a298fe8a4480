use crate::plane::{LEVEL_M, Lattice, Spot};
use crate::voxels::Floors;
use avln_geom::{Point3, RayMesh, Vector3};
use avln_scene::Scene;

/// How far around a spot its patch of floor is looked for, cells: polygon edges leave the raster by less.
const SEARCH_CELLS: i64 = 4;

/// The height of the ground under the polygons.
pub(crate) struct Surface {
    lattice: Lattice,
    floors: Floors,
    /// Region of each polygon and, where the raster knows nothing, its level.
    patches: Vec<(u16, u16)>,
    ground: RayMesh,
}

impl Surface {
    pub(crate) fn new(lattice: Lattice, floors: Floors, patches: Vec<(u16, u16)>, scene: &Scene) -> Self {
        Self { lattice, floors, patches, ground: upward_faces(scene) }
    }

    /// Height of `spot` on `polygon`, metres: the scene's own surface, or half a level (2.5 cm) below the top of its
    /// lattice cell where the surface has a gap.
    pub(crate) fn height_m(&self, polygon: u32, spot: &Spot) -> f32 {
        let top = self.rough_height_m(polygon, spot) + LEVEL_M;
        let above = self.lattice.point(spot, top);
        let hit = self.ground.cast(&above, &-Vector3::y(), 3.0 * LEVEL_M);
        hit.map_or(top - 1.5 * LEVEL_M, |hit| top - hit.distance)
    }

    /// [`Surface::height_m`] to the next higher level of the lattice; cheap.
    pub(crate) fn rough_height_m(&self, polygon: u32, spot: &Spot) -> f32 {
        let (region, fallback) = self.patches[polygon as usize];
        let level = self.level_near(spot.x.floor() as i64, spot.y.floor() as i64, region);
        self.lattice.height_m(level.unwrap_or(fallback))
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

/// The offsets at Chebyshev distance `ring`, those nearest to an axis first.
fn square_ring(ring: i64) -> impl Iterator<Item = (i64, i64)> {
    (0..=ring).flat_map(move |i| {
        [(ring, i), (i, ring), (-ring, i), (i, -ring), (ring, -i), (-i, ring), (-ring, -i), (-i, -ring)]
    })
}

/// What a body can stand on: the triangles that face upwards, however steep.
fn upward_faces(scene: &Scene) -> RayMesh {
    let mesh = &scene.mesh;
    let corner = |index: u32| -> &Point3<f32> { &mesh.positions[index as usize] };
    let faces_up = |&&[a, b, c]: &&[u32; 3]| (corner(b) - corner(a)).cross(&(corner(c) - corner(a))).y > 0.0;
    let triangles: Vec<_> = mesh.triangles.iter().filter(faces_up).copied().collect();
    RayMesh::new(&mesh.positions, &triangles)
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
}
