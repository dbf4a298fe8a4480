//! Habitat's composed scenes: `X.scene_dataset_config.json` with stages, objects and scene instances, as in HSSD, ReplicaCAD
//! and ProcTHOR for Habitat.
//!
//! A scene's path is a `.scene_instance.json`, or the folder or configuration for a data set with a single scene.
//! Frames, scales and origins are those of habitat-sim; articulated objects (URDF) are left out, with a warning.

mod assembly;
mod dataset;
mod labels;

use crate::files::{ImportReport, malformed, scene_name};
use crate::habitat::assembly::Assembly;
use crate::habitat::dataset::{Dataset, SceneInstance, TemplateKind, Templates, matching, with_suffix};
use crate::habitat::labels::CategorySources;
use avln_scene::{Scene, SceneError};
use std::path::{Path, PathBuf};

pub(crate) const DATASET_SUFFIX: &str = ".scene_dataset_config.json";
const SCENE_SUFFIX: &str = ".scene_instance.json";
/// Folders above a scene instance that may contain the data set.
const MAX_PARENTS: usize = 6;
const NAMED_SCENES: usize = 8;

/// Returns whether `path` is a scene instance, a data set configuration, or a folder with a configuration.
pub(crate) fn is_habitat(path: &Path) -> bool {
    if path.is_dir() {
        return with_suffix(path, DATASET_SUFFIX).is_ok_and(|found| !found.is_empty());
    }
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    name.ends_with(DATASET_SUFFIX) || name.ends_with(SCENE_SUFFIX)
}

/// Imports a `.scene_instance.json`, or a data set (folder or configuration) with a single scene.
///
/// An instance's number is `user_defined.instance_id`, or the next free number. Categories come from
/// `user_defined`, the semantic lexicon, the data set's metadata tables or the template's name, in this order, and become
/// mpcat40 names if possible. Missing objects are warnings.
pub(crate) fn import(path: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    let (dataset_path, scene_path) = locate(path)?;
    let dataset = Dataset::read(&dataset_path)?;
    let scene_path = match scene_path {
        Some(scene) => scene,
        None => only_scene(&dataset)?,
    };
    let instance = SceneInstance::read(&scene_path, &dataset.scene_instances)?;
    build(&dataset, &instance, &scene_path, report)
}

/// Returns the data set's configuration, and the scene instance if it is `path`.
fn locate(path: &Path) -> Result<(PathBuf, Option<PathBuf>), SceneError> {
    if path.is_dir() {
        return Ok((only_dataset(path)?, None));
    }
    if !path.to_string_lossy().ends_with(SCENE_SUFFIX) {
        return Ok((path.to_owned(), None));
    }
    for folder in path.ancestors().skip(1).take(MAX_PARENTS) {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        if !with_suffix(folder, DATASET_SUFFIX)?.is_empty() {
            return Ok((only_dataset(folder)?, Some(path.to_owned())));
        }
    }
    Err(malformed(
        path,
        format!(
            "no *{DATASET_SUFFIX} is in the {MAX_PARENTS} folders above it; put the scene into its data set"
        ),
    ))
}

fn only_dataset(folder: &Path) -> Result<PathBuf, SceneError> {
    let mut found = with_suffix(folder, DATASET_SUFFIX)?;
    match found.len() {
        1 => Ok(found.swap_remove(0)),
        0 => {
            Err(malformed(folder, format!("it contains no *{DATASET_SUFFIX}; use the folder of a data set")))
        }
        _ => Err(malformed(
            folder,
            format!("it contains {} data sets; use one of {}", found.len(), listed(&found)),
        )),
    }
}

fn only_scene(dataset: &Dataset) -> Result<PathBuf, SceneError> {
    let fail = |reason: String| malformed(&dataset.path, reason);
    let mut scenes = matching(&dataset.root, dataset.scene_instances.paths(".json"), SCENE_SUFFIX)?;
    match scenes.len() {
        1 => Ok(scenes.swap_remove(0)),
        0 => Err(fail("it lists no scene instance; use the file or folder of a scene".to_owned())),
        count => Err(fail(format!("it has {count} scenes; use one of them: {}", listed(&scenes)))),
    }
}

fn listed(paths: &[PathBuf]) -> String {
    let mut names: Vec<String> =
        paths.iter().take(NAMED_SCENES).map(|path| path.display().to_string()).collect();
    if paths.len() > NAMED_SCENES {
        names.push("…".to_owned());
    }
    names.join(", ")
}

fn build(
    dataset: &Dataset,
    scene: &SceneInstance,
    path: &Path,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    let fail = |reason: String| malformed(path, reason);
    let name = scene_name(path);
    let mut assembly = Assembly::new(name.clone());
    let stage_name = &scene.stage_instance.template_name;
    let stage =
        Templates::find(dataset, TemplateKind::Stage)?.read(stage_name, report)?.ok_or_else(|| {
            fail(format!(
                "its stage {stage_name:?} is not in the data set; add it, or correct stage_instance"
            ))
        })?;
    assembly.add_stage(&stage, &scene.stage_instance, &fail, report)?;

    let objects = Templates::find(dataset, TemplateKind::Object)?;
    let labels = CategorySources::read(dataset, report)?;
    for (number, instance) in scene.object_instances.iter().enumerate() {
        let Some(template) = objects.read(&instance.template_name, report)? else {
            report.warn(format!("object {:?} is not in the data set; left out", instance.template_name));
            continue;
        };
        let label = labels.of(instance, &template);
        assembly
            .add_object(&template, instance, scene.origin_of(instance), label, report)?
            .map_err(|why| fail(format!("its object instance {number} {why}")))?;
    }
    let articulated = scene.articulated_object_instances.len();
    if articulated > 0 {
        report.warn(format!("{articulated} articulated objects (URDF) are left out"));
    }
    let regions = labels::regions(dataset, scene, &name, report)?;
    assembly.finish(regions, report).map_err(fail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb;
    use avln_geom::{Aabb, Point2, Point3, Rng};
    use avln_scene::{InstanceId, Lighting, Material, Mesh};
    use serde_json::json;
    use tempfile::TempDir;

    /// A rectangle, `x` by `y` by `z` metres, from the origin to the opposite corner.
    fn sheet(x: f32, y: f32, z: f32) -> Vec<u8> {
        let mesh = Mesh {
            positions: vec![
                Point3::origin(),
                Point3::new(x, 0.0, 0.0),
                Point3::new(x, y, z),
                Point3::new(0.0, y, z),
            ],
            uvs: vec![Point2::origin(); 4],
            colors: vec![[255; 3]; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material_of: vec![0; 2],
            instance_of: vec![InstanceId::NONE; 2],
        };
        let paint = Material {
            name: "paint".into(),
            base_color: [200, 30, 20, 255],
            texture: None,
            alpha_cutoff: None,
        };
        glb::export(&Scene {
            name: "sheet".into(),
            mesh,
            materials: vec![paint],
            textures: Vec::new(),
            regions: Vec::new(),
            objects: Vec::new(),
            lighting: Lighting::Painted,
        })
    }

    fn write(folder: &TempDir, name: &str, bytes: impl AsRef<[u8]>) {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }

    /// Cosine and sine of half a right angle.
    const HALF: f64 = std::f64::consts::FRAC_1_SQRT_2;

    const SCENE: &str = "scenes/home.scene_instance.json";

    /// A data set with a floor, a bench of 2 x 1 x 0.5 m, a vase known by the lexicon and a chair known by a table.
    fn data_set() -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        let paths = |path: &str| json!({ "paths": { ".json": [path] } });
        write(&folder, "home.scene_dataset_config.json", json!({
            "stages": paths("stages"),
            "objects": {
                "paths": { ".json": ["objects/*"] },
                "configs": [{
                    "original_file": "objects/b/bench.object_config.json",
                    "template_handle": "tall_bench",
                    "attributes": { "scale": [1, 2, 1] },
                }],
            },
            "scene_instances": { "default_attributes": { "translation_origin": "asset_local" }, "paths": { ".json": ["scenes"] } },
            "semantic_scene_descriptor_instances": { "lexicon": "semantics/lexicon.json", "paths": { ".json": ["semantics/rooms"] } },
        }).to_string());
        write(
            &folder,
            "stages/floor.stage_config.json",
            r#"{"render_asset":"../meshes/floor.glb","up":[0,0,1],"front":[0,1,0]}"#,
        );
        write(&folder, "meshes/floor.glb", sheet(8.0, 6.0, 0.0));
        let object = |name: &str, more: &str| {
            write(
                &folder,
                &format!("objects/{}/{name}.object_config.json", &name[..1]),
                format!(r#"{{"render_asset":"../../meshes/{name}.glb"{more}}}"#),
            );
        };
        object("bench", r#","user_defined":{"category":"Bench"}"#);
        object("vase", r#","semantic_id":7"#);
        object("f3a9", "");
        write(&folder, "meshes/bench.glb", sheet(2.0, 1.0, 0.5));
        write(&folder, "meshes/vase.glb", sheet(0.2, 0.4, 0.2));
        write(&folder, "meshes/f3a9.glb", sheet(0.5, 0.9, 0.5));
        write(&folder, "semantics/lexicon.json", r#"{"classes":[{"id":7,"name":"vase"}]}"#);
        write(
            &folder,
            "semantics/rooms/home.semantic_config.json",
            json!({ "region_annotations": [{
            "name": "a", "label": "hall", "floor_height": 0, "extrusion_height": 3,
            "poly_loop": [[0, 0, 0], [4, 0, 0], [4, 0, -6], [0, 0, -6]],
        }] })
            .to_string(),
        );
        write(&folder, "metadata/objects.csv", "id,name,clean_category\nf3a9,\"seat, small\",office chair\n");
        write(&folder, SCENE, json!({
            "stage_instance": { "template_name": "stages/floor" },
            "object_instances": [
                { "template_name": "bench", "translation": [3, 0, -1], "rotation": [HALF, 0, HALF, 0],
                  "user_defined": { "instance_id": 9 } },
                { "template_name": "vase", "translation": [6, 1, -3], "translation_origin": "COM", "non_uniform_scale": [1, 2, 1] },
                { "template_name": "f3a9", "translation": [1, 0, -5] },
                { "template_name": "tall_bench", "translation": [5, 0, -5], "user_defined": { "instance_id": 9 } },
                { "template_name": "wardrobe" },
            ],
            "articulated_object_instances": [{ "template_name": "fridge" }],
        }).to_string());
        folder
    }

    #[test]
    fn scene_instance_places_its_parts() {
        let folder = data_set();
        let mut report = ImportReport::default();
        let scene = import(&folder.path().join(SCENE), &mut report).unwrap();
        let found: Vec<_> = scene
            .objects
            .iter()
            .map(|object| {
                (object.id.0, object.category.as_str(), object.attributes.noun.as_str(), object.region)
            })
            .collect();
        assert_eq!(
            found,
            [
                (1, "objects", "vase", None),
                (2, "chair", "", None),
                (3, "seating", "bench", None),
                (9, "seating", "bench", Some(0))
            ]
            .map(|mut object| {
                if object.1 == "chair" {
                    object.3 = Some(0)
                }
                object
            })
        );
        let bounds = |id| scene.object(InstanceId(id)).unwrap().bounds;
        // The bench is turned to the left: length (2 m) points to -Z, depth (0.5 m) to +X.
        let expected = Aabb::new(Point3::new(3.0, 0.0, -3.0), Point3::new(3.5, 1.0, -1.0));
        assert!(
            (bounds(9).min - expected.min).norm() < 1e-5 && (bounds(9).max - expected.max).norm() < 1e-5,
            "{:?}",
            bounds(9)
        );
        // The vase, scaled to 0.8 m, has the box centre as reference point.
        assert!((bounds(1).center() - Point3::new(6.0, 1.0, -3.0)).norm() < 1e-5);
        assert!((bounds(1).size().y - 0.8).abs() < 1e-5);
        assert!((bounds(3).size().y - 2.0).abs() < 1e-5, "the data set's own file scales the tall bench");
        // The floor is in the plane y = 0, with an edge at z = -6.
        assert_eq!(scene.bounds().unwrap().min, Point3::new(0.0, 0.0, -6.0));
        assert_eq!(scene.regions.len(), 1);
        assert_eq!(scene.regions[0].label, "hall");
        let warnings = report.warnings.join("\n");
        for part in ["wardrobe", "articulated", "instance_id is not unique"] {
            assert!(warnings.contains(part), "{part}: {warnings}");
        }
    }

    #[test]
    fn folder_opens_its_only_scene() {
        let folder = data_set();
        let by_folder = import(folder.path(), &mut ImportReport::default()).unwrap();
        assert_eq!(by_folder, import(&folder.path().join(SCENE), &mut ImportReport::default()).unwrap());
        assert!(
            is_habitat(folder.path())
                && is_habitat(&folder.path().join(SCENE))
                && !is_habitat(Path::new("a.glb"))
        );
        write(&folder, "scenes/other.scene_instance.json", "{}");
        let error = import(folder.path(), &mut ImportReport::default()).unwrap_err().to_string();
        assert!(error.contains("2 scenes") && error.contains("other.scene_instance.json"), "{error}");
    }

    #[test]
    fn faults_are_named_with_file_and_cause() {
        let cases: [(&str, &str, &str); 8] = [
            (SCENE, "{", "no JSON"),
            (SCENE, r#"{"object_instances":7}"#, "no scene instance"),
            (
                SCENE,
                r#"{"stage_instance":{"template_name":"moon"}}"#,
                "stage \"moon\" is not in the data set",
            ),
            (SCENE, r#"{"stage_instance":{"template_name":"floor","rotation":[0,0,0,0]}}"#, "no quaternion"),
            (
                SCENE,
                r#"{"stage_instance":{"template_name":"floor","non_uniform_scale":[1,0,1]}}"#,
                "scaled by 1 x 0 x 1",
            ),
            (
                "stages/floor.stage_config.json",
                r#"{"render_asset":"../../floor.glb"}"#,
                "no mesh in the data set",
            ),
            ("meshes/floor.glb", "version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
            ("meshes/bench.glb", "glTF", "ends inside its header"),
        ];
        for (file, content, expected) in cases {
            let folder = data_set();
            write(&folder, file, content);
            let error =
                import(&folder.path().join(SCENE), &mut ImportReport::default()).unwrap_err().to_string();
            let name = Path::new(file).file_name().unwrap().to_string_lossy().into_owned();
            let named = error.contains(&name) || file.starts_with("stages");
            assert!(named && error.contains(expected.trim_start_matches("no JSON")), "{expected}: {error}");
        }
        let lonely = tempfile::tempdir().unwrap();
        write(&lonely, "a/b/c/d/e/f/g/x.scene_instance.json", "{}");
        let error =
            import(&lonely.path().join("a/b/c/d/e/f/g/x.scene_instance.json"), &mut ImportReport::default())
                .unwrap_err();
        assert!(error.to_string().contains("folders above"), "{error}");
    }

    #[test]
    fn damaged_configurations_never_panic() {
        let folder = data_set();
        let files = [
            "home.scene_dataset_config.json",
            SCENE,
            "stages/floor.stage_config.json",
            "semantics/rooms/home.semantic_config.json",
            "metadata/objects.csv",
        ];
        let mut rng = Rng::new(5);
        let mut refused = 0;
        for file in files {
            let whole = std::fs::read(folder.path().join(file)).unwrap();
            for round in 0..250 {
                let mut bytes = whole.clone();
                for _ in 0..=rng.below(3) {
                    let at = rng.below(bytes.len());
                    bytes[at] = if rng.chance(0.5) {
                        b"0123456789-\"{}[],:e"[rng.below(19)]
                    } else {
                        bytes[at] ^ 1 << rng.below(8)
                    };
                }
                if round % 5 == 0 {
                    bytes.truncate(rng.below(whole.len()));
                }
                write(&folder, file, bytes);
                refused +=
                    u32::from(import(&folder.path().join(SCENE), &mut ImportReport::default()).is_err());
            }
            write(&folder, file, whole);
        }
        assert!(refused > 300, "{refused}");
        assert!(import(folder.path(), &mut ImportReport::default()).is_ok());
    }
}
