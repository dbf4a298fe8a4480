//! The folder that holds everything the server keeps.

use crate::{Failure, FailureKind};
use avln_dataset::Split;
use avln_store::Store;
use std::{
    io,
    path::{Path, PathBuf},
};

/// The folder that holds everything the server keeps: `avln.db` and `splits/`.
#[derive(Clone, Debug)]
pub struct DataFolder {
    root: PathBuf,
}

impl DataFolder {
    /// Opens the folder, and makes it when it is not there.
    ///
    /// # Errors
    /// When it cannot be made or written to.
    pub fn open(root: &Path) -> Result<Self, Failure> {
        let failed = |error: io::Error| {
            Failure::new(
                FailureKind::Data,
                format!("cannot write to data folder {}: {error}", root.display()),
            )
            .hinted("choose a folder of your own with --data FOLDER, or give this one write permission")
        };
        std::fs::create_dir_all(root.join("splits")).map_err(failed)?;
        let probe = root.join(".writable");
        std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe)).map_err(failed)?;
        let root = root.canonicalize().map_err(failed)?;
        Ok(Self { root })
    }

    /// Where the folder lies.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Opens its database, and makes it when it is not there.
    ///
    /// # Errors
    /// When it is not a database of this or an older version, or cannot be written to.
    pub async fn store(&self) -> Result<Store, Failure> {
        Ok(Store::open(&self.root.join("avln.db")).await?)
    }

    /// Writes a split; its name must be free.
    ///
    /// # Errors
    /// When there is one of that name with other content, or the file cannot be written.
    pub fn save_split(&self, split: &Split) -> Result<(), Failure> {
        let (path, bytes) = (self.split_path(&split.name)?, split.to_json()?);
        if path.exists() && self.split_bytes(&split.name)? != bytes {
            return Err(Failure::new(
                FailureKind::Scene,
                format!("split '{}' exists with other missions", split.name),
            )
            .hinted("give the new split another name"));
        }
        // A file under its final name is always whole.
        let partial = path.with_extension("json.partial");
        std::fs::write(&partial, bytes).and_then(|()| std::fs::rename(&partial, &path)).map_err(|error| {
            Failure::new(FailureKind::Data, format!("cannot write split file {}: {error}", path.display()))
        })
    }

    /// Reads the split called `name`.
    ///
    /// # Errors
    /// When there is none, or its file cannot be used.
    pub fn split(&self, name: &str) -> Result<Split, Failure> {
        Ok(Split::from_json(&self.split_bytes(name)?)?)
    }

    /// Digest of the split file: it changes whenever a mission does.
    ///
    /// # Errors
    /// When there is no such split.
    pub fn split_digest(&self, name: &str) -> Result<String, Failure> {
        Ok(blake3::hash(&self.split_bytes(name)?).to_hex().to_string())
    }

    fn split_bytes(&self, name: &str) -> Result<Vec<u8>, Failure> {
        let path = self.split_path(name)?;
        std::fs::read(&path).map_err(|error| {
            Failure::new(
                FailureKind::Data,
                format!("cannot read split '{name}' at {}: {error}", path.display()),
            )
            .hinted("make it with: avln split make NAME")
        })
    }

    fn split_path(&self, name: &str) -> Result<PathBuf, Failure> {
        check_name("split", name)?;
        Ok(self.root.join("splits").join(format!("{name}.json")))
    }
}

/// Names become file names and parts of URLs: letters, digits, `-` and `_`, at most 64.
///
/// # Errors
/// When `name` is none.
pub fn check_name(what: &str, name: &str) -> Result<(), Failure> {
    const LONGEST: usize = 64;
    let fits = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
    if !name.is_empty() && name.len() <= LONGEST && name.chars().all(fits) {
        return Ok(());
    }
    Err(Failure::new(FailureKind::Scene, format!("'{}' cannot be the name of a {what}", name.escape_debug()))
        .hinted(format!("use 1 to {LONGEST} letters, digits, - and _")))
}
