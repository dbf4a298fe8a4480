//! Scene export in HM3D's layout with semantics, for Habitat and other tools.

use crate::glb;
use crate::hm3d::table::HEADER;
use avln_geom::{Point2, Point3};
use avln_scene::describe::{Meaning, meaning};
use avln_scene::{InstanceId, Lighting, Material, Mesh, Object, Scene, Texture};
use std::collections::BTreeMap;

/// Colour factor: odd, so that multiplication permutes the 24-bit numbers and separates neighbours.
const SCATTER: u32 = 0x9E_37B1;
/// Palette colours in a row.
const PALETTE_WIDTH: usize = 64;

/// Contents for `X.glb`, `X.semantic.glb` and `X.semantic.txt`.
pub struct Exported {
    /// The visible scene, Z up.
    pub render: Vec<u8>,
    /// The triangles in `render`, in the same order, in their instances' colours, Z up.
    pub semantic: Vec<u8>,
    /// Number, colour, category and room for every instance.
    pub table: String,
}

/// Exports a scene in HM3D's layout: Z up, every instance in a unique colour, structure in black.
///
/// [`import`](super::import) restores instance and room numbers. The layout has no words except category or noun, no
/// room labels, and no rooms without instances.
///
/// # Panics
/// If the scene is inconsistent, like [`glb::export`].
pub fn export(scene: &Scene) -> Exported {
    let mut mesh = scene.mesh.clone();
    turn_z_up(&mut mesh);
    sort_by_material(&mut mesh);
    let semantic = glb::export(&painted(scene, &mesh));
    mesh.instance_of.fill(InstanceId::NONE);
    let render = Scene {
        name: scene.name.clone(),
        mesh,
        materials: scene.materials.clone(),
        textures: scene.textures.clone(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    };
    Exported { render: glb::export(&render), semantic, table: table(&scene.objects) }
}

/// Returns the data set configuration for an exported scene in habitat-sim; `file` is the render mesh's name in the same
/// folder. Keys are as in HM3D's configurations.
pub fn dataset_config(file: &str) -> String {
    let config = serde_json::json!({
        "stages": {
            "default_attributes": {
                "shader_type": "flat",
                "up": [0, 0, 1],
                "front": [0, 1, 0],
                "origin": [0, 0, 0],
                "semantic_up": [0, 0, 1],
                "semantic_front": [0, 1, 0],
                "semantic_asset": "%%CONFIG_NAME_AS_ASSET_FILENAME%%.semantic.glb",
                "semantic_descriptor_filename": "%%CONFIG_NAME_AS_ASSET_FILENAME%%.semantic.txt",
                "has_semantic_textures": true,
            },
            "paths": { ".glb": [file] },
        },
        "scene_instances": { "default_attributes": { "default_lighting": "no_lights" } },
    });
    format!("{config:#}\n")
}

/// Converts the world frame to HM3D's frame, with gravity in direction -Z: (x, y, z) becomes (x, -z, y).
fn turn_z_up(mesh: &mut Mesh) {
    for position in &mut mesh.positions {
        *position = Point3::new(position.x, -position.z, position.y);
    }
}

/// Sorts triangles into import order: a primitive per material.
fn sort_by_material(mesh: &mut Mesh) {
    let mut order: Vec<usize> = (0..mesh.triangles.len()).collect();
    order.sort_by_key(|&triangle| mesh.material_of[triangle]);
    mesh.triangles = order.iter().map(|&triangle| mesh.triangles[triangle]).collect();
    mesh.instance_of = order.iter().map(|&triangle| mesh.instance_of[triangle]).collect();
    mesh.material_of = order.iter().map(|&triangle| mesh.material_of[triangle]).collect();
}

/// The unique colour for an instance number; black for none.
fn color(id: InstanceId) -> [u8; 3] {
    let [_, r, g, b] = (id.0.wrapping_mul(SCATTER) & InstanceId::MAX).to_be_bytes();
    [r, g, b]
}

/// The mesh with a single material; the texture has a texel per instance, the first for none.
fn painted(scene: &Scene, mesh: &Mesh) -> Scene {
    let ids: Vec<InstanceId> =
        std::iter::once(InstanceId::NONE).chain(scene.objects.iter().map(|object| object.id)).collect();
    let height = ids.len().div_ceil(PALETTE_WIDTH);
    let mut colors: Vec<[u8; 3]> = ids.iter().map(|&id| color(id)).collect();
    colors.resize(PALETTE_WIDTH * height, [0; 3]);
    let pixels = colors.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect();
    let middle_of = |index: usize| {
        let (column, row) = (index % PALETTE_WIDTH, index / PALETTE_WIDTH);
        Point2::new((column as f32 + 0.5) / PALETTE_WIDTH as f32, (row as f32 + 0.5) / height as f32)
    };
    let place_of: BTreeMap<InstanceId, Point2<f32>> =
        ids.iter().enumerate().map(|(index, &id)| (id, middle_of(index))).collect();
    Scene {
        name: scene.name.clone(),
        mesh: repainted(mesh, &place_of),
        materials: vec![Material {
            name: "semantic".to_owned(),
            base_color: [255; 4],
            texture: Some(0),
            alpha_cutoff: None,
        }],
        textures: vec![Texture { width: PALETTE_WIDTH as u32, height: height as u32, pixels }],
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    }
}

/// The mesh with texture coordinates per instance; shared corners are duplicated.
fn repainted(mesh: &Mesh, place_of: &BTreeMap<InstanceId, Point2<f32>>) -> Mesh {
    let mut painted = Mesh::default();
    let mut number_of: BTreeMap<(u32, InstanceId), u32> = BTreeMap::new();
    for (triangle, &id) in mesh.triangles.iter().zip(&mesh.instance_of) {
        let corners = triangle.map(|corner| {
            // A vertex has a single texture coordinate, but neighbouring instances need different colours.
            *number_of.entry((corner, id)).or_insert_with(|| {
                painted.positions.push(mesh.positions[corner as usize]);
                painted.uvs.push(place_of.get(&id).copied().unwrap_or_else(|| place_of[&InstanceId::NONE]));
                painted.colors.push([255; 3]);
                painted.positions.len() as u32 - 1
            })
        });
        painted.triangles.push(corners);
    }
    painted.material_of = vec![0; painted.triangles.len()];
    painted.instance_of = vec![InstanceId::NONE; painted.triangles.len()];
    painted
}

fn table(objects: &[Object]) -> String {
    let mut text = format!("{}\n", HEADER);
    for object in objects {
        let [r, g, b] = color(object.id);
        let region = object.region.map_or(-1, i32::from);
        text += &format!("{},{r:02X}{g:02X}{b:02X},\"{}\",{region}\n", object.id.0, words(object));
    }
    text
}

/// The noun if an importer finds the category from it, or the category.
fn words(object: &Object) -> String {
    let noun = &object.attributes.noun;
    let read = Meaning::Object { category: object.category.clone(), noun: noun.clone() };
    let words = if !noun.is_empty() && meaning(noun) == read { noun } else { &object.category };
    words.replace('_', " ").replace('"', "'")
}
