//! The table `X.semantic.txt`, and scene export in HM3D's layout with semantics, for Habitat and other tools.

use crate::files::{Checked, plain_words, refuse_if};
use crate::glb;
use avln_geom::{Point2, Point3};
use avln_scene::describe::{Meaning, meaning};
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{InstanceId, Lighting, Material, Mesh, Object, Scene, Texture};
use hex::FromHex;
use std::collections::{BTreeMap, BTreeSet};

/// First line.
const HEADER: &str = "HM3D Semantic Annotations";

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct InstanceAnnotation {
    /// Instance number, at least 1.
    pub(super) id: u32,
    pub(super) color: [u8; 3],
    pub(super) category: String,
    /// Room number in the file; negative for none.
    pub(super) region: i32,
}

/// Parses the table: a header line, then lines `id,HEXRGB,"category",region`. Number 0 is unknown and left out.
pub(super) fn parse(text: &str) -> Checked<Vec<InstanceAnnotation>> {
    let mut lines = text.lines().enumerate();
    let header = lines.next().map(|(_, line)| line).unwrap_or_default();
    refuse_if(!header.contains(HEADER), || {
        format!("its first line is not {HEADER:?}; use the .semantic.txt of HM3D")
    })?;
    let mut annotations = Vec::new();
    let mut seen = BTreeSet::new();
    for (index, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let annotation = annotation(line.trim()).ok_or_else(|| {
            let start: String = line.chars().take(MAX_WORD_CHARS).collect();
            format!(
                "line {} is {start:?}, not: number up to 16777215, hex colour, quoted category, region",
                index + 1
            )
        })?;
        refuse_if(!seen.insert(annotation.id), || {
            format!("line {} repeats number {}; renumber the instances", index + 1, annotation.id)
        })?;
        annotations.push(annotation);
    }
    annotations.retain(|annotation| annotation.id != 0);
    Ok(annotations)
}

fn annotation(line: &str) -> Option<InstanceAnnotation> {
    let (id, rest) = line.split_once(',')?;
    let (color, rest) = rest.split_once(',')?;
    let hex = color.trim();
    let (category, region) = rest.rsplit_once(',')?;
    Some(InstanceAnnotation {
        id: id.trim().parse().ok().filter(|&id| id <= InstanceId::MAX)?,
        color: FromHex::from_hex(hex.strip_prefix('#').unwrap_or(hex)).ok()?,
        category: plain_words(category.trim().trim_matches('"').trim()),
        region: region.trim().parse().ok()?,
    })
}

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

/// Exports a scene in HM3D's layout: Z up, every instance in a unique colour, structure in black. The importer `import`
/// restores instance and room numbers, categories and nouns, but no other words, room labels, or rooms without instances.
///
/// # Panics
/// If the scene is inconsistent, like [`glb::export`].
pub fn export(scene: &Scene) -> Exported {
    let mut mesh = scene.mesh.clone();
    // HM3D has gravity in direction -Z: (x, y, z) becomes (x, -z, y).
    for position in &mut mesh.positions {
        *position = Point3::new(position.x, -position.z, position.y);
    }
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

/// Returns habitat-sim's data set configuration for an exported scene, with HM3D's keys; `file` is the render mesh's name.
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

/// Sorts triangles into import order: a primitive per material.
fn sort_by_material(mesh: &mut Mesh) {
    let mut order: Vec<usize> = (0..mesh.triangles.len()).collect();
    order.sort_by_key(|&triangle| mesh.material_of[triangle]);
    mesh.triangles = order.iter().map(|&triangle| mesh.triangles[triangle]).collect();
    mesh.instance_of = order.iter().map(|&triangle| mesh.instance_of[triangle]).collect();
    mesh.material_of = order.iter().map(|&triangle| mesh.material_of[triangle]).collect();
}

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
    let mut text = format!("{HEADER}\n");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn categories_may_contain_commas() {
        let text =
            "HM3D Semantic Annotations\r\n0,000000,\"Unknown\",-1\r\n7,1A2B3C,\"table, small\",4\r\n\r\n";
        let expected = InstanceAnnotation {
            id: 7,
            color: [0x1a, 0x2b, 0x3c],
            category: "table, small".to_owned(),
            region: 4,
        };
        assert_eq!(parse(text).unwrap(), [expected]);
    }

    #[test]
    fn invalid_lines_are_named() {
        for bad in ["7,12,\"x\",0", "16777216,123456,\"x\",0", "7,123456,\"x\"", "7,123456,\"x\",one", "x"] {
            let error = parse(&format!("{HEADER}\n1,AABBCC,\"bed\",0\n{bad}\n")).unwrap_err();
            assert!(error.starts_with("line 3"), "{error}");
        }
        assert!(parse("1,AABBCC,\"bed\",0").unwrap_err().contains("first line"));
        let twice = format!("{HEADER}\n1,AABBCC,\"bed\",0\n1,AABBCD,\"sofa\",0");
        assert!(parse(&twice).unwrap_err().contains("repeats number"));
    }
}
