//! A small scan in all PLY formats and as OBJ, damage for it, and tests of the PLY reader.

use crate::files::ImportReport;
use crate::ply::{import, parse};
use crate::world_frame::{ImportOptions, UpAxis};
use avln_geom::{Aabb, Point3, Rng};
use std::fmt::Write as _;
use std::path::Path;

/// Quads for a floor (thing 0), 6 x 5 m, a table (thing 1) and a red sofa (thing 2); Z up, counter-clockwise from outside.
pub(crate) fn quads() -> Vec<([[f32; 3]; 4], i32)> {
    let mut quads = vec![([[0.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.0, 5.0, 0.0], [0.0, 5.0, 0.0]], 0)];
    quads.extend(sides([1.0, 1.0, 0.0], [2.0, 1.5, 0.7]).map(|side| (side, 1)));
    quads.extend(sides([3.0, 3.0, 0.0], [5.0, 4.0, 0.9]).map(|side| (side, 2)));
    quads
}

/// A box's six sides.
fn sides([x0, y0, z0]: [f32; 3], [x1, y1, z1]: [f32; 3]) -> [[[f32; 3]; 4]; 6] {
    [
        [[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]],
        [[x0, y1, z0], [x1, y1, z0], [x1, y0, z0], [x0, y0, z0]],
        [[x0, y0, z0], [x1, y0, z0], [x1, y0, z1], [x0, y0, z1]],
        [[x1, y1, z0], [x0, y1, z0], [x0, y1, z1], [x1, y1, z1]],
        [[x0, y1, z0], [x0, y0, z0], [x0, y0, z1], [x0, y1, z1]],
        [[x1, y0, z0], [x1, y1, z0], [x1, y1, z1], [x1, y0, z1]],
    ]
}

fn color_of(thing: i32) -> [u8; 3] {
    [[200, 200, 200], [120, 80, 40], [220, 20, 20]][thing as usize]
}

/// The scan as a PLY file in a given format, with colours and `object_id` on faces.
pub(crate) fn ply(format: &str) -> Vec<u8> {
    let quads = quads();
    let mut file = format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex {}\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nproperty float x\nproperty double y\nproperty float z\nelement face {}\n\
         property int object_id\nproperty list uchar int vertex_indices\nend_header\n",
        4 * quads.len(),
        quads.len()
    )
    .into_bytes();
    for (corners, thing) in &quads {
        for [x, y, z] in corners {
            let [r, g, b] = color_of(*thing);
            match format {
                "ascii" => file.extend(format!("{r} {g} {b} {x} {y} {z}\n").bytes()),
                "binary_big_endian" => {
                    file.extend([r, g, b]);
                    file.extend(x.to_be_bytes());
                    file.extend(f64::from(*y).to_be_bytes());
                    file.extend(z.to_be_bytes());
                }
                _ => {
                    file.extend([r, g, b]);
                    file.extend(x.to_le_bytes());
                    file.extend(f64::from(*y).to_le_bytes());
                    file.extend(z.to_le_bytes());
                }
            }
        }
    }
    for (index, (_, thing)) in quads.iter().enumerate() {
        let corners: [i32; 4] = std::array::from_fn(|corner| (4 * index + corner) as i32);
        match format {
            "ascii" => {
                let [a, b, c, d] = corners;
                file.extend(format!("{thing} 4 {a} {b} {c} {d}\n").bytes());
            }
            "binary_big_endian" => {
                file.extend(thing.to_be_bytes());
                file.push(4);
                corners.iter().for_each(|corner| file.extend(corner.to_be_bytes()));
            }
            _ => {
                file.extend(thing.to_le_bytes());
                file.push(4);
                corners.iter().for_each(|corner| file.extend(corner.to_le_bytes()));
            }
        }
    }
    file
}

/// The scan as an OBJ file, Z up, one object per thing.
pub(crate) fn obj() -> String {
    let names = ["floor", "table_1", "sofa_1"];
    let mut text = "# made by hand\nmtllib scan.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n".to_owned();
    let mut last = -1;
    for (corners, thing) in quads() {
        if thing != last {
            let _ = writeln!(text, "o {}\nusemtl {}", names[thing as usize], names[thing as usize]);
            last = thing;
        }
        corners.iter().for_each(|[x, y, z]| {
            let _ = writeln!(text, "v {x} {y} {z}");
        });
        text.push_str("f -4/1 -3/2 -2/3 -1/4\n");
    }
    text
}

/// Writes `content` as `name` into `folder`, making folders on the way.
pub(crate) fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder is made");
    std::fs::write(path, content).expect("a file is written");
}

/// Calls `try_it` with `rounds` damaged copies: bytes are flipped, replaced by parser traps, moved or cut off.
pub(crate) fn damaged(file: &[u8], seed: u64, rounds: usize, mut try_it: impl FnMut(&[u8])) {
    const TRAPS: [&[u8]; 12] = [
        b"-1",
        b"nan",
        b"inf",
        b"1e39",
        b"4294967295",
        b"99999999999999999999",
        b"\n",
        b" ",
        b"\0\0\0\0",
        b"\xff\xff\xff\xff",
        b"\xff\xff\xff\x7f",
        b"/",
    ];
    let mut rng = Rng::new(seed);
    for _ in 0..rounds {
        let mut bytes = file.to_vec();
        for _ in 0..=rng.below(3) {
            let at = rng.below(bytes.len().max(1)).min(bytes.len());
            match rng.below(5) {
                0 => bytes.truncate(at),
                1 if at < bytes.len() => bytes[at] ^= 1 << rng.below(8),
                2 => {
                    let trap = TRAPS[rng.below(TRAPS.len())];
                    let end = (at + trap.len()).min(bytes.len());
                    bytes.splice(at..end, trap.iter().copied());
                }
                3 => {
                    let trap = TRAPS[rng.below(TRAPS.len())];
                    bytes.splice(at..at, trap.iter().copied());
                }
                _ => {
                    let end = (at + rng.below(40)).min(bytes.len());
                    bytes.drain(at..end);
                }
            }
        }
        try_it(&bytes);
    }
}

const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

#[test]
fn all_formats_have_equal_content() {
    for format in FORMATS {
        let ply = parse(&ply(format), &mut ImportReport::default()).unwrap();
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
    write(folder.path(), "scan.ply", ply("binary_little_endian"));
    let mut report = ImportReport::default();
    let scene = import(&folder.path().join("scan.ply"), &ImportOptions::default(), &mut report).unwrap();
    assert_eq!((scene.name.as_str(), scene.objects.len(), scene.materials.len()), ("scan", 0, 1));
    assert_eq!(scene.bounds().unwrap(), Aabb::new(Point3::new(0.0, 0.0, -5.0), Point3::new(6.0, 0.9, 0.0)));
    assert!(report.warnings[0].contains("but no names"), "{report:?}");
    let options = ImportOptions { up: Some(UpAxis::Y), unit: None };
    let scene = import(&folder.path().join("scan.ply"), &options, &mut report).unwrap();
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
    write(folder.path(), "one.ply", text);
    let mut report = ImportReport::default();
    let scene = import(&folder.path().join("one.ply"), &ImportOptions::default(), &mut report).unwrap();
    assert_eq!((scene.materials[0].texture, scene.textures.len()), (Some(0), 1));
    assert!(report.warnings.iter().any(|warning| warning.contains("gone.png")), "{report:?}");
}

#[test]
fn errors_name_line_or_byte() {
    let good = String::from_utf8(ply("ascii")).unwrap();
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
    let binary = ply("binary_little_endian");
    let error = parse(&binary[..binary.len() - 1], &mut ImportReport::default()).err().unwrap();
    assert!(error.contains("byte"), "{error}");
    let cloud = good.replace("element face 13", "element face 0");
    assert!(parse(cloud.as_bytes(), &mut ImportReport::default()).err().unwrap().contains("no faces"));
}

#[test]
fn damaged_files_never_panic() {
    for (seed, format) in FORMATS.iter().enumerate() {
        let mut errors = 0;
        damaged(&ply(format), seed as u64, 3000, |bytes| match parse(bytes, &mut ImportReport::default()) {
            Ok(ply) => assert!(ply.mesh.triangles.len() < 10_000),
            Err(reason) => {
                errors += 1;
                assert!(!reason.is_empty());
            }
        });
        assert!(errors > 1000, "{format}: {errors}");
    }
}
