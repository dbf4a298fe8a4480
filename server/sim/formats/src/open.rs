//! Opens a building in whatever layout it comes.

mod layouts;
#[cfg(test)]
mod tests;

use crate::frame::Options;
use crate::{Report, files};
use avln_scene::canonical::canonical;
use avln_scene::{Scene, SceneError};
use layouts::{LAYOUTS, Layout};
use std::path::{Path, PathBuf};

/// [`open_with`] for callers who do not care about warnings.
///
/// # Errors
/// Those of [`open_with`].
pub fn open(path: &Path) -> Result<Scene, SceneError> {
    open_with(path, &mut Report::default())
}

/// [`open_as`] with axes and units as the layout has them.
///
/// # Errors
/// Those of [`open_as`].
pub fn open_with(path: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    open_as(path, &Options::default(), report)
}

/// Opens a folder or a file in the layout that is recognised by what lies there: HM3D, Matterport3D, Replica, Gibson,
/// Habitat's scene configurations, ProcTHOR, or a plain glTF, OBJ or PLY file. A file of a scan stands for the whole scan,
/// semantics included; a folder must hold exactly one scene.
///
/// Triangles, materials and textures come in the order of an exported file: its digest is that of the scene.
///
/// The report names the layout, the navmesh that lies beside the scene, and what was guessed or left out.
///
/// # Errors
/// Those of the importer chosen; [`SceneError::Malformed`] for a path that leads to no scene or to several, which lists
/// them, and for `options` on a layout that fixes axes and units.
pub fn open_as(path: &Path, options: &Options, report: &mut Report) -> Result<Scene, SceneError> {
    let path = &existing(path)?;
    let (layout, scene) = recognised(path)?;
    report.layout = layout.name;
    report.navmesh = navmesh_beside(&scene);
    (layout.import)(&scene, options, report).map(canonical)
}

/// The path, which must lead somewhere.
fn existing(path: &Path) -> Result<PathBuf, SceneError> {
    match std::fs::metadata(path) {
        Ok(_) => Ok(path.to_owned()),
        Err(source) => Err(SceneError::Read { path: path.display().to_string(), source }),
    }
}

type Candidate = (&'static Layout, PathBuf);

/// The layout of the one scene that `path` leads to, and the file that stands for it.
fn recognised(path: &Path) -> Result<Candidate, SceneError> {
    if !path.is_dir() {
        let found = LAYOUTS.iter().find_map(|layout| Some((layout, (layout.scene_of_file)(path)?)));
        return found.ok_or_else(|| files::malformed(path, nothing(path)));
    }
    let mut candidates: Vec<Candidate> = Vec::new();
    for layout in LAYOUTS {
        candidates.extend(in_folder(path, layout)?.into_iter().map(|scene| (layout, scene)));
    }
    let most = candidates.iter().map(|(layout, _)| layout.tells).max();
    candidates.retain(|(layout, _)| Some(layout.tells) == most);
    match candidates.len() {
        0 => Err(files::malformed(path, nothing(path))),
        1 => Ok(candidates.swap_remove(0)),
        _ => Err(files::malformed(path, several(&candidates))),
    }
}

fn several(candidates: &[Candidate]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<String> = candidates
        .iter()
        .take(SHOWN)
        .map(|(layout, scene)| format!("{} ({})", scene.display(), layout.name))
        .collect();
    let more = if candidates.len() > SHOWN { ", …" } else { "" };
    format!("it holds {} scenes; name the file of one of them: {}{more}", candidates.len(), shown.join(", "))
}

fn nothing(path: &Path) -> String {
    let wanted = LAYOUTS
        .iter()
        .map(|layout| format!("{} ({})", layout.name, layout.sign))
        .collect::<Vec<_>>()
        .join(", ");
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("navmesh") => {
            "it is a navigation mesh, without surfaces; name the mesh that lies beside it".to_owned()
        }
        _ => format!("no scene of a known layout is there; known are {wanted}"),
    }
}

/// The scenes of a layout in a folder, or in a folder of it that the layout has, sorted by name.
fn in_folder(folder: &Path, layout: &Layout) -> Result<Vec<PathBuf>, SceneError> {
    let mut scenes = Vec::new();
    let inner = layout.inner_folders.iter().map(|name| folder.join(name)).filter(|inner| inner.is_dir());
    for place in std::iter::once(folder.to_owned()).chain(inner) {
        let fail = |source| SceneError::Read { path: place.display().to_string(), source };
        for entry in std::fs::read_dir(&place).map_err(fail)? {
            let file = entry.map_err(fail)?.path();
            if file.is_file() {
                scenes.extend((layout.scene_in_folder)(&file));
            }
        }
    }
    scenes.sort();
    scenes.dedup();
    Ok(scenes)
}

/// The `.navmesh` that belongs to the file `scene`: that of the same name, else the only one in the folder.
fn navmesh_beside(scene: &Path) -> Option<PathBuf> {
    let stem = scene.file_name()?.to_str()?.split('.').next()?.to_owned();
    let folder = scene.parent()?;
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let is_navmesh = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "navmesh");
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(is_navmesh)
        .collect();
    found.sort();
    let named = |path: &PathBuf| {
        path.file_name().is_some_and(|name| name.to_string_lossy().split('.').next() == Some(&stem))
    };
    match found.iter().position(named) {
        Some(index) => Some(found.swap_remove(index)),
        None if found.len() == 1 => found.pop(),
        None => None,
    }
}
