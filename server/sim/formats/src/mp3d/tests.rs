use super::*;
use crate::glb::export;
use crate::tests::{self, damaged};
use avln_geom::{Aabb, Point3};
use avln_scene::Lighting;

const TABLE_TEXT: &str = "ASCII 1.1\n\
    H made - 0 0 0 0 3 3 3 2 0 2 0 0 0 0 0 0 0 0 6 5 3 0 0 0 0 0\n\
    L 0 1 - 0 0 0 0 0 0 6 5 3 0 0 0 0 0\n\
    L 1 1 - 0 0 0 0 0 -3 6 5 0 0 0 0 0 0\n\
    R 0 0 0 0 l 0 0 0 0 0 0 6 5 3 3 0 0 0 0\n\
    R 1 1 0 0 k 0 0 0 0 0 -3 6 5 0 3 0 0 0 0\n\
    C 0 1 floor#tile 2 floor 0 0 0 0 0\n\
    C 1 2 office#desk 5 table 0 0 0 0 0\n\
    C 2 3 sofa 10 sofa 0 0 0 0 0\n\
    O 0 0 0 3 3 0 1 0 0 0 1 0 3 3 0 0 0 0 0 0 0 0 0\n\
    O 1 0 1 1 1 1 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0\n\
    O 2 1 2 4 4 1 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0\n\
    E 0 0 10 1 0 0 0 0 0 0 1 1 1 0 0 0 0 0\n\
    E 1 1 11 1 0 0 0 0 0 0 1 1 1 0 0 0 0 0\n\
    E 2 2 12 1 0 0 0 0 0 0 1 1 1 0 0 0 0 0\n";

/// The scan with Z up as a textured mesh would be.
fn render() -> Vec<u8> {
    let mut ply = ply::parse(&tests::ply("ascii"), &mut ImportReport::default()).unwrap();
    // Another order of triangles, so that labels are found by place.
    ply.mesh.triangles.reverse();
    export(&Scene {
        name: "made".to_owned(),
        mesh: ply.mesh,
        materials: vec![ply::material(None)],
        textures: Vec::new(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    })
}

fn imported(files: &[(&str, &[u8])]) -> (Scene, ImportReport) {
    let folder = tempfile::tempdir().unwrap();
    tests::write(folder.path(), "made.house", TABLE_TEXT);
    files.iter().for_each(|(name, content)| tests::write(folder.path(), name, content));
    let mut report = ImportReport::default();
    (import(&folder.path().join("made.house"), &ImportOptions::default(), &mut report).unwrap(), report)
}

fn check(scene: &Scene) {
    assert_eq!(scene.name, "made");
    let [desk, sofa] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
    assert_eq!((desk.id.0, desk.category.as_str(), desk.attributes.noun.as_str()), (2, "table", "desk"));
    assert_eq!((sofa.id.0, sofa.category.as_str(), sofa.attributes.color.as_str()), (3, "sofa", "red"));
    assert_eq!((desk.region, sofa.region), (Some(0), Some(1)));
    assert_eq!(sofa.bounds, Aabb::new(Point3::new(3.0, 0.0, -4.0), Point3::new(5.0, 0.9, -3.0)));
    let labelled = scene.mesh.instance_of.iter().filter(|id| id.0 != 0).count();
    assert_eq!((labelled, scene.mesh.triangles.len()), (24, 26));
    let rooms: Vec<(&str, u16)> =
        scene.regions.iter().map(|room| (room.label.as_str(), room.storey)).collect();
    assert_eq!(rooms, [("living_room", 1), ("kitchen", 0)], "the second level is below the first");
    assert_eq!(scene.regions[0].bounds, Aabb::new(Point3::new(0.0, 0.0, -5.0), Point3::new(6.0, 3.0, 0.0)));
}

#[test]
fn labels_are_carried_to_the_textured_mesh() {
    let (scene, report) =
        imported(&[("made_semantic.ply", &tests::ply("binary_little_endian")), ("made.glb", &render())]);
    check(&scene);
    assert!(report.warnings.is_empty(), "{report:?}");
}

#[test]
fn labelled_mesh_replaces_missing_textured_mesh() {
    let (scene, report) = imported(&[("made_semantic.ply", &tests::ply("binary_big_endian"))]);
    check(&scene);
    assert!(report.warnings[0].contains("colours of X_semantic.ply"), "{report:?}");
}

#[test]
fn segments_of_the_original_release_have_objects() {
    let text = String::from_utf8(tests::ply("ascii")).unwrap().replace("object_id", "face_material");
    let body = text.find("end_header").unwrap();
    let (head, body) = text.split_at(body);
    // Faces begin with their object; segments have other numbers.
    let faces: Vec<String> = body
        .lines()
        .map(|line| match line.split_once(" 4 ") {
            Some((object, rest)) if line.split(' ').count() == 6 && object.len() == 1 => {
                format!("1{object} 4 {rest}")
            }
            _ => line.to_owned(),
        })
        .collect();
    let original = format!("{head}{}\n", faces.join("\n"));
    let (scene, _) = imported(&[("made.ply", original.as_bytes())]);
    check(&scene);
}

#[test]
fn house_without_labels_has_rooms() {
    let (scene, report) = imported(&[("made.glb", &render())]);
    assert_eq!((scene.objects.len(), scene.regions.len()), (0, 2));
    assert!(report.warnings.iter().any(|warning| warning.contains("no labelled objects")), "{report:?}");
}

#[test]
fn inconsistent_files_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("made.house");
    tests::write(folder.path(), "made.house", TABLE_TEXT);
    let error =
        import(&table, &ImportOptions::default(), &mut ImportReport::default()).unwrap_err().to_string();
    assert!(
        error.contains("made.house") && error.contains("X.glb and X_semantic.ply are missing"),
        "{error}"
    );
    tests::write(folder.path(), "made_semantic.ply", &tests::ply("ascii")[..900]);
    let error =
        import(&table, &ImportOptions::default(), &mut ImportReport::default()).unwrap_err().to_string();
    assert!(error.contains("made_semantic.ply") && error.contains("line"), "{error}");
    // The table has an additional object, and lacks another.
    let more = TABLE_TEXT
        .replace("E 0 0", "O 9 0 2 4 4 1 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0\nE 0 0")
        .replace("O 1 0", "O 8 0");
    tests::write(folder.path(), "made.house", more);
    tests::write(folder.path(), "made_semantic.ply", tests::ply("ascii"));
    let mut report = ImportReport::default();
    assert_eq!(import(&table, &ImportOptions::default(), &mut report).unwrap().objects.len(), 1);
    let says = |words: &str| report.warnings.iter().any(|warning| warning.contains(words));
    assert!(says("2 labelled objects have no triangles and are left out (numbers 9, 10)"), "{report:?}");
    assert!(says("1 numbers on the mesh are not in the table and have no object (numbers 2)"), "{report:?}");
}

#[test]
fn damaged_files_never_panic() {
    let mut errors = 0;
    damaged(TABLE_TEXT.as_bytes(), 11, 4000, |bytes| match house::parse(&String::from_utf8_lossy(bytes)) {
        Ok(house) => {
            let _ = labels(&house, &BTreeMap::new());
            let mesh = avln_scene::Mesh::default();
            let frame = FileFrame::of(
                &mesh,
                &ImportOptions::default(),
                UpConvention::Fixed(UpAxis::Z),
                &mut ImportReport::default(),
            );
            let _ = regions(&house, &frame, &mut ImportReport::default());
        }
        Err(_) => errors += 1,
    });
    assert!(errors > 1000, "{errors}");
}
