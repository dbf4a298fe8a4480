//! Model construction.

use super::textures::Textures;
use super::tree::{Content, Node, Tree};
use super::{CORNERS, Cluster, HOLED, Model, NO_TEXTURE, assemble};
use crate::lanes::LANES;
use avln_geom::Aabb;
use avln_scene::{Material, Mesh, Scene, Texture};
use std::collections::BTreeMap;

/// Material for surfaces without a known material; the last in a model.
const PLAIN: [u32; 4] = [u32::MAX, NO_TEXTURE, 0, 0];

impl Model {
    /// Builds the model of `mesh` with the scene's materials and the textures `pictures`. Omits degenerate
    /// triangles and triangles with invalid corners.
    pub(crate) fn build(scene: &Scene, mesh: &Mesh, pictures: &[Texture]) -> Self {
        let (boxes, members) = visible(mesh);
        let left_out = mesh.triangles.len() - members.len();
        let tree = Tree::new(&boxes, members);
        let mut surfaces = Surfaces::default();
        let surface_of = surfaces.of_triangles(mesh, scene.materials.len());
        let mut textures = Textures::new();
        let materials = materials(scene, pictures, &mut textures);
        let mut packed = Packed::default();
        for cluster in &tree.clusters {
            packed.add(mesh, cluster, |member| {
                let surface = surface_of[member as usize];
                let [material, _] = surfaces.list[surface as usize];
                (surface, materials[material as usize][2] != 0)
            });
        }
        let [r, g, b] = scene.lighting.backdrop_rgb();
        assemble(&[
            bytemuck::cast_slice(&tree.nodes.iter().map(node).collect::<Vec<_>>()),
            bytemuck::cast_slice(&packed.clusters),
            bytemuck::cast_slice(&packed.coordinates),
            bytemuck::cast_slice(&packed.corners),
            bytemuck::cast_slice(&packed.triangles),
            bytemuck::cast_slice(&surfaces.list),
            bytemuck::cast_slice(&materials),
            bytemuck::cast_slice(&textures.levels),
            &textures.texels,
            &[u32::from_le_bytes([r, g, b, 0]), left_out as u32],
        ])
    }
}

impl Default for Model {
    /// Returns the empty model.
    fn default() -> Self {
        let Textures { levels, texels } = Textures::new();
        let levels = bytemuck::cast_slice(&levels);
        assemble(&[&[], &[], &[], &[], &[], &[], &PLAIN, levels, &texels, &[0, 0]])
    }
}

/// Returns all triangle boxes, and the visible triangles.
fn visible(mesh: &Mesh) -> (Vec<Aabb>, Vec<u32>) {
    let mut members = Vec::with_capacity(mesh.triangles.len());
    let boxes = mesh.triangles.iter().enumerate().map(|(index, triangle)| {
        let corners = triangle.map(|corner| mesh.positions.get(corner as usize).copied());
        let [Some(a), Some(b), Some(c)] = corners else {
            return Aabb::new(Default::default(), Default::default());
        };
        let double_area = (b - a).cast::<f64>().cross(&(c - a).cast::<f64>());
        if double_area.iter().all(|value| value.is_finite()) && double_area.iter().any(|&value| value != 0.0)
        {
            members.push(index as u32);
        }
        Aabb { min: a.inf(&b).inf(&c), max: a.sup(&b).sup(&c) }
    });
    (boxes.collect(), members)
}

/// Distinct pairs of material and instance.
#[derive(Default)]
struct Surfaces {
    list: Vec<[u32; 2]>,
    number_of: BTreeMap<[u32; 2], u32>,
}

impl Surfaces {
    /// Returns the surface by triangle; unknown materials map to the plain material.
    fn of_triangles(&mut self, mesh: &Mesh, materials: usize) -> Vec<u32> {
        let pairs = mesh.material_of.iter().zip(&mesh.instance_of);
        let mut last = None;
        pairs
            .map(|(&material, &instance)| {
                let pair = [usize::from(material).min(materials) as u32, instance.0];
                match last {
                    Some((known, number)) if known == pair => number,
                    _ => {
                        let number = self.number(pair);
                        last = Some((pair, number));
                        number
                    }
                }
            })
            .collect()
    }

    fn number(&mut self, pair: [u32; 2]) -> u32 {
        *self.number_of.entry(pair).or_insert_with(|| {
            self.list.push(pair);
            self.list.len() as u32 - 1
        })
    }
}

/// Returns the materials, the plain material last.
fn materials(scene: &Scene, pictures: &[Texture], textures: &mut Textures) -> Vec<[u32; 4]> {
    let levels: Vec<u32> = pictures.iter().map(|texture| textures.add(texture)).collect();
    let material = |material: &Material| {
        let texture = material.texture.and_then(|index| levels.get(usize::from(index)));
        let texture = texture.copied().unwrap_or(NO_TEXTURE);
        [u32::from_le_bytes(material.base_color), texture, u32::from(material.alpha_cutoff.unwrap_or(0)), 0]
    };
    scene.materials.iter().map(material).chain([PLAIN]).collect()
}

fn node(Node { bounds, content }: &Node) -> [u32; 8] {
    let [min, max] =
        [bounds.min, bounds.max].map(|corner| [0, 1, 2].map(|axis: usize| corner[axis].to_bits()));
    let (number, kind) = match *content {
        Content::Pair(left) => (left, 0),
        Content::Cluster(cluster) => (cluster, 1),
    };
    [min[0], min[1], min[2], max[0], max[1], max[2], number, kind]
}

// More than twice the corner count of a cluster, so that probing is short.
const SLOTS: usize = 512;

/// Packed cluster lists; see [`super::ModelView`].
#[derive(Default)]
struct Packed {
    clusters: Vec<Cluster>,
    coordinates: Vec<f32>,
    corners: Vec<[u32; 3]>,
    triangles: Vec<[u32; 2]>,
}

/// A corner as bits: position, texture coordinates, colour.
type Corner = [u32; 6];

/// A cluster's distinct corners.
struct Distinct {
    corners: Vec<Corner>,
    /// Index into `corners` plus one, or 0.
    slots: [u8; SLOTS],
}

impl Packed {
    /// Adds a cluster; `surface_of` returns a triangle's surface and a flag for holes.
    fn add(&mut self, mesh: &Mesh, members: &[u32], surface_of: impl Fn(u32) -> (u32, bool)) {
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
    /// Returns the index of `corner`, added if new.
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
