use super::*;
use avln_geom::{Point2, Point3};
use avln_scene::describe::{Meaning, meaning};
use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Texture};

const BED: [u8; 3] = [10, 200, 30];
const WALL: [u8; 3] = [250, 1, 99];
const LAMP: [u8; 3] = [0, 0, 255];

const TABLE: &str = "HM3D Semantic Annotations\n\
    3,0AC81E,\"bed\",5\n\
    4,FA0163,\"wall\",5\n\
    6,0000FF,\"shade, desk lamp\",-1\n";

/// A scene with flat rectangles `[x0, y0, x1, y1]` in `pieces` strips, Z up, at height z = 1, with a single material.
/// The texture has a column per rectangle, in `colors`.
fn flat(rectangles: &[[f32; 4]], colors: &[[u8; 3]], pieces: u32) -> Scene {
    let mut mesh = Mesh::default();
    for (index, &[x0, y0, x1, y1]) in rectangles.iter().enumerate() {
        let u = (index as f32 + 0.5) / rectangles.len() as f32;
        for piece in 0..pieces {
            let share = |part: u32| x0 + (x1 - x0) * part as f32 / pieces as f32;
            let first = mesh.positions.len() as u32;
            let corners =
                [(share(piece), y0), (share(piece + 1), y0), (share(piece + 1), y1), (share(piece), y1)];
            mesh.positions.extend(corners.map(|(x, y)| Point3::new(x, y, 1.0)));
            mesh.uvs.extend([Point2::new(u, 0.5); 4]);
            mesh.colors.extend([[255; 3]; 4]);
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            mesh.material_of.extend([0; 2]);
            mesh.instance_of.extend([InstanceId::NONE; 2]);
        }
    }
    let pixels = colors.iter().flat_map(|&[r, g, b]| [r, g, b, 255]).collect();
    Scene {
        name: "flat".to_owned(),
        mesh,
        materials: vec![Material {
            name: "paint".to_owned(),
            base_color: [255; 4],
            texture: Some(0),
            alpha_cutoff: None,
        }],
        textures: vec![Texture { width: colors.len() as u32, height: 1, pixels }],
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    }
}

const RECTANGLES: [[f32; 4]; 4] =
    [[0.0, 0.0, 2.0, 1.5], [3.0, 0.0, 3.2, 4.0], [5.0, 5.0, 5.3, 5.2], [8.0, 8.0, 8.5, 8.5]];

/// Writes a scene with a render mesh in `pieces` strips, and imports it.
fn imported(pieces: u32) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    let render = flat(&RECTANGLES, &[[190, 40, 40], [240; 3], [20; 3], [128; 3]], pieces);
    write("00001-made.glb", &glb::export(&render));
    let semantic = flat(&RECTANGLES, &[BED, WALL, LAMP, [7, 7, 7]], 1);
    write("00001-made.semantic.glb", &glb::export(&semantic));
    write("00001-made.semantic.txt", TABLE.as_bytes());
    import(folder.path(), &mut ImportReport::default()).unwrap()
}

#[test]
fn painted_instances_become_objects_and_walls_do_not() {
    let scene = imported(1);
    assert_eq!(scene.name, "00001-made");
    let ids: Vec<u32> = scene.mesh.instance_of.iter().map(|id| id.0).collect();
    assert_eq!(ids, [3, 3, 0, 0, 6, 6, 0, 0]);
    let [bed, lamp] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
    assert_eq!((bed.category.as_str(), bed.region), ("bed", Some(0)));
    assert_eq!(bed.bounds, Aabb::new(Point3::new(0.0, 1.0, -1.5), Point3::new(2.0, 1.0, 0.0)));
    assert_eq!(bed.attributes.color, "red");
    assert_eq!((lamp.category.as_str(), lamp.region), ("lighting", None));
    assert_eq!((lamp.attributes.color.as_str(), lamp.attributes.size.as_str()), ("black", "small"));
    // The room contains the bed and the wall, which ends at z = -4.
    assert_eq!(scene.regions.len(), 1);
    assert_eq!(scene.regions[0].bounds.min, Point3::new(0.0, 1.0, -4.0));
}

#[test]
fn another_tessellation_takes_the_nearest_label() {
    let scene = imported(4);
    assert_eq!(scene.mesh.triangles.len(), 32);
    for (triangle, id) in scene.mesh.instance_of.iter().enumerate() {
        let center = Aabb::around(&scene.corners(triangle)).unwrap().center();
        if center.x > 0.4 && center.x < 1.6 {
            assert_eq!(id.0, 3, "{center}");
        }
        if center.x > 2.5 && center.x < 4.0 || center.x > 7.0 {
            assert_eq!(*id, InstanceId::NONE, "{center}");
        }
    }
}

#[test]
fn missing_semantics_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = import(folder.path(), &mut ImportReport::default()).unwrap_err().to_string();
    assert!(error.contains("semantic.txt"), "{error}");
    let flat = glb::export(&flat(&RECTANGLES, &[BED; 4], 1));
    std::fs::write(folder.path().join("X.basis.glb"), &flat).unwrap();
    std::fs::write(folder.path().join("X.semantic.glb"), &flat).unwrap();
    let error =
        import(&folder.path().join("X.basis.glb"), &mut ImportReport::default()).unwrap_err().to_string();
    assert!(error.starts_with("cannot read") && error.contains("X.semantic.txt"), "{error}");
}

#[test]
fn unmatched_colours_and_numbers_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    let painted = glb::export(&flat(&RECTANGLES, &[BED, WALL, LAMP, [7, 7, 7]], 1));
    write("X.glb", &painted);
    write("X.semantic.glb", &painted);
    let table = format!("{TABLE}8,010203,\"chair\",1\n9,0AC81E,\"sofa\",1\n");
    write("X.semantic.txt", table.as_bytes());
    let mut report = ImportReport::default();
    let scene = import(folder.path(), &mut report).unwrap();
    assert_eq!(scene.objects.len(), 2);
    let warnings = report.warnings.join("\n");
    for part in [
        "instances 3 and 9",
        "1 painted colours are not in the table, for example 070707",
        "2 instances of the table have no surface",
    ] {
        assert!(warnings.contains(part), "{part}: {warnings}");
    }
}

/// Exports and imports a scene.
fn back(scene: &Scene) -> (Scene, ImportReport) {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    let exported = export(scene);
    write("back.glb", &exported.render);
    write("back.semantic.glb", &exported.semantic);
    write("back.semantic.txt", exported.table.as_bytes());
    let mut report = ImportReport::default();
    (import(folder.path(), &mut report).unwrap(), report)
}

#[test]
fn exported_house_preserves_its_instances() {
    let scene = avln_houses::house("made", 3, &avln_houses::HouseOptions::default());
    let (back, report) = back(&scene);
    assert_eq!(report.warnings, [""; 0]);
    assert_eq!(back.mesh.triangles.len(), scene.mesh.triangles.len());
    // A rug is an object in the scene, and floor in mpcat40.
    let is_thing = |object: &&Object| matches!(meaning(&object.category), Meaning::Object { .. });
    let things: Vec<&Object> = scene.objects.iter().filter(is_thing).collect();
    assert_eq!(back.objects.len(), things.len());
    for (found, object) in back.objects.iter().zip(things) {
        // A vase is in mpcat40's category `objects`.
        let Meaning::Object { category, .. } = meaning(&object.category) else { panic!("{object:?}") };
        assert_eq!((found.id, &found.category), (object.id, &category));
        let (a, b) = (&found.bounds, &object.bounds);
        let off = (a.min - b.min).abs().max().max((a.max - b.max).abs().max());
        assert!(off < 1e-5, "{:?} {off}", object.category);
        assert_eq!(found.region.is_some(), object.region.is_some());
        let count = |scene: &Scene| scene.mesh.instance_of.iter().filter(|id| **id == object.id).count();
        assert_eq!(count(&back), count(&scene));
    }
}

#[test]
fn exported_table_has_hm3ds_format() {
    let mut scene = flat(&[[0.0, 0.0, 2.0, 1.5]], &[BED], 1);
    let bounds = scene.bounds().unwrap();
    let object = |id: u32, category: &str, noun: &str, region| Object {
        id: InstanceId(id),
        category: category.to_owned(),
        bounds,
        region,
        attributes: Attributes { noun: noun.to_owned(), ..Attributes::default() },
    };
    scene.objects = vec![
        object(1, "chest_of_drawers", "nightstand", Some(2)),
        object(2, "chest_of_drawers", "quxotron", None),
        object(700, "a \"thing\"", "", Some(0)),
    ];
    let table = export(&scene).table;
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines[0], "HM3D Semantic Annotations");
    assert_eq!(lines[1], "1,9E37B1,\"nightstand\",2");
    assert!(
        lines[2].ends_with(",\"chest of drawers\",-1") && lines[3].ends_with(",\"a 'thing'\",0"),
        "{table}"
    );
    let colors: std::collections::BTreeSet<String> =
        lines[1..].iter().map(|line| line.split(',').nth(1).unwrap().to_owned()).collect();
    assert_eq!(colors.len(), 3);
}

#[test]
fn damaged_tables_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let painted = glb::export(&flat(&RECTANGLES, &[BED, WALL, LAMP, [7, 7, 7]], 1));
    std::fs::write(folder.path().join("X.glb"), &painted).unwrap();
    std::fs::write(folder.path().join("X.semantic.glb"), &painted).unwrap();
    let mut rng = avln_geom::Rng::new(2);
    let mut refused = 0;
    for _ in 0..1000 {
        let mut bytes = TABLE.as_bytes().to_vec();
        for _ in 0..=rng.below(3) {
            let at = rng.below(bytes.len());
            bytes[at] ^= 1 << rng.below(8);
        }
        bytes.truncate(1 + rng.below(2 * TABLE.len()));
        std::fs::write(folder.path().join("X.semantic.txt"), bytes).unwrap();
        refused += u32::from(import(folder.path(), &mut ImportReport::default()).is_err());
    }
    assert!(refused > 300, "{refused}");
}
