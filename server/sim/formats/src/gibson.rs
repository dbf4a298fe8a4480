//! Gibson buildings: `X.scn` (objects with class and box), `X.glb` or `X.obj` (textured, Z up) and, if it exists,
//! `X_semantic.ply` (object numbers per face).

use crate::files::{self, Checked, ImportReport, beside, refuse_if, scene_name};
use crate::labels::{self, ObjectLabel, UnlabelledSurfaces};
use crate::ply;
use crate::world_frame::{FileFrame, ImportOptions, UpAxis, UpConvention, check_size};
use avln_geom::{Aabb, Point3};
use avln_scene::limits::MAX_ENTRIES;
use avln_scene::{InstanceId, Mesh, Scene, SceneError};
use serde::Deserialize;
use std::{collections::BTreeSet, path::Path};

pub(crate) const TABLE: &str = ".scn";
const RENDER_MESHES: [&str; 3] = [".glb", ".obj", "_semantic.ply"];
const SEMANTIC_MESH: &str = "_semantic.ply";
const MAX_TABLE_BYTES: u64 = 64 << 20;
/// Margin around an object's box, metres.
const MARGIN_M: f32 = 0.02;

/// Imports the building with this table (`X.scn`). Without labelled faces, an object is the surface in its box; the smaller wins.
pub(crate) fn import(
    table: &Path,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    let bytes = files::read(table, MAX_TABLE_BYTES, report)?;
    let fail = |reason: String| files::malformed(table, reason);
    let listed = parse(&bytes, InstanceId::MAX).map_err(fail)?;
    let render = beside(table, TABLE, &RENDER_MESHES).ok_or_else(|| {
        let reason = "X.glb or X.obj is missing next to X.scn; put the mesh of the building into its folder";
        files::malformed(table, reason)
    })?;
    let mut surface = UnlabelledSurfaces::read(&render, report)?;
    let frame = FileFrame::applied(&mut surface.mesh, options, UpConvention::Fixed(UpAxis::Z), report);
    check_size(&surface.mesh, report).map_err(fail)?;
    let label_of = match beside(table, TABLE, &[SEMANTIC_MESH]) {
        Some(path) => labels_of_faces(&path, &frame, &surface.mesh, report)?,
        None => {
            report
                .warn("X_semantic.ply is missing next to X.scn: objects are the surfaces inside their boxes");
            labels_of_boxes(&listed, &frame, &surface.mesh)
        }
    };
    let labels: Vec<ObjectLabel> =
        listed.iter().map(|object| ObjectLabel::of_words(object.id, &object.class)).collect();
    Ok(labels::scene(scene_name(table), surface, &label_of, &labels, Vec::new(), report))
}

fn labels_of_faces(
    path: &Path,
    frame: &FileFrame,
    render: &Mesh,
    report: &mut ImportReport,
) -> Result<Vec<u32>, SceneError> {
    let mut semantic = ply::read(path, report)?;
    frame.apply(&mut semantic.mesh);
    let objects = semantic.object_of.ok_or_else(|| {
        files::malformed(path, "its faces have no object_id; regenerate it from the .ids file")
    })?;
    let labels: Vec<u32> = objects.into_iter().map(labels::number_of_face).collect();
    Ok(labels::carried(&semantic.mesh, &labels, render, report))
}

/// Labels each triangle by the smallest enclosing box.
fn labels_of_boxes(listed: &[GibsonObject], frame: &FileFrame, mesh: &Mesh) -> Vec<u32> {
    let volume = |bounds: &Aabb| bounds.size().product();
    let mut boxes: Vec<(u32, Aabb)> =
        listed.iter().filter_map(|object| Some((object.id, world_box(object, frame)?))).collect();
    // Small boxes first: a cushion on a sofa is inside both boxes.
    boxes.sort_by(|(a_id, a), (b_id, b)| volume(a).total_cmp(&volume(b)).then(a_id.cmp(b_id)));
    let label = |triangle: &[u32; 3]| {
        let corners = triangle.map(|corner| mesh.positions[corner as usize]);
        let encloses = |(_, bounds): &&(u32, Aabb)| corners.iter().all(|corner| bounds.contains(corner));
        boxes.iter().find(encloses).map_or(0, |(id, _)| *id)
    };
    mesh.triangles.iter().map(label).collect()
}

fn world_box(object: &GibsonObject, frame: &FileFrame) -> Option<Aabb> {
    let [center, size] = object.place?;
    let corner = |sign: f32| std::array::from_fn(|axis| center[axis] + sign * size[axis] / 2.0);
    let bounds = frame.bounds(corner(-1.0), corner(1.0)).grown(MARGIN_M);
    let is_finite = |point: &Point3<f32>| point.iter().all(|coordinate| coordinate.is_finite());
    (is_finite(&bounds.min) && is_finite(&bounds.max)).then_some(bounds)
}

#[derive(Deserialize)]
struct ScnFile {
    objects: Vec<ScnObject>,
}

#[derive(Deserialize)]
struct ScnObject {
    id: i64,
    #[serde(default)]
    class_: String,
    location: Option<[f32; 3]>,
    size: Option<[f32; 3]>,
}

/// An object: number, class and, if given, box in the file's own frame.
#[derive(Clone, Debug, PartialEq)]
struct GibsonObject {
    id: u32,
    class: String,
    place: Option<[[f32; 3]; 2]>,
}

/// Parses the table; numbers are 1 to `max_id`.
fn parse(bytes: &[u8], max_id: u32) -> Checked<Vec<GibsonObject>> {
    let file: ScnFile = serde_json::from_slice(bytes)
        .map_err(|error| format!("it is no Gibson table ({error}); copy the .scn file again"))?;
    refuse_if(file.objects.len() > MAX_ENTRIES, || format!("it lists more than {MAX_ENTRIES} objects"))?;
    let mut seen = BTreeSet::new();
    let mut found = Vec::new();
    for entry in file.objects {
        let id = labels::unique_number(entry.id, 1..=max_id, &mut seen)?;
        if let Some(size) =
            entry.size.and_then(|sizes| sizes.into_iter().find(|size| size.is_nan() || *size < 0.0))
        {
            return Err(format!("object {id} has the size {size} m; copy the .scn file again"));
        }
        let place = entry.location.zip(entry.size).map(|(center, size)| [center, size]);
        found.push(GibsonObject { id, class: entry.class_, place });
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{self, damaged};

    const TABLE_TEXT: &str = r#"{"objects": [
        {"class_": "couch", "id": 2, "location": [4, 3.5, 0.45], "size": [2, 1, 0.9], "parent_room": 1},
        {"class_": "dining table", "id": 1, "location": [1.5, 1.25, 0.35], "size": [1, 0.5, 0.7], "material": ["wood"]},
        {"class_": "oven", "id": 7}
    ]}"#;

    fn check(files: &[(&str, &[u8])]) -> ImportReport {
        let folder = tempfile::tempdir().unwrap();
        tests::write(folder.path(), "Made.scn", TABLE_TEXT);
        files.iter().for_each(|(name, content)| tests::write(folder.path(), name, content));
        let mut report = ImportReport::default();
        let scene = import(&folder.path().join("Made.scn"), &ImportOptions::default(), &mut report).unwrap();
        let [table, sofa] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
        assert_eq!((table.id.0, table.category.as_str()), (1, "table"));
        assert_eq!((sofa.id.0, sofa.category.as_str()), (2, "sofa"));
        assert_eq!(sofa.bounds, Aabb::new(Point3::new(3.0, 0.0, -4.0), Point3::new(5.0, 0.9, -3.0)));
        assert!(report.warnings.iter().any(|warning| warning.contains("left out (numbers 7)")), "{report:?}");
        report
    }

    #[test]
    fn objects_are_the_surfaces_in_their_boxes() {
        let report = check(&[("Made.obj", tests::obj().as_bytes())]);
        assert!(report.warnings.iter().any(|warning| warning.contains("inside their boxes")), "{report:?}");
    }

    #[test]
    fn labels_on_faces_come_before_boxes() {
        let report =
            check(&[("Made_semantic.ply", &tests::ply("ascii")), ("Made.obj", tests::obj().as_bytes())]);
        assert!(!report.warnings.iter().any(|warning| warning.contains("boxes")), "{report:?}");
        check(&[("Made_semantic.ply", &tests::ply("ascii"))]);
    }

    #[test]
    fn a_table_without_a_mesh_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        tests::write(folder.path(), "Made.scn", TABLE_TEXT);
        let error =
            import(&folder.path().join("Made.scn"), &ImportOptions::default(), &mut ImportReport::default())
                .unwrap_err()
                .to_string();
        assert!(error.contains("Made.scn") && error.contains("X.obj"), "{error}");
    }

    #[test]
    fn damaged_files_never_panic() {
        let mesh = ply::parse(&tests::ply("ascii"), &mut ImportReport::default()).unwrap().mesh;
        let frame = FileFrame::of(
            &mesh,
            &ImportOptions::default(),
            UpConvention::Fixed(UpAxis::Z),
            &mut ImportReport::default(),
        );
        let mut errors = 0;
        damaged(TABLE_TEXT.as_bytes(), 17, 4000, |bytes| match parse(bytes, InstanceId::MAX) {
            Ok(found) => assert_eq!(labels_of_boxes(&found, &frame, &mesh).len(), mesh.triangles.len()),
            Err(_) => errors += 1,
        });
        assert!(errors > 1000, "{errors}");
    }

    #[test]
    fn errors_name_the_defect() {
        for (text, expected) in [
            (r#"{"objects": [{"id": 1"#, "line 1 column"),
            (r#"{"objects": [{"id": 0}]}"#, "number 0"),
            (r#"{"objects": [{"id": 2}, {"id": 2}]}"#, "object number 2 is not unique"),
            (r#"{"objects": [{"id": 2, "size": [1, 1, -3]}]}"#, "object 2 has the size -3"),
            (r#"{"objects": [{"id": 2, "size": [1, 1]}]}"#, "line 1 column"),
        ] {
            let error = parse(text.as_bytes(), 9).unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
