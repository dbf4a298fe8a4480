//! Replica scans: `habitat/info_semantic.json` (objects and classes), `habitat/mesh_semantic.ply` (object numbers per face)
//! and `mesh.ply` (the same surfaces, coloured); polygons have four corners, Z is up.

use crate::files::{self, Checked, ImportReport, refuse_if, scene_name};
use crate::labels::{self, ObjectLabel, UnlabelledSurfaces};
use crate::ply::{self, Ply};
use crate::world_frame::{FileFrame, ImportOptions, UpAxis, UpConvention, check_size};
use avln_geom::Aabb;
use avln_scene::limits::MAX_ENTRIES;
use avln_scene::{InstanceId, Scene, SceneError};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub(crate) const TABLE: &str = "info_semantic.json";
pub(crate) const SEMANTIC_MESH: &str = "mesh_semantic.ply";
const RENDER_MESH: &str = "mesh.ply";
/// Inner folder with table and labelled mesh.
pub(crate) const SEMANTIC_FOLDER: &str = "habitat";
const MAX_TABLE_BYTES: u64 = 64 << 20;
/// Greatest difference between two meshes' boxes in a scan, in the file's unit.
const SAME_FRAME: f32 = 0.5;

/// Imports the scene with this table, named after the folder. Instance numbers are the table's plus one: 0 is no instance.
pub(crate) fn import(
    table: &Path,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    let bytes = files::read(table, MAX_TABLE_BYTES, report)?;
    let listed = parse(&bytes, InstanceId::MAX - 1).map_err(|reason| files::malformed(table, reason))?;
    let semantic_path = table.with_file_name(SEMANTIC_MESH);
    let mut semantic = ply::read(&semantic_path, report)?;
    let objects = semantic.object_of.take().ok_or_else(|| {
        let reason = "its faces have no object_id; use mesh_semantic.ply of the folder habitat";
        files::malformed(&semantic_path, reason)
    })?;
    let labels: Vec<u32> =
        objects.iter().map(|&object| labels::number_of_face(object.saturating_add(1))).collect();
    let render = render(table, &semantic, report)?;
    let frame = FileFrame::applied(&mut semantic.mesh, options, UpConvention::Fixed(UpAxis::Z), report);
    let (mesh, label_of) = match render {
        Some(mut render) => {
            frame.apply(&mut render.mesh);
            let label_of = labels::carried(&semantic.mesh, &labels, &render.mesh, report);
            (render.mesh, label_of)
        }
        None => (semantic.mesh, labels),
    };
    check_size(&mesh, report).map_err(|reason| files::malformed(&semantic_path, reason))?;
    let labels: Vec<ObjectLabel> =
        listed.iter().map(|object| ObjectLabel::of_words(object.id + 1, &object.class)).collect();
    Ok(labels::scene(name(table), UnlabelledSurfaces::of_scan(mesh), &label_of, &labels, Vec::new(), report))
}

/// Reads the coloured mesh, if it exists, has colours, and has the labelled mesh's extent.
fn render(table: &Path, semantic: &Ply, report: &mut ImportReport) -> Result<Option<Ply>, SceneError> {
    let folder = scene_folder(table);
    let path = folder.join(RENDER_MESH);
    if !path.is_file() {
        if !semantic.is_coloured {
            report.warn("mesh_semantic.ply has no colours, and mesh.ply is missing: all is white");
        }
        return Ok(None);
    }
    let render = ply::read(&path, report)?;
    // Some releases contain a mesh.ply in another frame: labels would land on the wrong surfaces.
    let boxes = Aabb::around(&render.mesh.positions).zip(Aabb::around(&semantic.mesh.positions));
    let is_same = boxes.is_some_and(|(a, b)| {
        (a.min - b.min).abs().max() < SAME_FRAME && (a.max - b.max).abs().max() < SAME_FRAME
    });
    if !is_same {
        report.warn("mesh.ply differs from mesh_semantic.ply in extent, and is left out");
    }
    Ok((is_same && render.is_coloured).then_some(render))
}

/// The scene folder: the table's folder, or its parent if that folder is `habitat`.
fn scene_folder(table: &Path) -> PathBuf {
    let folder = table.parent().unwrap_or(Path::new(""));
    let is_inner = folder.file_name().is_some_and(|name| name == SEMANTIC_FOLDER);
    if is_inner { folder.join("..") } else { folder.to_owned() }
}

fn name(table: &Path) -> String {
    let folder = scene_folder(table);
    let whole = std::fs::canonicalize(&folder).unwrap_or(folder);
    scene_name(&whole)
}

#[derive(Deserialize)]
struct InfoFile {
    #[serde(default)]
    classes: Vec<InfoClass>,
    #[serde(default)]
    id_to_label: Vec<i64>,
    objects: Vec<InfoObject>,
}

#[derive(Deserialize)]
struct InfoClass {
    id: i64,
    name: String,
}

#[derive(Deserialize)]
struct InfoObject {
    id: i64,
    class_id: Option<i64>,
    class_name: Option<String>,
    oriented_bbox: Option<InfoBox>,
}

#[derive(Deserialize)]
struct InfoBox {
    abb: InfoExtent,
}

#[derive(Deserialize)]
struct InfoExtent {
    sizes: [f64; 3],
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct ReplicaObject {
    id: u32,
    class: String,
}

/// Parses the table. Objects with an unknown class are left out.
fn parse(bytes: &[u8], max_id: u32) -> Checked<Vec<ReplicaObject>> {
    let file: InfoFile = serde_json::from_slice(bytes)
        .map_err(|error| format!("it is no Replica table ({error}); copy info_semantic.json again"))?;
    refuse_if(file.objects.len() > MAX_ENTRIES || file.classes.len() > MAX_ENTRIES, || {
        format!("it lists more than {MAX_ENTRIES} objects or classes")
    })?;
    let mut name_of = BTreeMap::new();
    for class in &file.classes {
        refuse_if(
            name_of.insert(class.id, class.name.as_str()).is_some_and(|before| before != class.name),
            || format!("class {} has two names", class.id),
        )?;
    }
    let mut seen = BTreeSet::new();
    let mut found = Vec::new();
    for entry in &file.objects {
        let id = labels::unique_number(entry.id, 0..=max_id, &mut seen)?;
        check_box(id, entry)?;
        let listed = || file.id_to_label.get(id as usize).copied();
        let class = entry.class_id.or_else(listed);
        let by_class = class.and_then(|class| name_of.get(&class).copied());
        if let Some(class) = by_class.or(entry.class_name.as_deref()) {
            found.push(ReplicaObject { id, class: class.to_owned() });
        }
    }
    Ok(found)
}

/// Checks an object's box. Boxes are not used, but an invalid box is a sign for a damaged file.
fn check_box(id: u32, entry: &InfoObject) -> Checked<()> {
    let sizes = entry.oriented_bbox.as_ref().map_or([0.0; 3], |oriented| oriented.abb.sizes);
    match sizes.iter().find(|size| size.is_nan() || **size < 0.0) {
        Some(size) => {
            Err(format!("the box of object {id} has the size {size} m; copy info_semantic.json again"))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{self, damaged};
    use avln_geom::Point3;

    const TABLE_TEXT: &str = r#"{
        "classes": [{"id": 1, "name": "floor"}, {"id": 2, "name": "coffee-table"}, {"id": 3, "name": "sofa"}],
        "id_to_label": [1, 2, 3],
        "objects": [
            {"id": 0, "class_id": 1, "class_name": "floor"},
            {"id": 2, "class_id": 3, "class_name": "sofa",
                "oriented_bbox": {"abb": {"center": [4, 3.5, 0.5], "sizes": [2, 1, 0.9]}, "orientation": {"rotation": [0, 0, 0, 1]}}},
            {"id": 1, "class_id": 2, "class_name": "table"}
        ]
    }"#;

    fn folder_with(files: &[(&str, &[u8])]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        tests::write(folder.path(), "room_7/habitat/info_semantic.json", TABLE_TEXT);
        files.iter().for_each(|(name, content)| tests::write(folder.path(), name, content));
        folder
    }

    fn check(folder: &Path) -> ImportReport {
        let mut report = ImportReport::default();
        let scene =
            import(&folder.join("room_7/habitat/info_semantic.json"), &ImportOptions::default(), &mut report)
                .unwrap();
        assert_eq!(scene.name, "room_7");
        let [table, sofa] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
        assert_eq!(
            (table.id.0, table.category.as_str(), table.attributes.noun.as_str()),
            (2, "table", "coffee table")
        );
        assert_eq!((sofa.id.0, sofa.category.as_str(), sofa.attributes.color.as_str()), (3, "sofa", "red"));
        assert_eq!(sofa.bounds, Aabb::new(Point3::new(3.0, 0.0, -4.0), Point3::new(5.0, 0.9, -3.0)));
        report
    }

    #[test]
    fn the_labelled_mesh_alone_is_a_scene() {
        let folder =
            folder_with(&[("room_7/habitat/mesh_semantic.ply", &tests::ply("binary_little_endian"))]);
        assert!(check(folder.path()).warnings.is_empty());
    }

    #[test]
    fn coloured_mesh_needs_the_same_extent() {
        let plain =
            String::from_utf8(tests::ply("ascii")).unwrap().replace(" red", " a").replace(" green", " b");
        let files: [(&str, &[u8]); 2] = [
            ("room_7/habitat/mesh_semantic.ply", plain.as_bytes()),
            ("room_7/mesh.ply", &tests::ply("binary_big_endian")),
        ];
        assert!(check(folder_with(&files).path()).warnings.is_empty());
        let turned = String::from_utf8(tests::ply("ascii"))
            .unwrap()
            .replace("float z", "float y")
            .replace("double y", "double z");
        let files: [(&str, &[u8]); 2] = [
            ("room_7/habitat/mesh_semantic.ply", &tests::ply("ascii")),
            ("room_7/mesh.ply", turned.as_bytes()),
        ];
        let report = check(folder_with(&files).path());
        assert!(report.warnings[0].contains("mesh.ply differs from mesh_semantic.ply"), "{report:?}");
    }

    #[test]
    fn mesh_without_labels_is_refused() {
        let plain = String::from_utf8(tests::ply("ascii")).unwrap().replace("object_id", "group");
        let folder = folder_with(&[("room_7/habitat/mesh_semantic.ply", plain.as_bytes())]);
        let table = folder.path().join("room_7/habitat/info_semantic.json");
        let error =
            import(&table, &ImportOptions::default(), &mut ImportReport::default()).unwrap_err().to_string();
        assert!(error.contains("mesh_semantic.ply") && error.contains("object_id"), "{error}");
        std::fs::remove_file(table.with_file_name(SEMANTIC_MESH)).unwrap();
        let error =
            import(&table, &ImportOptions::default(), &mut ImportReport::default()).unwrap_err().to_string();
        assert!(error.starts_with("cannot read") && error.contains("mesh_semantic.ply"), "{error}");
    }

    #[test]
    fn damaged_files_never_panic() {
        let mut errors = 0;
        damaged(TABLE_TEXT.as_bytes(), 13, 4000, |bytes| {
            errors += usize::from(parse(bytes, InstanceId::MAX - 1).is_err());
        });
        assert!(errors > 1000, "{errors}");
    }

    #[test]
    fn classes_are_found_by_number_list_or_name() {
        let text = r#"{"classes": [{"id": 3, "name": "sofa"}, {"id": 5, "name": "rug"}], "id_to_label": [5, -1],
            "objects": [{"id": 7, "class_id": 3, "class_name": "couch"}, {"id": 0},
                {"id": 1}, {"id": 9, "class_id": 77, "class_name": "lamp"}]}"#;
        let listed = parse(text.as_bytes(), 100).unwrap();
        let found: Vec<(u32, &str)> =
            listed.iter().map(|object| (object.id, object.class.as_str())).collect();
        assert_eq!(found, [(7, "sofa"), (0, "rug"), (9, "lamp")]);
    }

    #[test]
    fn errors_name_the_defect() {
        for (text, expected) in [
            (r#"{"objects": ["#, "line 1 column"),
            (r#"{"classes": []}"#, "objects"),
            (r#"{"objects": [{"id": 4}, {"id": 4}]}"#, "object number 4 is not unique"),
            (r#"{"objects": [{"id": -4}]}"#, "number -4"),
            (r#"{"objects": [{"id": 101}]}"#, "number 101"),
            (
                r#"{"objects": [{"id": 4, "oriented_bbox": {"abb": {"sizes": [1, -2, 1]}}}]}"#,
                "object 4 has the size -2",
            ),
            (r#"{"classes": [{"id": 1, "name": "a"}, {"id": 1, "name": "b"}], "objects": []}"#, "class 1"),
        ] {
            let error = parse(text.as_bytes(), 100).unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
