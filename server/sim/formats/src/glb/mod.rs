//! Buildings as glTF 2.0 files (Khronos, glTF 2.0 specification 2.0.1): export of any scene, import of any `.glb` or `.gltf`.
//!
//! Units are metres and Y is up, as the specification demands. What glTF has no word for (instance numbers,
//! attributes, regions) travels in `extras` under the key `avln`, so that an exported scene comes back whole.
//! In foreign files a node is an instance when its name, or its nearest ancestor's, says a category
//! (`chair_3`, `KitchenTable_01`); walls, floors, doors and the like are surfaces without an instance.

mod accessor;
mod basis;
mod bounded;
mod container;
mod draco;
mod export;
mod extras;
mod image;
mod instances;
mod materials;
mod names;
mod schema;
mod surfaces;
mod transform;
mod uri;

use crate::files::Checked;
use crate::frame::{Convention, Frame, check_size};
use crate::{Options, Report, Up, files};
use avln_scene::limits::MAX_FILE_BYTES;
use avln_scene::{Material, Mesh, Scene, SceneError, Texture};
use container::Source;
use extras::NodeExtras;
use std::path::Path;

pub(crate) use bounded::bounded;
pub use export::export;
pub(crate) use image::{checker, decode as decode_picture};
pub(crate) use names::category as category_of_name;
pub(crate) use uri::{neighbour, read_limited};

/// A file's surfaces before anyone said which of them form an instance.
pub(crate) struct Model {
    /// All instances are [`InstanceId::NONE`](avln_scene::InstanceId::NONE).
    pub(crate) mesh: Mesh,
    pub(crate) materials: Vec<Material>,
    pub(crate) textures: Vec<Texture>,
    /// Index into `nodes` of each triangle.
    node_of: Vec<u32>,
    nodes: Vec<ModelNode>,
    scene_extras: serde_json::Value,
}

impl Model {
    /// Surfaces of parts with names; `part_of` holds an index into `names` for each triangle.
    pub(crate) fn of_parts(
        mesh: Mesh,
        materials: Vec<Material>,
        textures: Vec<Texture>,
        part_of: Vec<u32>,
        names: Vec<String>,
    ) -> Self {
        let node = |name| ModelNode { name, parent: None, extras: None };
        let nodes = names.into_iter().map(node).collect();
        Self { mesh, materials, textures, node_of: part_of, nodes, scene_extras: serde_json::Value::Null }
    }
}

/// The scene of a model, with the instances that its nodes' extras or names tell.
pub(crate) fn named_scene(name: String, model: Model) -> Checked<Scene> {
    instances::scene(name, model)
}

/// A node of the default scene; parents stand before their children.
struct ModelNode {
    name: String,
    /// Index into [`Model::nodes`].
    parent: Option<usize>,
    extras: Option<NodeExtras>,
}

/// Reads a `.glb` or `.gltf` file, Y up, metres. The scene is named after the file.
///
/// Files that it names must lie in its own folder or below. A missing picture is a warning, and a checker stands in for it.
///
/// # Errors
/// [`SceneError::Read`] when the file itself cannot be read; [`SceneError::Malformed`] when it is damaged, exceeds one of
/// the [`limits`](avln_scene::limits), uses a compression or texture format that is not read, or cannot be in metres.
pub fn import(path: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    import_as(path, &Options::default(), report)
}

/// [`import`] with axes and unit as the caller knows them.
///
/// # Errors
/// Those of [`import`].
pub fn import_as(path: &Path, options: &Options, report: &mut Report) -> Result<Scene, SceneError> {
    let fail = |reason| files::malformed(path, reason);
    let mut model = read_part(path, report)?;
    Frame::of(&model.mesh, options, Convention::Fixed(Up::Y), report).apply(&mut model.mesh);
    check_size(&model.mesh, report).map_err(fail)?;
    named_scene(scene_name(path), model).map_err(fail)
}

/// The same as [`import`] for bytes at hand, which must hold all their data (`.glb`, or `data:` URIs).
/// `label_for_errors` takes the place of the path in errors.
///
/// # Errors
/// [`SceneError::Malformed`], as for [`import`].
pub fn from_bytes(name: &str, label_for_errors: &str, bytes: &[u8]) -> Result<Scene, SceneError> {
    parse(bytes, None, &mut Report::default())
        .and_then(|model| check_size(&model.mesh, &mut Report::default()).map(|()| model))
        .and_then(|model| named_scene(name.to_owned(), model))
        .map_err(|reason| SceneError::Malformed { path: label_for_errors.to_owned(), reason })
}

/// The surfaces of a building's file, checked, without instances.
pub(crate) fn read_model(path: &Path, report: &mut Report) -> Result<Model, SceneError> {
    let model = read_part(path, report)?;
    // Which axis is the height is not settled yet: what is said of it would mislead.
    check_size(&model.mesh, &mut Report::default()).map_err(|reason| files::malformed(path, reason))?;
    Ok(model)
}

/// The surfaces of a file that may be of any size, even none.
pub(crate) fn read_part(path: &Path, report: &mut Report) -> Result<Model, SceneError> {
    let path = &files::resolve(path, report)?;
    let bytes = files::read(path, MAX_FILE_BYTES, report)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&bytes, Some(folder), report).map_err(|reason| files::malformed(path, reason))
}

/// The part of a file name before the first dot, with what a scene name may not hold replaced by `_`.
pub(crate) fn scene_name(path: &Path) -> String {
    let file = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = file.split('.').next().unwrap_or_default();
    let allowed = |letter: char| letter.is_ascii_alphanumeric() || letter == '-' || letter == '_';
    let name: String = stem.chars().map(|letter| if allowed(letter) { letter } else { '_' }).collect();
    if name.is_empty() { "scene".to_owned() } else { name }
}

fn parse(bytes: &[u8], folder: Option<&Path>, report: &mut Report) -> Checked<Model> {
    surfaces::model(&Source::parse(bytes, folder)?, report)
}

#[cfg(test)]
mod tests;
