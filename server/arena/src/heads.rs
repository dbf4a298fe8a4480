//! Measured heads: read from SOFA files, and kept as they were given.

use crate::{Failure, FailureKind, secret};
use avln_acoustics::{Head, MeasuredHead};
use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Largest file that is read: ten times a fine-grained set of responses.
const MOST_BYTES: u64 = 256 << 20;

/// A folder of heads, named by digest.
pub struct HeadFolder {
    folder: PathBuf,
}

impl HeadFolder {
    /// The heads in `folder`, which is created on first use.
    pub fn at(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// Copies the head in the SOFA file `source` and returns its digest.
    ///
    /// # Errors
    /// If the file is not a head, or cannot be copied.
    pub fn adopt(&self, source: &Path) -> Result<String, Failure> {
        let (bytes, _) = read(source)?;
        let digest = digest(&bytes);
        if self.head(&digest).is_err() {
            self.write(&digest, &bytes).map_err(|error| {
                let message = format!("cannot keep the head in {}: {error}", self.folder.display());
                Failure::new(FailureKind::Data, message).hinted("give the folder write permission and space")
            })?;
        }
        Ok(digest)
    }

    /// The head with this digest.
    ///
    /// # Errors
    /// If it is missing or modified.
    pub fn head(&self, wanted: &str) -> Result<Head, Failure> {
        let path = self.path(wanted);
        let hint = "restore the file from a backup, or open the phase again with --head FILE.sofa";
        let (bytes, head) = read(&path).map_err(|failure| failure.hinted(hint))?;
        let found = digest(&bytes);
        if found == wanted {
            return Ok(head);
        }
        let message =
            format!("cannot hear with {}: its digest is {found}, somebody has changed it", path.display());
        Err(Failure::new(FailureKind::Data, message).hinted(hint))
    }

    fn path(&self, digest: &str) -> PathBuf {
        self.folder.join(format!("{digest}.sofa"))
    }

    /// Writes a file under another name and moves it into place when it is complete.
    fn write(&self, digest: &str, bytes: &[u8]) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        let random = secret::random_hex().map_err(io::Error::other)?;
        let unfinished = self.folder.join(format!("{random}.part"));
        fs::write(&unfinished, bytes)?;
        fs::rename(&unfinished, self.path(digest))
    }
}

/// The head in a SOFA file, and the file bytes.
///
/// # Errors
/// If the file is unreadable, too large, or not a head.
pub fn read(path: &Path) -> Result<(Vec<u8>, Head), Failure> {
    let bytes = bytes_of(path).map_err(|error| unusable(path, error, "check the path"))?;
    let hint = "the sphere, without --head, needs no file";
    let head = MeasuredHead::from_sofa(&bytes).map_err(|error| unusable(path, error, hint))?;
    Ok((bytes, Head::Measured(Arc::new(head))))
}

fn bytes_of(path: &Path) -> io::Result<Vec<u8>> {
    let bytes = fs::metadata(path)?.len();
    if bytes > MOST_BYTES {
        return Err(io::Error::other(format!("{bytes} bytes; heads of up to {MOST_BYTES} are read")));
    }
    fs::read(path)
}

fn unusable(path: &Path, why: impl std::fmt::Display, hint: &str) -> Failure {
    Failure::new(FailureKind::Data, format!("cannot use {}: {why}", path.display())).hinted(hint)
}

/// BLAKE3, hex.
fn digest(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}
