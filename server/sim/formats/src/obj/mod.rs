//! Wavefront `.obj` files with their material libraries: polygons of any size, colours at vertices, pictures, and objects or
//! groups whose names say a category (`chair_3`, `KitchenTable_01`), which become instances.

mod lines;
mod mtl;
mod surfaces;
#[cfg(test)]
mod tests;

use crate::files::Checked;
use crate::frame::{Convention, Frame, Options, Up, check_size};
use crate::glb::{Model, named_scene, neighbour, scene_name};
use crate::pictures::Pictures;
use crate::{Report, files};
use avln_scene::limits::{MAX_FILE_BYTES, MAX_TEXELS};
use avln_scene::{Material, Scene, SceneError};
use mtl::Entry;
use std::path::Path;
use surfaces::Surfaces;

/// Imports a file; Y is taken for up unless the shape says otherwise.
///
/// A missing library or picture is a warning: plain grey or a checker stands in for it.
///
/// # Errors
/// [`SceneError::Read`] when the file itself cannot be read; [`SceneError::Malformed`], with the line, when it is damaged,
/// holds no surfaces, or cannot be in metres.
pub fn import(path: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    import_as(path, &Options::default(), report)
}

/// [`import`] with axes and unit as the caller knows them.
///
/// # Errors
/// Those of [`import`].
pub fn import_as(path: &Path, options: &Options, report: &mut Report) -> Result<Scene, SceneError> {
    let fail = |reason| files::malformed(path, reason);
    let mut model = read(path, report)?;
    Frame::of(&model.mesh, options, Convention::Usual(Up::Y), report).apply(&mut model.mesh);
    check_size(&model.mesh, report).map_err(fail)?;
    named_scene(scene_name(path), model).map_err(fail)
}

/// Reads a file in its own frame.
pub(crate) fn read(path: &Path, report: &mut Report) -> Result<Model, SceneError> {
    let real = files::resolve(path, report)?;
    let bytes = files::read(&real, MAX_FILE_BYTES, report)?;
    let folder = real.parent().unwrap_or(Path::new(""));
    model(&bytes, folder, report).map_err(|reason| files::malformed(path, reason))
}

fn model(bytes: &[u8], folder: &Path, report: &mut Report) -> Checked<Model> {
    let surfaces = surfaces::parse(bytes, report)?;
    let entries = libraries(&surfaces, folder, report);
    let mut pictures = Pictures::new(folder, MAX_TEXELS);
    let mut materials = Vec::with_capacity(surfaces.materials.len());
    for name in &surfaces.materials {
        materials.push(material(name, &entries, &mut pictures, report)?);
    }
    let textures = pictures.into_textures();
    Ok(Model::of_parts(surfaces.mesh, materials, textures, surfaces.part_of, surfaces.parts))
}

/// The entries of all material libraries that the file names.
fn libraries(surfaces: &Surfaces, folder: &Path, report: &mut Report) -> Vec<Entry> {
    let mut entries = Vec::new();
    for name in &surfaces.libraries {
        let text = neighbour(folder, &name.replace('\\', "/"))
            .and_then(|path| files::read(&path, MAX_FILE_BYTES, report).map_err(|error| error.to_string()));
        match text {
            Ok(bytes) => entries.extend(mtl::parse(&String::from_utf8_lossy(&bytes))),
            Err(reason) => report.warn(format!("material library {name:?} is left out: {reason}")),
        }
    }
    entries
}

fn material(
    name: &str,
    entries: &[Entry],
    pictures: &mut Pictures,
    report: &mut Report,
) -> Checked<Material> {
    let Some(entry) = entries.iter().find(|entry| entry.name == name) else {
        if !name.is_empty() {
            report.warn(format!("material {name:?} is in no library; plain grey is in its place"));
        }
        return Ok(mtl::plain(name));
    };
    let texture = match &entry.picture {
        Some(picture) => Some(pictures.number(picture, report)?),
        None => None,
    };
    Ok(entry.material(texture))
}
