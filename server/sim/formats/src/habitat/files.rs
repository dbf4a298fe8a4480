//! Data set files: folders, `*` in names, and paths inside the data set's folder.

use crate::files::{malformed, read_regular};
use avln_scene::SceneError;
use serde::de::DeserializeOwned;
use std::path::{Component, Path, PathBuf};

/// Bytes in a configuration or table.
pub(super) const MAX_CONFIG_BYTES: u64 = 64 << 20;
/// Files per pattern.
const MAX_MATCHES: usize = 1 << 18;

/// Reads a JSON file.
pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, SceneError> {
    let bytes = read(path)?;
    serde_json::from_slice(&bytes)
        .map_err(|error| malformed(path, format!("it is not the expected JSON ({error}); correct it")))
}

pub(super) fn read(path: &Path) -> Result<Vec<u8>, SceneError> {
    read_regular(path, MAX_CONFIG_BYTES)
}

/// Lists a folder's files with the suffix, sorted.
pub(super) fn with_suffix(folder: &Path, suffix: &str) -> Result<Vec<PathBuf>, SceneError> {
    let mut found = entries(folder)?;
    found.retain(|path| path.to_string_lossy().ends_with(suffix) && path.is_file());
    Ok(found)
}

/// Lists a folder, sorted; empty if it is no folder.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let read = |source| SceneError::Read { path: folder.display().to_string(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        found.push(entry.map_err(read)?.path());
        // A folder can be huge: the limit applies while listing, before sorting.
        if found.len() > MAX_MATCHES {
            return Err(malformed(folder, format!("it contains more than {MAX_MATCHES} files; split it")));
        }
    }
    found.sort();
    Ok(found)
}

/// Lists the files with the suffix that match patterns relative to `root`: files, and files directly in matching folders.
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
                format!(
                    "its path {pattern:?} and others match more than {MAX_MATCHES} files; split the data set"
                ),
            ));
        }
    }
    found.sort();
    found.dedup();
    Ok(found)
}

/// Expands a pattern with `*` in names; paths outside `root` are left out.
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

/// Returns whether `name` matches `pattern`; `*` matches any characters.
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

/// Resolves `address` relative to `folder`; `None` if it is outside `root`.
pub(super) fn inside(root: &Path, folder: &Path, address: &str) -> Option<PathBuf> {
    let from_root = folder.strip_prefix(root).ok()?.join(address);
    normalised(&from_root).map(|relative| root.join(relative))
}

/// Removes `.` and `..`; `None` if the path leaves the start folder, or is absolute.
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
    fn star_matches_any_letters_in_a_name() {
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
    fn addresses_stay_inside_the_root() {
        let (root, folder) = (Path::new("set"), Path::new("set/configs/objects"));
        assert_eq!(inside(root, folder, "../../objects/a.glb"), Some(PathBuf::from("set/objects/a.glb")));
        for address in ["../../../a.glb", "/etc/passwd", "x/../../../../a"] {
            assert_eq!(inside(root, folder, address), None, "{address}");
        }
    }
}
