//! The layouts by the files that betray them, in the order in which they are looked for.

use crate::frame::Options;
use crate::{Report, files, gibson, glb, habitat, hm3d, mp3d, obj, ply, procthor, replica};
use avln_scene::{Scene, SceneError};
use std::path::{Path, PathBuf};

/// A way to lay out a scene in files.
pub(super) struct Layout {
    /// What it is called.
    pub(super) name: &'static str,
    /// What betrays it, for people.
    pub(super) sign: &'static str,
    /// Folders inside a scene's that hold its files.
    pub(super) inner_folders: &'static [&'static str],
    /// Which layouts it hides in its folder: those that tell less.
    pub(super) tells: Tells,
    /// The scene that a file of a folder betrays: the file that the importer takes.
    pub(super) scene_in_folder: fn(&Path) -> Option<PathBuf>,
    /// The scene that a file named by itself belongs to.
    pub(super) scene_of_file: fn(&Path) -> Option<PathBuf>,
    pub(super) import: fn(&Path, &Options, &mut Report) -> Result<Scene, SceneError>,
}

/// What the files of a layout tell, the least first.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Tells {
    /// Surfaces.
    Mesh,
    /// Which files make up a scene, or only how Habitat loads a scan.
    Composition,
    /// Which thing is where.
    Labels,
}

pub(super) const LAYOUTS: &[Layout] = &[
    Layout {
        name: "HM3D",
        sign: "X.semantic.txt beside X.glb",
        inner_folders: &[],
        tells: Tells::Labels,
        scene_in_folder: hm3d_mesh,
        scene_of_file: |file| hm3d::is_hm3d(file).then(|| file.to_owned()),
        import: |path, options, report| {
            fixed(path, options, "HM3D").and_then(|()| hm3d::import(path, report))
        },
    },
    Layout {
        name: "Habitat scene instance",
        sign: "X.scene_instance.json in a data set",
        inner_folders: &[],
        tells: Tells::Composition,
        scene_in_folder: |file| ends_with(file, habitat::DATASET_SUFFIX).then(|| file.to_owned()),
        scene_of_file: |file| habitat::is_habitat(file).then(|| file.to_owned()),
        import: |path, options, report| {
            fixed(path, options, "Habitat").and_then(|()| habitat::import(path, report))
        },
    },
    Layout {
        name: "ProcTHOR house",
        sign: "X.json",
        inner_folders: &[],
        tells: Tells::Labels,
        scene_in_folder: |file| procthor::is_procthor(file).then(|| file.to_owned()),
        scene_of_file: |file| procthor::is_procthor(file).then(|| file.to_owned()),
        import: |path, options, report| {
            fixed(path, options, "ProcTHOR").and_then(|()| procthor::import(path, report))
        },
    },
    Layout {
        name: "Matterport3D",
        sign: "X.house",
        inner_folders: &[],
        tells: Tells::Labels,
        scene_in_folder: |file| ends_with(file, mp3d::TABLE).then(|| file.to_owned()),
        scene_of_file: |file| companion(file, mp3d::TABLE),
        import: mp3d::import_as,
    },
    Layout {
        name: "Replica",
        sign: "habitat/info_semantic.json",
        inner_folders: &[replica::SEMANTIC_FOLDER],
        tells: Tells::Labels,
        scene_in_folder: |file| ends_with(file, replica::TABLE).then(|| file.to_owned()),
        scene_of_file: replica_table,
        import: replica::import_as,
    },
    Layout {
        name: "Gibson",
        sign: "X.scn",
        inner_folders: &[],
        tells: Tells::Labels,
        scene_in_folder: |file| ends_with(file, gibson::TABLE).then(|| file.to_owned()),
        scene_of_file: |file| companion(file, gibson::TABLE),
        import: gibson::import_as,
    },
    Layout {
        name: "glTF",
        sign: "X.glb or X.gltf",
        inner_folders: &[],
        tells: Tells::Mesh,
        scene_in_folder: |file| has_extension(file, &["glb", "gltf"]).then(|| file.to_owned()),
        scene_of_file: |file| has_extension(file, &["glb", "gltf"]).then(|| file.to_owned()),
        import: glb::import_as,
    },
    Layout {
        name: "OBJ",
        sign: "X.obj",
        inner_folders: &[],
        tells: Tells::Mesh,
        scene_in_folder: |file| has_extension(file, &["obj"]).then(|| file.to_owned()),
        scene_of_file: |file| has_extension(file, &["obj"]).then(|| file.to_owned()),
        import: obj::import_as,
    },
    Layout {
        name: "PLY",
        sign: "X.ply",
        inner_folders: &[],
        tells: Tells::Mesh,
        scene_in_folder: |file| has_extension(file, &["ply"]).then(|| file.to_owned()),
        scene_of_file: |file| has_extension(file, &["ply"]).then(|| file.to_owned()),
        import: ply::import_as,
    },
];

/// Refuses options on a layout that fixes axes and units.
fn fixed(path: &Path, options: &Options, layout: &str) -> Result<(), SceneError> {
    if *options == Options::default() {
        return Ok(());
    }
    Err(files::malformed(
        path,
        format!("the layout {layout} fixes axes and units; leave out --up and --units"),
    ))
}

/// The mesh `X.glb` or `X.basis.glb` that a semantic file of HM3D belongs to.
fn hm3d_mesh(file: &Path) -> Option<PathBuf> {
    let name = file.file_name()?.to_str()?;
    let stem = [".semantic.txt", ".semantic.glb"].iter().find_map(|suffix| name.strip_suffix(suffix))?;
    let [plain, basis] = [".glb", ".basis.glb"].map(|suffix| file.with_file_name(format!("{stem}{suffix}")));
    Some(if basis.is_file() && !plain.is_file() { basis } else { plain })
}

fn has_extension(file: &Path, extensions: &[&str]) -> bool {
    let extension = file.extension().map(|extension| extension.to_ascii_lowercase());
    extension.is_some_and(|extension| extensions.iter().any(|known| extension == *known))
}

fn ends_with(file: &Path, suffix: &str) -> bool {
    file.file_name().is_some_and(|name| name.to_string_lossy().ends_with(suffix))
}

/// The part of the name that the files of one scan share.
fn stem(file: &Path) -> Option<&str> {
    let stem = file.file_name()?.to_str()?.split('.').next()?;
    Some(stem.strip_suffix("_semantic").unwrap_or(stem))
}

/// The table `X<suffix>` of the scan that `file` belongs to.
fn companion(file: &Path, suffix: &str) -> Option<PathBuf> {
    let is_part = has_extension(file, &["glb", "obj", "ply"]) || ends_with(file, suffix);
    let table = file.with_file_name(format!("{}{suffix}", stem(file)?));
    (is_part && table.is_file()).then_some(table)
}

/// The table of the Replica scene whose mesh or table `file` is.
fn replica_table(file: &Path) -> Option<PathBuf> {
    if ends_with(file, replica::TABLE) {
        return Some(file.to_owned());
    }
    let table = match file.file_name()?.to_str()? {
        replica::SEMANTIC_MESH => file.with_file_name(replica::TABLE),
        "mesh.ply" => file.with_file_name(replica::SEMANTIC_FOLDER).join(replica::TABLE),
        _ => return None,
    };
    table.is_file().then_some(table)
}
