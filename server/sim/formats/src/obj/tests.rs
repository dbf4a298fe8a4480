use super::*;
use crate::tests::{self, damaged};
use avln_geom::{Aabb, Point3};

const LIBRARY: &str = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl table_1\nKd 0.5 0.3 0.1\nmap_Kd wood.png\nnewmtl sofa_1\nKd 0.9 0.1 0.1\n";

#[test]
fn objects_named_by_category_are_instances() {
    let folder = tempfile::tempdir().unwrap();
    tests::write(folder.path(), "house.obj", tests::obj());
    tests::write(folder.path(), "scan.mtl", LIBRARY);
    let mut report = ImportReport::default();
    let scene = import(&folder.path().join("house.obj"), &ImportOptions::default(), &mut report).unwrap();
    // The scan has Z up, and is flat enough for recognition.
    assert_eq!(scene.bounds().unwrap(), Aabb::new(Point3::new(0.0, 0.0, -5.0), Point3::new(6.0, 0.9, 0.0)));
    let found: Vec<(u32, &str)> =
        scene.objects.iter().map(|object| (object.id.0, object.category.as_str())).collect();
    assert_eq!(found, [(1, "table"), (2, "sofa")]);
    assert_eq!(scene.objects[1].attributes.color, "red");
    assert_eq!(scene.objects[0].bounds, Aabb::new(Point3::new(1.0, 0.0, -1.5), Point3::new(2.0, 0.7, -1.0)));
    assert_eq!(
        scene.materials.iter().map(|material| material.texture).collect::<Vec<_>>(),
        [None, Some(0), None]
    );
    assert_eq!(scene.textures.len(), 1);
    let says = |words: &str| report.warnings.iter().any(|warning| warning.contains(words));
    assert!(says("z axis is taken for up") && says("wood.png"), "{report:?}");
}

#[test]
fn a_missing_library_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    tests::write(folder.path(), "house.obj", tests::obj());
    let mut report = ImportReport::default();
    let scene = import(&folder.path().join("house.obj"), &ImportOptions::default(), &mut report).unwrap();
    assert_eq!(scene.materials.len(), 3);
    assert!(report.warnings.iter().any(|warning| warning.contains("scan.mtl")), "{report:?}");
    assert!(
        report.warnings.iter().any(|warning| warning.contains("\"sofa_1\" is in no library")),
        "{report:?}"
    );
}

#[test]
fn vertices_with_equal_position_and_uv_are_shared() {
    let text = b"v 0 0 0 1 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nvt 0 0\nvt 0.5 0.25\nf 1/1 2/1 3/1\nf 1/1 3/1 4/2\nf 1/2 3/1 4/2\n";
    let surfaces = parse(text, &mut ImportReport::default()).unwrap();
    assert_eq!(surfaces.mesh.positions.len(), 5, "position 1 is used with two texture coordinates");
    assert_eq!(surfaces.mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 2, 3]]);
    assert_eq!((surfaces.mesh.uvs[4].x, surfaces.mesh.uvs[4].y), (0.5, 0.75), "rows count from below");
    assert_eq!([surfaces.mesh.colors[0], surfaces.mesh.colors[1]], [[255, 0, 0], [255; 3]]);
}

#[test]
fn groups_name_instances_of_unnamed_objects() {
    let corners = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\n";
    let text = format!("{corners}o House\ng chair_1\nf 1 2 3\ng Mesh7\nf 1 3 4\no bed_2\ng Mesh8\nf 1 2 4\n");
    let surfaces = parse(text.as_bytes(), &mut ImportReport::default()).unwrap();
    assert_eq!(surfaces.parts, ["chair_1", "House", "bed_2"]);
    assert_eq!(surfaces.part_of, [0, 1, 2]);
}

#[test]
fn errors_name_the_line() {
    for (text, expected) in [
        ("v 0 0 0\nv 1 0\n", "line 2: 2 numbers, 3 are needed"),
        ("v 0 0 nan\n", "line 1: \"nan\""),
        ("v 0 0 1e12\n", "line 1: \"1e12\""),
        ("v 0 0 0\nf 1 1\n", "line 2: a face has 2 corners"),
        ("v 0 0 0\nf 1 1 2\n", "line 2: it refers to vertex 2, there are 1"),
        ("v 0 0 0\nf 1/1 1/1 1/1\n", "line 2: it refers to texture coordinate 1, there are 0"),
        ("v 0 0 0\nf 1 -2 1\n", "line 2: it refers to vertex -2"),
        ("v 0 0 0\n", "no faces"),
        ("", "no faces"),
    ] {
        let error = parse(text.as_bytes(), &mut ImportReport::default()).err().unwrap();
        assert!(error.contains(expected), "{text:?}: {error}");
    }
    let long = format!("v 0 0 0\nf {}\n", "1 ".repeat(5000));
    assert!(parse(long.as_bytes(), &mut ImportReport::default()).err().unwrap().contains("4097 corners"));
}

#[test]
fn damaged_files_never_panic() {
    let text = tests::obj();
    let mut errors = 0;
    damaged(text.as_bytes(), 5, 3000, |bytes| {
        errors += usize::from(parse(bytes, &mut ImportReport::default()).is_err());
    });
    assert!(errors > 300, "{errors}");
    damaged(LIBRARY.as_bytes(), 6, 3000, |bytes| {
        let entries = mtl::parse(&String::from_utf8_lossy(bytes));
        entries.iter().for_each(|entry| drop(entry.material(Some(0))));
    });
}

#[test]
fn a_backslash_joins_lines() {
    let found: Vec<(usize, String)> =
        lines(b"f 1 \\\r\n2 3\nv\\").map(|(number, line)| (number, line.into_owned())).collect();
    assert_eq!(found[0].0, 1);
    assert_eq!(split(&found[0].1).1.split_whitespace().collect::<Vec<_>>(), ["1", "2", "3"]);
    assert_eq!(found[1], (3, "v".to_owned()));
}

#[test]
fn corners_count_from_either_end() {
    assert_eq!(corner("3", 3, 0).unwrap(), (2, None));
    assert_eq!(corner("1//7", 3, 0).unwrap(), (0, None));
    assert_eq!(corner("-1/-2/-3", 3, 2).unwrap(), (2, Some(0)));
    for wrong in ["0", "4", "-4", "1/3", "x", "", "1/x", "9223372036854775807", "-9223372036854775808"] {
        assert!(corner(wrong, 3, 2).is_err(), "{wrong}");
    }
}

#[test]
fn numbers_must_be_usable() {
    assert_eq!(numbers::<3>("1 -2.5 3e1 9", 3, 1e6).unwrap(), ([1.0, -2.5, 30.0], 3));
    for wrong in ["1 2", "1 2 x", "1 2 nan", "1 2 inf", "1 2 1e30"] {
        assert!(numbers::<3>(wrong, 3, 1e6).is_err(), "{wrong}");
    }
}
