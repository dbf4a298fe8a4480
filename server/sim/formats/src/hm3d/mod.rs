//! HM3D scenes with semantics: `X.glb` (Z up), `X.semantic.glb` (instances painted in colours) and `X.semantic.txt`
//! (colour to category and region). The result has the triangles in `X.glb`, turned Y up.

mod layout;

use crate::files::{Checked, ImportReport, malformed, read_regular, scene_name};
use crate::glb;
use crate::hm3d::layout::{InstanceAnnotation, parse};
use crate::labels::{self, ObjectLabel, UnlabelledSurfaces, transfer};
use crate::named_model::Model;
use crate::world_frame::{FileFrame, UpAxis};
use avln_geom::Aabb;
use avln_scene::describe::{inner_points, storeys, texel_at};
use avln_scene::{Region, Scene, SceneError};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub use layout::{Exported, dataset_config, export};

const SEMANTIC_MESH: &str = ".semantic.glb";
const SEMANTIC_TABLE: &str = ".semantic.txt";
/// Render meshes, the preferred first; the second has `.basis` textures, in the archives for Habitat.
const RENDER_MESHES: [&str; 2] = [".glb", ".basis.glb"];
const MAX_TABLE_BYTES: u64 = 16 << 20;

struct Hm3dFiles {
    render: PathBuf,
    semantic: PathBuf,
    table: PathBuf,
}

/// Returns whether `path` is an HM3D scene folder with semantics, or a mesh in it.
pub(crate) fn is_hm3d(path: &Path) -> bool {
    files(path).is_some()
}

/// Imports a folder (`00800-TEEsavR23oF`), or a `.glb` with semantic files next to it.
///
/// Instances have the table's numbers; structure (walls, floors, doors, windows …) is no object, but stays in the mesh.
pub(crate) fn import(folder_or_glb: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    let files = files(folder_or_glb).ok_or_else(|| {
        malformed(folder_or_glb, "X.glb, X.semantic.glb or X.semantic.txt is missing; add the semantic files of HM3D, or open the .glb without them")
    })?;
    let annotations = read_annotations(&files.table)?;
    let mut render = glb::read_model(&files.render, report)?;
    let mut semantic = glb::read_model(&files.semantic, report)?;
    let frame = FileFrame { up: UpAxis::Z, metres: 1.0 };
    frame.apply(&mut render.mesh);
    let painted = painted_labels(&semantic, &annotations, report);
    frame.apply(&mut semantic.mesh);
    let label_of = transfer(&semantic.mesh, &painted, &render.mesh);
    let surfaces =
        UnlabelledSurfaces { mesh: render.mesh, materials: render.materials, textures: render.textures };
    scene(scene_name(&files.render), surfaces, &label_of, &annotations, report)
        .map_err(|reason| malformed(&files.table, reason))
}

/// Scene files for a mesh or folder; for several scenes in a folder, the first by name.
fn files(path: &Path) -> Option<Hm3dFiles> {
    let (folder, stem) =
        if path.is_dir() { (path, first_stem(path)?) } else { (path.parent()?, stem_of_mesh(path)?) };
    let file = |suffix: &str| folder.join(format!("{stem}{suffix}"));
    let render = RENDER_MESHES.iter().map(|suffix| file(suffix)).find(|render| render.is_file())?;
    let found = Hm3dFiles { render, semantic: file(SEMANTIC_MESH), table: file(SEMANTIC_TABLE) };
    (found.semantic.is_file() || found.table.is_file()).then_some(found)
}

fn first_stem(folder: &Path) -> Option<String> {
    let names =
        std::fs::read_dir(folder).ok()?.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    names.filter_map(|name| name.strip_suffix(SEMANTIC_MESH).map(str::to_owned)).min()
}

fn stem_of_mesh(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    let suffixes = [SEMANTIC_MESH, ".basis.glb", ".glb"];
    suffixes.iter().find_map(|suffix| name.strip_suffix(suffix)).map(str::to_owned)
}

fn read_annotations(table: &Path) -> Result<Vec<InstanceAnnotation>, SceneError> {
    let bytes = read_regular(table, MAX_TABLE_BYTES)?;
    parse(&String::from_utf8_lossy(&bytes)).map_err(|reason| malformed(table, reason))
}

/// Joins mesh and table; `label_of` are instance numbers per triangle, 0 for none.
fn scene(
    name: String,
    surfaces: UnlabelledSurfaces,
    label_of: &[u32],
    annotations: &[InstanceAnnotation],
    report: &mut ImportReport,
) -> Checked<Scene> {
    let bounds_of = labels::bounds_of(&surfaces.mesh, label_of);
    let (regions, index_of) = regions(annotations, &bounds_of)?;
    // Instances without a surface are left out here: `painted_labels` has counted them in its warning.
    let listed = annotations.iter().filter(|annotation| bounds_of.contains_key(&annotation.id));
    let label = |annotation: &InstanceAnnotation| ObjectLabel {
        region: index_of.get(&annotation.region).copied(),
        ..ObjectLabel::of_words(annotation.id, &annotation.category)
    };
    let labels: Vec<ObjectLabel> = listed.map(label).collect();
    Ok(labels::scene(name, surfaces, label_of, &labels, regions, report))
}

/// Rooms in number order, and their indices by number. A room is the box around the instances; rooms without
/// instances are left out.
fn regions(
    annotations: &[InstanceAnnotation],
    bounds_of: &BTreeMap<u32, Aabb>,
) -> Checked<(Vec<Region>, BTreeMap<i32, u16>)> {
    let mut boxes: BTreeMap<i32, Aabb> = BTreeMap::new();
    for annotation in annotations.iter().filter(|annotation| annotation.region >= 0) {
        let Some(bounds) = bounds_of.get(&annotation.id) else { continue };
        boxes.entry(annotation.region).and_modify(|room| *room = room.union(bounds)).or_insert(*bounds);
    }
    let storeys = storeys(&boxes.values().map(|room| room.min.y).collect::<Vec<_>>());
    let mut regions = Vec::new();
    let mut index_of = BTreeMap::new();
    for ((number, bounds), storey) in boxes.into_iter().zip(storeys) {
        let index = u16::try_from(regions.len()).map_err(|_| "it has more than 65536 regions".to_owned())?;
        index_of.insert(number, index);
        regions.push(Region { label: String::new(), bounds, storey });
    }
    Ok((regions, index_of))
}

const BLACK: [u8; 3] = [0; 3];

/// Returns instance numbers per semantic triangle, 0 for colours outside the table; warns about unknown colours,
/// and about numbers without triangles.
fn painted_labels(
    semantic: &Model,
    annotations: &[InstanceAnnotation],
    report: &mut ImportReport,
) -> Vec<u32> {
    let mut number_of: BTreeMap<[u8; 3], u32> = BTreeMap::new();
    for annotation in annotations {
        let first = *number_of.entry(annotation.color).or_insert(annotation.id);
        if first != annotation.id {
            report.warn(format!(
                "instances {first} and {} have the same colour; all of it is instance {first}",
                annotation.id
            ));
        }
    }
    let mut unknown = BTreeSet::new();
    let labels: Vec<u32> = (0..semantic.mesh.triangles.len())
        .map(|triangle| {
            let colors = painted_colors(semantic, triangle);
            let label = most_frequent(&colors, &number_of);
            if label.is_none() && colors[0] != BLACK {
                unknown.insert(colors[0]);
            }
            label.unwrap_or(0)
        })
        .collect();
    if let Some([r, g, b]) = unknown.first() {
        report.warn(format!(
            "{} painted colours are not in the table, for example {r:02X}{g:02X}{b:02X}; their surfaces have no label",
            unknown.len()
        ));
    }
    let seen: BTreeSet<u32> = labels.iter().copied().collect();
    let absent = annotations.iter().filter(|annotation| !seen.contains(&annotation.id)).count();
    if absent > 0 {
        report.warn(format!("{absent} instances of the table have no surface; left out"));
    }
    labels
}

/// Colours at a triangle's centre, and half-way to the corners.
fn painted_colors(semantic: &Model, triangle: usize) -> [[u8; 3]; 4] {
    let material = &semantic.materials[usize::from(semantic.mesh.material_of[triangle])];
    let Some(texture) = material.texture.map(|texture| &semantic.textures[usize::from(texture)]) else {
        let [r, g, b, _] = material.base_color;
        return [[r, g, b]; 4];
    };
    let uvs = semantic.mesh.triangles[triangle].map(|corner| semantic.mesh.uvs[corner as usize]);
    // Without filters or colour conversion: only exact colours have a meaning.
    inner_points(&uvs).map(|uv| {
        let [r, g, b, _] = texel_at(texture, &uv);
        [r, g, b]
    })
}

fn most_frequent(colors: &[[u8; 3]; 4], number_of: &BTreeMap<[u8; 3], u32>) -> Option<u32> {
    let votes = colors.map(|color| number_of.get(&color).copied());
    let count = |candidate: &u32| votes.iter().filter(|vote| **vote == Some(*candidate)).count();
    // Paint seams run across triangles: the most frequent number wins, the centre's in a tie. `max_by_key` returns the last
    // maximum, and the centre is the last in reverse order.
    votes.iter().rev().flatten().copied().max_by_key(count)
}

#[cfg(test)]
mod tests {
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
}
