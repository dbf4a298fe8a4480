//! One order for the parts of a scene: that in which a file of the arena holds them.

use crate::{InstanceId, Material, Mesh, Scene, Texture};
use std::collections::BTreeMap;

/// Triangles by the place of their instance among the objects (behind them for none) and by material.
type Groups = BTreeMap<(usize, u16), Vec<u32>>;

/// The same scene in the order that export and import keep, so that it has one digest in every layout and as a file:
/// triangles by instance and material, each group with vertices of its own; materials and textures by first use, unused ones
/// left out, and so are triangles that use a vertex twice.
pub(crate) fn canonical(scene: Scene) -> Scene {
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

fn groups(scene: &Scene, number: impl Fn(u16) -> u16) -> Groups {
    let mesh = &scene.mesh;
    let mut groups = Groups::new();
    for (triangle, [a, b, c]) in mesh.triangles.iter().enumerate() {
        if a == b || b == c || c == a {
            continue;
        }
        let place = scene.objects.binary_search_by_key(&mesh.instance_of[triangle], |object| object.id);
        let key = (place.unwrap_or(scene.objects.len()), number(mesh.material_of[triangle]));
        groups.entry(key).or_default().push(triangle as u32);
    }
    groups
}

/// Appends triangles with the vertices that they use, in the order of `from`.
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

/// The materials with a number, by it, and the textures that they use, by first use.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digest::digest;
    use crate::{Attributes, Lighting, Object, glb};
    use avln_geom::{Aabb, Point2, Point3, Rng};

    /// Triangles at random places, of random things and materials.
    fn scattered(seed: u64) -> Scene {
        let mut rng = Rng::new(seed);
        let mut mesh = Mesh::default();
        for _ in 0..60 {
            mesh.positions.push(Point3::new(rng.range(0.0, 5.0), rng.range(0.0, 3.0), rng.range(0.0, 4.0)));
            mesh.uvs.push(Point2::new(rng.range(0.0, 1.0), rng.range(0.0, 1.0)));
            mesh.colors.push([rng.below(256) as u8; 3]);
        }
        for _ in 0..200 {
            mesh.triangles.push(std::array::from_fn(|_| rng.below(60) as u32));
            mesh.material_of.push(rng.below(7) as u16);
            mesh.instance_of.push(InstanceId(rng.below(5) as u32));
        }
        let texture = |shade: u8| Texture { width: 1, height: 1, pixels: vec![shade, 0, 0, 255] };
        let material = |number: u8| Material {
            name: format!("m{number}"),
            base_color: [number; 4],
            texture: (!number.is_multiple_of(3)).then_some(u16::from(4 - number % 4)),
            alpha_cutoff: None,
        };
        let object = |id: u32| Object {
            id: InstanceId(id),
            category: "chair".to_owned(),
            bounds: Aabb::new(Point3::origin(), Point3::origin()),
            region: None,
            attributes: Attributes::default(),
        };
        let mut scene = Scene {
            name: "scattered".to_owned(),
            materials: (0..9).map(material).collect(),
            textures: (0..6).map(texture).collect(),
            regions: Vec::new(),
            objects: [1, 3, 4].map(object).to_vec(),
            mesh,
            lighting: Lighting::Painted,
        };
        for object in &mut scene.objects {
            let mesh = &scene.mesh;
            let whole = |[a, b, c]: [u32; 3]| a != b && b != c && c != a;
            let corners: Vec<Point3<f32>> = (0..200)
                .filter(|&triangle| {
                    mesh.instance_of[triangle] == object.id && whole(mesh.triangles[triangle])
                })
                .flat_map(|triangle| mesh.triangles[triangle].map(|corner| mesh.positions[corner as usize]))
                .collect();
            object.bounds = Aabb::around(&corners).unwrap();
        }
        scene
    }

    #[test]
    fn export_and_import_keep_the_digest_of_the_canonical_order() {
        for seed in 0..40 {
            let ordered = canonical(scattered(seed));
            assert_eq!((ordered.materials.len(), ordered.textures.len() < 6), (7, true));
            let back = glb::from_bytes("scattered", "memory", &glb::export(&ordered)).unwrap();
            assert_eq!(digest(&back), digest(&ordered), "{seed}");
            assert_eq!(digest(&canonical(back)), digest(&ordered), "{seed}");
        }
    }

    #[test]
    fn every_triangle_keeps_its_place_look_and_thing() {
        let scene = scattered(99);
        let ordered = canonical(scene.clone());
        let told = |scene: &Scene| {
            let known = |id: InstanceId| if scene.object(id).is_some() { id.0 } else { 0 };
            let mut told: Vec<String> = (0..scene.mesh.triangles.len())
                .filter(|&triangle| {
                    let [a, b, c] = scene.mesh.triangles[triangle];
                    a != b && b != c && c != a
                })
                .map(|triangle| {
                    let material = &scene.materials[usize::from(scene.mesh.material_of[triangle])];
                    let picture =
                        material.texture.map(|texture| scene.textures[usize::from(texture)].pixels[0]);
                    let id = known(scene.mesh.instance_of[triangle]);
                    format!("{:?} {} {picture:?} {id}", scene.corners(triangle), material.name)
                })
                .collect();
            told.sort();
            told
        };
        assert_eq!(told(&ordered), told(&scene));
    }
}
