//! The table of a Gibson building (`X.scn`).

use crate::files::Checked;
use avln_scene::limits::MAX_ENTRIES;
use serde::Deserialize;
use std::collections::BTreeSet;

#[derive(Deserialize)]
struct File {
    objects: Vec<Entry>,
}

#[derive(Deserialize)]
struct Entry {
    id: i64,
    #[serde(default)]
    class_: String,
    location: Option<[f32; 3]>,
    size: Option<[f32; 3]>,
}

/// A thing: its number, class and box in the file's own frame, where it says one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Thing {
    pub(super) id: u32,
    pub(super) class: String,
    /// Centre and size.
    pub(super) place: Option<[[f32; 3]; 2]>,
}

/// Reads the table; numbers are 1 to `max_id`.
pub(super) fn parse(bytes: &[u8], max_id: u32) -> Checked<Vec<Thing>> {
    let file: File = serde_json::from_slice(bytes)
        .map_err(|error| format!("it is no table of Gibson ({error}); copy the .scn file again"))?;
    if file.objects.len() > MAX_ENTRIES {
        return Err(format!("it lists more than {MAX_ENTRIES} objects"));
    }
    let mut seen = BTreeSet::new();
    let mut things = Vec::new();
    for entry in file.objects {
        let id = u32::try_from(entry.id).ok().filter(|id| (1..=max_id).contains(id)).ok_or_else(|| {
            format!("an object has number {}, numbers are 1 to {max_id}; number them anew", entry.id)
        })?;
        if !seen.insert(id) {
            return Err(format!("object {id} is there a second time; number them anew"));
        }
        if let Some(size) =
            entry.size.and_then(|sizes| sizes.into_iter().find(|size| size.is_nan() || *size < 0.0))
        {
            return Err(format!("object {id} has the size {size} m; copy the .scn file again"));
        }
        let place = entry.location.zip(entry.size).map(|(center, size)| [center, size]);
        things.push(Thing { id, class: entry.class_, place });
    }
    Ok(things)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_is_named() {
        for (text, expected) in [
            (r#"{"objects": [{"id": 1"#, "line 1 column"),
            (r#"{"objects": [{"id": 0}]}"#, "number 0"),
            (r#"{"objects": [{"id": 2}, {"id": 2}]}"#, "object 2 is there a second time"),
            (r#"{"objects": [{"id": 2, "size": [1, 1, -3]}]}"#, "object 2 has the size -3"),
            (r#"{"objects": [{"id": 2, "size": [1, 1]}]}"#, "line 1 column"),
        ] {
            let error = parse(text.as_bytes(), 9).unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
