//! Files: size limits, neighbouring files, symbolic links and Git LFS pointers; the import report.

use avln_scene::SceneError;
use avln_scene::limits::{MAX_ENTRIES, MAX_WORD_CHARS};
use percent_encoding::percent_decode_str;
use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};
use std::path::{Component, Path, PathBuf};
use std::{fs::File, io::Read, marker::PhantomData};

/// A result with the reason as its error, in words that continue "… is not a usable scene: ".
pub(crate) type Checked<T> = Result<T, String>;

/// First words in a Git LFS pointer, the text instead of a file that was not downloaded.
const LFS_POINTER: &[u8] = b"version https://git-lfs";
const LFS_ADVICE: &str = "it is a Git LFS pointer in the file's place; run `git lfs pull` in its folder";
/// Greatest size for a text link or Git LFS pointer.
const MAX_STAND_IN_BYTES: u64 = 1024;
const MAX_LINKS: usize = 4;

pub(crate) fn refuse_if(is_bad: bool, reason: impl FnOnce() -> String) -> Checked<()> {
    if is_bad { Err(reason()) } else { Ok(()) }
}

pub(crate) fn too_many(limit: usize, parts: &str) -> String {
    format!("it has more than {limit} {parts}; decimate it in a 3D editor")
}

/// Returns the error for an unusable file; `reason` continues "… is not a usable scene: ".
pub(crate) fn malformed(path: &Path, reason: impl Into<String>) -> SceneError {
    SceneError::Malformed { path: path.display().to_string(), reason: reason.into() }
}

/// Reads a regular file with at most `limit` bytes, as [`read_limited`].
pub(crate) fn read_regular(path: &Path, limit: u64) -> Result<Vec<u8>, SceneError> {
    read_limited(path, limit).map_err(|source| SceneError::Read { path: path.display().to_string(), source })
}

/// Reads a file with at most `limit` bytes; follows links like [`resolve`].
pub(crate) fn read(path: &Path, limit: u64, report: &mut ImportReport) -> Result<Vec<u8>, SceneError> {
    read_regular(&resolve(path, report)?, limit)
}

/// Follows text links to the real file, with a warning. Refuses Git LFS pointers and long chains.
pub(crate) fn resolve(path: &Path, report: &mut ImportReport) -> Result<PathBuf, SceneError> {
    // Without support for symbolic links, version control writes a link as a short text with the target's name.
    let mut at = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Some(text) = stand_in(&at) else { return Ok(at) };
        if text.starts_with(LFS_POINTER) {
            return Err(malformed(&at, LFS_ADVICE));
        }
        let Some(target) = link_target(&at, &text) else { return Ok(at) };
        let (link, real) = (at.display(), target.display());
        report.warn(format!(
            "{link} contains only the address of a symbolic link; {real} was read in its place"
        ));
        at = target;
    }
    Err(malformed(path, format!("it starts a chain of more than {MAX_LINKS} links; put the real file there")))
}

/// A file's content, if it is short enough for a text link or pointer.
fn stand_in(path: &Path) -> Option<Vec<u8>> {
    let metadata = std::fs::metadata(path).ok()?;
    let is_short = metadata.is_file() && (1..=MAX_STAND_IN_BYTES).contains(&metadata.len());
    if is_short { std::fs::read(path).ok() } else { None }
}

fn link_target(path: &Path, text: &[u8]) -> Option<PathBuf> {
    let address = std::str::from_utf8(text).ok()?.trim_end();
    if address.is_empty() || address.chars().any(char::is_control) || Path::new(address).is_absolute() {
        return None;
    }
    let target = path.parent()?.join(address);
    (target.extension() == path.extension() && target.is_file() && target != path).then_some(target)
}

/// Reads a regular file with at most `limit` bytes. Refuses Git LFS pointers.
pub(crate) fn read_limited(path: &Path, limit: u64) -> std::io::Result<Vec<u8>> {
    let refuse = |reason: String| Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, reason));
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() {
        return refuse("it is not a regular file".to_owned());
    }
    if metadata.len() > limit {
        return refuse(format!("it has {} bytes, at most {limit} are read", metadata.len()));
    }
    // The file may grow after the check of its metadata: `take` enforces the limit while reading.
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    File::open(path)?.take(limit).read_to_end(&mut bytes)?;
    if bytes.starts_with(LFS_POINTER) {
        return refuse(LFS_ADVICE.to_owned());
    }
    Ok(bytes)
}

/// Returns the file for a relative URI. Refuses files outside `folder`.
pub(crate) fn neighbour(folder: &Path, address: &str) -> Checked<PathBuf> {
    let outside = || format!("it refers to {address:?} outside its own folder; move that file next to it");
    let decoded = percent_decode_str(address).decode_utf8().map_err(|_| outside())?;
    let relative = normalised(Path::new(&*decoded)).ok_or_else(outside)?;
    if decoded.contains("://") || decoded.contains('\0') || relative.as_os_str().is_empty() {
        return Err(outside());
    }
    Ok(folder.join(relative))
}

/// Removes `.` and `..`; `None` if the path leaves the start folder, or is absolute.
pub(crate) fn normalised(path: &Path) -> Option<PathBuf> {
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

/// Returns the first existing file `X<suffix>` next to the table `X<ending>`.
pub(crate) fn beside(table: &Path, ending: &str, suffixes: &[&str]) -> Option<PathBuf> {
    let stem = table.file_name()?.to_str()?.strip_suffix(ending)?;
    suffixes.iter().map(|suffix| table.with_file_name(format!("{stem}{suffix}"))).find(|path| path.is_file())
}

/// Returns the file name up to the first dot, with `_` for characters that scene names cannot have.
pub(crate) fn scene_name(path: &Path) -> String {
    let file = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = file.split('.').next().unwrap_or_default();
    let allowed = |letter: char| letter.is_ascii_alphanumeric() || letter == '-' || letter == '_';
    let name: String = stem.chars().map(|letter| if allowed(letter) { letter } else { '_' }).collect();
    if name.is_empty() { "scene".to_owned() } else { name }
}

/// Returns at most [`MAX_WORD_CHARS`] characters, without control characters.
pub(crate) fn plain_words(text: &str) -> String {
    text.chars().filter(|letter| !letter.is_control()).take(MAX_WORD_CHARS).collect()
}

/// Reads a list and refuses one with more than [`MAX_ENTRIES`] entries: a short JSON text can name many defaults.
pub(crate) fn bounded<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_seq(Bounded(PhantomData))
}

struct Bounded<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for Bounded<T> {
    type Value = Vec<T>;

    fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "a list of at most {MAX_ENTRIES} entries")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Vec<T>, A::Error> {
        let mut found = Vec::new();
        while let Some(entry) = entries.next_element()? {
            // An entry of three bytes, `{},`, takes several hundred bytes in memory: without a limit, a small file
            // could exhaust it (docs/decisions/0020).
            if found.len() == MAX_ENTRIES {
                return Err(A::Error::custom(format!("a list has more than {MAX_ENTRIES} entries")));
            }
            found.push(entry);
        }
        Ok(found)
    }
}

const MAX_WARNINGS: usize = 100;
const MORE: &str = "there are further warnings, which are not listed";

/// Notes from a successful import: guesses, replacements and omissions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImportReport {
    /// The recognised layout (`HM3D`, `glTF` …); empty before the import.
    pub layout: &'static str,
    /// Path to a navigation mesh next to the scene.
    pub navmesh: Option<PathBuf>,
    /// Distinct sentences in order; at most 100, and a note if there were more.
    pub warnings: Vec<String>,
}

impl ImportReport {
    /// Adds a warning, unless it is a duplicate.
    pub fn warn(&mut self, text: impl Into<String>) {
        let text = text.into();
        // A damaged file can cause a warning per triangle; the linear search for duplicates stays short because of the limit.
        if self.warnings.len() > MAX_WARNINGS || self.warnings.contains(&text) {
            return;
        }
        self.warnings.push(if self.warnings.len() < MAX_WARNINGS { text } else { MORE.to_owned() });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_links_are_followed_with_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        let [link, real] = ["link.ply", "real.ply"].map(|name| folder.path().join(name));
        std::fs::write(&real, "ply\nformat").unwrap();
        std::fs::write(&link, "real.ply\n").unwrap();
        let mut report = ImportReport::default();
        assert_eq!(resolve(&link, &mut report).unwrap(), real);
        assert!(report.warnings[0].contains("real.ply was read"), "{report:?}");
        assert_eq!(read(&link, 100, &mut report).unwrap(), b"ply\nformat");
        std::fs::write(&real, "link.ply").unwrap();
        assert!(resolve(&link, &mut report).unwrap_err().to_string().contains("chain of more than"));
    }

    #[test]
    fn git_lfs_pointers_are_refused_with_advice() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        std::fs::write(&path, "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n")
            .unwrap();
        let error = read(&path, 100, &mut ImportReport::default()).unwrap_err().to_string();
        assert!(error.contains("mesh.ply") && error.contains("git lfs pull"), "{error}");
    }

    #[test]
    fn other_texts_are_no_links() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.obj");
        for text in ["", "v 0 0 0", "/etc/passwd", "absent.obj", "scene.obj"] {
            std::fs::write(&path, text).unwrap();
            assert_eq!(resolve(&path, &mut ImportReport::default()).unwrap(), path, "{text}");
        }
    }

    #[test]
    fn neighbours_stay_in_the_folder() {
        let folder = Path::new("scenes");
        assert_eq!(neighbour(folder, "a%20b/../c.bin").unwrap(), Path::new("scenes/c.bin"));
        for address in
            ["../secret", "a/../../secret", "/etc/passwd", "https://example.org/a.bin", "", "%00", "%2e%2e/x"]
        {
            assert!(neighbour(folder, address).unwrap_err().contains("its own folder"), "{address}");
        }
    }

    #[test]
    fn warnings_are_unique_and_limited() {
        let mut report = ImportReport::default();
        ["a", "b", "a"].into_iter().for_each(|text| report.warn(text));
        assert_eq!(report.warnings, ["a", "b"]);
        (0..1000).for_each(|number| report.warn(format!("warning {number}")));
        assert_eq!(report.warnings.len(), MAX_WARNINGS + 1);
        assert_eq!(report.warnings[MAX_WARNINGS - 1], "warning 97");
        assert_eq!(report.warnings[MAX_WARNINGS], MORE);
    }
}
