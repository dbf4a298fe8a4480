//! Real files of other people's tools, where `../shared/scenes` lies beside the repository.

use avln_formats::{glb, open};
use avln_geom::{Aabb, Point3};
use avln_scene::{InstanceId, Scene};
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
fn the_small_house_in_hm3d_layout_has_its_labelled_instances() {
    let Some(shared) = shared("the_small_house_in_hm3d_layout_has_its_labelled_instances") else { return };
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
fn every_way_to_name_an_hm3d_scene_opens_it() {
    let Some(shared) = shared("every_way_to_name_an_hm3d_scene_opens_it") else { return };
    let folder = shared.join("aws_small_house/hm3d_style/00000-SmallHouse");
    let whole = open::open(&folder).unwrap();
    assert_eq!(open::open(&folder.join("SmallHouse.glb")).unwrap().objects, whole.objects);
}

#[test]
fn the_small_house_as_one_file_names_its_instances() {
    let Some(shared) = shared("the_small_house_as_one_file_names_its_instances") else { return };
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
fn a_real_house_survives_the_way_out_and_back() {
    let Some(shared) = shared("a_real_house_survives_the_way_out_and_back") else { return };
    let scene = open::open(&shared.join("aws_small_house/hm3d_style/00000-SmallHouse")).unwrap();
    let back = glb::from_bytes("SmallHouse", "memory", &glb::export(&scene)).unwrap();
    check_consistent(&back);
    assert_eq!(back.objects, scene.objects);
    assert_eq!(back.regions, scene.regions);
    assert_eq!(back.mesh.triangles.len(), scene.mesh.triangles.len());
    assert_eq!(back.bounds(), scene.bounds());
}

#[test]
fn files_of_other_tools_open_in_their_documented_size() {
    let Some(shared) = shared("files_of_other_tools_open_in_their_documented_size") else { return };
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
fn a_box_in_millimetres_is_refused_with_its_size() {
    let Some(shared) = shared("a_box_in_millimetres_is_refused_with_its_size") else { return };
    let error = open::open(&shared.join("bevy/CornellBox.glb")).unwrap_err().to_string();
    assert!(error.contains("scale it") && error.contains("55"), "{error}");
}
