//! Matterport3D scans: `X.house` (levels, rooms, objects), `X_semantic.ply` (object numbers per face) and `X.glb`
//! (textured, Z up). The coloured `X_semantic.ply` replaces a missing `X.glb`; `X.ply` with the segments of the original
//! release replaces a missing `X_semantic.ply`.

mod house;

use crate::files::{self, Checked, ImportReport, beside, plain_words, refuse_if, scene_name};
use crate::labels::{self, ObjectLabel, UnlabelledSurfaces};
use crate::mp3d::house::{Category, HouseObject, HouseRoom, HouseTable};
use crate::ply::{self, Ply};
use crate::world_frame::{FileFrame, ImportOptions, UpAxis, UpConvention, check_size};
use avln_geom::{Aabb, Point3};
use avln_scene::describe::is_structure;
use avln_scene::{InstanceId, Region, Scene, SceneError, categories};
use std::collections::BTreeMap;
use std::path::Path;

pub(crate) const TABLE: &str = ".house";
/// Visible meshes, the preferred first.
const RENDER_MESHES: [&str; 3] = [".glb", ".basis.glb", ".obj"];
/// Labelled meshes, the preferred first.
const SEMANTIC_MESHES: [&str; 2] = ["_semantic.ply", ".ply"];
const MAX_TABLE_BYTES: u64 = 256 << 20;

/// Room labels after their letters (Matterport3D's data organisation).
const ROOM_LABELS: &str = "a:bathroom b:bedroom c:closet d:dining_room e:entryway f:family_room g:garage h:hallway \
    i:library j:laundry_room k:kitchen l:living_room m:meeting_room n:lounge o:office p:porch r:rec_room s:stairs \
    t:toilet u:utility_room v:tv_room w:gym x:outdoor y:balcony z:other_room B:bar C:classroom D:dining_booth S:spa Z:junk";

/// Imports the house with this table (`X.house`). Instance numbers are the table's numbers plus one, because 0 is no instance.
/// Errors name line or byte.
pub(crate) fn import(
    table: &Path,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    let bytes = files::read(table, MAX_TABLE_BYTES, report)?;
    let fail = |reason| files::malformed(table, reason);
    let house = house::parse(&String::from_utf8_lossy(&bytes)).map_err(fail)?;
    let semantic = beside(table, TABLE, &SEMANTIC_MESHES).map(|path| ply::read(&path, report)).transpose()?;
    let (surface, label_of, frame) = surfaces(table, semantic, &house, options, report)?;
    check_size(&surface.mesh, report).map_err(fail)?;
    let (regions, index_of) = regions(&house, &frame, report).map_err(fail)?;
    let labels = labels(&house, &index_of).map_err(fail)?;
    Ok(labels::scene(scene_name(table), surface, &label_of, &labels, regions, report))
}

fn surfaces(
    table: &Path,
    semantic: Option<Ply>,
    house: &HouseTable,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<(UnlabelledSurfaces, Vec<u32>, FileFrame), SceneError> {
    let labelled = semantic.map(|ply| (triangle_labels(&ply, house, report), ply));
    let render = beside(table, TABLE, &RENDER_MESHES)
        .map(|path| UnlabelledSurfaces::read(&path, report))
        .transpose()?;
    let convention = UpConvention::Fixed(UpAxis::Z);
    match (render, labelled) {
        (Some(mut render), Some((labels, mut ply))) => {
            let frame = FileFrame::applied(&mut render.mesh, options, convention, report);
            frame.apply(&mut ply.mesh);
            let label_of = labels::carried(&ply.mesh, &labels, &render.mesh, report);
            Ok((render, label_of, frame))
        }
        (Some(mut render), None) => {
            report.warn(
                "X_semantic.ply is missing next to X.house: the house has rooms, but no labelled objects",
            );
            let frame = FileFrame::applied(&mut render.mesh, options, convention, report);
            let count = render.mesh.triangles.len();
            Ok((render, vec![0; count], frame))
        }
        (None, Some((labels, mut ply))) => {
            report.warn(match ply.is_coloured {
                true => "X.glb is missing next to X.house: the colours of X_semantic.ply are shown",
                false => "X.glb is missing next to X.house, and X_semantic.ply has no colours: all is white",
            });
            let frame = FileFrame::applied(&mut ply.mesh, options, convention, report);
            Ok((UnlabelledSurfaces::of_scan(ply.mesh), labels, frame))
        }
        (None, None) => Err(files::malformed(
            table,
            "X.glb and X_semantic.ply are missing next to it; put the meshes of the house into its folder",
        )),
    }
}

/// Labels per triangle, 0 for none: by object number, or by segment.
fn triangle_labels(ply: &Ply, house: &HouseTable, report: &mut ImportReport) -> Vec<u32> {
    let label = |object: i64| labels::number_of_face(object.saturating_add(1));
    // Labels are numbers plus one: number 0 is an object in Matterport3D, and no instance in a scene.
    if let Some(objects) = &ply.object_of {
        return objects.iter().map(|&object| label(object)).collect();
    }
    if let Some(segments) = &ply.segment_of {
        let object = |segment: &i64| {
            house.object_of_segment.get(segment).map_or(0, |&object| label(i64::from(object)))
        };
        return segments.iter().map(object).collect();
    }
    report.warn("X_semantic.ply has no object_id: the house has no labelled objects");
    vec![0; ply.mesh.triangles.len()]
}

fn labels(house: &HouseTable, index_of: &BTreeMap<u32, u16>) -> Result<Vec<ObjectLabel>, String> {
    let label = |object: &HouseObject| {
        let (category, noun) = object
            .category
            .and_then(|index| house.categories.get(&index))
            .map_or((None, String::new()), meaning);
        refuse_if(object.index >= InstanceId::MAX, || {
            format!("it numbers an object {}, the largest number is {}", object.index, InstanceId::MAX - 1)
        })?;
        let region = object.region.and_then(|region| index_of.get(&region).copied());
        Ok(ObjectLabel { id: object.index + 1, category, noun, region })
    };
    house.objects.iter().map(label).collect()
}

/// A record's category and noun: by mpcat40 number, or by name.
fn meaning(record: &Category) -> (Option<String>, String) {
    let by_number = record.mpcat40_index.and_then(|number| match number {
        0 => Some("void"),
        41 => Some("unlabeled"),
        _ => categories::mpcat40_of_number(number),
    });
    let category = by_number
        .or_else(|| categories::mpcat40(&record.mpcat40_name))
        .or_else(|| categories::mpcat40(&record.raw_name));
    match category {
        Some(category) if is_structure(category) => (None, String::new()),
        Some(category) => {
            let is_same_thing = categories::mpcat40(&record.raw_name) == Some(category);
            let noun = categories::noun(&record.raw_name).filter(|_| is_same_thing);
            (Some(category.to_owned()), noun.unwrap_or_default().to_owned())
        }
        None => (Some(plain_words(&record.raw_name.to_lowercase())), String::new()),
    }
}

/// Rooms in table order, and their indices by number. Rooms without surfaces are empty boxes.
fn regions(
    house: &HouseTable,
    frame: &FileFrame,
    report: &mut ImportReport,
) -> Checked<(Vec<Region>, BTreeMap<u32, u16>)> {
    let storey_of = storeys(house);
    let mut regions = Vec::with_capacity(house.regions.len());
    let mut index_of = BTreeMap::new();
    for room in &house.regions {
        let index = u16::try_from(regions.len()).map_err(|_| "it has more than 65536 regions".to_owned())?;
        index_of.insert(room.index, index);
        let storey = room.level.and_then(|level| storey_of.get(&level).copied());
        if storey.is_none() && !storey_of.is_empty() {
            report.warn(format!("region {} has no level; it is assigned to the lowest storey", room.index));
        }
        regions.push(Region {
            label: room_label(room, report),
            bounds: room_bounds(room, frame),
            storey: storey.unwrap_or(0),
        });
    }
    Ok((regions, index_of))
}

/// Storeys by level number: levels sorted by floor height.
fn storeys(house: &HouseTable) -> BTreeMap<u32, u16> {
    let mut levels: Vec<_> = house.levels.iter().collect();
    levels.sort_by(|a, b| a.floor_m.total_cmp(&b.floor_m).then(a.index.cmp(&b.index)));
    (0_u16..).zip(levels).map(|(storey, level)| (level.index, storey)).collect()
}

fn room_label(room: &HouseRoom, report: &mut ImportReport) -> String {
    let named = |entry: &'static str| entry.strip_prefix(&room.label)?.strip_prefix(':');
    let label = ROOM_LABELS.split(' ').find_map(named);
    if label.is_none() && room.label != "-" {
        let start: String = room.label.chars().take(20).collect();
        report.warn(format!(
            "the label {start:?} of region {} is unknown; the region has no label",
            room.index
        ));
    }
    label.unwrap_or_default().to_owned()
}

fn room_bounds(room: &HouseRoom, frame: &FileFrame) -> Aabb {
    match room.bounds {
        Some([low, high]) => frame.bounds(low, high),
        None => Aabb::new(Point3::origin(), Point3::origin()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::export;
    use crate::tests::{self, damaged};
    use avln_geom::{Aabb, Point3};
    use avln_scene::Lighting;

    const TABLE_TEXT: &str = "ASCII 1.1\n\
        H made - 0 0 0 0 3 3 3 2 0 2 0 0 0 0 0 0 0 0 6 5 3 0 0 0 0 0\n\
        L 0 1 - 0 0 0 0 0 0 6 5 3 0 0 0 0 0\n\
        L 1 1 - 0 0 0 0 0 -3 6 5 0 0 0 0 0 0\n\
        R 0 0 0 0 l 0 0 0 0 0 0 6 5 3 3 0 0 0 0\n\
        R 1 1 0 0 k 0 0 0 0 0 -3 6 5 0 3 0 0 0 0\n\
        C 0 1 floor#tile 2 floor 0 0 0 0 0\n\
        C 1 2 office#desk 5 table 0 0 0 0 0\n\
        C 2 3 sofa 10 sofa 0 0 0 0 0\n\
        O 0 0 0 3 3 0 1 0 0 0 1 0 3 3 0 0 0 0 0 0 0 0 0\n\
        O 1 0 1 1 1 1 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0\n\
        O 2 1 2 4 4 1 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0\n\
        E 0 0 10 1 0 0 0 0 0 0 1 1 1 0 0 0 0 0\n\
        E 1 1 11 1 0 0 0 0 0 0 1 1 1 0 0 0 0 0\n\
        E 2 2 12 1 0 0 0 0 0 0 1 1 1 0 0 0 0 0\n";

    /// The scan with Z up as a textured mesh would be.
    fn render() -> Vec<u8> {
        let mut ply = ply::parse(&tests::ply("ascii"), &mut ImportReport::default()).unwrap();
        // Another order of triangles, so that labels are found by place.
        ply.mesh.triangles.reverse();
        export(&Scene {
            name: "made".to_owned(),
            mesh: ply.mesh,
            materials: vec![ply::material(None)],
            textures: Vec::new(),
            regions: Vec::new(),
            objects: Vec::new(),
            lighting: Lighting::Painted,
        })
    }

    fn imported(files: &[(&str, &[u8])]) -> (Scene, ImportReport) {
        let folder = tempfile::tempdir().unwrap();
        tests::write(folder.path(), "made.house", TABLE_TEXT);
        files.iter().for_each(|(name, content)| tests::write(folder.path(), name, content));
        let mut report = ImportReport::default();
        (import(&folder.path().join("made.house"), &ImportOptions::default(), &mut report).unwrap(), report)
    }

    fn check(scene: &Scene) {
        assert_eq!(scene.name, "made");
        let [desk, sofa] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
        assert_eq!((desk.id.0, desk.category.as_str(), desk.attributes.noun.as_str()), (2, "table", "desk"));
        assert_eq!((sofa.id.0, sofa.category.as_str(), sofa.attributes.color.as_str()), (3, "sofa", "red"));
        assert_eq!((desk.region, sofa.region), (Some(0), Some(1)));
        assert_eq!(sofa.bounds, Aabb::new(Point3::new(3.0, 0.0, -4.0), Point3::new(5.0, 0.9, -3.0)));
        let labelled = scene.mesh.instance_of.iter().filter(|id| id.0 != 0).count();
        assert_eq!((labelled, scene.mesh.triangles.len()), (24, 26));
        let rooms: Vec<(&str, u16)> =
            scene.regions.iter().map(|room| (room.label.as_str(), room.storey)).collect();
        assert_eq!(rooms, [("living_room", 1), ("kitchen", 0)], "the second level is below the first");
        assert_eq!(
            scene.regions[0].bounds,
            Aabb::new(Point3::new(0.0, 0.0, -5.0), Point3::new(6.0, 3.0, 0.0))
        );
    }

    #[test]
    fn labels_are_carried_to_the_textured_mesh() {
        let (scene, report) =
            imported(&[("made_semantic.ply", &tests::ply("binary_little_endian")), ("made.glb", &render())]);
        check(&scene);
        assert!(report.warnings.is_empty(), "{report:?}");
    }

    #[test]
    fn labelled_mesh_replaces_missing_textured_mesh() {
        let (scene, report) = imported(&[("made_semantic.ply", &tests::ply("binary_big_endian"))]);
        check(&scene);
        assert!(report.warnings[0].contains("colours of X_semantic.ply"), "{report:?}");
    }

    #[test]
    fn segments_of_the_original_release_have_objects() {
        let text = String::from_utf8(tests::ply("ascii")).unwrap().replace("object_id", "face_material");
        let body = text.find("end_header").unwrap();
        let (head, body) = text.split_at(body);
        // Faces begin with their object; segments have other numbers.
        let faces: Vec<String> = body
            .lines()
            .map(|line| match line.split_once(" 4 ") {
                Some((object, rest)) if line.split(' ').count() == 6 && object.len() == 1 => {
                    format!("1{object} 4 {rest}")
                }
                _ => line.to_owned(),
            })
            .collect();
        let original = format!("{head}{}\n", faces.join("\n"));
        let (scene, _) = imported(&[("made.ply", original.as_bytes())]);
        check(&scene);
    }

    #[test]
    fn house_without_labels_has_rooms() {
        let (scene, report) = imported(&[("made.glb", &render())]);
        assert_eq!((scene.objects.len(), scene.regions.len()), (0, 2));
        assert!(report.warnings.iter().any(|warning| warning.contains("no labelled objects")), "{report:?}");
    }

    #[test]
    fn inconsistent_files_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("made.house");
        tests::write(folder.path(), "made.house", TABLE_TEXT);
        let error =
            import(&table, &ImportOptions::default(), &mut ImportReport::default()).unwrap_err().to_string();
        assert!(
            error.contains("made.house") && error.contains("X.glb and X_semantic.ply are missing"),
            "{error}"
        );
        tests::write(folder.path(), "made_semantic.ply", &tests::ply("ascii")[..900]);
        let error =
            import(&table, &ImportOptions::default(), &mut ImportReport::default()).unwrap_err().to_string();
        assert!(error.contains("made_semantic.ply") && error.contains("line"), "{error}");
        // The table has an additional object, and lacks another.
        let more = TABLE_TEXT
            .replace("E 0 0", "O 9 0 2 4 4 1 1 0 0 0 1 0 1 1 1 0 0 0 0 0 0 0 0\nE 0 0")
            .replace("O 1 0", "O 8 0");
        tests::write(folder.path(), "made.house", more);
        tests::write(folder.path(), "made_semantic.ply", tests::ply("ascii"));
        let mut report = ImportReport::default();
        assert_eq!(import(&table, &ImportOptions::default(), &mut report).unwrap().objects.len(), 1);
        let says = |words: &str| report.warnings.iter().any(|warning| warning.contains(words));
        assert!(says("2 labelled objects have no triangles and are left out (numbers 9, 10)"), "{report:?}");
        assert!(
            says("1 numbers on the mesh are not in the table and have no object (numbers 2)"),
            "{report:?}"
        );
    }

    #[test]
    fn damaged_files_never_panic() {
        let mut errors = 0;
        damaged(TABLE_TEXT.as_bytes(), 11, 4000, |bytes| {
            match house::parse(&String::from_utf8_lossy(bytes)) {
                Ok(house) => {
                    let _ = labels(&house, &BTreeMap::new());
                    let mesh = avln_scene::Mesh::default();
                    let frame = FileFrame::of(
                        &mesh,
                        &ImportOptions::default(),
                        UpConvention::Fixed(UpAxis::Z),
                        &mut ImportReport::default(),
                    );
                    let _ = regions(&house, &frame, &mut ImportReport::default());
                }
                Err(_) => errors += 1,
            }
        });
        assert!(errors > 1000, "{errors}");
    }
}
