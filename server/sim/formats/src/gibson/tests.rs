use super::*;
use crate::testing::{self, damaged};

const TABLE_TEXT: &str = r#"{"objects": [
    {"class_": "couch", "id": 2, "location": [4, 3.5, 0.45], "size": [2, 1, 0.9], "parent_room": 1},
    {"class_": "dining table", "id": 1, "location": [1.5, 1.25, 0.35], "size": [1, 0.5, 0.7], "material": ["wood"]},
    {"class_": "oven", "id": 7}
]}"#;

fn check(files: &[(&str, &[u8])]) -> Report {
    let folder = tempfile::tempdir().unwrap();
    testing::write(folder.path(), "Made.scn", TABLE_TEXT);
    files.iter().for_each(|(name, content)| testing::write(folder.path(), name, content));
    let mut report = Report::default();
    let scene = import(&folder.path().join("Made.scn"), &mut report).unwrap();
    let [table, sofa] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
    assert_eq!((table.id.0, table.category.as_str()), (1, "table"));
    assert_eq!((sofa.id.0, sofa.category.as_str()), (2, "sofa"));
    assert_eq!(sofa.bounds, Aabb::new(Point3::new(3.0, 0.0, -4.0), Point3::new(5.0, 0.9, -3.0)));
    assert!(report.warnings.iter().any(|warning| warning.contains("left out (numbers 7)")), "{report:?}");
    report
}

#[test]
fn things_are_what_lies_in_their_boxes() {
    let report = check(&[("Made.obj", testing::obj().as_bytes())]);
    assert!(report.warnings.iter().any(|warning| warning.contains("inside their boxes")), "{report:?}");
}

#[test]
fn labels_on_faces_come_before_boxes() {
    let report =
        check(&[("Made_semantic.ply", &testing::ply("ascii")), ("Made.obj", testing::obj().as_bytes())]);
    assert!(!report.warnings.iter().any(|warning| warning.contains("boxes")), "{report:?}");
    check(&[("Made_semantic.ply", &testing::ply("ascii"))]);
}

#[test]
fn a_table_without_a_mesh_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    testing::write(folder.path(), "Made.scn", TABLE_TEXT);
    let error = import(&folder.path().join("Made.scn"), &mut Report::default()).unwrap_err().to_string();
    assert!(error.contains("Made.scn") && error.contains("X.obj"), "{error}");
}

#[test]
fn damage_is_an_error_and_never_a_panic() {
    let mesh = ply::parse(&testing::ply("ascii"), &mut Report::default()).unwrap().mesh;
    let frame = Frame::of(&mesh, &Options::default(), Convention::Fixed(Up::Z), &mut Report::default());
    let mut errors = 0;
    damaged(TABLE_TEXT.as_bytes(), 17, 4000, |bytes| match table::parse(bytes, InstanceId::MAX) {
        Ok(things) => assert_eq!(labels_of_boxes(&things, &frame, &mesh).len(), mesh.triangles.len()),
        Err(_) => errors += 1,
    });
    assert!(errors > 1000, "{errors}");
}
