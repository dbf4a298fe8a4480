//! Scene export as binary glTF 2.0.

use crate::images::encode_png;
use crate::named_model::{object_extras, scene_extras, structure_extras};
use avln_scene::colors::light_of;
use avln_scene::{InstanceId, Material, Mesh, Scene, Texture};
use serde_json::{Value, json};
use std::collections::BTreeMap;

const ARRAY_BUFFER: u32 = 34_962;
const ELEMENT_ARRAY_BUFFER: u32 = 34_963;
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;

/// Exports a scene as binary glTF 2.0 (`.glb`), Y up, metres, for Blender, Habitat and other programs.
///
/// Each object is a node `<category>_<id>`; surfaces without an object are the node `structure`. Textures are embedded PNG
/// files, materials are unlit, colours linear. [`from_bytes`](super::from_bytes) restores objects, regions and attributes.
///
/// # Panics
/// If the scene is inconsistent: an invalid index, or a texture with too few pixels.
pub fn export(scene: &Scene) -> Vec<u8> {
    let mut writer = GlbWriter::default();
    let mut groups = groups(&scene.mesh);
    let mut meshes = Vec::new();
    let mut nodes = Vec::new();
    let mut add = |name: String, extras: Value, surfaces: Option<BTreeMap<u16, Vec<u32>>>| {
        let mut node = json!({ "name": name, "extras": extras });
        if let Some(surfaces) = surfaces {
            // A primitive per material, with separate vertices.
            let primitives: Vec<Value> = surfaces
                .iter()
                .map(|(&material, triangles)| writer.primitive(&scene.mesh, material, triangles))
                .collect();
            node["mesh"] = json!(meshes.len());
            meshes.push(json!({ "name": name, "primitives": primitives }));
        }
        nodes.push(node);
    };
    for object in &scene.objects {
        let name = format!("{}_{}", object.category, object.id.0);
        add(name, object_extras(object), groups.remove(&object.id));
    }
    // Triangles of unknown instances are structure too: the export loses no surface.
    let mut rest: BTreeMap<u16, Vec<u32>> = BTreeMap::new();
    for (material, triangles) in groups.into_values().flatten() {
        rest.entry(material).or_default().extend(triangles);
    }
    if !rest.is_empty() {
        add("structure".to_owned(), structure_extras(), Some(rest));
    }
    let mut image = |texture: &Texture| json!({ "bufferView": writer.view(&encode_png(texture), None), "mimeType": "image/png" });
    let images: Vec<Value> = scene.textures.iter().map(&mut image).collect();
    let document = document(scene, nodes, meshes, images, &writer);
    container(&document, &writer.bin)
}

fn groups(mesh: &Mesh) -> BTreeMap<InstanceId, BTreeMap<u16, Vec<u32>>> {
    let mut groups: BTreeMap<_, BTreeMap<_, Vec<_>>> = BTreeMap::new();
    for (triangle, (&instance, &material)) in mesh.instance_of.iter().zip(&mesh.material_of).enumerate() {
        groups.entry(instance).or_default().entry(material).or_default().push(triangle as u32);
    }
    groups
}

fn document(
    scene: &Scene,
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    images: Vec<Value>,
    writer: &GlbWriter,
) -> Value {
    // Linear filters with mip levels, repeating in both directions.
    let sampler = json!({ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 });
    let entry = json!({
        "name": scene.name,
        "extras": scene_extras(&scene.regions),
        "nodes": (0..nodes.len()).collect::<Vec<_>>(),
    });
    let textures: Vec<Value> =
        (0..images.len()).map(|image| json!({ "source": image, "sampler": 0 })).collect();
    without_empty_lists(json!({
        "asset": { "version": "2.0", "generator": "LH-AVLN Arena" },
        "scene": 0,
        "scenes": [without_empty_lists(entry)],
        "samplers": if images.is_empty() { vec![] } else { vec![sampler] },
        "extensionsUsed": if scene.materials.is_empty() { vec![] } else { vec!["KHR_materials_unlit"] },
        "nodes": nodes,
        "meshes": meshes,
        "materials": scene.materials.iter().map(material).collect::<Vec<_>>(),
        "textures": textures,
        "images": images,
        "accessors": writer.accessors,
        "bufferViews": writer.views,
        "buffers": if writer.bin.is_empty() { vec![] } else { vec![json!({ "byteLength": writer.bin.len() })] },
    }))
}

/// Removes empty lists, which glTF does not allow.
fn without_empty_lists(mut object: Value) -> Value {
    if let Some(fields) = object.as_object_mut() {
        fields.retain(|_, value| value.as_array().is_none_or(|list| !list.is_empty()));
    }
    object
}

fn material(material: &Material) -> Value {
    let [r, g, b, a] = material.base_color;
    let mut pbr = json!({
        "baseColorFactor": [light_of(r), light_of(g), light_of(b), f32::from(a) / 255.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 1.0,
    });
    if let Some(texture) = material.texture {
        pbr["baseColorTexture"] = json!({ "index": texture });
    }
    let mut entry = json!({
        "name": material.name,
        "pbrMetallicRoughness": pbr,
        "doubleSided": true,
        "extensions": { "KHR_materials_unlit": {} },
    });
    if let Some(cutoff) = material.alpha_cutoff {
        entry["alphaMode"] = json!("MASK");
        entry["alphaCutoff"] = json!(f32::from(cutoff) / 255.0);
    }
    entry
}

#[derive(Default)]
struct GlbWriter {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl GlbWriter {
    fn primitive(&mut self, mesh: &Mesh, material: u16, triangles: &[u32]) -> Value {
        let corners = || triangles.iter().flat_map(|&triangle| mesh.triangles[triangle as usize]);
        let mut used: Vec<u32> = corners().collect();
        used.sort_unstable();
        used.dedup();
        let indices: Vec<u32> =
            corners().map(|corner| used.partition_point(|&vertex| vertex < corner) as u32).collect();
        let vertices = || used.iter().map(|&vertex| vertex as usize);
        let mut attributes = json!({
            "POSITION": self.positions(vertices().map(|vertex| mesh.positions[vertex].into()).collect()),
            "TEXCOORD_0": self.floats(vertices().map(|vertex| mesh.uvs[vertex].into()).collect::<Vec<[f32; 2]>>(), "VEC2"),
        });
        if vertices().any(|vertex| mesh.colors[vertex] != [255; 3]) {
            attributes["COLOR_0"] = self.colors(vertices().map(|vertex| mesh.colors[vertex]).collect());
        }
        json!({ "attributes": attributes, "indices": self.indices(&indices), "material": material })
    }

    fn positions(&mut self, positions: Vec<[f32; 3]>) -> Value {
        let bound = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
            std::array::from_fn(|axis| {
                positions.iter().map(|position| position[axis]).reduce(pick).unwrap_or(0.0)
            })
        };
        let (min, max) = (bound(f32::min), bound(f32::max));
        let accessor = self.floats(positions, "VEC3");
        if let Some(entry) = self.accessors.last_mut() {
            entry["min"] = json!(min);
            entry["max"] = json!(max);
        }
        accessor
    }

    fn floats<const N: usize>(&mut self, elements: Vec<[f32; N]>, kind: &str) -> Value {
        let bytes: Vec<u8> = elements.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        let entry = json!({ "componentType": F32, "count": elements.len(), "type": kind });
        self.accessor(&bytes, ARRAY_BUFFER, entry)
    }

    // Linear light in 16 bits distinguishes all 256 sRGB codes; alpha is padding.
    fn colors(&mut self, colors: Vec<[u8; 3]>) -> Value {
        let light = |code: u8| (light_of(code) * f32::from(u16::MAX)).round() as u16;
        let rgba = colors.iter().flat_map(|&[r, g, b]| [light(r), light(g), light(b), u16::MAX]);
        let bytes: Vec<u8> = rgba.flat_map(u16::to_le_bytes).collect();
        let entry =
            json!({ "componentType": U16, "normalized": true, "count": colors.len(), "type": "VEC4" });
        self.accessor(&bytes, ARRAY_BUFFER, entry)
    }

    fn indices(&mut self, indices: &[u32]) -> Value {
        let bytes: Vec<u8> = indices.iter().flat_map(|index| index.to_le_bytes()).collect();
        let entry = json!({ "componentType": U32, "count": indices.len(), "type": "SCALAR" });
        self.accessor(&bytes, ELEMENT_ARRAY_BUFFER, entry)
    }

    fn accessor(&mut self, bytes: &[u8], target: u32, mut entry: Value) -> Value {
        entry["bufferView"] = json!(self.view(bytes, Some(target)));
        self.accessors.push(entry);
        json!(self.accessors.len() - 1)
    }

    /// Appends bytes at a multiple of four.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut entry = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            entry["target"] = json!(target);
        }
        self.bin.extend_from_slice(bytes);
        pad(&mut self.bin, 0);
        self.views.push(entry);
        self.views.len() - 1
    }
}

fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}

/// The GLB container (glTF 2.0, section 4): header, JSON chunk, binary chunk.
fn container(document: &Value, bin: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    pad(&mut json, b' ');
    let mut file = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    let mut chunk = |kind: &[u8; 4], content: &[u8]| {
        file.extend_from_slice(&(content.len() as u32).to_le_bytes());
        file.extend_from_slice(kind);
        file.extend_from_slice(content);
    };
    chunk(b"JSON", &json);
    if !bin.is_empty() {
        chunk(b"BIN\0", bin);
    }
    let length = (file.len() as u32).to_le_bytes();
    file[8..12].copy_from_slice(&length);
    file
}
