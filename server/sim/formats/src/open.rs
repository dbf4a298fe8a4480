//! Scene opening, with layout recognition.

use crate::files::{self, ImportReport};
use crate::world_frame::ImportOptions;
use crate::{gibson, glb, habitat, hm3d, mp3d, obj, ply, procthor, replica};
use avln_scene::digest::canonical;
use avln_scene::{Scene, SceneError};
use std::path::{Path, PathBuf};

/// [`open_with`] without warnings.
pub fn open(path: &Path) -> Result<Scene, SceneError> {
    open_with(path, &mut ImportReport::default())
}

/// [`open_as`] with the layout's axis and unit.
pub fn open_with(path: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    open_as(path, &ImportOptions::default(), report)
}

/// Opens a folder or file. The files present select the layout: HM3D, Matterport3D, Replica, Gibson, Habitat's scene
/// configurations, ProcTHOR, or a plain glTF, OBJ or PLY file. A scan file opens the whole scan with semantics; a folder
/// must contain a single scene.
///
/// Triangles, materials and textures are in exported file order, so that both have the same digest. The report contains
/// the layout, the navmesh next to the scene, guesses and omissions.
///
/// # Errors
/// Importer errors; [`SceneError::Malformed`] if the path has no scene, or several, or if `options` are given for a layout
/// with fixed axes and units.
pub fn open_as(path: &Path, options: &ImportOptions, report: &mut ImportReport) -> Result<Scene, SceneError> {
    std::fs::metadata(path)
        .map_err(|source| SceneError::Read { path: path.display().to_string(), source })?;
    let (layout, scene) = recognised(path)?;
    report.layout = layout.name;
    report.navmesh = navmesh_beside(&scene);
    (layout.import)(&scene, options, report).map(canonical)
}

type Candidate = (&'static Layout, PathBuf);

/// Recognises the layout and main file for the only scene at `path`.
fn recognised(path: &Path) -> Result<Candidate, SceneError> {
    if !path.is_dir() {
        let found = LAYOUTS.iter().find_map(|layout| Some((layout, (layout.scene_of_file)(path)?)));
        return found.ok_or_else(|| files::malformed(path, nothing(path)));
    }
    let mut candidates: Vec<Candidate> = Vec::new();
    for layout in LAYOUTS {
        candidates.extend(in_folder(path, layout)?.into_iter().map(|scene| (layout, scene)));
    }
    // The folder of a scan also contains plain meshes and a configuration for Habitat. They are no further scenes: only the
    // candidates with the most information count.
    let most = candidates.iter().map(|(layout, _)| layout.detail).max();
    candidates.retain(|(layout, _)| Some(layout.detail) == most);
    match candidates.len() {
        0 => Err(files::malformed(path, nothing(path))),
        1 => Ok(candidates.swap_remove(0)),
        _ => Err(files::malformed(path, several(&candidates))),
    }
}

fn several(candidates: &[Candidate]) -> String {
    const SHOWN: usize = 8;
    let label = |(layout, scene): &Candidate| format!("{} ({})", scene.display(), layout.name);
    let shown: Vec<String> = candidates.iter().take(SHOWN).map(label).collect();
    let more = if candidates.len() > SHOWN { ", …" } else { "" };
    let (count, shown) = (candidates.len(), shown.join(", "));
    format!("it contains {count} scenes; use the file of one of them: {shown}{more}")
}

fn nothing(path: &Path) -> String {
    if path.extension().is_some_and(|extension| extension == "navmesh") {
        return "it is a navigation mesh, without surfaces; use the mesh next to it".to_owned();
    }
    let known: Vec<String> =
        LAYOUTS.iter().map(|layout| format!("{} ({})", layout.name, layout.sign)).collect();
    format!("no scene of a known layout is there; known layouts are {}", known.join(", "))
}

/// Scenes with a layout in a folder or the inner folders, sorted by name.
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

/// A scene's `.navmesh`: the file with the same name, or the only one in the folder.
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

struct Layout {
    name: &'static str,
    /// Characteristic file, for error messages.
    sign: &'static str,
    /// Inner folders with files in this layout.
    inner_folders: &'static [&'static str],
    /// Information level; a layout hides lower levels in the same folder.
    detail: Detail,
    /// Returns a scene's main file, for a file in a folder.
    scene_in_folder: fn(&Path) -> Option<PathBuf>,
    /// Returns a scene's main file, for a file from the caller.
    scene_of_file: fn(&Path) -> Option<PathBuf>,
    import: ImportFunction,
}

type ImportFunction = fn(&Path, &ImportOptions, &mut ImportReport) -> Result<Scene, SceneError>;

/// Information in a layout's files, in increasing order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Detail {
    /// Surfaces.
    Mesh,
    /// Scene composition, or load settings for a scan.
    Composition,
    /// Labelled objects.
    Labels,
}

const LAYOUTS: &[Layout] = &[
    Layout {
        name: "HM3D",
        sign: "X.semantic.txt next to X.glb",
        inner_folders: &[],
        detail: Detail::Labels,
        scene_in_folder: hm3d_mesh,
        scene_of_file: |file| hm3d::is_hm3d(file).then(|| file.to_owned()),
        import: |path, options, report| fixed("HM3D", options, path, report, hm3d::import),
    },
    Layout {
        name: "Habitat scene instance",
        sign: "X.scene_instance.json in a data set",
        inner_folders: &[],
        detail: Detail::Composition,
        scene_in_folder: |file| ends_with(file, habitat::DATASET_SUFFIX).then(|| file.to_owned()),
        scene_of_file: |file| habitat::is_habitat(file).then(|| file.to_owned()),
        import: |path, options, report| fixed("Habitat", options, path, report, habitat::import),
    },
    Layout {
        name: "ProcTHOR house",
        sign: "X.json",
        inner_folders: &[],
        detail: Detail::Labels,
        scene_in_folder: |file| procthor::is_procthor(file).then(|| file.to_owned()),
        scene_of_file: |file| procthor::is_procthor(file).then(|| file.to_owned()),
        import: |path, options, report| fixed("ProcTHOR", options, path, report, procthor::import),
    },
    Layout {
        name: "Matterport3D",
        sign: "X.house",
        inner_folders: &[],
        detail: Detail::Labels,
        scene_in_folder: |file| ends_with(file, mp3d::TABLE).then(|| file.to_owned()),
        scene_of_file: |file| companion(file, mp3d::TABLE),
        import: mp3d::import,
    },
    Layout {
        name: "Replica",
        sign: "habitat/info_semantic.json",
        inner_folders: &[replica::SEMANTIC_FOLDER],
        detail: Detail::Labels,
        scene_in_folder: |file| ends_with(file, replica::TABLE).then(|| file.to_owned()),
        scene_of_file: replica_table,
        import: replica::import,
    },
    Layout {
        name: "Gibson",
        sign: "X.scn",
        inner_folders: &[],
        detail: Detail::Labels,
        scene_in_folder: |file| ends_with(file, gibson::TABLE).then(|| file.to_owned()),
        scene_of_file: |file| companion(file, gibson::TABLE),
        import: gibson::import,
    },
    mesh_layout("glTF", "X.glb or X.gltf", |file| with_extension(file, &["glb", "gltf"]), glb::import),
    mesh_layout("OBJ", "X.obj", |file| with_extension(file, &["obj"]), obj::import),
    mesh_layout("PLY", "X.ply", |file| with_extension(file, &["ply"]), ply::import),
];

const fn mesh_layout(
    name: &'static str,
    sign: &'static str,
    scene: fn(&Path) -> Option<PathBuf>,
    import: ImportFunction,
) -> Layout {
    Layout {
        name,
        sign,
        inner_folders: &[],
        detail: Detail::Mesh,
        scene_in_folder: scene,
        scene_of_file: scene,
        import,
    }
}

/// Imports a scene in a layout with fixed axes and units, and refuses options.
fn fixed(
    layout: &str,
    options: &ImportOptions,
    path: &Path,
    report: &mut ImportReport,
    import: fn(&Path, &mut ImportReport) -> Result<Scene, SceneError>,
) -> Result<Scene, SceneError> {
    if *options == ImportOptions::default() {
        return import(path, report);
    }
    let reason = format!("the layout {layout} has fixed axes and units; omit --up and --units");
    Err(files::malformed(path, reason))
}

/// The mesh `X.glb` or `X.basis.glb` for an HM3D semantic file.
fn hm3d_mesh(file: &Path) -> Option<PathBuf> {
    let name = file.file_name()?.to_str()?;
    let stem = [".semantic.txt", ".semantic.glb"].iter().find_map(|suffix| name.strip_suffix(suffix))?;
    let [plain, basis] = [".glb", ".basis.glb"].map(|suffix| file.with_file_name(format!("{stem}{suffix}")));
    Some(if basis.is_file() && !plain.is_file() { basis } else { plain })
}

fn with_extension(file: &Path, extensions: &[&str]) -> Option<PathBuf> {
    has_extension(file, extensions).then(|| file.to_owned())
}

fn has_extension(file: &Path, extensions: &[&str]) -> bool {
    let extension = file.extension().map(|extension| extension.to_ascii_lowercase());
    extension.is_some_and(|extension| extensions.iter().any(|known| extension == *known))
}

fn ends_with(file: &Path, suffix: &str) -> bool {
    file.file_name().is_some_and(|name| name.to_string_lossy().ends_with(suffix))
}

/// The common start in a scan's file names.
fn stem(file: &Path) -> Option<&str> {
    let stem = file.file_name()?.to_str()?.split('.').next()?;
    Some(stem.strip_suffix("_semantic").unwrap_or(stem))
}

/// The table `X<suffix>` in the scan with `file`.
fn companion(file: &Path, suffix: &str) -> Option<PathBuf> {
    let is_part = has_extension(file, &["glb", "obj", "ply"]) || ends_with(file, suffix);
    let table = file.with_file_name(format!("{}{suffix}", stem(file)?));
    (is_part && table.is_file()).then_some(table)
}

/// The Replica table for a mesh or table `file`.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{self, write};
    use crate::{LengthUnit, UpAxis};

    const HOUSE: &str = "ASCII 1.1\nH made - 0 0 0 0 0 1 1 0 0 0 0 0 0 0 0 0 0 0 6 5 3 0 0 0 0 0\nC 0 1 sofa 10 sofa 0 0 0 0 0\n\
        O 2 -1 0 4 4 1 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0\n";
    const REPLICA: &str =
        r#"{"classes": [{"id": 3, "name": "sofa"}], "objects": [{"id": 2, "class_id": 3}]}"#;
    const GIBSON: &str = r#"{"objects": [{"id": 2, "class_": "couch"}]}"#;

    fn opened(path: &Path) -> (&'static str, Vec<u32>, Option<PathBuf>) {
        let mut report = ImportReport::default();
        let scene = open_with(path, &mut report).unwrap();
        (report.layout, scene.objects.iter().map(|object| object.id.0).collect(), report.navmesh)
    }

    fn refusal(path: &Path) -> String {
        open(path).unwrap_err().to_string()
    }

    #[test]
    fn tables_identify_the_layout() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (scan, name, table, mesh) in [
            ("mp3d", "made.house", HOUSE, "made_semantic.ply"),
            ("replica", "habitat/info_semantic.json", REPLICA, "habitat/mesh_semantic.ply"),
            ("gibson", "made.scn", GIBSON, "made_semantic.ply"),
        ] {
            write(&at(scan), name, table);
            write(&at(scan), mesh, tests::ply("ascii"));
        }
        write(&at("mp3d"), "made.navmesh", "TESM");
        write(&at("plain"), "made.ply", tests::ply("ascii"));
        let navmesh = Some(at("mp3d/made.navmesh"));
        assert_eq!(opened(&at("mp3d")), ("Matterport3D", vec![3], navmesh.clone()));
        assert_eq!(opened(&at("mp3d/made.house")), ("Matterport3D", vec![3], navmesh.clone()));
        assert_eq!(opened(&at("mp3d/made_semantic.ply")), ("Matterport3D", vec![3], navmesh));
        assert_eq!(opened(&at("replica")), ("Replica", vec![3], None));
        assert_eq!(opened(&at("replica/habitat/mesh_semantic.ply")), ("Replica", vec![3], None));
        assert_eq!(opened(&at("gibson")), ("Gibson", vec![2], None));
        assert_eq!(opened(&at("plain")), ("PLY", vec![], None));
        assert_eq!(opened(&at("plain/made.ply")), ("PLY", vec![], None));
        let error = refusal(&at("mp3d/made.navmesh"));
        assert!(error.contains("navigation mesh"), "{error}");
    }

    #[test]
    fn several_scenes_are_listed() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "a.ply", tests::ply("ascii"));
        write(folder.path(), "b.obj", tests::obj());
        let error = refusal(folder.path());
        assert!(
            error.contains("2 scenes") && error.contains("a.ply (PLY)") && error.contains("b.obj (OBJ)"),
            "{error}"
        );
        // A table selects the mesh.
        write(folder.path(), "a.scn", GIBSON);
        write(folder.path(), "a_semantic.ply", tests::ply("ascii"));
        assert_eq!(opened(folder.path()).0, "Gibson");
        // Load settings for Habitat are no second scene.
        write(folder.path(), "a.scene_dataset_config.json", "{}");
        assert_eq!(opened(folder.path()).0, "Gibson");
        write(folder.path(), "c.house", HOUSE);
        let error = refusal(folder.path());
        assert!(error.contains("c.house (Matterport3D)") && error.contains("a.scn (Gibson)"), "{error}");
    }

    #[test]
    fn unknown_layouts_list_the_known_ones() {
        let folder = tempfile::tempdir().unwrap();
        assert!(refusal(&folder.path().join("absent")).starts_with("cannot read"));
        write(folder.path(), "notes.txt", "nothing");
        for path in [folder.path().to_owned(), folder.path().join("notes.txt")] {
            let error = refusal(&path);
            assert!(error.contains("Matterport3D (X.house)"), "{error}");
        }
    }

    #[test]
    fn caller_sets_axis_and_unit() {
        let folder = tempfile::tempdir().unwrap();
        let small = tests::obj();
        let big = small.lines().map(|line| match line.strip_prefix("v ") {
            Some(rest) => {
                let scaled: Vec<String> =
                    rest.split(' ').map(|word| (word.parse::<f32>().unwrap() * 1000.0).to_string()).collect();
                format!("v {}\n", scaled.join(" "))
            }
            None => format!("{line}\n"),
        });
        write(folder.path(), "big.obj", big.collect::<String>());
        let error = refusal(folder.path());
        assert!(error.contains("big.obj") && error.contains("--units mm"), "{error}");
        let options = ImportOptions { up: Some(UpAxis::Z), unit: Some(LengthUnit::Millimetre) };
        let scene = open_as(folder.path(), &options, &mut ImportReport::default()).unwrap();
        let size = scene.bounds().unwrap().size();
        assert!(
            (size.x - 6.0).abs() < 1e-4 && (size.y - 0.9).abs() < 1e-4 && (size.z - 5.0).abs() < 1e-4,
            "{size}"
        );
    }
}
