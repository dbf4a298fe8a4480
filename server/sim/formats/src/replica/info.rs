//! The table of a Replica scene (`info_semantic.json`).

use crate::files::Checked;
use avln_scene::limits::MAX_ENTRIES;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};

#[derive(Deserialize)]
struct File {
    #[serde(default)]
    classes: Vec<Class>,
    #[serde(default)]
    id_to_label: Vec<i64>,
    objects: Vec<Entry>,
}

#[derive(Deserialize)]
struct Class {
    id: i64,
    name: String,
}

#[derive(Deserialize)]
struct Entry {
    id: i64,
    class_id: Option<i64>,
    class_name: Option<String>,
    oriented_bbox: Option<Oriented>,
}

#[derive(Deserialize)]
struct Oriented {
    abb: Abb,
}

#[derive(Deserialize)]
struct Abb {
    sizes: [f64; 3],
}

/// A thing with the name of its class; empty where nothing names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Thing {
    pub(super) id: u32,
    pub(super) class: String,
}

/// Reads the table. Things of a negative class belong to nobody and are left out.
pub(super) fn parse(bytes: &[u8], max_id: u32) -> Checked<Vec<Thing>> {
    let file: File = serde_json::from_slice(bytes)
        .map_err(|error| format!("it is no table of Replica ({error}); copy info_semantic.json again"))?;
    if file.objects.len() > MAX_ENTRIES || file.classes.len() > MAX_ENTRIES {
        return Err(format!("it lists more than {MAX_ENTRIES} objects or classes"));
    }
    let mut name_of = BTreeMap::new();
    for class in &file.classes {
        if name_of.insert(class.id, class.name.as_str()).is_some_and(|before| before != class.name) {
            return Err(format!("class {} is there a second time under another name", class.id));
        }
    }
    let mut seen = BTreeSet::new();
    let mut things = Vec::new();
    for entry in &file.objects {
        let id = u32::try_from(entry.id).ok().filter(|&id| id <= max_id).ok_or_else(|| {
            format!("an object has number {}, numbers are 0 to {max_id}; number them anew", entry.id)
        })?;
        if !seen.insert(id) {
            return Err(format!("object {id} is there a second time; number them anew"));
        }
        check_size(id, entry)?;
        let listed = || file.id_to_label.get(id as usize).copied();
        let class = entry.class_id.or_else(listed);
        let by_class = class.and_then(|class| name_of.get(&class).copied());
        if let Some(class) = by_class.or(entry.class_name.as_deref()) {
            things.push(Thing { id, class: class.to_owned() });
        }
    }
    Ok(things)
}

/// Boxes are not used, the faces say where a thing is; but a broken one tells of a broken file.
fn check_size(id: u32, entry: &Entry) -> Checked<()> {
    let sizes = entry.oriented_bbox.as_ref().map_or([0.0; 3], |oriented| oriented.abb.sizes);
    match sizes.iter().find(|size| size.is_nan() || **size < 0.0) {
        Some(size) => {
            Err(format!("the box of object {id} has the size {size} m; copy info_semantic.json again"))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_are_found_by_number_by_list_or_by_name() {
        let text = r#"{"classes": [{"id": 3, "name": "sofa"}, {"id": 5, "name": "rug"}], "id_to_label": [5, -1],
            "objects": [{"id": 7, "class_id": 3, "class_name": "couch"}, {"id": 0},
                {"id": 1}, {"id": 9, "class_id": 77, "class_name": "lamp"}]}"#;
        let things = parse(text.as_bytes(), 100).unwrap();
        let found: Vec<(u32, &str)> = things.iter().map(|thing| (thing.id, thing.class.as_str())).collect();
        assert_eq!(found, [(7, "sofa"), (0, "rug"), (9, "lamp")]);
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, expected) in [
            (r#"{"objects": ["#, "line 1 column"),
            (r#"{"classes": []}"#, "objects"),
            (r#"{"objects": [{"id": 4}, {"id": 4}]}"#, "object 4 is there a second time"),
            (r#"{"objects": [{"id": -4}]}"#, "number -4"),
            (r#"{"objects": [{"id": 101}]}"#, "number 101"),
            (
                r#"{"objects": [{"id": 4, "oriented_bbox": {"abb": {"sizes": [1, -2, 1]}}}]}"#,
                "object 4 has the size -2",
            ),
            (r#"{"classes": [{"id": 1, "name": "a"}, {"id": 1, "name": "b"}], "objects": []}"#, "class 1"),
        ] {
            let error = parse(text.as_bytes(), 100).unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
