//! The JSON of data sets and scene instances, as far as it says where things are. Names follow habitat-sim's keys.

use super::files::read_json;
use super::{Value, malformed, overlaid};
use crate::glb::bounded;
use avln_scene::SceneError;
use serde::Deserialize;
use serde_json::Map;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// `X.scene_dataset_config.json`.
pub(super) struct Dataset {
    /// The file.
    pub(super) path: PathBuf,
    /// Its folder, which all its paths start from.
    pub(super) root: PathBuf,
    pub(super) stages: Section,
    pub(super) objects: Section,
    pub(super) scene_instances: Section,
    /// Names of semantic descriptions with their files, and `paths`.
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

/// What a data set says of one kind of thing.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Section {
    pub(super) default_attributes: Map<String, Value>,
    paths: BTreeMap<String, Vec<String>>,
    #[serde(deserialize_with = "bounded")]
    pub(super) configs: Vec<ConfigEntry>,
}

/// A template that the data set's own file makes or changes.
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
    /// The patterns for files that end in `extension` (`.json`, `.glb`).
    pub(super) fn paths(&self, extension: &str) -> impl Iterator<Item = &str> {
        self.paths.get(extension).into_iter().flatten().map(String::as_str)
    }
}

/// `X.scene_instance.json`.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct SceneInstance {
    translation_origin: String,
    pub(super) stage_instance: Instance,
    #[serde(deserialize_with = "bounded")]
    pub(super) object_instances: Vec<Instance>,
    #[serde(deserialize_with = "bounded")]
    articulated_object_instances: Vec<serde::de::IgnoredAny>,
    pub(super) semantic_scene_instance: String,
}

/// One thing in a scene.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Instance {
    pub(super) template_name: String,
    pub(super) translation: [f64; 3],
    /// Quaternion w, x, y, z.
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) uniform_scale: Option<f64>,
    pub(super) non_uniform_scale: Option<[f64; 3]>,
    pub(super) translation_origin: String,
    pub(super) user_defined: Map<String, Value>,
}

/// What an instance's translation moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// The centre of mass: the one given, else the centre of the box around the asset.
    CenterOfMass,
    /// The asset's own origin.
    Asset,
}

impl SceneInstance {
    /// Reads the file over the data set's defaults.
    pub(super) fn read(path: &Path, defaults: &Section) -> Result<Self, SceneError> {
        let own: Map<String, Value> = read_json(path)?;
        let merged = overlaid(&defaults.default_attributes, &own);
        Self::deserialize(Value::Object(merged))
            .map_err(|error| malformed(path, &format!("it is no scene instance ({error}); correct it")))
    }

    /// The instance's own origin, else the scene's, else the centre of mass.
    pub(super) fn origin_of(&self, instance: &Instance) -> Origin {
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
