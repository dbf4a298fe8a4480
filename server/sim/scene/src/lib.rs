//! What a building is: mesh, materials, regions and objects; importers, exporter and procedural houses.
//!
//! Start reading at [`Scene`].
//!
//! *Never*: decides where one can walk, what is seen or what is heard; knows of missions.

mod bake;
mod canonical;
pub mod categories;
pub mod colors;
mod describe;
pub mod digest;
mod files;
mod frame;
pub mod gibson;
pub mod glb;
pub mod habitat;
pub mod hm3d;
mod labelled;
mod lighting;
pub mod mp3d;
pub mod obj;
pub mod open;
mod pictures;
pub mod ply;
mod polygon;
pub mod procedural;
pub mod procthor;
pub mod replica;
mod report;
mod room_plan;
mod scene;
pub mod stats;
mod summary;
#[cfg(test)]
mod testing;

pub use frame::{Options, Unit, Up};
pub use lighting::{Lamp, Lighting};
pub use report::Report;
pub use room_plan::{RoomPlan, RoomPlanError};
pub use scene::{Attributes, InstanceId, Material, Mesh, Object, Region, Scene, SceneError, Texture};
pub use summary::Summary;
