//! Scans of Matterport3D: `X.house` (levels, rooms, things), `X_semantic.ply` (the thing of each face) and `X.glb` (textured;
//! Z up). Without `X.glb` the coloured `X_semantic.ply` is what is seen; `X.ply` with the segments of the original release
//! serves in its place.

mod house;
mod rooms;
#[cfg(test)]
mod tests;

use crate::frame::{Convention, Frame, Options, Up, check_size};
use crate::labelled::{self, Label, Surface};
use crate::ply::{self, Ply};
use crate::{Report, files, glb, obj};
use avln_scene::describe::is_structure;
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{InstanceId, Scene, SceneError, categories};
use house::{Category, House, Thing};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What `X.house` is called.
pub(crate) const TABLE: &str = ".house";
/// The meshes that are shown, in order of preference.
const RENDER_MESHES: [&str; 3] = [".glb", ".basis.glb", ".obj"];
/// The meshes that bring labels, in order of preference.
const SEMANTIC_MESHES: [&str; 2] = ["_semantic.ply", ".ply"];
const MAX_TABLE_BYTES: u64 = 256 << 20;

/// The categories of mpcat40 by their numbers.
const MPCAT40: [&str; 42] = [
    "void",
    "wall",
    "floor",
    "chair",
    "door",
    "table",
    "picture",
    "cabinet",
    "cushion",
    "window",
    "sofa",
    "bed",
    "curtain",
    "chest_of_drawers",
    "plant",
    "sink",
    "stairs",
    "ceiling",
    "toilet",
    "stool",
    "towel",
    "mirror",
    "tv_monitor",
    "shower",
    "column",
    "bathtub",
    "counter",
    "fireplace",
    "lighting",
    "beam",
    "railing",
    "shelving",
    "blinds",
    "gym_equipment",
    "seating",
    "board_panel",
    "furniture",
    "appliances",
    "clothes",
    "objects",
    "misc",
    "unlabeled",
];

/// Imports the house whose table is `table` (`X.house`). Things get their number in the table plus one, since no instance
/// has number 0; walls, floors, doors and the like are no objects.
///
/// # Errors
/// [`SceneError::Read`] for a file that cannot be read; [`SceneError::Malformed`], with line or byte, for one that does not
/// hold what it should, and where neither mesh is there.
pub fn import(table: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    import_as(table, &Options::default(), report)
}

/// [`import`] with axes and unit as the caller knows them.
///
/// # Errors
/// Those of [`import`].
pub fn import_as(table: &Path, options: &Options, report: &mut Report) -> Result<Scene, SceneError> {
    let bytes = files::read(table, MAX_TABLE_BYTES, report)?;
    let fail = |reason| files::malformed(table, reason);
    let house = house::parse(&String::from_utf8_lossy(&bytes)).map_err(fail)?;
    let semantic = match beside(table, &SEMANTIC_MESHES) {
        Some(path) => Some(ply::read(&path, report)?),
        None => None,
    };
    let (surface, label_of, frame) = surfaces(table, semantic, &house, options, report)?;
    check_size(&surface.mesh, report).map_err(fail)?;
    let (regions, index_of) = rooms::regions(&house, &frame, report).map_err(fail)?;
    let labels = labels(&house, &index_of).map_err(fail)?;
    Ok(labelled::scene(glb::scene_name(table), surface, &label_of, &labels, regions, report))
}

/// The first of `X<suffix>` that lies beside `X.house`.
fn beside(table: &Path, suffixes: &[&str]) -> Option<PathBuf> {
    let name = table.file_name()?.to_str()?;
    let stem = name.strip_suffix(TABLE)?;
    suffixes.iter().map(|suffix| table.with_file_name(format!("{stem}{suffix}"))).find(|path| path.is_file())
}

/// What is seen, and the label of each of its triangles, in the world frame.
fn surfaces(
    table: &Path,
    semantic: Option<Ply>,
    house: &House,
    options: &Options,
    report: &mut Report,
) -> Result<(Surface, Vec<u32>, Frame), SceneError> {
    let labels = semantic.as_ref().map(|ply| triangle_labels(ply, house, report));
    let render = match beside(table, &RENDER_MESHES) {
        Some(path) => Some(read_render(&path, report)?),
        None => None,
    };
    let convention = Convention::Fixed(Up::Z);
    match (render, semantic, labels) {
        (Some(mut render), Some(mut ply), Some(labels)) => {
            let frame = Frame::of(&render.mesh, options, convention, report);
            frame.apply(&mut render.mesh);
            frame.apply(&mut ply.mesh);
            let label_of = labelled::carried(&ply.mesh, &labels, &render.mesh, report);
            Ok((render, label_of, frame))
        }
        (Some(mut render), ..) => {
            report.warn(
                "there is no X_semantic.ply beside X.house: the house has rooms, and no labelled things",
            );
            let frame = Frame::of(&render.mesh, options, convention, report);
            frame.apply(&mut render.mesh);
            let count = render.mesh.triangles.len();
            Ok((render, vec![0; count], frame))
        }
        (None, Some(mut ply), Some(labels)) => {
            report.warn(match ply.is_coloured {
                true => "there is no X.glb beside X.house: the colours of X_semantic.ply are shown",
                false => "there is no X.glb beside X.house, and X_semantic.ply has no colours: all is white",
            });
            let frame = Frame::of(&ply.mesh, options, convention, report);
            frame.apply(&mut ply.mesh);
            let surface =
                Surface { mesh: ply.mesh, materials: vec![ply::material(None)], textures: Vec::new() };
            Ok((surface, labels, frame))
        }
        _ => Err(files::malformed(
            table,
            "neither X.glb nor X_semantic.ply lies beside it; put the meshes of the house into its folder",
        )),
    }
}

fn read_render(path: &Path, report: &mut Report) -> Result<Surface, SceneError> {
    let is_obj = path.extension().is_some_and(|extension| extension == "obj");
    let model = if is_obj {
        obj::read(path, report)?
    } else {
        glb::read_part(&files::resolve(path, report)?, report)?
    };
    Ok(Surface { mesh: model.mesh, materials: model.materials, textures: model.textures })
}

/// The label of each triangle, 0 for none: from the thing's number on the face, else from the segment's.
fn triangle_labels(ply: &Ply, house: &House, report: &mut Report) -> Vec<u32> {
    let label = |object: i64| u32::try_from(object + 1).ok().filter(|&id| id <= InstanceId::MAX).unwrap_or(0);
    if let Some(objects) = &ply.object_of {
        return objects.iter().map(|&object| label(object.clamp(-1, i64::from(u32::MAX)))).collect();
    }
    if let Some(segments) = &ply.segment_of {
        let object = |segment: &i64| {
            house.object_of_segment.get(segment).map_or(0, |&object| label(i64::from(object)))
        };
        return segments.iter().map(object).collect();
    }
    report.warn("X_semantic.ply gives its faces no object_id: the house has no labelled things");
    vec![0; ply.mesh.triangles.len()]
}

/// The things of the table by their numbers plus one.
fn labels(house: &House, index_of: &BTreeMap<u32, u16>) -> Result<Vec<Label>, String> {
    let label = |thing: &Thing| {
        let (category, noun) = thing
            .category
            .and_then(|index| house.categories.get(&index))
            .map_or((None, String::new()), meaning);
        if thing.index >= InstanceId::MAX {
            return Err(format!(
                "it numbers an object {}, the largest number is {}",
                thing.index,
                InstanceId::MAX - 1
            ));
        }
        let region = thing.region.and_then(|region| index_of.get(&region).copied());
        Ok(Label { id: thing.index + 1, category, noun, region })
    };
    house.objects.iter().map(label).collect()
}

/// Category and noun of a record: by the number in mpcat40, else by its names.
fn meaning(record: &Category) -> (Option<String>, String) {
    let by_number = record.mpcat40_index.and_then(|index| MPCAT40.get(index as usize).copied());
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
        None => {
            let words = record.raw_name.to_lowercase();
            (
                Some(words.chars().filter(|letter| !letter.is_control()).take(MAX_WORD_CHARS).collect()),
                String::new(),
            )
        }
    }
}
