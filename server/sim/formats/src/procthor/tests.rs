use super::*;
use avln_geom::{Aabb, Point3, Rng};
use avln_scene::InstanceId;
use serde_json::{Value, json};
use tempfile::TempDir;

fn at(x: f32, y: f32, z: f32) -> Value {
    json!({ "x": x, "y": y, "z": z })
}

fn wall(id: &str, room: &str, from: [f32; 2], to: [f32; 2]) -> Value {
    let corner = |[x, z]: [f32; 2], y| at(x, y, z);
    json!({ "id": id, "roomId": room, "material": { "name": "PureWhite", "color": { "r": 1.0, "g": 0.5, "b": 0.0 } },
        "polygon": [corner(from, 0.0), corner(to, 0.0), corner(from, 2.5), corner(to, 2.5)] })
}

/// Two rooms, 0 to 4 and 4 to 6 in x, both 3 m deep in Unity's z, with a door between them, one that leads outside
/// and a window.
fn house() -> Value {
    let rectangle = |x0, x1| json!([at(x0, 0.0, 0.0), at(x0, 0.0, 3.0), at(x1, 0.0, 3.0), at(x1, 0.0, 0.0)]);
    json!({
        "metadata": { "schema": "1.0.0" },
        "rooms": [
            { "id": "room|1", "roomType": "LivingRoom", "floorMaterial": { "name": "WoodFloor" }, "floorPolygon": rectangle(0.0, 4.0) },
            { "id": "room|2", "roomType": "Bathroom", "floorMaterial": "KitchenTiles", "floorPolygon": rectangle(4.0, 6.0) },
        ],
        "walls": [
            wall("w1", "room|1", [4.0, 0.0], [4.0, 3.0]),
            wall("w2", "room|2", [4.0, 3.0], [4.0, 0.0]),
            wall("w3", "room|1", [0.0, 0.0], [4.0, 0.0]),
            wall("wall|exterior|3", "room|1", [4.0, 0.0], [0.0, 0.0]),
        ],
        "doors": [
            { "id": "door|1|2", "wall0": "w1", "wall1": "w2", "holePolygon": [at(0.5, 0.0, 0.0), at(1.5, 2.0, 0.0)] },
            { "id": "door|1|0", "wall0": "w3", "wall1": "wall|exterior|3", "holePolygon": [at(1.0, 0.0, 0.0), at(2.0, 2.0, 0.0)] },
            { "id": "door|9|9", "wall0": "nowhere", "holePolygon": [] },
        ],
        "windows": [{ "id": "window|1", "wall0": "w3", "wall1": "wall|exterior|3", "holePolygon": [at(2.5, 1.0, 0.0), at(3.5, 2.0, 0.0)] }],
        "objects": [{
            "id": "Sofa|1|0", "assetId": "Sofa_1", "position": at(2.0, 0.4, 1.5), "rotation": at(0.0, 90.0, 0.0),
            "children": [{ "id": "Pillow|1|1", "assetId": "Pillow_4", "position": at(2.0, 0.9, 1.5), "rotation": 0 }],
        }],
        "proceduralParameters": { "ceilingMaterial": { "name": "CreamDrywall" } },
    })
}

fn imported(house: &Value, with_database: bool, report: &mut ImportReport) -> Result<Scene, SceneError> {
    let folder: TempDir = tempfile::tempdir().unwrap();
    if with_database {
        let database = json!({ "Sofa": [{ "assetId": "Sofa_1", "boundingBox": at(2.0, 0.8, 1.0) }] });
        std::fs::write(folder.path().join("asset-database.json"), database.to_string()).unwrap();
    }
    let path = folder.path().join("house_1.json");
    std::fs::write(&path, house.to_string()).unwrap();
    assert!(is_procthor(&path) || house.get("rooms").is_none());
    import(&path, report)
}

/// Distance to the first surface on a ray, metres.
fn hit(scene: &Scene, from: [f32; 3], towards: [f32; 3]) -> Option<f32> {
    let (from, towards) = (Point3::from(from), avln_geom::Vector3::from(towards));
    let distance = |triangle: usize| {
        let [a, b, c] = scene.corners(triangle);
        let normal = (b - a).cross(&(c - a));
        let t = (a - from).dot(&normal) / towards.dot(&normal);
        let point = from + towards * t;
        let inside =
            [(a, b), (b, c), (c, a)].iter().all(|(p, q)| (q - p).cross(&(point - p)).dot(&normal) >= 0.0);
        (t > 0.0 && inside).then_some(t)
    };
    (0..scene.mesh.triangles.len()).filter_map(distance).min_by(f32::total_cmp)
}

#[test]
fn house_has_rooms_openings_and_boxes() {
    let mut report = ImportReport::default();
    let scene = imported(&house(), true, &mut report).unwrap();
    let labels: Vec<&str> = scene.regions.iter().map(|region| region.label.as_str()).collect();
    assert_eq!(labels, ["living room", "bathroom"]);
    assert_eq!(scene.regions[0].bounds, Aabb::new(Point3::new(0.0, 0.0, -3.0), Point3::new(4.0, 2.5, 0.0)));
    let [sofa, pillow] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
    assert_eq!((sofa.category.as_str(), sofa.region), ("sofa", Some(0)));
    // 2 m wide in Unity's x before the quarter turn, in z after it.
    assert!((sofa.bounds.size() - avln_geom::Vector3::new(1.0, 0.8, 2.0)).norm() < 1e-5, "{:?}", sofa.bounds);
    assert!((sofa.bounds.center() - Point3::new(2.0, 0.4, -1.5)).norm() < 1e-5);
    assert_eq!(pillow.category, "cushion");
    let warnings = report.warnings.join("\n");
    assert!(
        warnings.contains("Pillow_4") && warnings.contains("door|9|9") && report.warnings.len() == 2,
        "{warnings}"
    );

    let close =
        |found: Option<f32>, expected: f32| found.is_some_and(|found| (found - expected).abs() < 0.02);
    // From the middle of the bathroom to -x: through the door, 0.5 to 1.5 m from the corner, without a hit; other rays hit the wall.
    assert_eq!(hit(&scene, [5.0, 1.0, -1.0], [-1.0, 0.0, 0.0]), None);
    assert!(close(hit(&scene, [5.0, 2.2, -1.0], [-1.0, 0.0, 0.0]), 1.0), "above the door");
    assert!(close(hit(&scene, [5.0, 1.0, -2.5], [-1.0, 0.0, 0.0]), 1.0), "beside the door");
    // Front door and window are closed, and so are floor and ceiling.
    for (from, towards, expected) in [
        ([1.5, 1.0, -1.0], [0.0, 0.0, 1.0], 1.0),
        ([3.0, 1.5, -1.0], [0.0, 0.0, 1.0], 1.0),
        ([0.5, 1.0, -1.0], [0.0, -1.0, 0.0], 1.0),
        ([0.5, 1.0, -1.0], [0.0, 1.0, 0.0], 1.5),
    ] {
        assert!(close(hit(&scene, from, towards), expected), "{from:?} {towards:?}");
    }
    let orange = scene.materials.iter().any(|material| material.base_color == [255, 128, 0, 255]);
    assert!(orange, "walls keep the colour that the file gives");
}

#[test]
fn floors_face_up_and_ceilings_down() {
    let scene = imported(&house(), true, &mut ImportReport::default()).unwrap();
    let mut levels = [0, 0];
    for triangle in 0..scene.mesh.triangles.len() {
        let [a, b, c] = scene.corners(triangle);
        let up = (b - a).cross(&(c - a)).y;
        if scene.mesh.instance_of[triangle] == InstanceId::NONE && up.abs() > 1.0 {
            let is_floor = a.y == 0.0;
            assert_eq!(up > 0.0, is_floor);
            levels[usize::from(is_floor)] += 1;
        }
    }
    assert_eq!(levels, [4, 4]);
}

#[test]
fn faults_are_named() {
    type Change = fn(&mut Value);
    let cases: [(&str, Change); 7] = [
        ("0 rooms", |house| house["rooms"] = json!([])),
        ("2 corners", |house| {
            house["rooms"][0]["floorPolygon"] = json!([at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0)])
        }),
        ("crosses itself", |house| {
            house["rooms"][0]["floorPolygon"] = json!([
                at(0.0, 0.0, 0.0),
                at(3.0, 0.0, 2.0),
                at(3.0, 0.0, 0.0),
                at(0.0, 0.0, 2.0),
                at(-2.0, 0.0, 1.0)
            ]);
        }),
        ("four finite corners", |house| house["walls"][0]["polygon"] = json!([at(0.0, 0.0, 0.0)])),
        ("no holePolygon", |house| house["doors"][0]["holePolygon"] = json!([])),
        ("no ProcTHOR house", |house| house["rooms"] = json!(3)),
        ("scale it", |house| house["rooms"][0]["floorPolygon"][2] = at(4.0e6, 0.0, 3.0)),
    ];
    for (expected, change) in cases {
        let mut house = house();
        change(&mut house);
        let error =
            imported(&house, true, &mut ImportReport::default()).map(|_| expected).unwrap_err().to_string();
        assert!(error.contains("house_1.json") && error.contains(expected), "{expected}: {error}");
    }
}

#[test]
fn damaged_houses_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("house.json");
    let whole = house().to_string().into_bytes();
    let mut rng = Rng::new(11);
    let mut refused = 0;
    for round in 0..1500 {
        let mut bytes = whole.clone();
        for _ in 0..=rng.below(4) {
            let at = rng.below(bytes.len());
            bytes[at] = if rng.chance(0.7) {
                b"0123456789-\"{}[],:e"[rng.below(19)]
            } else {
                bytes[at] ^ 1 << rng.below(8)
            };
        }
        if round % 5 == 0 {
            bytes.truncate(rng.below(whole.len()));
        }
        std::fs::write(&path, bytes).unwrap();
        refused += u32::from(import(&path, &mut ImportReport::default()).is_err());
    }
    assert!(refused > 400, "{refused}");
}
