//! Scene content hash, and the canonical order that makes it independent of the layout: the order in an
//! exported file.

use crate::{Attributes, InstanceId, Lamp, Lighting, Material, Mesh, Scene, Texture};
use avln_geom::Aabb;
use std::collections::BTreeMap;

/// Returns the BLAKE3 hash, in 64 hexadecimal digits, over all data with an influence on episodes: mesh, materials, textures,
/// regions, objects and lamps, in order, without the scene's name. Equal scenes have equal digests on every platform.
pub fn digest(scene: &Scene) -> String {
    let mut writer = SceneHasher(blake3::Hasher::new());
    writer.text("avln-scene 1");
    writer.mesh(scene);
    writer.looks(scene);
    writer.rooms(scene);
    writer.objects(scene);
    writer.lighting(scene);
    writer.0.finalize().to_hex().to_string()
}

/// Feeds values to the hash: little-endian, lists and texts after their length.
struct SceneHasher(blake3::Hasher);

impl SceneHasher {
    fn mesh(&mut self, scene: &Scene) {
        let mesh = &scene.mesh;
        self.list(&mesh.positions, |out, point| point.iter().for_each(|&value| out.float(value)));
        self.list(&mesh.uvs, |out, point| point.iter().for_each(|&value| out.float(value)));
        self.list(&mesh.colors, |out, color| out.bytes(color));
        self.list(&mesh.triangles, |out, corners| {
            corners.iter().for_each(|corner| out.bytes(&corner.to_le_bytes()));
        });
        self.list(&mesh.material_of, |out, index| out.bytes(&index.to_le_bytes()));
        self.list(&mesh.instance_of, |out, &InstanceId(id)| out.bytes(&id.to_le_bytes()));
    }

    fn looks(&mut self, scene: &Scene) {
        self.list(&scene.materials, |out, material| {
            out.text(&material.name);
            out.bytes(&material.base_color);
            out.optional(material.texture.as_ref(), |out, index| out.bytes(&index.to_le_bytes()));
            out.optional(material.alpha_cutoff.as_ref(), |out, &alpha| out.bytes(&[alpha]));
        });
        self.list(&scene.textures, |out, texture| {
            out.bytes(&texture.width.to_le_bytes());
            out.bytes(&texture.height.to_le_bytes());
            out.length(texture.pixels.len());
            out.bytes(&texture.pixels);
        });
    }

    fn rooms(&mut self, scene: &Scene) {
        self.list(&scene.regions, |out, region| {
            out.text(&region.label);
            out.bounds(&region.bounds);
            out.bytes(&region.storey.to_le_bytes());
        });
    }

    fn objects(&mut self, scene: &Scene) {
        self.list(&scene.objects, |out, object| {
            out.bytes(&object.id.0.to_le_bytes());
            out.text(&object.category);
            out.bounds(&object.bounds);
            out.optional(object.region.as_ref(), |out, index| out.bytes(&index.to_le_bytes()));
            let Attributes { noun, color, material, size, shape } = &object.attributes;
            [noun, color, material, size, shape].iter().for_each(|word| out.text(word));
        });
    }

    // Baked light adds no bytes: scan digests are older than lamps, and must stay.
    fn lighting(&mut self, scene: &Scene) {
        if let Lighting::Lamps(lamps) = &scene.lighting {
            self.list(lamps, |out, Lamp { position, facing, radius_m, strength }| {
                position.iter().for_each(|&value| out.float(value));
                out.optional(facing.as_ref(), |out, facing| {
                    facing.iter().for_each(|&value| out.float(value))
                });
                out.float(*radius_m);
                strength.iter().for_each(|&value| out.float(value));
            });
        }
    }

    fn bounds(&mut self, bounds: &Aabb) {
        bounds.min.iter().chain(bounds.max.iter()).for_each(|&value| self.float(value));
    }

    fn list<T>(&mut self, items: &[T], mut write: impl FnMut(&mut Self, &T)) {
        self.length(items.len());
        items.iter().for_each(|item| write(self, item));
    }

    fn optional<T>(&mut self, value: Option<&T>, write: impl FnOnce(&mut Self, &T)) {
        self.bytes(&[u8::from(value.is_some())]);
        if let Some(value) = value {
            write(self, value);
        }
    }

    fn text(&mut self, text: &str) {
        // The length separates neighbouring texts: `ab`, `c` must differ from `a`, `bc`.
        self.length(text.len());
        self.bytes(text.as_bytes());
    }

    fn float(&mut self, value: f32) {
        self.bytes(&value.to_le_bytes());
    }

    fn length(&mut self, length: usize) {
        self.bytes(&(length as u64).to_le_bytes());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Object, Region};
    use avln_geom::{Point2, Point3};

    fn scene() -> Scene {
        let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)];
        let bounds = Aabb::new(Point3::origin(), Point3::new(1.0, 0.0, 1.0));
        Scene {
            name: "one".into(),
            mesh: Mesh {
                positions: corners.map(|(x, z)| Point3::new(x, 0.0, z)).to_vec(),
                uvs: corners.map(|(u, v)| Point2::new(u, v)).to_vec(),
                colors: vec![[255; 3]; 3],
                triangles: vec![[0, 2, 1]],
                material_of: vec![0],
                instance_of: vec![InstanceId(1)],
            },
            materials: vec![Material {
                name: "wood".into(),
                base_color: [9, 8, 7, 255],
                texture: Some(0),
                alpha_cutoff: None,
            }],
            textures: vec![Texture { width: 1, height: 1, pixels: vec![1, 2, 3, 4] }],
            regions: vec![Region { label: "office".into(), bounds, storey: 0 }],
            objects: vec![Object {
                id: InstanceId(1),
                category: "table".into(),
                bounds,
                region: Some(0),
                attributes: Attributes::default(),
            }],
            lighting: Lighting::Painted,
        }
    }

    #[test]
    fn all_data_but_the_name_changes_the_digest() {
        let original = digest(&scene());
        assert_eq!(original.len(), 64);
        assert_eq!(digest(&Scene { name: "two".into(), ..scene() }), original);
        let changes: [fn(&mut Scene); 13] = [
            |s| s.mesh.positions[0].x = -0.0,
            |s| s.mesh.uvs[2].y = 0.5,
            |s| s.mesh.colors[1] = [255, 254, 255],
            |s| s.mesh.triangles[0] = [0, 1, 2],
            |s| s.mesh.instance_of[0] = InstanceId(2),
            |s| s.materials[0].base_color[3] = 1,
            |s| s.materials[0].texture = None,
            |s| s.materials[0].alpha_cutoff = Some(0),
            |s| s.textures[0].pixels[3] = 5,
            |s| s.regions[0].storey = 1,
            |s| s.objects[0].attributes.size = "long".into(),
            |s| s.objects[0].region = None,
            |s| s.lighting = Lighting::Lamps(vec![]),
        ];
        for (index, change) in changes.iter().enumerate() {
            let mut changed = scene();
            change(&mut changed);
            assert_ne!(digest(&changed), original, "change {index}");
        }
    }
}
