//! Buildings as glTF 2.0 files (Khronos, glTF 2.0 specification 2.0.1): export for any scene, import for any `.glb` or `.gltf`.
//!
//! Units are metres and Y is up, as the specification requires. Instance numbers, attributes and regions are `extras` under
//! the key `avln`: an exported scene is imported without loss. In other programs' files, a node is an instance if the name,
//! or an ancestor's name, contains a category (`chair_3`, `KitchenTable_01`); walls, floors, doors and other structure
//! have no instance.

mod document;
mod export;
mod source;
mod surfaces;

use crate::files::{self, Checked, ImportReport};
use crate::glb::source::Source;
use crate::named_model::{Model, import_named_model, scene_of_named_model};
use crate::world_frame::{ImportOptions, UpAxis, UpConvention, check_size};
use avln_scene::limits::MAX_FILE_BYTES;
use avln_scene::{Scene, SceneError};
use std::path::Path;

pub use export::export;

/// Imports a `.glb` or `.gltf` file, Y up, metres, with files in the same folder or below; missing images are warnings.
pub(crate) fn import(
    path: &Path,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    import_named_model(path, read_part(path, report)?, options, UpConvention::Fixed(UpAxis::Y), report)
}

/// Imports a file from memory; all data must be inside (`.glb`, or `data:` URIs). `label_for_errors` replaces the path in
/// errors.
///
/// # Errors
/// [`SceneError::Malformed`] if the file is damaged, exceeds one of the [`limits`](avln_scene::limits), uses an unsupported
/// compression or texture format, or cannot be in metres.
pub fn from_bytes(name: &str, label_for_errors: &str, bytes: &[u8]) -> Result<Scene, SceneError> {
    parse(bytes, None, &mut ImportReport::default())
        .and_then(|model| check_size(&model.mesh, &mut ImportReport::default()).map(|()| model))
        .and_then(|model| scene_of_named_model(name.to_owned(), model))
        .map_err(|reason| SceneError::Malformed { path: label_for_errors.to_owned(), reason })
}

/// Reads a building's surfaces, without instances, and checks their size.
pub(crate) fn read_model(path: &Path, report: &mut ImportReport) -> Result<Model, SceneError> {
    let model = read_part(path, report)?;
    // The vertical axis is not known yet: a warning about the height would mislead.
    check_size(&model.mesh, &mut ImportReport::default()).map_err(|reason| files::malformed(path, reason))?;
    Ok(model)
}

/// Reads a file's surfaces, with any extent, even none.
pub(crate) fn read_part(path: &Path, report: &mut ImportReport) -> Result<Model, SceneError> {
    let path = &files::resolve(path, report)?;
    let bytes = files::read(path, MAX_FILE_BYTES, report)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&bytes, Some(folder), report).map_err(|reason| files::malformed(path, reason))
}

fn parse(bytes: &[u8], folder: Option<&Path>, report: &mut ImportReport) -> Checked<Model> {
    surfaces::model(&Source::parse(bytes, folder)?, report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::scene_name;
    use crate::images;
    use avln_geom::{Aabb, Point2, Point3, Rng, Vector3};
    use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Region, Texture};

    mod formats;

    /// Appends a box with a material; corners carry texture coordinates and a shade.
    fn add_box(mesh: &mut Mesh, bounds: &Aabb, material: u16, instance: InstanceId, shade: [u8; 3]) {
        for axis in 0..3 {
            for side in [0.0, 1.0] {
                let first = mesh.positions.len() as u32;
                for (u, v) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
                    let mut share = Vector3::repeat(side);
                    share[(axis + 1) % 3] = u;
                    share[(axis + 2) % 3] = v;
                    mesh.positions.push(bounds.min + bounds.size().component_mul(&share));
                    mesh.uvs.push(Point2::new(u, v));
                    mesh.colors.push(shade);
                }
                let order = if side > 0.0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
                mesh.triangles.extend(order.map(|corners| corners.map(|corner| first + corner)));
                mesh.material_of.extend([material; 2]);
                mesh.instance_of.extend([instance; 2]);
            }
        }
    }

    fn texture(width: u32, height: u32, alpha: u8) -> Texture {
        let pixels =
            (0..width * height).flat_map(|texel| [(texel * 7) as u8, 250 - texel as u8, 90, alpha]).collect();
        Texture { width, height, pixels }
    }

    /// A floor slab, a red sofa and a shaded chest, in two rooms.
    fn sample() -> Scene {
        let sofa = Aabb::new(Point3::new(0.5, 0.0, -1.0), Point3::new(2.5, 0.8, 0.0));
        let chest = Aabb::new(Point3::new(3.1, 0.0, 1.3), Point3::new(3.7, 0.9, 1.9));
        let floor = Aabb::new(Point3::new(-1.0, -0.1, -3.0), Point3::new(5.0, 0.0, 3.0));
        let mut mesh = Mesh::default();
        add_box(&mut mesh, &floor, 0, InstanceId::NONE, [255; 3]);
        add_box(&mut mesh, &sofa, 1, InstanceId(4), [255; 3]);
        add_box(&mut mesh, &chest, 2, InstanceId(9), [200, 13, 96]);
        let material = |name: &str, base_color, texture, alpha_cutoff| Material {
            name: name.to_owned(),
            base_color,
            texture,
            alpha_cutoff,
        };
        let object = |id, category: &str, bounds, region, attributes| Object {
            id: InstanceId(id),
            category: category.to_owned(),
            bounds,
            region,
            attributes,
        };
        let words = |color: &str, material: &str, size: &str, shape: &str| Attributes {
            noun: "easel".to_owned(),
            color: color.to_owned(),
            material: material.to_owned(),
            size: size.to_owned(),
            shape: shape.to_owned(),
        };
        Scene {
            name: "sample".to_owned(),
            mesh,
            materials: vec![
                material("plaster", [241, 230, 7, 255], None, None),
                material("fabric", [200, 30, 1, 255], Some(0), None),
                material("wood", [255, 255, 255, 255], Some(1), Some(77)),
            ],
            textures: vec![texture(4, 2, 255), texture(3, 5, 120)],
            regions: vec![
                Region { label: "living room".to_owned(), bounds: floor, storey: 0 },
                Region { label: String::new(), bounds: chest, storey: 1 },
            ],
            objects: vec![
                object(4, "sofa", sofa, Some(0), words("red", "fabric", "large", "")),
                object(9, "chest_of_drawers", chest, None, words("", "wooden", "", "square")),
            ],
            lighting: Lighting::Painted,
        }
    }

    /// Instance, material, corners in micrometres and corner colours of a triangle.
    type Surface = (InstanceId, String, Vec<[i64; 3]>, Vec<[u8; 3]>);

    /// Every triangle, in an order that does not depend on the scene's.
    fn surfaces(scene: &Scene) -> Vec<Surface> {
        let micrometres =
            |point: &Point3<f32>| std::array::from_fn(|axis| (f64::from(point[axis]) * 1e6).round() as i64);
        let mut all: Vec<_> = (0..scene.mesh.triangles.len())
            .map(|index| {
                let corners = scene.mesh.triangles[index];
                (
                    scene.mesh.instance_of[index],
                    scene.materials[usize::from(scene.mesh.material_of[index])].name.clone(),
                    scene.corners(index).iter().map(micrometres).collect(),
                    corners.iter().map(|&corner| scene.mesh.colors[corner as usize]).collect(),
                )
            })
            .collect();
        all.sort();
        all
    }

    #[test]
    fn exported_scene_is_imported_without_loss() {
        let scene = sample();
        let back = from_bytes("sample", "memory", &export(&scene)).unwrap();
        assert_eq!(back.objects, scene.objects);
        assert_eq!(back.regions, scene.regions);
        assert_eq!(surfaces(&back), surfaces(&scene));
        assert_eq!((back.textures.len(), back.materials.len()), (2, 3));
        for material in &scene.materials {
            let found = back.materials.iter().find(|other| other.name == material.name).unwrap();
            assert_eq!(found.base_color, material.base_color);
            assert_eq!(found.alpha_cutoff, material.alpha_cutoff);
            let picture = |scene: &Scene, index: Option<u16>| {
                index.map(|index| scene.textures[usize::from(index)].clone())
            };
            assert_eq!(picture(&back, found.texture), picture(&scene, material.texture));
        }
    }

    #[test]
    fn a_strict_reader_finds_the_export_valid() {
        let scene = sample();
        let bytes = export(&scene);
        let file = gltf::Gltf::from_slice(&bytes).unwrap();
        let names: Vec<_> = file.nodes().map(|node| node.name().unwrap().to_owned()).collect();
        assert_eq!(names, ["sofa_4", "chest_of_drawers_9", "structure"]);
        let blob = file.blob.as_deref().unwrap();
        let sofa = file.nodes().next().unwrap().mesh().unwrap().primitives().next().unwrap();
        assert_eq!(sofa.bounding_box().min, [0.5, 0.0, -1.0]);
        let reader = sofa.reader(|_| Some(blob));
        assert_eq!(reader.read_positions().unwrap().count(), 24);
        assert_eq!(reader.read_indices().unwrap().into_u32().count(), 36);
        let red = sofa.material().pbr_metallic_roughness().base_color_factor()[0];
        assert!((red - 0.5776).abs() < 1e-3, "sRGB 200 is 0.578 of full light, not {red}");
        assert!(file.views().all(|view| view.offset() % 4 == 0));
    }

    #[test]
    fn damaged_files_never_panic() {
        let whole = export(&sample());
        let mut rng = Rng::new(41);
        let mut refused = 0;
        for round in 0..3000 {
            let mut bytes = whole.clone();
            for _ in 0..=rng.below(4) {
                let at = rng.below(bytes.len());
                bytes[at] ^= 1 << rng.below(8);
            }
            if round % 3 == 0 {
                bytes.truncate(rng.below(whole.len()));
            }
            refused += u32::from(from_bytes("damaged", "memory", &bytes).is_err());
        }
        assert!(refused > 1000, "every truncation at least is an error, {refused} were");
    }

    /// A glTF file around one triangle list with `positions`, patched by `change`.
    fn patched(
        positions: &[[f32; 3]],
        change: impl FnOnce(&mut serde_json::Value),
    ) -> Result<Scene, SceneError> {
        let bytes: Vec<u8> = positions.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        let coded: String = bytes.chunks(3).map(base64_group).collect();
        let mut document = serde_json::json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "name": "chair_1", "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
            "accessors": [{ "bufferView": 0, "componentType": 5126, "count": positions.len(), "type": "VEC3" }],
            "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
            "buffers": [{ "byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{coded}") }],
        });
        change(&mut document);
        from_bytes("patched", "memory", document.to_string().as_bytes())
    }

    fn base64_group(bytes: &[u8]) -> String {
        const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        let word =
            bytes.iter().fold(0_u32, |word, &byte| word << 8 | u32::from(byte)) << (8 * (3 - bytes.len()));
        let digit = |place: usize| char::from(DIGITS[(word >> (18 - 6 * place)) as usize & 63]);
        (0..4).map(|place| if place <= bytes.len() { digit(place) } else { '=' }).collect()
    }

    const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]];

    #[test]
    fn transforms_compose_and_mirrors_turn_the_winding() {
        let scene = patched(&TRIANGLE, |document| {
        document["nodes"] = serde_json::json!([
            { "children": [1], "translation": [10.0, 0.0, 0.0], "rotation": [0.0, 0.707_106_77, 0.0, 0.707_106_77] },
            { "name": "chair_1", "mesh": 0, "scale": [-1.0, 1.0, 1.0], "translation": [0.0, 0.5, 0.0] },
        ]);
    })
    .unwrap();
        // Mirrored x = 2 becomes -2; a quarter turn to the left about Y carries -X to +Z.
        let expected = [[10.0, 0.5, 0.0], [10.0, 3.5, 0.0], [10.0, 0.5, 2.0]];
        for (corner, expected) in scene.corners(0).iter().zip(expected) {
            assert!((corner - Point3::from(expected)).norm() < 1e-5, "{corner}");
        }
        assert_eq!(scene.objects[0].category, "chair");
        assert_eq!(scene.mesh.instance_of, [InstanceId(1)]);
    }

    #[test]
    fn each_fault_is_named_with_the_next_step() {
        type Change = fn(&mut serde_json::Value);
        let cases: [(&str, Change); 12] = [
            ("expected a list", |document| document["bufferViews"] = serde_json::json!("x")),
            ("accessor 7", |document| {
                document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 7.into()
            }),
            ("beyond its data", |document| document["accessors"][0]["count"] = 4_000_000_000_u64.into()),
            ("beyond its data", |document| document["bufferViews"][0]["byteStride"] = 0.into()),
            ("beyond its buffer", |document| document["bufferViews"][0]["byteOffset"] = u64::MAX.into()),
            ("twice", |document| document["nodes"][0]["children"] = serde_json::json!([0])),
            ("node 5", |document| document["nodes"][0]["children"] = serde_json::json!([5])),
            ("material 3", |document| document["meshes"][0]["primitives"][0]["material"] = 3.into()),
            ("EXT_meshopt", |document| {
                document["extensionsRequired"] = serde_json::json!(["EXT_meshopt_compression"])
            }),
            ("open it by its path", |document| document["buffers"][0]["uri"] = "other.bin".into()),
            ("extras.avln", |document| {
                document["nodes"][0]["extras"] = serde_json::json!({ "avln": { "instance": 1 } })
            }),
            ("no triangles", |document| document["nodes"][0]["mesh"] = serde_json::Value::Null),
        ];
        for (expected, change) in cases {
            let error = patched(&TRIANGLE, change).unwrap_err().to_string();
            assert!(error.starts_with("memory is not a usable scene") && error.contains(expected), "{error}");
        }
    }

    #[test]
    fn impossible_size_is_refused_with_size() {
        for (factor, size) in [(200.0, "400 x 600 x 0 m"), (0.1, "0.2 x 0.3")] {
            let positions = TRIANGLE.map(|corner| corner.map(|value| value * factor));
            let error = patched(&positions, |_| ()).unwrap_err().to_string();
            assert!(error.contains(size) && error.contains("scale it"), "{error}");
        }
        let error = patched(&[[f32::NAN; 3]; 3], |_| ()).unwrap_err().to_string();
        assert!(error.contains("finite"), "{error}");
    }

    #[test]
    fn touching_pieces_join_and_duplicates_are_renumbered() {
        let scene = patched(&TRIANGLE, |document| {
            document["scenes"][0]["nodes"] = serde_json::json!([0, 1, 2, 3, 4]);
            document["nodes"] = serde_json::json!([
                { "name": "Bed_01_001_0", "mesh": 0 },
                { "name": "Bed_01_001_1", "mesh": 0 },
                { "name": "Bed_01_001_2", "mesh": 0, "translation": [9.0, 0.0, 0.0] },
                { "name": "x", "mesh": 0, "extras": { "avln": { "instance": 7, "category": "sofa" } } },
                { "name": "x.001", "mesh": 0, "extras": { "avln": { "instance": 7, "category": "sofa" } } },
            ]);
        })
        .unwrap();
        let found: Vec<_> =
            scene.objects.iter().map(|object| (object.id.0, object.category.as_str())).collect();
        assert_eq!(found, [(1, "bed"), (2, "bed"), (3, "sofa"), (7, "sofa")]);
        assert_eq!(scene.mesh.instance_of.iter().map(|id| id.0).collect::<Vec<_>>(), [1, 1, 2, 7, 3]);
    }

    #[test]
    fn external_files_outside_the_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("inside");
        std::fs::create_dir(&inside).unwrap();
        std::fs::write(folder.path().join("secret.bin"), [0; 36]).unwrap();
        let scene = inside.join("scene.gltf");
        std::fs::write(&scene, r#"{"buffers":[{"byteLength":36,"uri":"../secret.bin"}]}"#).unwrap();
        let error =
            import(&scene, &ImportOptions::default(), &mut ImportReport::default()).unwrap_err().to_string();
        assert!(error.contains("own folder"), "{error}");
        let error =
            import(&inside.join("absent.glb"), &ImportOptions::default(), &mut ImportReport::default())
                .unwrap_err()
                .to_string();
        assert!(error.starts_with("cannot read"), "{error}");
    }

    #[test]
    fn scene_names_hold_no_other_letters() {
        assert_eq!(scene_name(Path::new("a/00800-TEEsavR23oF.basis.glb")), "00800-TEEsavR23oF");
        assert_eq!(scene_name(Path::new("my house!.glb")), "my_house_");
    }

    /// A JPEG of 16 x 8 texels, the left half (200, 40, 30), the right one (20, 60, 210).
    const JPEG: &str = concat!(
        "data:image/jpeg;base64,",
        "/9j/4AAQSkZJRgABAQAAAQABAAD/2wBDABALDA4MChAODQ4SERATGCgaGBYWGDEjJR0oOjM9PDkzODdASFxOQERXRTc4UG1R",
        "V19iZ2hnPk1xeXBkeFxlZ2P/2wBDARESEhgVGC8aGi9jQjhCY2NjY2NjY2NjY2NjY2NjY2NjY2NjY2NjY2NjY2NjY2NjY2Nj",
        "Y2NjY2NjY2NjY2NjY2P/wAARCAAIABADAREAAhEBAxEB/8QAFQABAQAAAAAAAAAAAAAAAAAABAX/xAAUEAEAAAAAAAAAAAAA",
        "AAAAAAAA/8QAFQEBAQAAAAAAAAAAAAAAAAAABgT/xAAUEQEAAAAAAAAAAAAAAAAAAAAA/9oADAMBAAIRAxEAPwCUgJhDYKf/",
        "2Q==",
    );

    #[test]
    fn jpeg_texture_colours_the_surface() {
        let scene = patched(&TRIANGLE, |document| {
            document["meshes"][0]["primitives"][0]["material"] = 0.into();
            document["materials"] =
                serde_json::json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
            document["textures"] = serde_json::json!([{ "source": 0 }]);
            document["images"] = serde_json::json!([{ "uri": JPEG }]);
        })
        .unwrap();
        let texture = &scene.textures[0];
        assert_eq!((texture.width, texture.height), (16, 8));
        for (column, expected) in [(2, [200, 40, 30, 255]), (13, [20, 60, 210, 255])] {
            let texel = &texture.pixels[4 * column..4 * column + 4];
            let close = texel.iter().zip(expected).all(|(&found, expected)| found.abs_diff(expected) < 12);
            assert!(close, "{texel:?} is not {expected:?}");
        }
        assert_eq!(scene.objects[0].attributes.color, "red");
    }

    #[test]
    fn damaged_images_never_panic() {
        let jpeg = source::load(JPEG, None, &mut 1000).unwrap();
        let png = images::encode_png(&texture(5, 7, 200));
        let mut rng = Rng::new(3);
        for whole in [jpeg, png] {
            let mut refused = 0;
            for _ in 0..1500 {
                let mut bytes = whole.clone();
                let at = rng.below(bytes.len());
                bytes[at] ^= 1 << rng.below(8);
                bytes.truncate(1 + rng.below(2 * whole.len()));
                refused += u32::from(images::decode(&bytes, &mut 1_000_000).is_err());
            }
            assert!(refused > 50, "{refused}");
        }
    }
}
