use super::*;
use crate::testing::{self, damaged};
use avln_geom::Aabb;
use avln_geom::Point3;

const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

#[test]
fn all_formats_have_equal_content() {
    for format in FORMATS {
        let ply = parse(&testing::ply(format), &mut ImportReport::default()).unwrap();
        assert_eq!((ply.mesh.triangles.len(), ply.mesh.positions.len()), (26, 52), "{format}");
        let objects = ply.object_of.unwrap();
        assert_eq!([objects[1], objects[2], objects[13], objects[14], objects[25]], [0, 1, 1, 2, 2]);
        assert_eq!(ply.mesh.positions[2], Point3::new(6.0, 5.0, 0.0));
        assert_eq!([ply.mesh.colors[0], ply.mesh.colors[51]], [[200; 3], [220, 20, 20]]);
        assert_eq!(ply.mesh.triangles[..2], [[0, 1, 2], [0, 2, 3]]);
    }
}

#[test]
fn import_turns_z_up() {
    let folder = tempfile::tempdir().unwrap();
    testing::write(folder.path(), "scan.ply", testing::ply("binary_little_endian"));
    let mut report = ImportReport::default();
    let scene = import(&folder.path().join("scan.ply"), &mut report).unwrap();
    assert_eq!((scene.name.as_str(), scene.objects.len(), scene.materials.len()), ("scan", 0, 1));
    assert_eq!(scene.bounds().unwrap(), Aabb::new(Point3::new(0.0, 0.0, -5.0), Point3::new(6.0, 0.9, 0.0)));
    assert!(report.warnings[0].contains("but no names"), "{report:?}");
    let options = ImportOptions { up: Some(UpAxis::Y), unit: None };
    let scene = import_as(&folder.path().join("scan.ply"), &options, &mut report).unwrap();
    assert_eq!(scene.bounds().unwrap().max, Point3::new(6.0, 5.0, 0.9));
}

#[test]
fn columns_come_in_any_order_and_type() {
    let text = "ply\nformat ascii 1.0\nelement camera 2\nproperty float fov\nproperty list uchar float rest\n\
        element face 2\nproperty list int uint vertex_index\nproperty float quality\n\
        element vertex 4\nproperty float t\nproperty float s\nproperty short z\nproperty float red\nproperty float green\n\
        property float blue\nproperty float y\nproperty float x\nproperty int object_id\nend_header\n\
        90 2 1 2\n60 0\n\
        3 0 1 2 0.5\n2 0 1 0.5\n\
        0 0.25 2 1 0.5 0 0 0 7\n1 0 2 0 0 0 0 5 7\n0 1 2 0 0 0 5 5 9\n0 0 0 0 0 0 0 0 9\n";
    let mut report = ImportReport::default();
    let ply = parse(text.as_bytes(), &mut report).unwrap();
    assert_eq!(ply.mesh.triangles, [[0, 1, 2]]);
    assert_eq!(ply.mesh.positions[1], Point3::new(5.0, 0.0, 2.0));
    assert_eq!(ply.mesh.colors[0], [255, 128, 0]);
    assert_eq!((ply.mesh.uvs[0].x, ply.mesh.uvs[0].y), (0.25, 1.0), "the first row is the lowest");
    assert_eq!(ply.object_of.unwrap(), [7], "the number of two of three vertices");
    assert!(report.warnings[0].contains("1 faces have fewer"), "{report:?}");
}

#[test]
fn texture_file_comment_is_the_texture() {
    let folder = tempfile::tempdir().unwrap();
    let text = "ply\nformat ascii 1.0\ncomment TextureFile gone.png\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty float u\nproperty float v\nelement face 1\nproperty list uchar int vertex_indices\n\
        end_header\n0 0 0 0 0\n2 0 0 1 0\n0 2 0 0 1\n3 0 1 2\n";
    testing::write(folder.path(), "one.ply", text);
    let mut report = ImportReport::default();
    let scene = import(&folder.path().join("one.ply"), &mut report).unwrap();
    assert_eq!((scene.materials[0].texture, scene.textures.len()), (Some(0), 1));
    assert!(report.warnings.iter().any(|warning| warning.contains("gone.png")), "{report:?}");
}

#[test]
fn errors_name_line_or_byte() {
    let good = String::from_utf8(testing::ply("ascii")).unwrap();
    for (from, to, expected) in [
        ("element vertex 52", "element vertex 53", "line "),
        ("element face 13", "element face 2000000000", "2000000000 rows of \"face\""),
        ("element vertex 52", "element vertex 99999999999999", "rows of \"vertex\""),
        ("200 200 200 0 0 0\n", "200 200 200 0 nan 0\n", "line 15: "),
        ("200 200 200 0 0 0\n", "200 200 200 0 1e30 0\n", "line 15: vertex 0"),
        ("0 4 0 1 2 3\n", "0 4 0 1 2 52\n", "face 0 refers to vertex 52, there are 52"),
        ("0 4 0 1 2 3\n", "0 4 0 1 2 -3\n", "line 67: face 0 refers to vertex -3"),
        ("0 4 0 1 2 3\n", "0 4000 0 1 2 3\n", "line 67: Expected 4000 list elements"),
        ("vertex_indices", "corners", "no list vertex_indices"),
        ("float x", "float width", "no x, y and z"),
    ] {
        assert!(good.contains(from), "{from}");
        let error = parse(good.replacen(from, to, 1).as_bytes(), &mut ImportReport::default()).err().unwrap();
        assert!(error.contains(expected), "{to:?}: {error}");
    }
    let binary = testing::ply("binary_little_endian");
    let error = parse(&binary[..binary.len() - 1], &mut ImportReport::default()).err().unwrap();
    assert!(error.contains("byte"), "{error}");
    let cloud = good.replace("element face 13", "element face 0");
    assert!(parse(cloud.as_bytes(), &mut ImportReport::default()).err().unwrap().contains("no faces"));
}

#[test]
fn damaged_files_never_panic() {
    for (seed, format) in FORMATS.iter().enumerate() {
        let mut errors = 0;
        damaged(&testing::ply(format), seed as u64, 3000, |bytes| {
            match parse(bytes, &mut ImportReport::default()) {
                Ok(ply) => assert!(ply.mesh.triangles.len() < 10_000),
                Err(reason) => {
                    errors += 1;
                    assert!(!reason.is_empty());
                }
            }
        });
        assert!(errors > 1000, "{format}: {errors}");
    }
}
