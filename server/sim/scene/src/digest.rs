//! Scene content hash.

use crate::scene::{Attributes, InstanceId, Lamp, Lighting, Scene};
use avln_geom::Aabb;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Mesh, Object, Region, Texture};
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
