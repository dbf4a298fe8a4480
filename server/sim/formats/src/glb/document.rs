//! The JSON document: the glTF 2.0 schema's surface part, and the node tree. Names follow the
//! specification's JSON keys.

use crate::files::{Checked, bounded, refuse_if};
use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3};
use serde_json::Value;
use std::collections::BTreeMap;

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) extensions_required: Vec<String>,
    pub(super) scene: Option<usize>,
    #[serde(deserialize_with = "bounded")]
    pub(super) scenes: Vec<SceneEntry>,
    #[serde(deserialize_with = "bounded")]
    pub(super) nodes: Vec<Node>,
    #[serde(deserialize_with = "bounded")]
    pub(super) meshes: Vec<MeshEntry>,
    #[serde(deserialize_with = "bounded")]
    pub(super) materials: Vec<MaterialEntry>,
    #[serde(deserialize_with = "bounded")]
    pub(super) textures: Vec<TextureEntry>,
    #[serde(deserialize_with = "bounded")]
    pub(super) images: Vec<Image>,
    #[serde(deserialize_with = "bounded")]
    pub(super) accessors: Vec<Accessor>,
    #[serde(deserialize_with = "bounded")]
    pub(super) buffer_views: Vec<BufferView>,
    #[serde(deserialize_with = "bounded")]
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(super) struct SceneEntry {
    #[serde(deserialize_with = "bounded")]
    pub(super) nodes: Vec<usize>,
    pub(super) extras: Value,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) name: String,
    #[serde(deserialize_with = "bounded")]
    pub(super) children: Vec<usize>,
    pub(super) mesh: Option<usize>,
    /// Column-major 4 × 4.
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    /// Quaternion x, y, z, w.
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
    pub(super) extras: Value,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(super) struct MeshEntry {
    #[serde(deserialize_with = "bounded")]
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    pub(super) material: Option<usize>,
    pub(super) mode: Option<u32>,
    pub(super) extensions: BTreeMap<String, Value>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct MaterialEntry {
    pub(super) name: String,
    pbr_metallic_roughness: Pbr,
    pub(super) alpha_mode: String,
    pub(super) alpha_cutoff: Option<f32>,
    extensions: MaterialExtensions,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
struct MaterialExtensions {
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    specular_glossiness: Option<SpecularGlossiness>,
}

/// Colours in the older extension.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct SpecularGlossiness {
    diffuse_factor: Option<[f32; 4]>,
    diffuse_texture: Option<TextureUse>,
}

impl MaterialEntry {
    /// Returns the base colour, linear RGBA.
    pub(super) fn color(&self) -> [f32; 4] {
        let older = || self.extensions.specular_glossiness.as_ref()?.diffuse_factor;
        self.pbr_metallic_roughness.base_color_factor.or_else(older).unwrap_or([1.0; 4])
    }

    pub(super) fn texture(&self) -> Option<TextureUse> {
        let older = || self.extensions.specular_glossiness.as_ref()?.diffuse_texture;
        self.pbr_metallic_roughness.base_color_texture.or_else(older)
    }
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Pbr {
    base_color_factor: Option<[f32; 4]>,
    base_color_texture: Option<TextureUse>,
}

#[derive(Clone, Copy, Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TextureUse {
    pub(super) index: usize,
    tex_coord: u32,
    extensions: TextureExtensions,
}

#[derive(Clone, Copy, Debug, Default, serde::Deserialize)]
#[serde(default)]
struct TextureExtensions {
    #[serde(rename = "KHR_texture_transform")]
    transform: Option<TextureTransform>,
}

/// `KHR_texture_transform`: scale, then rotation, then texture coordinate offset.
#[derive(Clone, Copy, Debug, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TextureTransform {
    pub(super) offset: [f32; 2],
    /// Counter-clockwise in the image, with v downwards.
    #[serde(rename = "rotation")]
    pub(super) rotation_rad: f32,
    pub(super) scale: [f32; 2],
    tex_coord: Option<u32>,
}

impl Default for TextureTransform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation_rad: 0.0, scale: [1.0; 2], tex_coord: None }
    }
}

impl TextureUse {
    pub(super) fn coordinate_set(&self) -> u32 {
        self.transform().and_then(|transform| transform.tex_coord).unwrap_or(self.tex_coord)
    }

    pub(super) fn transform(&self) -> Option<TextureTransform> {
        self.extensions.transform
    }
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(super) struct TextureEntry {
    pub(super) source: Option<usize>,
    pub(super) extensions: BTreeMap<String, Value>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Image {
    pub(super) uri: Option<String>,
    pub(super) buffer_view: Option<usize>,
    pub(super) mime_type: String,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
    pub(super) normalized: bool,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) sparse: Option<Sparse>,
}

/// Replacements for single accessor elements.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(default)]
pub(super) struct Sparse {
    pub(super) count: usize,
    pub(super) indices: SparsePart,
    pub(super) values: SparsePart,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct SparsePart {
    pub(super) buffer_view: usize,
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    pub(super) byte_stride: Option<usize>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: usize,
}

pub(super) fn missing(what: &str, index: usize) -> String {
    format!("it refers to {what} {index}, which does not exist; export the file again")
}

pub(super) struct PlacedNode {
    pub(super) node: usize,
    pub(super) parent: Option<usize>,
    pub(super) world_from_node: Matrix4<f64>,
}

/// Returns the default scene's nodes, parents before children; all nodes if the file has no scene.
pub(super) fn placed_nodes(document: &Document) -> Checked<Vec<PlacedNode>> {
    let mut seen = vec![false; document.nodes.len()];
    let mut placed = Vec::new();
    let mut open: Vec<PlacedNode> = Vec::new();
    for root in roots(document)?.into_iter().rev() {
        open.push(PlacedNode { node: root, parent: None, world_from_node: Matrix4::identity() });
    }
    // An explicit stack: the depth of a hostile file must not overflow the call stack.
    while let Some(mut next) = open.pop() {
        let node = document.nodes.get(next.node).ok_or_else(|| missing("node", next.node))?;
        // A node with two parents would be copied, a cycle would never end. glTF requires a strict tree.
        refuse_if(std::mem::replace(&mut seen[next.node], true), || {
            format!("node {} is in the node tree twice; export the file again", next.node)
        })?;
        next.world_from_node *= local_matrix(node);
        for &child in node.children.iter().rev() {
            open.push(PlacedNode {
                node: child,
                parent: Some(placed.len()),
                world_from_node: next.world_from_node,
            });
        }
        placed.push(next);
    }
    Ok(placed)
}

fn roots(document: &Document) -> Checked<Vec<usize>> {
    let index = document.scene.unwrap_or(0);
    match document.scenes.get(index) {
        Some(scene) => Ok(scene.nodes.clone()),
        None if document.scenes.is_empty() => {
            let mut is_root = vec![true; document.nodes.len()];
            for &child in document.nodes.iter().flat_map(|node| &node.children) {
                *is_root.get_mut(child).ok_or_else(|| missing("node", child))? = false;
            }
            Ok((0..is_root.len()).filter(|&node| is_root[node]).collect())
        }
        None => Err(missing("scene", index)),
    }
}

fn local_matrix(node: &Node) -> Matrix4<f64> {
    if let Some(columns) = &node.matrix {
        return Matrix4::from_column_slice(columns);
    }
    let mut matrix = Matrix4::new_nonuniform_scaling(&Vector3::from(node.scale.unwrap_or([1.0; 3])));
    if let Some([x, y, z, w]) = node.rotation {
        matrix = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_homogeneous() * matrix;
    }
    matrix.append_translation(&Vector3::from(node.translation.unwrap_or_default()))
}
