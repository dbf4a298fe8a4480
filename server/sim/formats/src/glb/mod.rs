//! Buildings as glTF 2.0 files (Khronos, glTF 2.0 specification 2.0.1): export for any scene, import for any `.glb` or `.gltf`.
//!
//! Units are metres and Y is up, as the specification requires. Instance numbers, attributes and regions are `extras` under
//! the key `avln`: an exported scene is imported without loss. In other programs' files, a node is an instance if the name,
//! or an ancestor's name, contains a category (`chair_3`, `KitchenTable_01`); walls, floors, doors and other structure
//! have no instance.

mod accessor;
mod document;
mod draco;
mod export;
mod materials;
mod source;
mod surfaces;
#[cfg(test)]
mod tests;

use crate::files;
use crate::files::Checked;
use crate::files::scene_name;
use crate::glb::source::Source;
use crate::named_model::{Model, scene_of_named_model};
use crate::options::{ImportOptions, ImportReport, UpAxis};
use crate::world_frame::{FileFrame, UpConvention, check_size};
use avln_scene::limits::MAX_FILE_BYTES;
use avln_scene::{Scene, SceneError};
use std::path::Path;

pub use export::export;

/// Imports a `.glb` or `.gltf` file, Y up, metres. The scene is named after the file.
///
/// Files that it refers to must be in the same folder or below. A missing image is replaced by a checker, with a warning.
///
/// # Errors
/// [`SceneError::Read`] if the file cannot be read; [`SceneError::Malformed`] if it is damaged, exceeds one of the
/// [`limits`](avln_scene::limits), uses an unsupported compression or texture format, or cannot be in metres.
pub fn import(path: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    import_as(path, &ImportOptions::default(), report)
}

/// [`import`] with the caller's axis and unit.
///
/// # Errors
/// See [`import`].
pub fn import_as(
    path: &Path,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    let fail = |reason| files::malformed(path, reason);
    let mut model = read_part(path, report)?;
    FileFrame::of(&model.mesh, options, UpConvention::Fixed(UpAxis::Y), report).apply(&mut model.mesh);
    check_size(&model.mesh, report).map_err(fail)?;
    scene_of_named_model(scene_name(path), model).map_err(fail)
}

/// Imports a file from memory; all data must be inside (`.glb`, or `data:` URIs). `label_for_errors` replaces the path in
/// errors.
///
/// # Errors
/// [`SceneError::Malformed`], as for [`import`].
pub fn from_bytes(name: &str, label_for_errors: &str, bytes: &[u8]) -> Result<Scene, SceneError> {
    parse(bytes, None, &mut ImportReport::default())
        .and_then(|model| check_size(&model.mesh, &mut ImportReport::default()).map(|()| model))
        .and_then(|model| scene_of_named_model(name.to_owned(), model))
        .map_err(|reason| SceneError::Malformed { path: label_for_errors.to_owned(), reason })
}

/// Reads a building's surfaces, without instances, and checks their size.
pub(crate) fn read_model(path: &Path, report: &mut ImportReport) -> Result<Model, SceneError> {
    let model = read_part(path, report)?;
    // The vertical axis is not known yet: a warning about the height would mislead.
    check_size(&model.mesh, &mut ImportReport::default()).map_err(|reason| files::malformed(path, reason))?;
    Ok(model)
}

/// Reads a file's surfaces, with any extent, even none.
pub(crate) fn read_part(path: &Path, report: &mut ImportReport) -> Result<Model, SceneError> {
    let path = &files::resolve(path, report)?;
    let bytes = files::read(path, MAX_FILE_BYTES, report)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&bytes, Some(folder), report).map_err(|reason| files::malformed(path, reason))
}

fn parse(bytes: &[u8], folder: Option<&Path>, report: &mut ImportReport) -> Checked<Model> {
    surfaces::model(&Source::parse(bytes, folder)?, report)
}
