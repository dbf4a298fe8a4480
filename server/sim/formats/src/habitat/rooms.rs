//! Rooms, from the outlines in semantic configurations.

use super::config::{Dataset, SceneInstance};
use super::{Value, files};
use crate::Report;
use crate::glb::bounded;
use avln_geom::{Aabb, Point3};
use avln_scene::describe::storeys;
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{Region, SceneError};
use serde::Deserialize;
use std::path::PathBuf;

const SUFFIX: &str = ".semantic_config.json";
/// Placeholder for the scene's own name.
const OWN_NAME: &str = "%%CONFIG_NAME_AS_ASSET_FILENAME%%";
/// Things lie in a room from this far below its floor, metres.
const BELOW_FLOOR_M: f32 = 0.3;

#[derive(Default, Deserialize)]
#[serde(default)]
struct Description {
    #[serde(deserialize_with = "bounded")]
    region_annotations: Vec<Annotation>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Annotation {
    name: String,
    label: String,
    /// Corners of the floor, metres.
    #[serde(deserialize_with = "bounded")]
    poly_loop: Vec<[f32; 3]>,
    floor_height: f32,
    extrusion_height: f32,
    min_bounds: Option<[f32; 3]>,
    max_bounds: Option<[f32; 3]>,
}

/// A room with its outline, seen from above, in (x, z).
pub(super) struct Room {
    pub(super) region: Region,
    outline: Vec<[f32; 2]>,
}

impl Room {
    /// Whether a point lies in the room.
    pub(super) fn holds(&self, point: &Point3<f32>) -> bool {
        let bounds = &self.region.bounds;
        let upright = (bounds.min.y - BELOW_FLOOR_M..=bounds.max.y).contains(&point.y);
        upright && if self.outline.len() < 3 { bounds.contains(point) } else { self.surrounds(point) }
    }

    /// Even-odd rule.
    fn surrounds(&self, point: &Point3<f32>) -> bool {
        let count = self.outline.len();
        let crossed = (0..count).filter(|&index| {
            let ([ax, az], [bx, bz]) = (self.outline[index], self.outline[(index + 1) % count]);
            (az > point.z) != (bz > point.z) && point.x < ax + (point.z - az) / (bz - az) * (bx - ax)
        });
        crossed.count() % 2 == 1
    }
}

/// The rooms of the scene called `name`; none where the data set describes none.
pub(super) fn regions(
    dataset: &Dataset,
    scene: &SceneInstance,
    name: &str,
    report: &mut Report,
) -> Result<Vec<Room>, SceneError> {
    let Some(file) = description(dataset, scene, name)? else { return Ok(Vec::new()) };
    let description: Description = files::read_json(&file)?;
    let mut rooms = Vec::new();
    for annotation in &description.region_annotations {
        match room(annotation) {
            Some(room) if rooms.len() < usize::from(u16::MAX) => rooms.push(room),
            _ => report.warn(format!(
                "region {:?} of {} has no outline; left out",
                annotation.name,
                file.display()
            )),
        }
    }
    let floors: Vec<f32> = rooms.iter().map(|room: &Room| room.region.bounds.min.y).collect();
    rooms.iter_mut().zip(storeys(&floors)).for_each(|(room, storey)| room.region.storey = storey);
    Ok(rooms)
}

/// The file that describes the scene's rooms: the one the scene names, else the one that has its name.
fn description(dataset: &Dataset, scene: &SceneInstance, name: &str) -> Result<Option<PathBuf>, SceneError> {
    let wanted = scene.semantic_scene_instance.replace(OWN_NAME, name);
    let named = dataset.semantics.get(&wanted).and_then(Value::as_str);
    if let Some(path) = named.and_then(|file| files::inside(&dataset.root, &dataset.root, file)) {
        return Ok(path.is_file().then_some(path));
    }
    let paths = dataset.semantics.get("paths").and_then(|paths| paths.get(".json")?.as_array());
    let patterns = paths.into_iter().flatten().filter_map(Value::as_str);
    let all = files::matching(&dataset.root, patterns, SUFFIX)?;
    let called = |stem: &str| all.iter().find(|path| path.ends_with(format!("{stem}{SUFFIX}"))).cloned();
    let stem = wanted.strip_suffix(SUFFIX).unwrap_or(&wanted);
    Ok(if stem.is_empty() { called(name) } else { called(stem).or_else(|| called(name)) })
}

/// The files of semantic descriptions that the data set names one by one.
pub(super) fn named_descriptions(dataset: &Dataset) -> Vec<PathBuf> {
    let named =
        dataset.semantics.iter().filter(|(key, _)| *key != "paths").filter_map(|(_, file)| file.as_str());
    named
        .filter_map(|file| files::inside(&dataset.root, &dataset.root, file))
        .filter(|path| path.is_file())
        .collect()
}

fn room(annotation: &Annotation) -> Option<Room> {
    let floor = annotation.floor_height;
    let corner = |&[x, _, z]: &[f32; 3], y| Point3::new(x, y, z);
    let top = floor + annotation.extrusion_height;
    let corners: Vec<Point3<f32>> =
        annotation.poly_loop.iter().flat_map(|at| [corner(at, floor), corner(at, top)]).collect();
    let stored = || Some(Aabb::new(annotation.min_bounds?.into(), annotation.max_bounds?.into()));
    let bounds = Aabb::around(&corners).or_else(stored)?;
    let finite = bounds.min.iter().chain(bounds.max.iter()).all(|coordinate| coordinate.is_finite());
    let words = if annotation.label.is_empty() { &annotation.name } else { &annotation.label };
    let label = words.chars().filter(|letter| !letter.is_control()).take(MAX_WORD_CHARS).collect();
    finite.then(|| Room {
        region: Region { label, bounds, storey: 0 },
        outline: annotation.poly_loop.iter().map(|&[x, _, z]| [x, z]).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outline_with_a_corner_cut_out_holds_what_lies_inside() {
        let annotation = Annotation {
            label: "kitchen".to_owned(),
            poly_loop: vec![
                [0.0; 3],
                [4.0, 0.0, 0.0],
                [4.0, 0.0, 2.0],
                [2.0, 0.0, 2.0],
                [2.0, 0.0, 4.0],
                [0.0, 0.0, 4.0],
            ],
            floor_height: 3.0,
            extrusion_height: 2.5,
            ..Annotation::default()
        };
        let room = room(&annotation).unwrap();
        assert_eq!(room.region.bounds, Aabb::new(Point3::new(0.0, 3.0, 0.0), Point3::new(4.0, 5.5, 4.0)));
        for (x, y, z, inside) in
            [(1.0, 3.5, 3.0, true), (3.0, 3.5, 3.0, false), (3.0, 3.5, 1.0, true), (1.0, 2.0, 1.0, false)]
        {
            assert_eq!(room.holds(&Point3::new(x, y, z)), inside, "{x} {y} {z}");
        }
    }
}
