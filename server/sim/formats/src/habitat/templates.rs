//! Templates of stages and objects: found by name, read when a scene asks for them.

use super::config::{Dataset, Section};
use super::{Value, files, malformed, overlaid};
use crate::Report;
use avln_scene::SceneError;
use serde::Deserialize;
use serde_json::Map;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Placeholder for the template's own name in file names.
const OWN_NAME: &str = "%%CONFIG_NAME_AS_ASSET_FILENAME%%";

/// Which section of the data set templates come from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Stage,
    Object,
}

/// What a template says of an asset.
#[derive(Clone, Debug, Deserialize)]
#[serde(default)]
pub(super) struct Template {
    #[serde(skip)]
    pub(super) name: String,
    /// The mesh; `None` where it is not in the data set.
    #[serde(skip)]
    pub(super) asset: Option<PathBuf>,
    pub(super) render_asset: String,
    /// Direction in the asset's frame that is up in the world.
    pub(super) up: [f64; 3],
    /// Direction in the asset's frame that is forward in the world.
    pub(super) front: [f64; 3],
    pub(super) scale: [f64; 3],
    pub(super) units_to_meters: f64,
    /// Centre of mass, in the asset's frame turned upright, before scaling.
    #[serde(rename = "COM")]
    pub(super) center_of_mass: Option<[f64; 3]>,
    pub(super) semantic_id: Option<i64>,
    pub(super) user_defined: Map<String, Value>,
}

impl Default for Template {
    fn default() -> Self {
        Self {
            name: String::new(),
            asset: None,
            render_asset: String::new(),
            up: [0.0, 1.0, 0.0],
            front: [0.0, 0.0, -1.0],
            scale: [1.0; 3],
            units_to_meters: 1.0,
            center_of_mass: None,
            semantic_id: None,
            user_defined: Map::new(),
        }
    }
}

/// Where a template is written.
#[derive(Clone, Default)]
struct Entry {
    /// Its configuration or, for a bare asset, the mesh.
    file: Option<PathBuf>,
    /// What the data set's own file says on top.
    attributes: Map<String, Value>,
}

/// The templates of one kind, by the name of their file without folders and endings, or by their handle.
pub(super) struct Templates<'a> {
    dataset: &'a Dataset,
    kind: Kind,
    entries: BTreeMap<String, Entry>,
}

impl<'a> Templates<'a> {
    /// Lists them without reading any.
    pub(super) fn find(dataset: &'a Dataset, kind: Kind) -> Result<Self, SceneError> {
        let mut templates = Self { dataset, kind, entries: BTreeMap::new() };
        let section = templates.section();
        // Configurations win over bare assets of the same name.
        for (extension, suffix) in [(".glb", ".glb"), (".gltf", ".gltf"), (".json", kind.suffix())] {
            for file in files::matching(&dataset.root, section.paths(extension), suffix)? {
                templates.entries.insert(stem(&file), Entry { file: Some(file), attributes: Map::new() });
            }
        }
        for entry in &section.configs {
            let original = files::inside(&dataset.root, &dataset.root, &entry.original_file);
            let file = original.filter(|_| !entry.original_file.is_empty());
            let key = match (&file, entry.template_handle.is_empty()) {
                (_, false) => entry.template_handle.clone(),
                (Some(file), true) => stem(file),
                (None, true) => continue,
            };
            templates.entries.insert(key, Entry { file, attributes: entry.attributes.clone() });
        }
        Ok(templates)
    }

    fn section(&self) -> &'a Section {
        match self.kind {
            Kind::Stage => &self.dataset.stages,
            Kind::Object => &self.dataset.objects,
        }
    }

    /// The template that `name` means: that of this name, else the first whose name contains it, as habitat-sim looks
    /// them up. `None` when there is none.
    pub(super) fn read(&self, name: &str, report: &mut Report) -> Result<Option<Template>, SceneError> {
        let wanted = stem(Path::new(name));
        if wanted.is_empty() {
            return Ok(None);
        }
        let lower = wanted.to_lowercase();
        let exact = self.entries.get_key_value(name).or_else(|| self.entries.get_key_value(&wanted));
        let contains = || self.entries.iter().find(|(key, _)| key.to_lowercase().contains(&lower));
        let Some((key, entry)) = exact.or_else(contains) else { return Ok(None) };
        if exact.is_none() {
            report.warn(format!("template {name:?} is taken to be {key:?}, whose name contains it"));
        }
        self.template(key, entry).map(Some)
    }

    /// The data set's defaults, then the template's file, then what the data set's file says of it.
    fn template(&self, key: &str, entry: &Entry) -> Result<Template, SceneError> {
        let root = &self.dataset.root;
        let mut merged = self.section().default_attributes.clone();
        let mut asset_folder = root.clone();
        let mut bare = None;
        match &entry.file {
            Some(file) if file.extension().is_some_and(|extension| extension == "json") => {
                let own: Map<String, Value> = files::read_json(file)?;
                merged = overlaid(&merged, &own);
                asset_folder = file.parent().unwrap_or(root).to_owned();
            }
            Some(file) => {
                bare = Some(file.clone());
                self.default_frame(&mut merged);
            }
            None => {}
        }
        if entry.attributes.contains_key("render_asset") {
            asset_folder = root.clone();
        }
        merged = overlaid(&merged, &entry.attributes);
        let told_by = entry.file.as_deref().unwrap_or(&self.dataset.path);
        let mut template = Template::deserialize(Value::Object(merged)).map_err(|error| {
            malformed(told_by, &format!("template {key:?} cannot be read ({error}); correct it"))
        })?;
        template.name = key.to_owned();
        template.asset = bare.or_else(|| {
            let named = template.render_asset.replace(OWN_NAME, key);
            files::inside(root, &asset_folder, &named).filter(|path| !named.is_empty() && path.is_file())
        });
        Ok(template)
    }

    /// A stage without configuration has gravity along -Z, as habitat-sim assumes of every bare `.glb`.
    fn default_frame(&self, attributes: &mut Map<String, Value>) {
        if self.kind == Kind::Stage {
            attributes.entry("up").or_insert_with(|| serde_json::json!([0, 0, 1]));
            attributes.entry("front").or_insert_with(|| serde_json::json!([0, 1, 0]));
        }
    }
}

impl Kind {
    fn suffix(self) -> &'static str {
        match self {
            Self::Stage => ".stage_config.json",
            Self::Object => ".object_config.json",
        }
    }
}

/// `objects/chair.object_config.json` and `chair.glb` as `chair`.
fn stem(path: &Path) -> String {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let endings = [".stage_config.json", ".object_config.json", ".glb", ".gltf"];
    endings.iter().find_map(|ending| name.strip_suffix(ending)).unwrap_or(&name).to_owned()
}
