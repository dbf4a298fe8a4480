//! Instance categories, from configurations, semantic lexicons and metadata tables; rooms from semantic configurations.

use crate::files::{ImportReport, bounded, plain_words};
use crate::habitat::dataset::{
    Dataset, InstanceEntry, OWN_NAME, SceneInstance, Template, inside, matching, read, read_json, with_suffix,
};
use crate::named_model::category_of_name;
use avln_geom::{Aabb, Point3};
use avln_scene::describe::{Meaning, meaning, storeys};
use avln_scene::{Region, SceneError};
use csv::{ByteRecord, ReaderBuilder};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Category keys in `user_defined`, the most specific first.
const CATEGORY_KEYS: [&str; 5] = ["category", "mpcat40", "class", "class_name", "semantic_class"];
/// Template name columns in metadata tables.
const ID_COLUMNS: [&str; 4] = ["id", "template", "template_name", "model_id"];
/// Category columns in metadata tables, the most specific first (HSSD has the first two).
const CATEGORY_COLUMNS: [&str; 4] = ["clean_category", "main_category", "category", "super_category"];
/// Metadata folders in a data set.
const TABLE_FOLDERS: [&str; 2] = ["metadata", "semantics"];
/// Mark before the part number in divided models' template names.
const PART_MARK: &str = "_part_";

pub(super) struct CategorySources {
    class_of: BTreeMap<i64, String>,
    table: BTreeMap<String, String>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Lexicon {
    #[serde(deserialize_with = "bounded")]
    classes: Vec<LexiconClass>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct LexiconClass {
    id: i64,
    name: String,
}

impl CategorySources {
    pub(super) fn read(dataset: &Dataset, report: &mut ImportReport) -> Result<Self, SceneError> {
        let mut labels = Self { class_of: BTreeMap::new(), table: BTreeMap::new() };
        for file in named_descriptions(dataset) {
            let lexicon: Lexicon = read_json(&file)?;
            labels.class_of.extend(lexicon.classes.into_iter().map(|class| (class.id, class.name)));
        }
        for folder in TABLE_FOLDERS {
            for file in with_suffix(&dataset.root.join(folder), ".csv")? {
                labels.add_table(&file, report)?;
            }
        }
        Ok(labels)
    }

    fn add_table(&mut self, file: &Path, report: &mut ImportReport) -> Result<(), SceneError> {
        let bytes = read(file)?;
        let mut reader = ReaderBuilder::new().flexible(true).from_reader(&bytes[..]);
        let header = reader.byte_headers().map(words).unwrap_or_default();
        let column = |names: &[&str]| {
            let position =
                |name: &&str| header.iter().position(|cell| cell.trim().eq_ignore_ascii_case(name));
            names.iter().find_map(position)
        };
        let (Some(id), Some(category)) = (column(&ID_COLUMNS), column(&CATEGORY_COLUMNS)) else {
            report.warn(format!("{} has no columns of ids and categories; it is ignored", file.display()));
            return Ok(());
        };
        for row in reader.byte_records().flatten() {
            let row = words(&row);
            if let (Some(id), Some(category)) =
                (row.get(id), row.get(category).filter(|words| !words.is_empty()))
            {
                self.table.entry(id.clone()).or_insert_with(|| category.clone());
            }
        }
        Ok(())
    }

    /// Returns an instance's meaning, by the first source with a category.
    pub(super) fn of(&self, instance: &InstanceEntry, template: &Template) -> Meaning {
        let lexicon = || template.semantic_id.and_then(|id| self.class_of.get(&id).cloned());
        let by_name = || category_of_name(&template.name).map(str::to_owned);
        // From specific to general: an instance can differ from its template, and a name is only a guess.
        let words = category_words(&instance.user_defined)
            .or_else(|| category_words(&template.user_defined))
            .or_else(lexicon)
            .or_else(|| self.in_table(&template.name))
            .or_else(by_name);
        words.map_or(Meaning::Unknown, |words| meaning(&words))
    }

    fn in_table(&self, template: &str) -> Option<String> {
        let whole = template.split(PART_MARK).next().unwrap_or(template);
        self.table.get(template).or_else(|| self.table.get(whole)).cloned()
    }
}

fn category_words(user_defined: &Map<String, Value>) -> Option<String> {
    let words = CATEGORY_KEYS.iter().filter_map(|key| user_defined.get(*key)?.as_str());
    words.map(str::trim).find(|words| !words.is_empty()).map(str::to_owned)
}

/// Cells in a row; broken characters are replaced.
fn words(row: &ByteRecord) -> Vec<String> {
    row.iter().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect()
}

const SUFFIX: &str = ".semantic_config.json";
/// Depth below a room's floor that still belongs to it, metres.
const BELOW_FLOOR_M: f32 = 0.3;

#[derive(Default, Deserialize)]
#[serde(default)]
struct Description {
    #[serde(deserialize_with = "bounded")]
    region_annotations: Vec<RegionAnnotation>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct RegionAnnotation {
    name: String,
    label: String,
    /// Floor corners, metres.
    #[serde(deserialize_with = "bounded")]
    poly_loop: Vec<[f32; 3]>,
    floor_height: f32,
    extrusion_height: f32,
    min_bounds: Option<[f32; 3]>,
    max_bounds: Option<[f32; 3]>,
}

pub(super) struct HabitatRoom {
    pub(super) region: Region,
    outline: Vec<[f32; 2]>,
}

impl HabitatRoom {
    pub(super) fn contains(&self, point: &Point3<f32>) -> bool {
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

/// Reads the rooms for the scene `name`; none if the data set has no description.
pub(super) fn regions(
    dataset: &Dataset,
    scene: &SceneInstance,
    name: &str,
    report: &mut ImportReport,
) -> Result<Vec<HabitatRoom>, SceneError> {
    let Some(file) = description(dataset, scene, name)? else { return Ok(Vec::new()) };
    let description: Description = read_json(&file)?;
    let mut rooms = Vec::new();
    for annotation in &description.region_annotations {
        match room(annotation) {
            Some(room) if rooms.len() < usize::from(u16::MAX) => rooms.push(room),
            _ => {
                let (name, file) = (&annotation.name, file.display());
                report.warn(format!("region {name:?} of {file} has no outline; left out"));
            }
        }
    }
    let floors: Vec<f32> = rooms.iter().map(|room: &HabitatRoom| room.region.bounds.min.y).collect();
    rooms.iter_mut().zip(storeys(&floors)).for_each(|(room, storey)| room.region.storey = storey);
    Ok(rooms)
}

/// File with the rooms: the file in the scene's configuration, or the file with the scene's name.
fn description(dataset: &Dataset, scene: &SceneInstance, name: &str) -> Result<Option<PathBuf>, SceneError> {
    let wanted = scene.semantic_scene_instance.replace(OWN_NAME, name);
    let named = dataset.semantics.get(&wanted).and_then(Value::as_str);
    if let Some(path) = named.and_then(|file| inside(&dataset.root, &dataset.root, file)) {
        return Ok(path.is_file().then_some(path));
    }
    let paths = dataset.semantics.get("paths").and_then(|paths| paths.get(".json")?.as_array());
    let patterns = paths.into_iter().flatten().filter_map(Value::as_str);
    let all = matching(&dataset.root, patterns, SUFFIX)?;
    let called = |stem: &str| all.iter().find(|path| path.ends_with(format!("{stem}{SUFFIX}"))).cloned();
    let stem = wanted.strip_suffix(SUFFIX).unwrap_or(&wanted);
    Ok(if stem.is_empty() { called(name) } else { called(stem).or_else(|| called(name)) })
}

/// Semantic description files that the data set lists by name.
pub(super) fn named_descriptions(dataset: &Dataset) -> Vec<PathBuf> {
    let named =
        dataset.semantics.iter().filter(|(key, _)| *key != "paths").filter_map(|(_, file)| file.as_str());
    named
        .filter_map(|file| inside(&dataset.root, &dataset.root, file))
        .filter(|path| path.is_file())
        .collect()
}

fn room(annotation: &RegionAnnotation) -> Option<HabitatRoom> {
    let floor = annotation.floor_height;
    let corner = |&[x, _, z]: &[f32; 3], y| Point3::new(x, y, z);
    let top = floor + annotation.extrusion_height;
    let corners: Vec<Point3<f32>> =
        annotation.poly_loop.iter().flat_map(|at| [corner(at, floor), corner(at, top)]).collect();
    let stored = || Some(Aabb::new(annotation.min_bounds?.into(), annotation.max_bounds?.into()));
    let bounds = Aabb::around(&corners).or_else(stored)?;
    let finite = bounds.min.iter().chain(bounds.max.iter()).all(|coordinate| coordinate.is_finite());
    let words = if annotation.label.is_empty() { &annotation.name } else { &annotation.label };
    let label = plain_words(words);
    finite.then(|| HabitatRoom {
        region: Region { label, bounds, storey: 0 },
        outline: annotation.poly_loop.iter().map(|&[x, _, z]| [x, z]).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quoted_cells_may_hold_commas() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("objects.csv");
        let mut sources = CategorySources { class_of: BTreeMap::new(), table: BTreeMap::new() };
        let mut report = ImportReport::default();
        std::fs::write(&file, "name, ID ,category\n\"b, c\",a,\"chair, low\"\nshort\n,d,\n,e,bed,more\n")
            .unwrap();
        sources.add_table(&file, &mut report).unwrap();
        let [a, e] = [("a", "chair, low"), ("e", "bed")].map(|(id, words)| (id.to_owned(), words.to_owned()));
        assert_eq!(sources.table, BTreeMap::from([a, e]));
        assert!(report.warnings.is_empty(), "{report:?}");
        std::fs::write(&file, "").unwrap();
        sources.add_table(&file, &mut report).unwrap();
        assert!(report.warnings[0].contains("no columns of ids"), "{report:?}");
    }

    #[test]
    fn concave_outline_contains_its_inside() {
        let annotation = RegionAnnotation {
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
            ..RegionAnnotation::default()
        };
        let room = room(&annotation).unwrap();
        assert_eq!(room.region.bounds, Aabb::new(Point3::new(0.0, 3.0, 0.0), Point3::new(4.0, 5.5, 4.0)));
        for (x, y, z, inside) in
            [(1.0, 3.5, 3.0, true), (3.0, 3.5, 3.0, false), (3.0, 3.5, 1.0, true), (1.0, 2.0, 1.0, false)]
        {
            assert_eq!(room.contains(&Point3::new(x, y, z)), inside, "{x} {y} {z}");
        }
    }
}
