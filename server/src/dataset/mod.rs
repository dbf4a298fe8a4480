//! Data sets on disk: reading them scene by scene, building them on all processors, checking them, taking in those of
//! others; pictures with what is in them.

pub mod build;
pub mod check;
pub mod export;
mod files;
mod folder;
pub mod frames;
pub mod import;
mod seal;
mod shares;

pub use files::{DatasetFiles, Sealed};
pub use folder::SplitFolder;
pub use seal::Passphrase;
