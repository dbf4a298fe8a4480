use super::*;
use crate::testing::{self, damaged};
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
    testing::write(folder.path(), "room_7/habitat/info_semantic.json", TABLE_TEXT);
    files.iter().for_each(|(name, content)| testing::write(folder.path(), name, content));
    folder
}

fn check(folder: &Path) -> Report {
    let mut report = Report::default();
    let scene = import(&folder.join("room_7/habitat/info_semantic.json"), &mut report).unwrap();
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
    let folder = folder_with(&[("room_7/habitat/mesh_semantic.ply", &testing::ply("binary_little_endian"))]);
    assert!(check(folder.path()).warnings.is_empty());
}

#[test]
fn the_coloured_mesh_is_shown_where_it_lies_in_the_same_place() {
    let plain =
        String::from_utf8(testing::ply("ascii")).unwrap().replace(" red", " a").replace(" green", " b");
    let files: [(&str, &[u8]); 2] = [
        ("room_7/habitat/mesh_semantic.ply", plain.as_bytes()),
        ("room_7/mesh.ply", &testing::ply("binary_big_endian")),
    ];
    assert!(check(folder_with(&files).path()).warnings.is_empty());
    let turned = String::from_utf8(testing::ply("ascii"))
        .unwrap()
        .replace("float z", "float y")
        .replace("double y", "double z");
    let files: [(&str, &[u8]); 2] = [
        ("room_7/habitat/mesh_semantic.ply", &testing::ply("ascii")),
        ("room_7/mesh.ply", turned.as_bytes()),
    ];
    let report = check(folder_with(&files).path());
    assert!(report.warnings[0].contains("mesh.ply does not lie where"), "{report:?}");
}

#[test]
fn a_mesh_without_labels_is_refused_by_name() {
    let plain = String::from_utf8(testing::ply("ascii")).unwrap().replace("object_id", "group");
    let folder = folder_with(&[("room_7/habitat/mesh_semantic.ply", plain.as_bytes())]);
    let table = folder.path().join("room_7/habitat/info_semantic.json");
    let error = import(&table, &mut Report::default()).unwrap_err().to_string();
    assert!(error.contains("mesh_semantic.ply") && error.contains("object_id"), "{error}");
    std::fs::remove_file(table.with_file_name(SEMANTIC_MESH)).unwrap();
    let error = import(&table, &mut Report::default()).unwrap_err().to_string();
    assert!(error.starts_with("cannot read") && error.contains("mesh_semantic.ply"), "{error}");
}

#[test]
fn damage_is_an_error_and_never_a_panic() {
    let mut errors = 0;
    damaged(TABLE_TEXT.as_bytes(), 13, 4000, |bytes| {
        errors += usize::from(info::parse(bytes, InstanceId::MAX - 1).is_err());
    });
    assert!(errors > 1000, "{errors}");
}
