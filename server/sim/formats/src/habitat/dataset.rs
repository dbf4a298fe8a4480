//! Data set files: configurations, scene instances, and the templates of stages and objects. Names follow habitat-sim's keys.

use crate::files::{ImportReport, bounded, malformed, normalised, read_regular};
use avln_scene::SceneError;
use serde::Deserialize;
use serde::de::{DeserializeOwned, IgnoredAny};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// `X.scene_dataset_config.json`.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Dataset {
    #[serde(skip)]
    pub(super) path: PathBuf,
    #[serde(skip)]
    pub(super) root: PathBuf,
    pub(super) stages: Section,
    pub(super) objects: Section,
    pub(super) scene_instances: Section,
    /// Semantic descriptions by name, and `paths`.
    #[serde(rename = "semantic_scene_descriptor_instances")]
    pub(super) semantics: Map<String, Value>,
}

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
        let root = path.parent().unwrap_or(Path::new("")).to_owned();
        Ok(Self { path: path.to_owned(), root, ..read_json(path)? })
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
    pub(super) articulated_object_instances: Vec<IgnoredAny>,
    pub(super) semantic_scene_instance: String,
}

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
    Asset,
}

impl SceneInstance {
    /// Reads a file over the data set's defaults.
    pub(super) fn read(path: &Path, defaults: &Section) -> Result<Self, SceneError> {
        let mut merged = defaults.default_attributes.clone();
        merged.extend(read_json::<Map<String, Value>>(path)?);
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
}

/// Placeholder for the own name of a template or scene in file names.
pub(super) const OWN_NAME: &str = "%%CONFIG_NAME_AS_ASSET_FILENAME%%";

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum TemplateKind {
    Stage,
    Object,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(default)]
pub(super) struct Template {
    #[serde(skip)]
    pub(super) name: String,
    /// Mesh path; `None` if it is missing.
    #[serde(skip)]
    pub(super) asset: Option<PathBuf>,
    pub(super) render_asset: String,
    pub(super) up: [f64; 3],
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
    pub(super) fn find(dataset: &'a Dataset, kind: TemplateKind) -> Result<Self, SceneError> {
        let mut templates = Self { dataset, kind, entries: BTreeMap::new() };
        let section = templates.section();
        let suffix = match kind {
            TemplateKind::Stage => ".stage_config.json",
            TemplateKind::Object => ".object_config.json",
        };
        // Configurations replace bare assets with the same name.
        for (extension, suffix) in [(".glb", ".glb"), (".gltf", ".gltf"), (".json", suffix)] {
            for file in matching(&dataset.root, section.paths(extension), suffix)? {
                templates
                    .entries
                    .insert(stem(&file), TemplateSource { file: Some(file), attributes: Map::new() });
            }
        }
        for entry in &section.configs {
            let original = inside(&dataset.root, &dataset.root, &entry.original_file);
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
                merged.extend(read_json::<Map<String, Value>>(file)?);
                asset_folder = file.parent().unwrap_or(root).to_owned();
            }
            Some(file) => {
                bare = Some(file.clone());
                // A stage without configuration has gravity in direction -Z, as habitat-sim assumes for every bare `.glb`.
                if self.kind == TemplateKind::Stage {
                    merged.entry("up").or_insert_with(|| serde_json::json!([0, 0, 1]));
                    merged.entry("front").or_insert_with(|| serde_json::json!([0, 1, 0]));
                }
            }
            None => {}
        }
        if entry.attributes.contains_key("render_asset") {
            asset_folder = root.clone();
        }
        merged.extend(entry.attributes.clone());
        let source = entry.file.as_deref().unwrap_or(&self.dataset.path);
        let mut template = Template::deserialize(Value::Object(merged)).map_err(|error| {
            malformed(source, format!("template {key:?} cannot be read ({error}); correct it"))
        })?;
        template.name = key.to_owned();
        template.asset = bare.or_else(|| {
            let named = template.render_asset.replace(OWN_NAME, key);
            inside(root, &asset_folder, &named).filter(|path| !named.is_empty() && path.is_file())
        });
        Ok(template)
    }
}

/// `objects/chair.object_config.json` and `chair.glb` as `chair`.
fn stem(path: &Path) -> String {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let endings = [".stage_config.json", ".object_config.json", ".glb", ".gltf"];
    endings.iter().find_map(|ending| name.strip_suffix(ending)).unwrap_or(&name).to_owned()
}

/// Bytes in a configuration or table.
const MAX_CONFIG_BYTES: u64 = 64 << 20;
/// Files per pattern.
const MAX_MATCHES: usize = 1 << 18;

pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, SceneError> {
    let bytes = read(path)?;
    serde_json::from_slice(&bytes)
        .map_err(|error| malformed(path, format!("it is not the expected JSON ({error}); correct it")))
}

pub(super) fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_regular(path, MAX_CONFIG_BYTES)
}

/// Lists a folder's files with the suffix, sorted.
pub(super) fn with_suffix(folder: &Path, suffix: &str) -> Result<Vec<PathBuf>, SceneError> {
    let mut found = entries(folder)?;
    found.retain(|path| path.to_string_lossy().ends_with(suffix) && path.is_file());
    Ok(found)
}

/// Lists a folder, sorted; empty if it is no folder.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let read = |source| SceneError::Read { path: folder.display().to_string(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        found.push(entry.map_err(read)?.path());
        // A folder can be huge: the limit applies while listing, before sorting.
        if found.len() > MAX_MATCHES {
            return Err(malformed(folder, format!("it contains more than {MAX_MATCHES} files; split it")));
        }
    }
    found.sort();
    Ok(found)
}

/// Lists the files with the suffix that match patterns relative to `root`: files, and files directly in matching folders.
pub(super) fn matching<'a>(
    root: &Path,
    patterns: impl Iterator<Item = &'a str>,
    suffix: &str,
) -> Result<Vec<PathBuf>, SceneError> {
    let mut found = Vec::new();
    for pattern in patterns {
        for path in expanded(root, pattern)? {
            if path.is_dir() {
                found.extend(with_suffix(&path, suffix)?);
            } else if path.to_string_lossy().ends_with(suffix) && path.is_file() {
                found.push(path);
            }
        }
        if found.len() > MAX_MATCHES {
            let reason = format!(
                "its path {pattern:?} and others match more than {MAX_MATCHES} files; split the data set"
            );
            return Err(malformed(root, reason));
        }
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// Expands a pattern with `*` in names; paths outside `root` are left out.
fn expanded(root: &Path, pattern: &str) -> Result<Vec<PathBuf>, SceneError> {
    let Some(relative) = normalised(Path::new(pattern)) else { return Ok(Vec::new()) };
    let mut open = vec![root.to_owned()];
    for component in relative.components() {
        let name = component.as_os_str().to_string_lossy();
        let mut next = Vec::new();
        for folder in open {
            if !name.contains('*') {
                next.push(folder.join(component));
                continue;
            }
            let fits =
                |path: &PathBuf| path.file_name().is_some_and(|file| fits(&file.to_string_lossy(), &name));
            next.extend(entries(&folder)?.into_iter().filter(fits));
        }
        open = next;
    }
    Ok(open)
}

/// Returns whether `name` matches `pattern`; `*` matches any characters.
fn fits(name: &str, pattern: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = name.strip_prefix(first) else { return false };
    let mut parts: Vec<&str> = parts.collect();
    let Some(last) = parts.pop() else { return rest.is_empty() };
    for part in parts {
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    rest.ends_with(last)
}

/// Resolves `address` relative to `folder`; `None` if it is outside `root`.
pub(super) fn inside(root: &Path, folder: &Path, address: &str) -> Option<PathBuf> {
    let from_root = folder.strip_prefix(root).ok()?.join(address);
    normalised(&from_root).map(|relative| root.join(relative))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn star_matches_any_letters_in_a_name() {
        for (name, pattern, expected) in [
            ("a.glb", "*.glb", true),
            ("a.glb", "*", true),
            ("a.glb", "a*b", true),
            ("a.glb", "a.glb", true),
            ("ab", "a*b*b", false),
            ("a.glbx", "*.glb", false),
            ("b", "a*", false),
            ("aa", "aa*a", false),
        ] {
            assert_eq!(fits(name, pattern), expected, "{name} {pattern}");
        }
    }

    #[test]
    fn addresses_stay_inside_the_root() {
        let (root, folder) = (Path::new("set"), Path::new("set/configs/objects"));
        assert_eq!(inside(root, folder, "../../objects/a.glb"), Some(PathBuf::from("set/objects/a.glb")));
        for address in ["../../../a.glb", "/etc/passwd", "x/../../../../a"] {
            assert_eq!(inside(root, folder, address), None, "{address}");
        }
    }
}
