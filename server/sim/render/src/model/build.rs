//! Model construction, and textures with mipmaps, in blocks, so that neighbouring texels share a cache line.

use super::tree::{Content, Node, Tree};
use super::{CORNERS, Cluster, HOLED, Level, Model, assemble};
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
            bytemuck::cast_slice(&tree.nodes.iter().map(node_words).collect::<Vec<_>>()),
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

pub(super) fn node_words(Node { bounds, content }: &Node) -> [u32; 8] {
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
pub(super) struct Packed {
    pub(super) clusters: Vec<Cluster>,
    pub(super) coordinates: Vec<f32>,
    pub(super) corners: Vec<[u32; 3]>,
    pub(super) triangles: Vec<[u32; 2]>,
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

    /// Returns the size, bytes.
    pub(super) fn byte_count(&self) -> usize {
        size_of_val(self.clusters.as_slice())
            + size_of_val(self.coordinates.as_slice())
            + size_of_val(self.corners.as_slice())
            + size_of_val(self.triangles.as_slice())
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

// 16 texels of 4 bytes fill a cache line.
pub(crate) const BLOCK: usize = 4;

/// Bits for a texture's level count; the others are the first level.
pub(crate) const LEVEL_BITS: u32 = 5;

/// White texture (level 0) for untextured surfaces.
pub(crate) const NO_TEXTURE: u32 = 1;

// More texels per side would not fit the sampling arithmetic.
const LARGEST: usize = 16_384;

/// A model's textures.
struct Textures {
    levels: Vec<Level>,
    texels: Vec<u32>,
}

/// A version of a texture, row-major from the top-left.
struct Mipmap {
    width: usize,
    height: usize,
    texels: Vec<[u8; 4]>,
}

impl Textures {
    fn new() -> Self {
        Self { levels: vec![[0, 1 | 1 << 16]], texels: vec![u32::MAX; BLOCK * BLOCK] }
    }

    /// Adds a texture with mipmaps. Returns the first level with the level count in the low [`LEVEL_BITS`]
    /// bits; [`NO_TEXTURE`] for an empty image, more than 16,384 texels per side, a wrong byte count, or 2^32
    /// texels in total.
    fn add(&mut self, texture: &Texture) -> u32 {
        let first = self.levels.len() as u32;
        let mut level = Mipmap::full(texture);
        while let Some(current) = level {
            let Ok(start) = u32::try_from(self.texels.len()) else { break };
            self.levels.push([start, current.width as u32 | (current.height as u32) << 16]);
            current.store(&mut self.texels);
            level = current.halved();
        }
        match self.levels.len() as u32 - first {
            0 => NO_TEXTURE,
            count => first << LEVEL_BITS | count,
        }
    }
}

impl Mipmap {
    fn full(texture: &Texture) -> Option<Self> {
        let (width, height) = (texture.width as usize, texture.height as usize);
        let (texels, rest) = texture.pixels.as_chunks::<4>();
        let fits = !texels.is_empty()
            && rest.is_empty()
            && width.max(height) <= LARGEST
            && width.checked_mul(height) == Some(texels.len());
        fits.then(|| Self { width, height, texels: texels.to_vec() })
    }

    /// Appends the texels block by block; blocks across the border repeat border texels.
    fn store(&self, texels: &mut Vec<u32>) {
        for (top, left) in (0..self.height)
            .step_by(BLOCK)
            .flat_map(|top| (0..self.width).step_by(BLOCK).map(move |left| (top, left)))
        {
            for at in 0..BLOCK * BLOCK {
                let x = (left + at % BLOCK).min(self.width - 1);
                let y = (top + at / BLOCK).min(self.height - 1);
                texels.push(u32::from_le_bytes(self.texels[y * self.width + x]));
            }
        }
    }

    /// Returns half the size, by means of four texels; `None` for a single texel.
    fn halved(&self) -> Option<Self> {
        if self.texels.len() == 1 {
            return None;
        }
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            let upper = &self.texels[2 * y * self.width..][..self.width];
            let lower = &self.texels[(2 * y + 1).min(self.height - 1) * self.width..][..self.width];
            texels.extend((0..width).map(|x| {
                let (left, right) = (2 * x, (2 * x + 1).min(self.width - 1));
                mean_of([upper[left], upper[right], lower[left], lower[right]])
            }));
        }
        Some(Self { width, height, texels })
    }
}

/// Returns the mean colour, weighted by alpha, and the mean alpha.
fn mean_of(texels: [[u8; 4]; 4]) -> [u8; 4] {
    let sum = |channel: usize| texels.iter().map(|texel| u32::from(texel[channel])).sum::<u32>();
    let alpha = sum(3);
    if alpha == 4 * 255 {
        return [0, 1, 2, 3].map(|channel| ((sum(channel) + 2) / 4) as u8);
    }
    let weight = |texel: &[u8; 4]| if alpha == 0 { 1 } else { u32::from(texel[3]) };
    let total = if alpha == 0 { 4 } else { alpha };
    let mut mean = [0, 1, 2, 3].map(|channel| {
        let sum: u32 = texels.iter().map(|texel| u32::from(texel[channel]) * weight(texel)).sum();
        ((sum + total / 2) / total) as u8
    });
    mean[3] = ((alpha + 2) / 4) as u8;
    mean
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

    #[test]
    fn clear_texels_do_not_darken_smaller_versions() {
        let mixed = mean_of([[0, 0, 0, 0], [200, 100, 50, 255], [0, 0, 0, 0], [200, 100, 50, 255]]);
        assert_eq!(mixed, [200, 100, 50, 128]);
        assert_eq!(mean_of([[1, 2, 3, 255], [1, 2, 3, 255], [5, 6, 7, 255], [5, 6, 7, 255]]), [3, 4, 5, 255]);
    }

    #[test]
    fn mipmaps_end_with_one_texel_in_padded_blocks() {
        let pixels = (0..5 * 3).flat_map(|i| [i, 0, 0, 255]).collect();
        let mut textures = Textures::new();
        assert_eq!(textures.add(&Texture { width: 5, height: 3, pixels }), 1 << LEVEL_BITS | 3);
        assert_eq!(textures.levels[1..], [[16, 5 | 3 << 16], [48, 2 | 1 << 16], [64, 1 | 1 << 16]]);
        assert_eq!(textures.texels.len(), 80);
        let red = |at: usize| textures.texels[16 + at] as u8;
        assert_eq!([red(0), red(3), red(4), red(16), red(17), red(12)], [0, 3, 5, 4, 4, 10]);
    }

    #[test]
    fn invalid_images_have_no_levels() {
        let mut textures = Textures::new();
        for (width, height, bytes) in [(2, 2, 3), (2, 2, 12), (0, 0, 0), (0, 5, 0), (20_000, 1, 80_000)] {
            let texture = Texture { width, height, pixels: vec![0; bytes] };
            assert_eq!(textures.add(&texture), NO_TEXTURE, "{width} x {height}");
        }
    }
}
