//! Files as version control and archives leave them: real ones, and stand-ins that only say where the content is.

use crate::Report;
use crate::glb::read_limited;
use avln_scene::SceneError;
use std::path::{Path, PathBuf};

/// A result whose error is the reason, in words that continue "… is not a usable scene: ".
pub(crate) type Checked<T> = Result<T, String>;

/// How the text begins that Git LFS keeps instead of a file.
const LFS_POINTER: &[u8] = b"version https://git-lfs";
/// A stand-in is at most this long.
const MAX_STAND_IN_BYTES: u64 = 1024;
const MAX_LINKS: usize = 4;

/// The sentence that `path` is no scene, for `reason`.
pub(crate) fn malformed(path: &Path, reason: impl Into<String>) -> SceneError {
    SceneError::Malformed { path: path.display().to_string(), reason: reason.into() }
}

/// The bytes of a file, at most `limit` of them; follows links as [`resolve`] does.
pub(crate) fn read(path: &Path, limit: u64, report: &mut Report) -> Result<Vec<u8>, SceneError> {
    let real = resolve(path, report)?;
    read_limited(&real, limit).map_err(|source| SceneError::Read { path: real.display().to_string(), source })
}

/// Where the content of `path` lies. A short text that names a neighbouring file of the same kind is a symbolic link as
/// systems without them check it out, and is followed; the pointer of Git LFS is an error that says so.
pub(crate) fn resolve(path: &Path, report: &mut Report) -> Result<PathBuf, SceneError> {
    let mut at = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Some(text) = stand_in(&at) else { return Ok(at) };
        if text.starts_with(LFS_POINTER) {
            return Err(malformed(
                &at,
                "it is a Git LFS pointer in the file's place; run `git lfs pull` in its folder",
            ));
        }
        let Some(target) = link_target(&at, &text) else { return Ok(at) };
        report.warn(format!(
            "{} holds only the address of a symbolic link; {} was read in its place",
            at.display(),
            target.display()
        ));
        at = target;
    }
    Err(malformed(path, format!("more than {MAX_LINKS} links follow each other; put the real file there")))
}

/// The content of a file that is short enough to be a stand-in.
fn stand_in(path: &Path) -> Option<Vec<u8>> {
    read_limited_quietly(path).filter(|bytes| !bytes.is_empty())
}

fn read_limited_quietly(path: &Path) -> Option<Vec<u8>> {
    let metadata = std::fs::metadata(path).ok()?;
    let is_short = metadata.is_file() && metadata.len() <= MAX_STAND_IN_BYTES;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_checked_out_as_text_is_followed_and_named() {
        let folder = tempfile::tempdir().unwrap();
        let [link, real] = ["link.ply", "real.ply"].map(|name| folder.path().join(name));
        std::fs::write(&real, "ply\nformat").unwrap();
        std::fs::write(&link, "real.ply\n").unwrap();
        let mut report = Report::default();
        assert_eq!(resolve(&link, &mut report).unwrap(), real);
        assert!(report.warnings[0].contains("real.ply was read"), "{report:?}");
        assert_eq!(read(&link, 100, &mut report).unwrap(), b"ply\nformat");
        std::fs::write(&real, "link.ply").unwrap();
        assert!(resolve(&link, &mut report).unwrap_err().to_string().contains("links follow each other"));
    }

    #[test]
    fn a_pointer_of_git_lfs_is_named_with_the_next_step() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        std::fs::write(&path, "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n")
            .unwrap();
        let error = read(&path, 100, &mut Report::default()).unwrap_err().to_string();
        assert!(error.contains("mesh.ply") && error.contains("git lfs pull"), "{error}");
    }

    #[test]
    fn other_texts_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.obj");
        for text in ["", "v 0 0 0", "/etc/passwd", "absent.obj", "scene.obj"] {
            std::fs::write(&path, text).unwrap();
            assert_eq!(resolve(&path, &mut Report::default()).unwrap(), path, "{text}");
        }
    }
}
