//! Scenes composed of parts, in other people's files, where `../shared/scenes` lies beside the repository.

use avln_formats::{Report, habitat, hm3d, open};
use avln_geom::{Aabb, Point3};
use avln_scene::InstanceId;
use std::path::{Path, PathBuf};

/// The folder of shared scenes; says that `test` is skipped where there is none.
fn shared(test: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/scenes");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: {test}: needs ../shared/scenes");
    None
}

#[test]
fn the_small_house_of_parts_has_its_labelled_instances() {
    let Some(shared) = shared("the_small_house_of_parts_has_its_labelled_instances") else { return };
    let folder = shared.join("aws_small_house");
    let mut report = Report::default();
    let scene = open::open_with(&folder, &mut report).unwrap();
    assert_eq!(report.warnings, [""; 0]);
    assert_eq!(scene.name, "small_house");
    let text = std::fs::read_to_string(folder.join("instances.json")).unwrap();
    let expected: Vec<serde_json::Value> = serde_json::from_str(&text).unwrap();
    let mut things = 0;
    for instance in &expected {
        let corner = |key: &str| {
            Point3::from(std::array::from_fn(|axis| instance[key][axis].as_f64().unwrap() as f32))
        };
        let bounds = Aabb::new(corner("aabb_min"), corner("aabb_max"));
        let is_structure =
            ["wall", "floor", "door", "window"].contains(&instance["mpcat40"].as_str().unwrap());
        let object = scene.object(InstanceId(instance["id"].as_u64().unwrap() as u32));
        assert_eq!(object.is_none(), is_structure, "{instance}");
        let Some(object) = object else { continue };
        things += 1;
        assert_eq!(object.category, instance["mpcat40"].as_str().unwrap());
        let off =
            (object.bounds.min - bounds.min).abs().max().max((object.bounds.max - bounds.max).abs().max());
        assert!(off < 0.002, "{instance} lies {off} m off");
    }
    assert_eq!(scene.objects.len(), things);
}

#[test]
fn the_small_house_of_parts_comes_back_from_hm3d_layout() {
    let Some(shared) = shared("the_small_house_of_parts_comes_back_from_hm3d_layout") else { return };
    let scene = open::open(&shared.join("aws_small_house")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let exported = hm3d::export(&scene);
    let config = hm3d::dataset_config("house.glb");
    let files = [
        ("house.glb", exported.render.as_slice()),
        ("house.semantic.glb", &exported.semantic),
        ("house.semantic.txt", exported.table.as_bytes()),
        ("house.scene_dataset_config.json", config.as_bytes()),
    ];
    files.iter().for_each(|(name, bytes)| std::fs::write(folder.path().join(name), bytes).unwrap());
    let mut report = Report::default();
    let back = open::open_with(folder.path(), &mut report).unwrap();
    assert_eq!((report.layout, report.warnings), ("HM3D", Vec::new()));
    assert_eq!(back.objects, scene.objects);
    assert_eq!(back.mesh.triangles.len(), scene.mesh.triangles.len());
}

#[test]
fn the_test_data_sets_of_habitat_sim_open_with_their_rooms() {
    let Some(shared) = shared("the_test_data_sets_of_habitat_sim_open_with_their_rooms") else { return };
    let sets = shared.join("habitat_sim/dataset_tests");
    let mut report = Report::default();
    let scene = habitat::import(&sets.join("dataset_0"), &mut report).unwrap();
    assert_eq!(scene.name, "dataset_test_scene");
    let labels: Vec<&str> = scene.regions.iter().map(|region| region.label.as_str()).collect();
    assert_eq!(labels, ["bedroom", "bathroom"]);
    assert_eq!(
        scene.regions[0].bounds,
        Aabb::new(Point3::new(-25.0, -2.0, -10.0), Point3::new(-5.0, 2.0, 10.0))
    );
    // The stage, 20 x 20 m, is moved by (1.1, 2.2, 3.3).
    let center = scene.bounds().unwrap().center();
    assert!((center.x - 1.1).abs() < 0.01 && (center.z - 3.3).abs() < 0.01, "{center}");
    assert_eq!(scene.objects.len(), 2, "{:?}", report.warnings);

    let error = habitat::import(&sets.join("dataset_1"), &mut Report::default()).unwrap_err().to_string();
    assert!(error.contains("2 scenes") && error.contains("dataset_test_scene_1"), "{error}");
}

#[test]
fn houses_of_procthor_open_with_the_sizes_of_its_asset_database() {
    let Some(shared) = shared("houses_of_procthor_open_with_the_sizes_of_its_asset_database") else { return };
    let folder = shared.join("procthor");
    let mut report = Report::default();
    let scene = open::open_with(&folder.join("house_100.json"), &mut report).unwrap();
    let labels: Vec<&str> = scene.regions.iter().map(|region| region.label.as_str()).collect();
    assert_eq!(labels, ["bathroom", "bedroom"]);
    let bounds = scene.regions[0].bounds;
    assert!((bounds.min - Point3::new(0.0, 0.0, -5.696)).norm() < 1e-3, "{bounds:?}");
    assert!((bounds.max - Point3::new(5.696, 2.605, -1.899)).norm() < 1e-3, "{bounds:?}");
    let counted = |category: &str| scene.objects.iter().filter(|object| object.category == category).count();
    assert_eq!(
        [counted("bed"), counted("toilet"), counted("chest_of_drawers"), counted("picture")],
        [1, 1, 2, 6]
    );
    assert_eq!(report.warnings, [""; 0], "all sizes are known");
    // Bed_8 stands on the floor: its centre is as high as half of its box.
    let bed = scene.objects.iter().find(|object| object.category == "bed").unwrap();
    assert!(bed.bounds.min.y.abs() < 0.02, "{:?}", bed.bounds);
    assert!(scene.objects.iter().all(|object| object.region.is_some()));

    for stage in std::fs::read_dir(folder.join("partial_houses")).unwrap() {
        let path = stage.unwrap().path();
        let scene = open::open(&path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(scene.regions.len(), 1, "{}", path.display());
    }
}
