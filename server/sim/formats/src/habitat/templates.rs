//! Stage and object templates: found by name, read at the first use.

use crate::files::malformed;
use crate::habitat::config::{Dataset, Section, overlaid};
use crate::habitat::files;
use crate::options::ImportReport;
use avln_scene::SceneError;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Placeholder for the template's own name in file names.
const OWN_NAME: &str = "%%CONFIG_NAME_AS_ASSET_FILENAME%%";

/// The templates' section in the data set.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum TemplateKind {
    Stage,
    Object,
}

/// An asset's configuration.
#[derive(Clone, Debug, Deserialize)]
#[serde(default)]
pub(super) struct Template {
    #[serde(skip)]
    pub(super) name: String,
    /// Mesh path; `None` if it is missing.
    #[serde(skip)]
    pub(super) asset: Option<PathBuf>,
    pub(super) render_asset: String,
    /// Upward direction in the asset's frame.
    pub(super) up: [f64; 3],
    /// Forward direction in the asset's frame.
    pub(super) front: [f64; 3],
    pub(super) scale: [f64; 3],
    pub(super) units_to_meters: f64,
    /// Centre of mass, in the asset's upright frame, before scaling.
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

/// A template's location.
#[derive(Clone, Default)]
struct TemplateSource {
    /// Configuration path, or mesh path for a bare asset.
    file: Option<PathBuf>,
    /// Changes in the data set's configuration.
    attributes: Map<String, Value>,
}

/// A section's templates, by file name without folders and suffixes, or by handle.
pub(super) struct Templates<'a> {
    dataset: &'a Dataset,
    kind: TemplateKind,
    entries: BTreeMap<String, TemplateSource>,
}

impl<'a> Templates<'a> {
    /// Lists the templates, without reading them.
    pub(super) fn find(dataset: &'a Dataset, kind: TemplateKind) -> Result<Self, SceneError> {
        let mut templates = Self { dataset, kind, entries: BTreeMap::new() };
        let section = templates.section();
        // Configurations replace bare assets with the same name.
        for (extension, suffix) in [(".glb", ".glb"), (".gltf", ".gltf"), (".json", kind.suffix())] {
            for file in files::matching(&dataset.root, section.paths(extension), suffix)? {
                templates
                    .entries
                    .insert(stem(&file), TemplateSource { file: Some(file), attributes: Map::new() });
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
            templates.entries.insert(key, TemplateSource { file, attributes: entry.attributes.clone() });
        }
        Ok(templates)
    }

    fn section(&self) -> &'a Section {
        match self.kind {
            TemplateKind::Stage => &self.dataset.stages,
            TemplateKind::Object => &self.dataset.objects,
        }
    }

    /// Reads the template `name`, or the first template that contains `name`, as habitat-sim does; `None` without a match.
    pub(super) fn read(&self, name: &str, report: &mut ImportReport) -> Result<Option<Template>, SceneError> {
        let wanted = stem(Path::new(name));
        if wanted.is_empty() {
            return Ok(None);
        }
        let lower = wanted.to_lowercase();
        let exact = self.entries.get_key_value(name).or_else(|| self.entries.get_key_value(&wanted));
        let contains = || self.entries.iter().find(|(key, _)| key.to_lowercase().contains(&lower));
        let Some((key, entry)) = exact.or_else(contains) else { return Ok(None) };
        if exact.is_none() {
            report.warn(format!(
                "template {name:?} is not in the data set; {key:?} contains its name and is used"
            ));
        }
        self.template(key, entry).map(Some)
    }

    /// Reads a template: the data set's defaults, the template's file, and the changes in the data set's configuration.
    fn template(&self, key: &str, entry: &TemplateSource) -> Result<Template, SceneError> {
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
            malformed(told_by, format!("template {key:?} cannot be read ({error}); correct it"))
        })?;
        template.name = key.to_owned();
        template.asset = bare.or_else(|| {
            let named = template.render_asset.replace(OWN_NAME, key);
            files::inside(root, &asset_folder, &named).filter(|path| !named.is_empty() && path.is_file())
        });
        Ok(template)
    }

    /// A stage without configuration has gravity in direction -Z, as habitat-sim assumes for every bare `.glb`.
    fn default_frame(&self, attributes: &mut Map<String, Value>) {
        if self.kind == TemplateKind::Stage {
            attributes.entry("up").or_insert_with(|| serde_json::json!([0, 0, 1]));
            attributes.entry("front").or_insert_with(|| serde_json::json!([0, 1, 0]));
        }
    }
}

impl TemplateKind {
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
