//! Scene files: importers for scans and 3D models, exporters to GLB and HM3D.
//!
//! Start at [`open`].
//!
//! *Never*: depends on missions.

mod basis;
mod extras;
mod files;
pub mod gibson;
pub mod glb;
pub mod habitat;
pub mod hm3d;
mod images;
mod labels;
pub mod mp3d;
mod named_model;
pub mod obj;
pub mod open;
mod options;
pub mod ply;
pub mod procthor;
pub mod replica;
#[cfg(test)]
mod testing;
mod world_frame;

pub use options::{ImportOptions, ImportReport, LengthUnit, UpAxis};
