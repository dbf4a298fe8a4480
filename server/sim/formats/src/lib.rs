//! Scene files: importers of scans and 3D models, exporters to GLB and HM3D.
//!
//! Start reading at [`open`].
//!
//! *Never*: decides where one can walk, what is seen or what is heard; knows of missions.

mod bake;
mod files;
mod frame;
pub mod gibson;
pub mod glb;
pub mod habitat;
pub mod hm3d;
mod labelled;
pub mod mp3d;
pub mod obj;
pub mod open;
mod pictures;
pub mod ply;
pub mod procthor;
pub mod replica;
mod report;
#[cfg(test)]
mod testing;

pub use frame::{Options, Unit, Up};
pub use report::Report;
