//! The files of a data set: listing folders, `*` in names, and staying inside of the data set's folder.

use super::malformed;
use crate::glb::read_limited;
use avln_scene::SceneError;
use serde::de::DeserializeOwned;
use std::path::{Component, Path, PathBuf};

/// Bytes of one configuration or table.
pub(super) const MAX_CONFIG_BYTES: u64 = 64 << 20;
/// Files that one pattern may match.
const MAX_MATCHES: usize = 1 << 18;

/// Reads a JSON file.
pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, SceneError> {
    let bytes = read(path)?;
    serde_json::from_slice(&bytes).map_err(|error| {
        malformed(path, &format!("it is not the JSON that is expected here ({error}); correct it"))
    })
}

pub(super) fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_limited(path, MAX_CONFIG_BYTES)
        .map_err(|source| SceneError::Read { path: path.display().to_string(), source })
}

/// The files of a folder whose names end in `suffix`, sorted.
pub(super) fn with_suffix(folder: &Path, suffix: &str) -> Result<Vec<PathBuf>, SceneError> {
    let mut found = entries(folder)?;
    found.retain(|path| path.to_string_lossy().ends_with(suffix) && path.is_file());
    Ok(found)
}

/// Everything in a folder, sorted; nothing where it is no folder.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let read = |source| SceneError::Read { path: folder.display().to_string(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        found.push(entry.map_err(read)?.path());
        if found.len() > MAX_MATCHES {
            return Err(malformed(folder, &format!("it holds more than {MAX_MATCHES} files; split it")));
        }
    }
    found.sort();
    Ok(found)
}

/// The files ending in `suffix` that patterns relative to `root` name: a file itself, or those directly in a folder.
pub(super) fn matching<'a>(
    root: &Path,
    patterns: impl Iterator<Item = &'a str>,
    suffix: &str,
) -> Result<Vec<PathBuf>, SceneError> {
    let mut found = Vec::new();
    for pattern in patterns {
        for path in expanded(root, pattern)? {
            if path.is_dir() {
                found.extend(with_suffix(&path, suffix)?);
            } else if path.to_string_lossy().ends_with(suffix) && path.is_file() {
                found.push(path);
            }
        }
        if found.len() > MAX_MATCHES {
            return Err(malformed(
                root,
                &format!(
                    "its path {pattern:?} and others match more than {MAX_MATCHES} files; split the data set"
                ),
            ));
        }
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// The paths that a pattern with `*` inside of names stands for; none outside of `root`.
fn expanded(root: &Path, pattern: &str) -> Result<Vec<PathBuf>, SceneError> {
    let Some(relative) = normalised(Path::new(pattern)) else { return Ok(Vec::new()) };
    let mut open = vec![root.to_owned()];
    for component in relative.components() {
        let name = component.as_os_str().to_string_lossy();
        let mut next = Vec::new();
        for folder in open {
            if !name.contains('*') {
                next.push(folder.join(component));
                continue;
            }
            let fits =
                |path: &PathBuf| path.file_name().is_some_and(|file| fits(&file.to_string_lossy(), &name));
            next.extend(entries(&folder)?.into_iter().filter(fits));
        }
        open = next;
    }
    Ok(open)
}

/// Whether `name` is `pattern` with each `*` standing for any letters.
fn fits(name: &str, pattern: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = name.strip_prefix(first) else { return false };
    let mut parts: Vec<&str> = parts.collect();
    let Some(last) = parts.pop() else { return rest.is_empty() };
    for part in parts {
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    rest.ends_with(last)
}

/// `address`, relative to `folder`, as a path; `None` when it lies outside of `root`.
pub(super) fn inside(root: &Path, folder: &Path, address: &str) -> Option<PathBuf> {
    let from_root = folder.strip_prefix(root).ok()?.join(address);
    normalised(&from_root).map(|relative| root.join(relative))
}

/// The path without `.` and `..`; `None` when it leaves its start or has one of its own.
fn normalised(path: &Path) -> Option<PathBuf> {
    let mut plain = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::Normal(name) => plain.push(name),
            Component::ParentDir if plain.pop() => {}
            _ => return None,
        }
    }
    Some(plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_stand_for_any_letters_inside_of_a_name() {
        for (name, pattern, expected) in [
            ("a.glb", "*.glb", true),
            ("a.glb", "*", true),
            ("a.glb", "a*b", true),
            ("a.glb", "a.glb", true),
            ("ab", "a*b*b", false),
            ("a.glbx", "*.glb", false),
            ("b", "a*", false),
            ("aa", "aa*a", false),
        ] {
            assert_eq!(fits(name, pattern), expected, "{name} {pattern}");
        }
    }

    #[test]
    fn an_address_may_climb_up_to_the_root_and_no_further() {
        let (root, folder) = (Path::new("set"), Path::new("set/configs/objects"));
        assert_eq!(inside(root, folder, "../../objects/a.glb"), Some(PathBuf::from("set/objects/a.glb")));
        for address in ["../../../a.glb", "/etc/passwd", "x/../../../../a"] {
            assert_eq!(inside(root, folder, address), None, "{address}");
        }
    }
}
