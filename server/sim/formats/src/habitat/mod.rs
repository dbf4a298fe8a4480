//! Habitat's composed scenes: `X.scene_dataset_config.json` with stages, objects and scene instances, as in HSSD, ReplicaCAD
//! and ProcTHOR for Habitat.
//!
//! A scene's path is a `.scene_instance.json`, or the folder or configuration for a data set with a single scene.
//! Frames, scales and origins are those of habitat-sim; articulated objects (URDF) are left out, with a warning.

mod assembly;
mod dataset;
mod labels;
#[cfg(test)]
mod tests;

use crate::files::{ImportReport, malformed, scene_name};
use crate::habitat::assembly::Assembly;
use crate::habitat::dataset::{Dataset, SceneInstance, TemplateKind, Templates, matching, with_suffix};
use crate::habitat::labels::CategorySources;
use avln_scene::{Scene, SceneError};
use std::path::{Path, PathBuf};

pub(crate) const DATASET_SUFFIX: &str = ".scene_dataset_config.json";
const SCENE_SUFFIX: &str = ".scene_instance.json";
/// Folders above a scene instance that may contain the data set.
const MAX_PARENTS: usize = 6;
const NAMED_SCENES: usize = 8;

/// Returns whether `path` is a scene instance, a data set configuration, or a folder with a configuration.
pub(crate) fn is_habitat(path: &Path) -> bool {
    if path.is_dir() {
        return with_suffix(path, DATASET_SUFFIX).is_ok_and(|found| !found.is_empty());
    }
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    name.ends_with(DATASET_SUFFIX) || name.ends_with(SCENE_SUFFIX)
}

/// Imports a `.scene_instance.json`, or a data set (folder or configuration) with a single scene.
///
/// An instance's number is `user_defined.instance_id`, or the next free number. Categories come from
/// `user_defined`, the semantic lexicon, the data set's metadata tables or the template's name, in this order, and become
/// mpcat40 names if possible. Missing objects are warnings.
pub(crate) fn import(path: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    let (dataset_path, scene_path) = locate(path)?;
    let dataset = Dataset::read(&dataset_path)?;
    let scene_path = match scene_path {
        Some(scene) => scene,
        None => only_scene(&dataset)?,
    };
    let instance = SceneInstance::read(&scene_path, &dataset.scene_instances)?;
    build(&dataset, &instance, &scene_path, report)
}

/// Returns the data set's configuration, and the scene instance if it is `path`.
fn locate(path: &Path) -> Result<(PathBuf, Option<PathBuf>), SceneError> {
    if path.is_dir() {
        return Ok((only_dataset(path)?, None));
    }
    if !path.to_string_lossy().ends_with(SCENE_SUFFIX) {
        return Ok((path.to_owned(), None));
    }
    for folder in path.ancestors().skip(1).take(MAX_PARENTS) {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        if !with_suffix(folder, DATASET_SUFFIX)?.is_empty() {
            return Ok((only_dataset(folder)?, Some(path.to_owned())));
        }
    }
    Err(malformed(
        path,
        format!(
            "no *{DATASET_SUFFIX} is in the {MAX_PARENTS} folders above it; put the scene into its data set"
        ),
    ))
}

fn only_dataset(folder: &Path) -> Result<PathBuf, SceneError> {
    let mut found = with_suffix(folder, DATASET_SUFFIX)?;
    match found.len() {
        1 => Ok(found.swap_remove(0)),
        0 => {
            Err(malformed(folder, format!("it contains no *{DATASET_SUFFIX}; use the folder of a data set")))
        }
        _ => Err(malformed(
            folder,
            format!("it contains {} data sets; use one of {}", found.len(), listed(&found)),
        )),
    }
}

fn only_scene(dataset: &Dataset) -> Result<PathBuf, SceneError> {
    let fail = |reason: String| malformed(&dataset.path, reason);
    let mut scenes = matching(&dataset.root, dataset.scene_instances.paths(".json"), SCENE_SUFFIX)?;
    match scenes.len() {
        1 => Ok(scenes.swap_remove(0)),
        0 => Err(fail("it lists no scene instance; use the file or folder of a scene".to_owned())),
        count => Err(fail(format!("it has {count} scenes; use one of them: {}", listed(&scenes)))),
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
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    let fail = |reason: String| malformed(path, reason);
    let name = scene_name(path);
    let mut assembly = Assembly::new(name.clone());
    let stage_name = &scene.stage_instance.template_name;
    let stage =
        Templates::find(dataset, TemplateKind::Stage)?.read(stage_name, report)?.ok_or_else(|| {
            fail(format!(
                "its stage {stage_name:?} is not in the data set; add it, or correct stage_instance"
            ))
        })?;
    assembly.add_stage(&stage, &scene.stage_instance, &fail, report)?;

    let objects = Templates::find(dataset, TemplateKind::Object)?;
    let labels = CategorySources::read(dataset, report)?;
    for (number, instance) in scene.object_instances.iter().enumerate() {
        let Some(template) = objects.read(&instance.template_name, report)? else {
            report.warn(format!("object {:?} is not in the data set; left out", instance.template_name));
            continue;
        };
        let label = labels.of(instance, &template);
        assembly
            .add_object(&template, instance, scene.origin_of(instance), label, report)?
            .map_err(|why| fail(format!("its object instance {number} {why}")))?;
    }
    let articulated = scene.articulated_object_instances.len();
    if articulated > 0 {
        report.warn(format!("{articulated} articulated objects (URDF) are left out"));
    }
    let regions = labels::regions(dataset, scene, &name, report)?;
    assembly.finish(regions, report).map_err(fail)
}
