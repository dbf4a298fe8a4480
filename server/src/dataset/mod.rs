//! Data sets on disk: reading them scene by scene, building them on all processors, checking them.

pub mod build;
pub mod check;
mod files;
mod folder;
mod shares;

pub use files::DatasetFiles;
pub use folder::SplitFolder;
