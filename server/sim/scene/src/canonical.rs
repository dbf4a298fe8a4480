//! Canonical scene order: the order in an exported file.

use crate::scene::{InstanceId, Material, Mesh, Scene, Texture};
use std::collections::BTreeMap;

/// Triangles by object index (the object count for none) and material.
type TriangleGroups = BTreeMap<(usize, u16), Vec<u32>>;

/// Brings a scene into canonical order: triangles by instance and material, with separate vertices per group; materials and
/// textures by first use. Unused ones are dropped, and triangles with a repeated vertex.
///
/// Export and import keep this order, so that a scene has the same digest in every layout and as a file.
pub fn canonical(scene: Scene) -> Scene {
    // Materials are numbered by first use, in old number order within an object.
    let mut number_of: BTreeMap<u16, u16> = BTreeMap::new();
    for &(_, material) in groups(&scene, |material| material).keys() {
        let next = number_of.len() as u16;
        number_of.entry(material).or_insert(next);
    }
    let mut mesh = Mesh::default();
    for ((place, material), triangles) in groups(&scene, |material| number_of[&material]) {
        append(&scene.mesh, &triangles, &mut mesh);
        let instance = scene.objects.get(place).map_or(InstanceId::NONE, |object| object.id);
        mesh.material_of.resize(mesh.triangles.len(), material);
        mesh.instance_of.resize(mesh.triangles.len(), instance);
    }
    let (materials, textures) = looks(&number_of, scene.materials, scene.textures);
    Scene { mesh, materials, textures, ..scene }
}

fn groups(scene: &Scene, number: impl Fn(u16) -> u16) -> TriangleGroups {
    let mesh = &scene.mesh;
    let mut groups = TriangleGroups::new();
    for (triangle, [a, b, c]) in mesh.triangles.iter().enumerate() {
        // Importers drop such triangles too; they have no surface.
        if a == b || b == c || c == a {
            continue;
        }
        let place = scene.objects.binary_search_by_key(&mesh.instance_of[triangle], |object| object.id);
        let key = (place.unwrap_or(scene.objects.len()), number(mesh.material_of[triangle]));
        groups.entry(key).or_default().push(triangle as u32);
    }
    groups
}

/// Appends triangles and their vertices, in `from` order.
fn append(from: &Mesh, triangles: &[u32], to: &mut Mesh) {
    let corners = || triangles.iter().map(|&triangle| from.triangles[triangle as usize]);
    let mut used: Vec<u32> = corners().flatten().collect();
    used.sort_unstable();
    used.dedup();
    let first = to.positions.len();
    let moved = |corner: u32| (first + used.partition_point(|&vertex| vertex < corner)) as u32;
    to.triangles.extend(corners().map(|triangle| triangle.map(moved)));
    for vertex in used.iter().map(|&vertex| vertex as usize) {
        to.positions.push(from.positions[vertex]);
        to.uvs.push(from.uvs[vertex]);
        to.colors.push(from.colors[vertex]);
    }
}

/// Returns the numbered materials in number order, and their textures by first use.
fn looks(
    number_of: &BTreeMap<u16, u16>,
    materials: Vec<Material>,
    textures: Vec<Texture>,
) -> (Vec<Material>, Vec<Texture>) {
    let numbered = (0..).zip(materials).filter_map(|(old, material)| Some((*number_of.get(&old)?, material)));
    let ordered: BTreeMap<u16, Material> = numbered.collect();
    let mut sources: Vec<Option<Texture>> = textures.into_iter().map(Some).collect();
    let mut kept = Vec::new();
    let mut place_of: BTreeMap<u16, u16> = BTreeMap::new();
    let mut place = |old: u16| {
        *place_of.entry(old).or_insert_with(|| {
            kept.extend(sources[usize::from(old)].take());
            (kept.len() - 1) as u16
        })
    };
    let relinked = |material: Material| Material { texture: material.texture.map(&mut place), ..material };
    let materials = ordered.into_values().map(relinked).collect();
    (materials, kept)
}
