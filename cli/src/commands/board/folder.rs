//! A copy on the disk: its files, the list of their digests, and the server's signature under the list.

use avln_arena::{Failure, FailureKind, runlog::SigningKey};
use sha2::{Digest, Sha256};
use std::{
    fmt::Write as _,
    fs, io,
    path::{Path, PathBuf},
};

/// The list of all other files and their digests.
pub(super) const SUMS: &str = "SHA256SUMS";
/// The key and its signature under that list, hexadecimal, a line each.
pub(super) const SIGNATURE: &str = "SHA256SUMS.sig";

/// Files that are written and counted.
pub(super) struct Folder {
    folder: PathBuf,
    sums: Vec<(String, String)>,
}

impl Folder {
    /// A copy in `folder`, which must be empty.
    pub(super) fn begin(folder: &Path) -> Result<Self, Failure> {
        let failed = |error| cannot_write(folder, &error);
        fs::create_dir_all(folder).map_err(failed)?;
        if fs::read_dir(folder).map_err(failed)?.next().is_some() {
            let message = format!("folder {} is not empty", folder.display());
            return Err(Failure::new(FailureKind::Data, message).hinted("choose an empty one with --out"));
        }
        Ok(Self { folder: folder.to_owned(), sums: vec![] })
    }

    /// Writes a file of the copy.
    pub(super) fn keep(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        self.sums.push((name.to_owned(), digest(bytes)));
        fs::write(path, bytes)
    }

    /// Writes the list of digests, and signs it.
    pub(super) fn end(mut self, key: &SigningKey) -> io::Result<()> {
        self.sums.sort();
        let mut list = String::new();
        for (name, digest) in &self.sums {
            let _ = writeln!(list, "{digest}  {name}");
        }
        let signature = format!("{}\n{}\n", key.public(), key.sign(&statement(&list)));
        fs::write(self.folder.join(SUMS), list)?;
        fs::write(self.folder.join(SIGNATURE), signature)
    }
}

/// What is signed of a list of digests; nothing else that the server signs reads like it.
pub(super) fn statement(list: &str) -> String {
    format!("frozen board {}", digest(list.as_bytes()))
}

/// SHA-256, hexadecimal.
pub(super) fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

pub(super) fn cannot_write(folder: &Path, error: &io::Error) -> Failure {
    Failure::new(FailureKind::Data, format!("cannot write to {}: {error}", folder.display()))
        .hinted("choose a folder of your own with --out")
}
