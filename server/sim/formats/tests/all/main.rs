//! Tests of imports and exports with whole scenes: one digest for a scene and for its file, and equal objects, boxes and
//! depth for a house in five layouts.

mod shared_scenes;

use avln_formats::{ImportReport, glb, open};
use avln_geom::{Aabb, Point2, Point3, RayMesh, Rng, Vector3};
use avln_houses::{HouseOptions, house};
use avln_scene::digest::{canonical, digest};
use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Scene, Texture};
use std::path::{Path, PathBuf};

/// The folder of shared scenes; reports that `test` is skipped if it is missing.
fn scene_folder(test: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/scenes");
    if folder.is_dir() {
        return Some(folder);
    }
    // Not `println!`, which the test harness hides.
    let _ = std::io::Write::write_fmt(
        &mut std::io::stderr(),
        format_args!("skipped: {test}; put scenes into ../shared/scenes\n"),
    );
    None
}

/// Triangles at random places, of random things and materials.
fn scattered(seed: u64) -> Scene {
    let mut rng = Rng::new(seed);
    let mut mesh = Mesh::default();
    for _ in 0..60 {
        mesh.positions.push(Point3::new(rng.range(0.0, 5.0), rng.range(0.0, 3.0), rng.range(0.0, 4.0)));
        mesh.uvs.push(Point2::new(rng.range(0.0, 1.0), rng.range(0.0, 1.0)));
        mesh.colors.push([rng.below(256) as u8; 3]);
    }
    for _ in 0..200 {
        mesh.triangles.push(std::array::from_fn(|_| rng.below(60) as u32));
        mesh.material_of.push(rng.below(7) as u16);
        mesh.instance_of.push(InstanceId(rng.below(5) as u32));
    }
    let texture = |shade: u8| Texture { width: 1, height: 1, pixels: vec![shade, 0, 0, 255] };
    let material = |number: u8| Material {
        name: format!("m{number}"),
        base_color: [number; 4],
        texture: (!number.is_multiple_of(3)).then_some(u16::from(4 - number % 4)),
        alpha_cutoff: None,
    };
    let object = |id: u32| Object {
        id: InstanceId(id),
        category: "chair".to_owned(),
        bounds: Aabb::new(Point3::origin(), Point3::origin()),
        region: None,
        attributes: Attributes::default(),
    };
    let mut scene = Scene {
        name: "scattered".to_owned(),
        materials: (0..9).map(material).collect(),
        textures: (0..6).map(texture).collect(),
        regions: Vec::new(),
        objects: [1, 3, 4].map(object).to_vec(),
        mesh,
        lighting: Lighting::Painted,
    };
    for object in &mut scene.objects {
        let mesh = &scene.mesh;
        let whole = |[a, b, c]: [u32; 3]| a != b && b != c && c != a;
        let corners: Vec<Point3<f32>> = (0..200)
            .filter(|&triangle| mesh.instance_of[triangle] == object.id && whole(mesh.triangles[triangle]))
            .flat_map(|triangle| mesh.triangles[triangle].map(|corner| mesh.positions[corner as usize]))
            .collect();
        object.bounds = Aabb::around(&corners).unwrap();
    }
    scene
}

#[test]
fn export_and_import_preserve_the_canonical_digest() {
    for seed in 0..40 {
        let ordered = canonical(scattered(seed));
        assert_eq!((ordered.materials.len(), ordered.textures.len() < 6), (7, true));
        let back = glb::from_bytes("scattered", "memory", &glb::export(&ordered)).unwrap();
        assert_eq!(digest(&back), digest(&ordered), "{seed}");
        assert_eq!(digest(&canonical(back)), digest(&ordered), "{seed}");
    }
}

#[test]
fn every_triangle_keeps_its_position_look_and_object() {
    let scene = scattered(99);
    let ordered = canonical(scene.clone());
    let told = |scene: &Scene| {
        let known = |id: InstanceId| if scene.object(id).is_some() { id.0 } else { 0 };
        let mut told: Vec<String> = (0..scene.mesh.triangles.len())
            .filter(|&triangle| {
                let [a, b, c] = scene.mesh.triangles[triangle];
                a != b && b != c && c != a
            })
            .map(|triangle| {
                let material = &scene.materials[usize::from(scene.mesh.material_of[triangle])];
                let picture = material.texture.map(|texture| scene.textures[usize::from(texture)].pixels[0]);
                let id = known(scene.mesh.instance_of[triangle]);
                format!("{:?} {} {picture:?} {id}", scene.corners(triangle), material.name)
            })
            .collect();
        told.sort();
        told
    };
    assert_eq!(told(&ordered), told(&scene));
}

#[test]
fn exported_house_loses_its_lamps() {
    let scene = house("lamps", 1, &HouseOptions::small());
    let mut moved = scene.clone();
    let Lighting::Lamps(lamps) = &mut moved.lighting else { panic!("a house has lamps") };
    lamps[0].position.y += 0.01;
    assert_ne!(digest(&moved), digest(&scene));
    let back = glb::from_bytes("lamps", "memory", &glb::export(&scene)).unwrap();
    assert_eq!(back.lighting, Lighting::Painted);
    assert_eq!((scene.lighting.backdrop_rgb(), back.lighting.backdrop_rgb()), ([135, 176, 222], [0; 3]));
}

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

fn house_folder(test: &str) -> Option<PathBuf> {
    Some(scene_folder(test)?.join("aws_small_house"))
}

/// Category and box per object, without building parts.
fn expected_objects(house: &Path) -> Vec<(String, Aabb)> {
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
    let Some(house) = house_folder("five_layouts_have_equal_objects_and_depth") else { return };
    let expected = expected_objects(&house);
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
    let Some(house) = house_folder("numbering_layouts_agree_on_numbers") else { return };
    let numbered = LAYOUTS[2..].iter().map(|(_, place)| {
        let scene = open::open(&house.join(place)).expect("a scene");
        scene.objects.iter().map(|object| (object.id.0, object.category.clone())).collect::<Vec<_>>()
    });
    let numbered: Vec<_> = numbered.collect();
    assert!(numbered.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn exported_layouts_preserve_their_digest() {
    let Some(house) = house_folder("exported_layouts_preserve_their_digest") else { return };
    for (layout, place) in LAYOUTS {
        let scene = open::open(&house.join(place)).expect(layout);
        let back = glb::from_bytes(&scene.name, "memory", &glb::export(&scene)).expect("our own file");
        assert_eq!(digest(&back), digest(&scene), "{layout}");
    }
}
