//! A house in five layouts, if `../shared/scenes` exists: equal objects, boxes and depth.

use avln_formats::{ImportReport, glb, open};
use avln_geom::{Aabb, Point3, RayMesh, Vector3};
use avln_scene::Scene;
use avln_scene::digest::digest;
use std::path::{Path, PathBuf};

/// Boxes agree within this, metres; the list that came with the house is rounded to 0.0001.
const BOX_TOLERANCE_M: f32 = 0.002;
/// Depths agree within this, metres.
const DEPTH_TOLERANCE_M: f32 = 0.002;
/// Share of rays that may differ, at object edges.
const EDGE_SHARE: f32 = 0.002;
/// Rays across and up of a picture.
const SIDE: usize = 64;

/// Layouts and paths below `aws_small_house`.
const LAYOUTS: [(&str, &str); 5] = [
    ("glTF", "combined/small_house.glb"),
    ("Habitat scene instance", "."),
    ("HM3D", "hm3d_style/00000-SmallHouse"),
    ("Matterport3D", "mp3d_style/SmallHouse"),
    ("Replica", "replica_style/small_house"),
];

fn house(test: &str) -> Option<PathBuf> {
    Some(crate::scene_folder(test)?.join("aws_small_house"))
}

/// Category and box of each thing that is no part of the building.
fn expected(house: &Path) -> Vec<(String, Aabb)> {
    let text = std::fs::read_to_string(house.join("instances.json")).expect("a list of instances");
    let list: Vec<serde_json::Value> = serde_json::from_str(&text).expect("JSON");
    let corner = |entry: &serde_json::Value, key: &str| {
        Point3::from(std::array::from_fn(|axis| entry[key][axis].as_f64().expect("a number") as f32))
    };
    let thing = |entry: &serde_json::Value| {
        let category = entry["mpcat40"].as_str().expect("a category").to_owned();
        (category, Aabb::new(corner(entry, "aabb_min"), corner(entry, "aabb_max")))
    };
    let structure = ["wall", "floor", "door", "window"];
    list.iter().map(thing).filter(|(category, _)| !structure.contains(&category.as_str())).collect()
}

fn close(a: &Aabb, b: &Aabb) -> bool {
    (a.min - b.min).abs().max() <= BOX_TOLERANCE_M && (a.max - b.max).abs().max() <= BOX_TOLERANCE_M
}

/// Checks that the scene has exactly the expected objects.
fn check_things(layout: &str, scene: &Scene, expected: &[(String, Aabb)]) {
    for (category, bounds) in expected {
        let found = scene
            .objects
            .iter()
            .filter(|object| object.category == *category && close(&object.bounds, bounds));
        assert_eq!(found.count(), 1, "{layout}: {category} {bounds:?}");
    }
    for object in &scene.objects {
        let is_expected = expected
            .iter()
            .any(|(category, bounds)| object.category == *category && close(&object.bounds, bounds));
        assert!(is_expected, "{layout}: {} {:?} is not in the list", object.category, object.bounds);
    }
}

/// Ray distances from `eye` in the four compass directions; 0 without a surface.
fn depths(scene: &Scene, eye: Point3<f32>) -> Vec<f32> {
    let rays = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
    let mut depths = Vec::new();
    for [forward, right] in [
        [-Vector3::z(), Vector3::x()],
        [Vector3::x(), Vector3::z()],
        [Vector3::z(), -Vector3::x()],
        [-Vector3::x(), -Vector3::z()],
    ] {
        for (row, column) in (0..SIDE * SIDE).map(|pixel| (pixel / SIDE, pixel % SIDE)) {
            let share = |index: usize| (index as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0;
            let direction = forward + right * share(column) - Vector3::y() * share(row);
            depths.push(rays.cast(&eye, &direction, f32::INFINITY).map_or(0.0, |hit| hit.distance));
        }
    }
    depths
}

#[test]
fn five_layouts_have_equal_objects_and_depth() {
    let Some(house) = house("five_layouts_have_equal_objects_and_depth") else { return };
    let expected = expected(&house);
    assert_eq!(expected.len(), 66);
    let eyes = [Point3::new(0.5, 1.0, 1.0), Point3::new(-6.0, 1.3, -1.0), Point3::new(6.0, 1.0, 2.0)];
    let mut first: Option<Vec<Vec<f32>>> = None;
    for (layout, place) in LAYOUTS {
        let mut report = ImportReport::default();
        let scene = open::open_with(&house.join(place), &mut report).expect(layout);
        assert_eq!(report.layout, layout);
        check_things(layout, &scene, &expected);
        let seen = eyes.map(|eye| depths(&scene, eye)).to_vec();
        let first = first.get_or_insert_with(|| seen.clone());
        for (eye, (a, b)) in first.iter().zip(&seen).enumerate() {
            let different = a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > DEPTH_TOLERANCE_M).count();
            let share = different as f32 / a.len() as f32;
            assert!(share <= EDGE_SHARE, "{layout}, eye {eye}: {share} of the rays see another depth");
            assert!(a.iter().filter(|depth| **depth > 0.3).count() > a.len() / 2, "eye {eye} sees the house");
        }
    }
}

#[test]
fn numbering_layouts_agree_on_numbers() {
    let Some(house) = house("numbering_layouts_agree_on_numbers") else { return };
    let numbered = LAYOUTS[2..].iter().map(|(_, place)| {
        let scene = open::open(&house.join(place)).expect("a scene");
        scene.objects.iter().map(|object| (object.id.0, object.category.clone())).collect::<Vec<_>>()
    });
    let numbered: Vec<_> = numbered.collect();
    assert!(numbered.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn exported_layouts_preserve_their_digest() {
    let Some(house) = house("exported_layouts_preserve_their_digest") else { return };
    for (layout, place) in LAYOUTS {
        let scene = open::open(&house.join(place)).expect(layout);
        let back = glb::from_bytes(&scene.name, "memory", &glb::export(&scene)).expect("our own file");
        assert_eq!(digest(&back), digest(&scene), "{layout}");
    }
}
