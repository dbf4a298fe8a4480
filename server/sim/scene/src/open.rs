//! Opens a building in whatever layout it comes.

use crate::{Report, Scene, SceneError, glb, habitat, hm3d, procthor};
use std::path::{Path, PathBuf};

/// [`open_with`] for callers who do not care about warnings.
///
/// # Errors
/// Those of [`open_with`].
pub fn open(path: &Path) -> Result<Scene, SceneError> {
    open_with(path, &mut Report::default())
}

/// Opens a folder or file: HM3D where semantics lie beside the mesh ([`hm3d::import`]), scenes composed by
/// Habitat's configurations ([`habitat::import`]), houses of ProcTHOR ([`procthor::import`]), else plain glTF ([`glb::import`]); a folder without semantics must hold exactly one `.glb` or `.gltf`.
///
/// # Errors
/// Those of the importer chosen; [`SceneError::Malformed`] for a folder that holds no scene, or several.
pub fn open_with(path: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    if hm3d::is_hm3d(path) {
        report.layout = "HM3D";
        return hm3d::import(path, report);
    }
    if habitat::is_habitat(path) {
        report.layout = "Habitat scene instance";
        return habitat::import(path, report);
    }
    if procthor::is_procthor(path) {
        report.layout = "ProcTHOR house";
        return procthor::import(path, report);
    }
    report.layout = "glTF";
    if !path.is_dir() {
        return glb::import(path, report);
    }
    let mut scenes = scene_files(path)?;
    match (scenes.pop(), scenes.pop()) {
        (Some(only), None) => glb::import(&only, report),
        (None, _) => {
            Err(malformed(path, "the folder holds no .glb or .gltf; name a folder or file that does"))
        }
        _ => Err(malformed(path, "the folder holds several .glb or .gltf; name one of them")),
    }
}

/// The `.glb` and `.gltf` files of a folder, sorted by name.
fn scene_files(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let read = |source| SceneError::Read { path: folder.display().to_string(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        let path = entry.map_err(read)?.path();
        let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
        if extension.is_some_and(|extension| extension == "glb" || extension == "gltf") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn malformed(path: &Path, reason: &str) -> SceneError {
    SceneError::Malformed { path: path.display().to_string(), reason: reason.to_owned() }
}
