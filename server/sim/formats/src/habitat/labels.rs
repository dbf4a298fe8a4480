//! What instances are: categories from configurations, semantic lexicons and metadata tables.

use super::config::{Dataset, Instance};
use super::templates::Template;
use super::{Value, files, rooms};
use crate::Report;
use crate::glb::{bounded, category_of_name};
use avln_scene::SceneError;
use avln_scene::describe::{Meaning, meaning};
use serde::Deserialize;
use serde_json::Map;
use std::collections::BTreeMap;
use std::path::Path;

/// Keys of `user_defined` that hold a category, the most exact words first.
const CATEGORY_KEYS: [&str; 5] = ["category", "mpcat40", "class", "class_name", "semantic_class"];
/// Columns of metadata tables that name a template.
const ID_COLUMNS: [&str; 4] = ["id", "template", "template_name", "model_id"];
/// Columns of metadata tables that hold a category, the most exact first (HSSD has the first two).
const CATEGORY_COLUMNS: [&str; 4] = ["clean_category", "main_category", "category", "super_category"];
/// Folders of a data set that may hold metadata tables.
const TABLE_FOLDERS: [&str; 2] = ["metadata", "semantics"];
/// Template names may end in this and a number where a model was cut into parts.
const PART_MARK: &str = "_part_";

/// Where the data set says what things are.
pub(super) struct Labels {
    class_of: BTreeMap<i64, String>,
    table: BTreeMap<String, String>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Lexicon {
    #[serde(deserialize_with = "bounded")]
    classes: Vec<Class>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Class {
    id: i64,
    name: String,
}

impl Labels {
    pub(super) fn read(dataset: &Dataset, report: &mut Report) -> Result<Self, SceneError> {
        let mut labels = Self { class_of: BTreeMap::new(), table: BTreeMap::new() };
        for file in rooms::named_descriptions(dataset) {
            let lexicon: Lexicon = files::read_json(&file)?;
            labels.class_of.extend(lexicon.classes.into_iter().map(|class| (class.id, class.name)));
        }
        for folder in TABLE_FOLDERS {
            for file in files::with_suffix(&dataset.root.join(folder), ".csv")? {
                labels.add_table(&file, report)?;
            }
        }
        Ok(labels)
    }

    fn add_table(&mut self, file: &Path, report: &mut Report) -> Result<(), SceneError> {
        let text = String::from_utf8_lossy(&files::read(file)?).into_owned();
        let mut lines = text.lines();
        let header = cells(lines.next().unwrap_or_default());
        let column = |names: &[&str]| {
            names
                .iter()
                .find_map(|name| header.iter().position(|cell| cell.trim().eq_ignore_ascii_case(name)))
        };
        let (Some(id), Some(category)) = (column(&ID_COLUMNS), column(&CATEGORY_COLUMNS)) else {
            report.warn(format!("{} has no columns of ids and categories; not used", file.display()));
            return Ok(());
        };
        for row in lines.map(cells) {
            if let (Some(id), Some(category)) =
                (row.get(id), row.get(category).filter(|words| !words.is_empty()))
            {
                self.table.entry(id.clone()).or_insert_with(|| category.clone());
            }
        }
        Ok(())
    }

    /// What the instance is, by the first place that says it.
    pub(super) fn of(&self, instance: &Instance, template: &Template) -> Meaning {
        let lexicon = || template.semantic_id.and_then(|id| self.class_of.get(&id).cloned());
        let by_name = || category_of_name(&template.name).map(str::to_owned);
        let words = told(&instance.user_defined)
            .or_else(|| told(&template.user_defined))
            .or_else(lexicon)
            .or_else(|| self.in_table(&template.name))
            .or_else(by_name);
        words.map_or(Meaning::Nothing, |words| meaning(&words))
    }

    fn in_table(&self, template: &str) -> Option<String> {
        let whole = template.split(PART_MARK).next().unwrap_or(template);
        self.table.get(template).or_else(|| self.table.get(whole)).cloned()
    }
}

fn told(user_defined: &Map<String, Value>) -> Option<String> {
    let words = CATEGORY_KEYS.iter().filter_map(|key| user_defined.get(*key)?.as_str());
    words.map(str::trim).find(|words| !words.is_empty()).map(str::to_owned)
}

/// The cells of a comma-separated line; quotes around a cell may hold commas, and quotes written twice.
fn cells(line: &str) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut quoted = false;
    for letter in line.chars() {
        let cell = cells.len() - 1;
        match letter {
            '"' => quoted = !quoted,
            ',' if !quoted => cells.push(String::new()),
            _ => cells[cell].push(letter),
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quoted_cells_may_hold_commas() {
        assert_eq!(cells("a,\"b, c\",,d"), ["a", "b, c", "", "d"]);
        assert_eq!(cells(""), [""]);
    }
}
