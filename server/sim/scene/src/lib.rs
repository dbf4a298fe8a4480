//! What a building is: mesh, materials, regions and objects; importers, exporter and procedural houses.
//!
//! Start reading at [`Scene`].
//!
//! *Never*: decides where one can walk, what is seen or what is heard; knows of missions.

pub mod categories;
pub mod colors;
mod describe;
pub mod digest;
pub mod glb;
pub mod habitat;
pub mod hm3d;
pub mod open;
pub mod procedural;
pub mod procthor;
mod report;
mod scene;
pub mod stats;

pub use report::Report;
pub use scene::{Attributes, InstanceId, Material, Mesh, Object, Region, Scene, SceneError, Texture};
