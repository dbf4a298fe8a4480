//! Real files by other tools, if `../shared/scenes` exists.

use crate::scene_folder;
use avln_formats::{ImportReport, glb, hm3d, open};
use avln_geom::{Aabb, Point3};
use avln_scene::{InstanceId, Scene};
use std::path::Path;

fn check_consistent(scene: &Scene) {
    let mesh = &scene.mesh;
    assert_eq!(mesh.material_of.len(), mesh.triangles.len());
    assert_eq!(mesh.instance_of.len(), mesh.triangles.len());
    assert_eq!((mesh.uvs.len(), mesh.colors.len()), (mesh.positions.len(), mesh.positions.len()));
    assert!(mesh.triangles.iter().flatten().all(|&corner| (corner as usize) < mesh.positions.len()));
    assert!(mesh.material_of.iter().all(|&material| usize::from(material) < scene.materials.len()));
    for texture in scene.materials.iter().filter_map(|material| material.texture) {
        let texture = &scene.textures[usize::from(texture)];
        assert_eq!(texture.pixels.len(), texture.width as usize * texture.height as usize * 4);
    }
    assert!(scene.objects.windows(2).all(|pair| pair[0].id < pair[1].id));
    for object in &scene.objects {
        assert_ne!(object.id, InstanceId::NONE);
        let triangles = (0..mesh.triangles.len()).filter(|&triangle| mesh.instance_of[triangle] == object.id);
        let corners: Vec<Point3<f32>> = triangles.flat_map(|triangle| scene.corners(triangle)).collect();
        assert_eq!(Aabb::around(&corners), Some(object.bounds), "{}", object.category);
    }
}

/// Number, category and box of an instance in the list that came with the house.
struct Expected {
    id: u32,
    category: String,
    bounds: Aabb,
}

fn expected_instances(shared: &Path) -> Vec<Expected> {
    let text = std::fs::read_to_string(shared.join("aws_small_house/instances.json")).unwrap();
    let list: Vec<serde_json::Value> = serde_json::from_str(&text).unwrap();
    let corner = |entry: &serde_json::Value, key: &str| {
        Point3::from(std::array::from_fn(|axis| entry[key][axis].as_f64().unwrap() as f32))
    };
    let read = |entry: &serde_json::Value| Expected {
        id: entry["id"].as_u64().unwrap() as u32,
        category: entry["mpcat40"].as_str().unwrap().to_owned(),
        bounds: Aabb::new(corner(entry, "aabb_min"), corner(entry, "aabb_max")),
    };
    list.iter().map(read).collect()
}

fn close(a: &Aabb, b: &Aabb, tolerance_m: f32) -> bool {
    (a.min - b.min).abs().max() <= tolerance_m && (a.max - b.max).abs().max() <= tolerance_m
}

#[test]
fn hm3d_house_has_labelled_instances() {
    let Some(shared) = scene_folder("hm3d_house_has_labelled_instances") else {
        return;
    };
    let scene = open::open(&shared.join("aws_small_house/hm3d_style/00000-SmallHouse")).unwrap();
    check_consistent(&scene);
    assert_eq!(scene.name, "SmallHouse");
    assert!((140_000..=145_844).contains(&scene.mesh.triangles.len()), "{}", scene.mesh.triangles.len());
    assert_eq!(scene.regions.len(), 1);
    let structure = ["wall", "floor", "door", "window"];
    for expected in expected_instances(&shared) {
        let object = scene.object(InstanceId(expected.id));
        assert_eq!(object.is_none(), structure.contains(&expected.category.as_str()), "{}", expected.id);
        let Some(object) = object else { continue };
        assert_eq!(object.category, expected.category, "{}", expected.id);
        assert!(close(&object.bounds, &expected.bounds, 0.02), "{}: {:?}", expected.id, object.bounds);
        assert!(!object.attributes.color.is_empty());
        assert_eq!(object.region, Some(0));
    }
}

#[test]
fn hm3d_scene_opens_by_folder_and_file() {
    let Some(shared) = scene_folder("hm3d_scene_opens_by_folder_and_file") else { return };
    let folder = shared.join("aws_small_house/hm3d_style/00000-SmallHouse");
    let whole = open::open(&folder).unwrap();
    assert_eq!(open::open(&folder.join("SmallHouse.glb")).unwrap().objects, whole.objects);
}

#[test]
fn single_file_house_names_its_instances() {
    let Some(shared) = scene_folder("single_file_house_names_its_instances") else { return };
    let scene = open::open(&shared.join("aws_small_house/combined/small_house.glb")).unwrap();
    check_consistent(&scene);
    let expected = expected_instances(&shared);
    let matches = |wanted: &Expected| {
        let found = scene.objects.iter().filter(|object| object.category == wanted.category);
        found.filter(|object| close(&object.bounds, &wanted.bounds, 0.02)).count()
    };
    for (category, count) in
        [("bed", 1), ("sofa", 1), ("chair", 8), ("chest_of_drawers", 2), ("tv_monitor", 2)]
    {
        let wanted: Vec<&Expected> =
            expected.iter().filter(|instance| instance.category == category).collect();
        assert_eq!(wanted.len(), count);
        assert!(wanted.iter().all(|instance| matches(instance) == 1), "{category}");
        assert_eq!(
            scene.objects.iter().filter(|object| object.category == category).count(),
            count,
            "{category}"
        );
    }
    let unstructured = scene.mesh.instance_of.iter().filter(|id| **id == InstanceId::NONE).count();
    assert!(unstructured > 1000, "walls and floors belong to no instance");
}

#[test]
fn real_house_survives_export_and_import() {
    let Some(shared) = scene_folder("real_house_survives_export_and_import") else { return };
    let scene = open::open(&shared.join("aws_small_house/hm3d_style/00000-SmallHouse")).unwrap();
    let back = glb::from_bytes("SmallHouse", "memory", &glb::export(&scene)).unwrap();
    check_consistent(&back);
    assert_eq!(back.objects, scene.objects);
    assert_eq!(back.regions, scene.regions);
    assert_eq!(back.mesh.triangles.len(), scene.mesh.triangles.len());
    assert_eq!(back.bounds(), scene.bounds());
}

#[test]
fn files_of_other_tools_have_documented_sizes() {
    let Some(shared) = scene_folder("files_of_other_tools_have_documented_sizes") else { return };
    for (file, triangles, size_m) in [
        ("webxr/home-theater/home-theater.gltf", 7_915, [6.1, 3.3, 7.1]),
        ("playcanvas/vr-gallery.glb", 1_930, [10.1, 5.1, 10.1]),
        ("playcanvas/glass-table.glb", 592, [1.98, 1.25, 3.6]),
    ] {
        let scene = open::open(&shared.join(file)).unwrap();
        check_consistent(&scene);
        let size = scene.bounds().unwrap().size();
        assert_eq!(scene.mesh.triangles.len(), triangles, "{file}");
        assert!((0..3).all(|axis| (size[axis] - size_m[axis]).abs() < 0.06), "{file}: {size}");
    }
}

#[test]
fn box_in_millimetres_is_refused_with_size() {
    let Some(shared) = scene_folder("box_in_millimetres_is_refused_with_size") else { return };
    let error = open::open(&shared.join("bevy/CornellBox.glb")).unwrap_err().to_string();
    assert!(error.contains("scale it") && error.contains("55"), "{error}");
}

#[test]
fn composed_house_has_labelled_instances() {
    let Some(shared) = scene_folder("composed_house_has_labelled_instances") else { return };
    let folder = shared.join("aws_small_house");
    let mut report = ImportReport::default();
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
fn composed_house_survives_hm3d_export() {
    let Some(shared) = scene_folder("composed_house_survives_hm3d_export") else { return };
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
    let mut report = ImportReport::default();
    let back = open::open_with(folder.path(), &mut report).unwrap();
    assert_eq!((report.layout, report.warnings), ("HM3D", Vec::new()));
    assert_eq!(back.objects, scene.objects);
    assert_eq!(back.mesh.triangles.len(), scene.mesh.triangles.len());
}

#[test]
fn habitat_sim_test_data_sets_have_rooms() {
    let Some(shared) = scene_folder("habitat_sim_test_data_sets_have_rooms") else {
        return;
    };
    let sets = shared.join("habitat_sim/dataset_tests");
    let mut report = ImportReport::default();
    let scene = open::open_with(&sets.join("dataset_0"), &mut report).unwrap();
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

    let error = open::open(&sets.join("dataset_1")).unwrap_err().to_string();
    assert!(error.contains("2 scenes") && error.contains("dataset_test_scene_1"), "{error}");
}

#[test]
fn procthor_houses_use_asset_database_sizes() {
    let Some(shared) = scene_folder("procthor_houses_use_asset_database_sizes") else {
        return;
    };
    let folder = shared.join("procthor");
    let mut report = ImportReport::default();
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
    // Bed_8 is on the floor: the centre is at half the box height.
    let bed = scene.objects.iter().find(|object| object.category == "bed").unwrap();
    assert!(bed.bounds.min.y.abs() < 0.02, "{:?}", bed.bounds);
    assert!(scene.objects.iter().all(|object| object.region.is_some()));

    for stage in std::fs::read_dir(folder.join("partial_houses")).unwrap() {
        let path = stage.unwrap().path();
        let scene = open::open(&path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(scene.regions.len(), 1, "{}", path.display());
    }
}
