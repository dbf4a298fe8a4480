//! JSON in data sets and scene instances. Names follow habitat-sim's keys.

use crate::files::{bounded, malformed};
use crate::habitat::files::read_json;
use avln_scene::SceneError;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// `X.scene_dataset_config.json`.
pub(super) struct Dataset {
    /// The file.
    pub(super) path: PathBuf,
    /// Base folder for all paths.
    pub(super) root: PathBuf,
    pub(super) stages: Section,
    pub(super) objects: Section,
    pub(super) scene_instances: Section,
    /// Semantic descriptions by name, and `paths`.
    pub(super) semantics: Map<String, Value>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct DatasetFile {
    stages: Section,
    objects: Section,
    scene_instances: Section,
    semantic_scene_descriptor_instances: Map<String, Value>,
}

/// A data set section: stages, objects or scene instances.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Section {
    pub(super) default_attributes: Map<String, Value>,
    paths: BTreeMap<String, Vec<String>>,
    #[serde(deserialize_with = "bounded")]
    pub(super) configs: Vec<ConfigEntry>,
}

/// A template defined or changed in the data set's configuration.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct ConfigEntry {
    pub(super) original_file: String,
    pub(super) template_handle: String,
    pub(super) attributes: Map<String, Value>,
}

impl Dataset {
    pub(super) fn read(path: &Path) -> Result<Self, SceneError> {
        let file: DatasetFile = read_json(path)?;
        Ok(Self {
            path: path.to_owned(),
            root: path.parent().unwrap_or(Path::new("")).to_owned(),
            stages: file.stages,
            objects: file.objects,
            scene_instances: file.scene_instances,
            semantics: file.semantic_scene_descriptor_instances,
        })
    }
}

impl Section {
    /// Returns the path patterns for an extension (`.json`, `.glb`).
    pub(super) fn paths(&self, extension: &str) -> impl Iterator<Item = &str> {
        self.paths.get(extension).into_iter().flatten().map(String::as_str)
    }
}

/// `X.scene_instance.json`.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct SceneInstance {
    translation_origin: String,
    pub(super) stage_instance: InstanceEntry,
    #[serde(deserialize_with = "bounded")]
    pub(super) object_instances: Vec<InstanceEntry>,
    #[serde(deserialize_with = "bounded")]
    articulated_object_instances: Vec<serde::de::IgnoredAny>,
    pub(super) semantic_scene_instance: String,
}

/// A placed asset.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct InstanceEntry {
    pub(super) template_name: String,
    pub(super) translation: [f64; 3],
    /// Quaternion w, x, y, z.
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) uniform_scale: Option<f64>,
    pub(super) non_uniform_scale: Option<[f64; 3]>,
    pub(super) translation_origin: String,
    pub(super) user_defined: Map<String, Value>,
}

/// Reference point for an instance's translation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// The given centre of mass, or the asset's box centre.
    CenterOfMass,
    /// The asset's origin.
    Asset,
}

impl SceneInstance {
    /// Reads a file over the data set's defaults.
    pub(super) fn read(path: &Path, defaults: &Section) -> Result<Self, SceneError> {
        let own: Map<String, Value> = read_json(path)?;
        let merged = overlaid(&defaults.default_attributes, &own);
        Self::deserialize(Value::Object(merged))
            .map_err(|error| malformed(path, format!("it is no scene instance ({error}); correct it")))
    }

    /// Returns the instance's origin; the default is the scene's, then the centre of mass.
    pub(super) fn origin_of(&self, instance: &InstanceEntry) -> Origin {
        let named = |name: &str| match name.to_ascii_lowercase().as_str() {
            "asset_local" => Some(Origin::Asset),
            "com" => Some(Origin::CenterOfMass),
            _ => None,
        };
        named(&instance.translation_origin)
            .or_else(|| named(&self.translation_origin))
            .unwrap_or(Origin::CenterOfMass)
    }

    pub(super) fn articulated_count(&self) -> usize {
        self.articulated_object_instances.len()
    }
}

/// Returns the entries in `below`, with replacements from `above`.
pub(super) fn overlaid(
    below: &serde_json::Map<String, Value>,
    above: &serde_json::Map<String, Value>,
) -> serde_json::Map<String, Value> {
    let mut merged = below.clone();
    merged.extend(above.iter().map(|(key, value)| (key.clone(), value.clone())));
    merged
}
