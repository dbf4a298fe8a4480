//! Packing of clusters: equal corners are stored once, in arrays aligned to vector registers.

use super::{CORNERS, Cluster, HOLED};
use crate::lanes::LANES;
use avln_scene::Mesh;

/// Hash table slots for equal corners: more than twice the corner count.
const SLOTS: usize = 512;

/// Packed lists of all clusters; see [`super::View`].
#[derive(Default)]
pub(super) struct Packed {
    pub(super) clusters: Vec<Cluster>,
    pub(super) coordinates: Vec<f32>,
    pub(super) corners: Vec<[u32; 3]>,
    pub(super) triangles: Vec<[u32; 2]>,
}

/// A corner as bits: position, texture coordinates, colour.
type Corner = [u32; 6];

/// Distinct corners of a cluster.
struct Distinct {
    corners: Vec<Corner>,
    /// Index into `corners` plus one, or 0.
    slots: [u8; SLOTS],
}

impl Packed {
    /// Adds the cluster of the triangles `members`; `surface_of` returns the surface and a flag for holes.
    pub(super) fn add(&mut self, mesh: &Mesh, members: &[u32], surface_of: impl Fn(u32) -> (u32, bool)) {
        let mut distinct = Distinct { corners: Vec::with_capacity(CORNERS), slots: [0; SLOTS] };
        let first_triangle = self.triangles.len();
        for &member in members {
            let [a, b, c] =
                mesh.triangles[member as usize].map(|corner| distinct.index(corner_of(mesh, corner)));
            let (surface, is_holed) = surface_of(member);
            let corners = u32::from_le_bytes([a, b, c, 0]);
            self.triangles.push([if is_holed { corners | HOLED } else { corners }, surface]);
        }
        let corners = &distinct.corners;
        self.clusters.push([
            self.coordinates.len() as u32,
            self.corners.len() as u32,
            first_triangle as u32,
            members.len() as u32 | (corners.len() as u32) << 16,
        ]);
        let padded = corners.len().next_multiple_of(LANES);
        for axis in 0..3 {
            let last = corners[corners.len() - 1][axis];
            let along = corners.iter().map(|corner| corner[axis]);
            self.coordinates.extend(along.chain(std::iter::repeat(last)).take(padded).map(f32::from_bits));
        }
        self.corners.extend(corners.iter().map(|corner| [corner[3], corner[4], corner[5]]));
    }
}

impl Distinct {
    /// The number of `corner` among the different ones, which it joins if it is new.
    fn index(&mut self, corner: Corner) -> u8 {
        let mut slot = hash(&corner) % SLOTS;
        while self.slots[slot] != 0 {
            let index = self.slots[slot] - 1;
            if self.corners[usize::from(index)] == corner {
                return index;
            }
            slot = (slot + 1) % SLOTS;
        }
        self.corners.push(corner);
        self.slots[slot] = self.corners.len() as u8;
        self.corners.len() as u8 - 1
    }
}

fn corner_of(mesh: &Mesh, index: u32) -> Corner {
    let index = index as usize;
    let (position, uv, [r, g, b]) = (&mesh.positions[index], &mesh.uvs[index], mesh.colors[index]);
    let bits = |value: f32| value.to_bits();
    [
        bits(position.x),
        bits(position.y),
        bits(position.z),
        bits(uv.x),
        bits(uv.y),
        u32::from_le_bytes([r, g, b, 0]),
    ]
}

fn hash(corner: &Corner) -> usize {
    let mixed =
        corner.iter().fold(0_u32, |hash, word| (hash.rotate_left(5) ^ word).wrapping_mul(0x9e37_79b1));
    (mixed >> 16) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::{Point2, Point3};
    use avln_scene::InstanceId;

    #[test]
    fn equal_corners_are_stored_once() {
        // Two triangles of a square with separate corners, one with a different colour.
        let position = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
        let mut mesh = Mesh {
            positions: position.map(|(x, y)| Point3::new(x, y, 2.0)).to_vec(),
            uvs: vec![Point2::origin(); 6],
            colors: vec![[9; 3]; 6],
            triangles: vec![[0, 1, 2], [3, 5, 4]],
            material_of: vec![0; 2],
            instance_of: vec![InstanceId(1); 2],
        };
        let pack = |mesh: &Mesh| {
            let mut packed = Packed::default();
            packed.add(mesh, &[0, 1], |member| (member + 7, member == 1));
            packed
        };
        let packed = pack(&mesh);
        assert_eq!(packed.clusters, [[0, 0, 0, 2 | 4 << 16]]);
        assert_eq!(packed.triangles, [[0x02_01_00, 7], [HOLED | 0x02_03_01, 8]]);
        assert_eq!(packed.coordinates.len(), 3 * LANES);
        assert_eq!(packed.coordinates[..5], [0.0, 1.0, 0.0, 1.0, 1.0]);
        mesh.colors[3] = [8; 3];
        assert_eq!(pack(&mesh).corners.len(), 5);
    }
}
