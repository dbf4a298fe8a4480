//! Scenes that Habitat composes of parts: `X.scene_dataset_config.json` with stages, objects and scene instances, as in
//! HSSD, ReplicaCAD and ProcTHOR for Habitat.
//!
//! A scene is named by its `.scene_instance.json`, or by the data set's folder or configuration where that has one scene.
//! Frames, scales and origins are applied as habitat-sim does; articulated objects (URDF) are left out, with a warning.

mod assembly;
mod config;
mod files;
mod labels;
mod placing;
mod rooms;
mod templates;

use crate::{Report, glb};
use assembly::Assembly;
use avln_scene::{Scene, SceneError};
use config::{Dataset, SceneInstance};
use labels::Labels;
use serde_json::Value;
use std::path::{Path, PathBuf};
use templates::{Kind, Templates};

pub(crate) const DATASET_SUFFIX: &str = ".scene_dataset_config.json";
const SCENE_SUFFIX: &str = ".scene_instance.json";
/// Folders above a scene instance that are searched for its data set.
const MAX_PARENTS: usize = 6;
/// Scenes that an error names.
const NAMED_SCENES: usize = 8;

/// Whether `path` is a scene instance, a data set configuration, or a folder that holds one.
pub(crate) fn is_habitat(path: &Path) -> bool {
    if path.is_dir() {
        return files::with_suffix(path, DATASET_SUFFIX).is_ok_and(|found| !found.is_empty());
    }
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    name.ends_with(DATASET_SUFFIX) || name.ends_with(SCENE_SUFFIX)
}

/// Imports a `.scene_instance.json`, or a data set (folder or configuration) that has exactly one.
///
/// Instances take the number that their `user_defined.instance_id` gives, else the next free one. Categories come from
/// `user_defined`, the semantic lexicon, the data set's metadata tables or the template's name, in this order, and become
/// mpcat40 names where one is known.
///
/// # Errors
/// [`SceneError::Read`] for a configuration that cannot be read; [`SceneError::Malformed`] where one says nothing usable,
/// the stage is missing, an asset is damaged, the scene exceeds one of the [limits](avln_scene::limits) or cannot be in metres.
/// Missing objects are warnings.
pub fn import(path: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    let (dataset_path, scene_path) = locate(path)?;
    let dataset = Dataset::read(&dataset_path)?;
    let scene_path = match scene_path {
        Some(scene) => scene,
        None => only_scene(&dataset)?,
    };
    let instance = SceneInstance::read(&scene_path, &dataset.scene_instances)?;
    build(&dataset, &instance, &scene_path, report)
}

/// The data set's configuration, and the scene instance where `path` names one.
fn locate(path: &Path) -> Result<(PathBuf, Option<PathBuf>), SceneError> {
    if path.is_dir() {
        return Ok((only_dataset(path)?, None));
    }
    if !path.to_string_lossy().ends_with(SCENE_SUFFIX) {
        return Ok((path.to_owned(), None));
    }
    for folder in path.ancestors().skip(1).take(MAX_PARENTS) {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        if !files::with_suffix(folder, DATASET_SUFFIX)?.is_empty() {
            return Ok((only_dataset(folder)?, Some(path.to_owned())));
        }
    }
    Err(malformed(
        path,
        &format!(
            "no *{DATASET_SUFFIX} lies in the {MAX_PARENTS} folders above it; put the scene into its data set"
        ),
    ))
}

fn only_dataset(folder: &Path) -> Result<PathBuf, SceneError> {
    let mut found = files::with_suffix(folder, DATASET_SUFFIX)?;
    match found.len() {
        1 => Ok(found.swap_remove(0)),
        0 => Err(malformed(folder, &format!("it holds no *{DATASET_SUFFIX}; name a data set's folder"))),
        _ => Err(malformed(
            folder,
            &format!("it holds {} data sets; name one of {}", found.len(), listed(&found)),
        )),
    }
}

fn only_scene(dataset: &Dataset) -> Result<PathBuf, SceneError> {
    let fail = |reason: String| malformed(&dataset.path, &reason);
    let mut scenes = files::matching(&dataset.root, dataset.scene_instances.paths(".json"), SCENE_SUFFIX)?;
    match scenes.len() {
        1 => Ok(scenes.swap_remove(0)),
        0 => Err(fail("it lists no scene instance; name a scene's own file or folder".to_owned())),
        count => Err(fail(format!("it has {count} scenes; name one of them: {}", listed(&scenes)))),
    }
}

fn listed(paths: &[PathBuf]) -> String {
    let mut names: Vec<String> =
        paths.iter().take(NAMED_SCENES).map(|path| path.display().to_string()).collect();
    if paths.len() > NAMED_SCENES {
        names.push("…".to_owned());
    }
    names.join(", ")
}

fn build(
    dataset: &Dataset,
    scene: &SceneInstance,
    path: &Path,
    report: &mut Report,
) -> Result<Scene, SceneError> {
    let fail = |reason: String| malformed(path, &reason);
    let name = glb::scene_name(path);
    let mut assembly = Assembly::new(name.clone());
    let stage_name = &scene.stage_instance.template_name;
    let stage = Templates::find(dataset, Kind::Stage)?.read(stage_name, report)?.ok_or_else(|| {
        fail(format!("its stage {stage_name:?} is not in the data set; add it, or correct stage_instance"))
    })?;
    assembly.add_stage(&stage, &scene.stage_instance, &fail, report)?;

    let objects = Templates::find(dataset, Kind::Object)?;
    let labels = Labels::read(dataset, report)?;
    for (number, instance) in scene.object_instances.iter().enumerate() {
        let says = |why: String| fail(format!("its object instance {number} {why}"));
        let Some(template) = objects.read(&instance.template_name, report)? else {
            report.warn(format!("object {:?} is not in the data set; left out", instance.template_name));
            continue;
        };
        let label = labels.of(instance, &template);
        assembly.add_object(&template, instance, scene.origin_of(instance), label, report)?.map_err(says)?;
    }
    if scene.articulated_count() > 0 {
        report.warn(format!("{} articulated objects (URDF) are left out", scene.articulated_count()));
    }
    let regions = rooms::regions(dataset, scene, &name, report)?;
    assembly.finish(regions, report).map_err(fail)
}

fn malformed(path: &Path, reason: &str) -> SceneError {
    SceneError::Malformed { path: path.display().to_string(), reason: reason.to_owned() }
}

/// `value` over `below`: objects entry by entry, anything else as a whole.
fn overlaid(
    below: &serde_json::Map<String, Value>,
    above: &serde_json::Map<String, Value>,
) -> serde_json::Map<String, Value> {
    let mut merged = below.clone();
    merged.extend(above.iter().map(|(key, value)| (key.clone(), value.clone())));
    merged
}

#[cfg(test)]
mod tests;
