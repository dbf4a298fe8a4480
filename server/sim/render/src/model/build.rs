//! Makes a model from a scene.

use super::cluster::Packed;
use super::stored::assemble;
use super::textures::Textures;
use super::tree::{Content, Node, Tree};
use super::{Model, NO_TEXTURE};
use avln_geom::Aabb;
use avln_scene::{Material, Mesh, Scene, Texture};
use std::collections::BTreeMap;

/// The last material, for surfaces without a known material.
const PLAIN: [u32; 4] = [u32::MAX, NO_TEXTURE, 0, 0];

impl Model {
    /// Builds the model of `mesh` with the materials of `scene` and the textures `pictures`. Omits invisible
    /// triangles: degenerate, or with invalid corners.
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
    /// The empty model.
    fn default() -> Self {
        let Textures { levels, texels } = Textures::new();
        let levels = bytemuck::cast_slice(&levels);
        assemble(&[&[], &[], &[], &[], &[], &[], &PLAIN, levels, &texels, &[0, 0]])
    }
}

/// The boxes of all triangles, and the numbers of those that can be seen.
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

/// The different pairs of material and instance.
#[derive(Default)]
struct Surfaces {
    list: Vec<[u32; 2]>,
    number_of: BTreeMap<[u32; 2], u32>,
}

impl Surfaces {
    /// Surface of every triangle; unknown materials map to the plain material.
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

/// Materials of a model, the plain material last.
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
