//! Wide vector instructions and memory-mapped files: all `unsafe` code of servers and agents.
//!
//! The `README.md` of this crate contains the soundness arguments.
//!
//! This crate never contains knowledge about scenes or images.

mod widest;

use memmap2::Mmap;
use std::fs::File;
use std::io;
use std::path::Path;
pub use widest::{Width, Work, run_at};

/// A memory-mapped file, loaded on first access and shared between processes.
pub struct Mapped(Mmap);

impl Mapped {
    /// Maps the file at `path`, which must not be modified any more; it may be unlinked.
    ///
    /// # Errors
    /// If the file cannot be opened or mapped, for example an empty file.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        // SAFETY: callers guarantee that the content does not change while it is borrowed; see README.md.
        unsafe { Mmap::map(&file) }.map(Self)
    }
}

impl AsRef<[u8]> for Mapped {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mapped_file_is_readable_after_unlink() {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let path = folder.path().join("file");
        std::fs::write(&path, b"some bytes").expect("a file");
        let mapped = Mapped::open(&path).expect("a mapping");
        std::fs::remove_file(&path).expect("the file is there");
        assert_eq!(mapped.as_ref(), b"some bytes");
        assert!(Mapped::open(&path).is_err(), "it is gone");
    }
}
