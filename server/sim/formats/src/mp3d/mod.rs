//! Matterport3D scans: `X.house` (levels, rooms, objects), `X_semantic.ply` (object numbers per face) and `X.glb`
//! (textured, Z up). The coloured `X_semantic.ply` replaces a missing `X.glb`; `X.ply` with the segments of the original
//! release replaces a missing `X_semantic.ply`.

mod house;
#[cfg(test)]
mod tests;

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

/// mpcat40 categories in number order.
const MPCAT40: &str = "void wall floor chair door table picture cabinet cushion window sofa bed curtain chest_of_drawers \
    plant sink stairs ceiling toilet stool towel mirror tv_monitor shower column bathtub counter fireplace lighting beam \
    railing shelving blinds gym_equipment seating board_panel furniture appliances clothes objects misc unlabeled";
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
    let semantic = match beside(table, TABLE, &SEMANTIC_MESHES) {
        Some(path) => Some(ply::read(&path, report)?),
        None => None,
    };
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
    let render = match beside(table, TABLE, &RENDER_MESHES) {
        Some(path) => Some(UnlabelledSurfaces::read(&path, report)?),
        None => None,
    };
    let convention = UpConvention::Fixed(UpAxis::Z);
    match (render, labelled) {
        (Some(mut render), Some((labels, mut ply))) => {
            let frame = FileFrame::of(&render.mesh, options, convention, report);
            frame.apply(&mut render.mesh);
            frame.apply(&mut ply.mesh);
            let label_of = labels::carried(&ply.mesh, &labels, &render.mesh, report);
            Ok((render, label_of, frame))
        }
        (Some(mut render), None) => {
            report.warn(
                "X_semantic.ply is missing next to X.house: the house has rooms, but no labelled objects",
            );
            let frame = FileFrame::of(&render.mesh, options, convention, report);
            frame.apply(&mut render.mesh);
            let count = render.mesh.triangles.len();
            Ok((render, vec![0; count], frame))
        }
        (None, Some((labels, mut ply))) => {
            report.warn(match ply.is_coloured {
                true => "X.glb is missing next to X.house: the colours of X_semantic.ply are shown",
                false => "X.glb is missing next to X.house, and X_semantic.ply has no colours: all is white",
            });
            let frame = FileFrame::of(&ply.mesh, options, convention, report);
            frame.apply(&mut ply.mesh);
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
    let label = |object: i64| u32::try_from(object + 1).ok().filter(|&id| id <= InstanceId::MAX).unwrap_or(0);
    // Labels are numbers plus one: number 0 is an object in Matterport3D, and no instance in a scene.
    if let Some(objects) = &ply.object_of {
        return objects.iter().map(|&object| label(object.clamp(-1, i64::from(u32::MAX)))).collect();
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
    let by_number = record.mpcat40_index.and_then(|index| MPCAT40.split(' ').nth(index as usize));
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
