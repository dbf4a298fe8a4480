//! The part of the glTF 2.0 schema that holds surfaces. Names follow the specification's JSON keys.

use super::limits::MAX_ENTRIES;
use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};
use serde_json::Value;
use std::collections::BTreeMap;
use std::marker::PhantomData;

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
    pub(super) pbr_metallic_roughness: Pbr,
    pub(super) alpha_mode: String,
    pub(super) alpha_cutoff: Option<f32>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Pbr {
    /// Linear RGBA.
    pub(super) base_color_factor: Option<[f32; 4]>,
    pub(super) base_color_texture: Option<TextureUse>,
}

#[derive(Clone, Copy, Debug, Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TextureUse {
    pub(super) index: usize,
    pub(super) tex_coord: u32,
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
    pub(super) sparse: Option<Value>,
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

/// Reads a list and refuses one with more than [`MAX_ENTRIES`] entries: a short JSON text can name many defaults.
fn bounded<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_seq(Bounded(PhantomData))
}

struct Bounded<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for Bounded<T> {
    type Value = Vec<T>;

    fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "a list of at most {MAX_ENTRIES} entries")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Vec<T>, A::Error> {
        let mut found = Vec::new();
        while let Some(entry) = entries.next_element()? {
            if found.len() == MAX_ENTRIES {
                return Err(A::Error::custom(format!("a list has more than {MAX_ENTRIES} entries")));
            }
            found.push(entry);
        }
        Ok(found)
    }
}
