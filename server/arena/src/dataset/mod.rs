//! Data sets on disk, read scene by scene.

/// Files of a data set.
pub mod files;
mod folder;
mod seal;

pub use files::{DatasetFiles, Sealed};
pub use folder::SplitFolder;
pub use seal::Passphrase;
