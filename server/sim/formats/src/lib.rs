//! Scene files: importers for scans and 3D models, exporters to GLB and HM3D.
//!
//! Start at [`open`].
//!
//! This crate never depends on missions.

mod files;
mod gibson;
pub mod glb;
mod habitat;
pub mod hm3d;
mod images;
mod labels;
mod mp3d;
mod named_model;
mod obj;
pub mod open;
mod ply;
mod procthor;
mod replica;
#[cfg(test)]
mod tests;
mod world_frame;

pub use files::ImportReport;
pub use world_frame::{ImportOptions, LengthUnit, UpAxis};
