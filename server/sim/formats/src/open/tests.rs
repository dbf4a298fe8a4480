use super::*;
use crate::testing::{self, write};
use crate::{Unit, Up};

const HOUSE: &str = "ASCII 1.1\nH made - 0 0 0 0 0 1 1 0 0 0 0 0 0 0 0 0 0 0 6 5 3 0 0 0 0 0\nC 0 1 sofa 10 sofa 0 0 0 0 0\n\
    O 2 -1 0 4 4 1 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0\n";
const REPLICA: &str = r#"{"classes": [{"id": 3, "name": "sofa"}], "objects": [{"id": 2, "class_id": 3}]}"#;
const GIBSON: &str = r#"{"objects": [{"id": 2, "class_": "couch"}]}"#;

fn opened(path: &Path) -> (&'static str, Vec<u32>, Option<PathBuf>) {
    let mut report = Report::default();
    let scene = open_with(path, &mut report).unwrap();
    (report.layout, scene.objects.iter().map(|object| object.id.0).collect(), report.navmesh)
}

fn refusal(path: &Path) -> String {
    open(path).unwrap_err().to_string()
}

#[test]
fn a_folder_is_known_by_its_tables() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (scan, name, table, mesh) in [
        ("mp3d", "made.house", HOUSE, "made_semantic.ply"),
        ("replica", "habitat/info_semantic.json", REPLICA, "habitat/mesh_semantic.ply"),
        ("gibson", "made.scn", GIBSON, "made_semantic.ply"),
    ] {
        write(&at(scan), name, table);
        write(&at(scan), mesh, testing::ply("ascii"));
    }
    write(&at("mp3d"), "made.navmesh", "TESM");
    write(&at("plain"), "made.ply", testing::ply("ascii"));
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
    write(folder.path(), "a.ply", testing::ply("ascii"));
    write(folder.path(), "b.obj", testing::obj());
    let error = refusal(folder.path());
    assert!(
        error.contains("2 scenes") && error.contains("a.ply (PLY)") && error.contains("b.obj (OBJ)"),
        "{error}"
    );
    // A table says which of the meshes is meant.
    write(folder.path(), "a.scn", GIBSON);
    write(folder.path(), "a_semantic.ply", testing::ply("ascii"));
    assert_eq!(opened(folder.path()).0, "Gibson");
    // How Habitat loads it is no second scene.
    write(folder.path(), "a.scene_dataset_config.json", "{}");
    assert_eq!(opened(folder.path()).0, "Gibson");
    write(folder.path(), "c.house", HOUSE);
    let error = refusal(folder.path());
    assert!(error.contains("c.house (Matterport3D)") && error.contains("a.scn (Gibson)"), "{error}");
}

#[test]
fn what_leads_to_no_scene_is_named_with_what_would() {
    let folder = tempfile::tempdir().unwrap();
    assert!(refusal(&folder.path().join("absent")).starts_with("cannot read"));
    write(folder.path(), "notes.txt", "nothing");
    for path in [folder.path().to_owned(), folder.path().join("notes.txt")] {
        let error = refusal(&path);
        assert!(error.contains("Matterport3D (X.house)"), "{error}");
    }
}

#[test]
fn axes_and_units_are_taken_from_the_caller() {
    let folder = tempfile::tempdir().unwrap();
    let small = testing::obj();
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
    let options = Options { up: Some(Up::Z), unit: Some(Unit::Millimetre) };
    let scene = open_as(folder.path(), &options, &mut Report::default()).unwrap();
    let size = scene.bounds().unwrap().size();
    assert!(
        (size.x - 6.0).abs() < 1e-4 && (size.y - 0.9).abs() < 1e-4 && (size.z - 5.0).abs() < 1e-4,
        "{size}"
    );
}
