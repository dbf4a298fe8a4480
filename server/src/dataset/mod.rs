//! Data sets on disk: reading them scene by scene, building them on all processors, checking them, taking in those of
//! others; pictures with what is in them.

pub mod build;
pub mod check;
pub mod export;
pub(crate) mod files;
mod folder;
pub mod frames;
pub mod import;
pub mod openness;
mod seal;
pub(crate) mod shares;

pub use files::{DatasetFiles, Sealed};
pub use folder::SplitFolder;
pub use seal::Passphrase;
