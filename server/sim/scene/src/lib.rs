//! The scene model: mesh, materials, regions, objects and lamps of a building.
//!
//! Start reading at [`Scene`].
//!
//! *Never*: reads or writes files; decides where one can walk, what is seen or what is heard; knows of missions.

pub mod canonical;
pub mod categories;
pub mod colors;
pub mod describe;
pub mod digest;
mod lighting;
pub mod limits;
pub mod polygon;
mod room_plan;
mod scene;
pub mod stats;
mod summary;

pub use lighting::{Lamp, Lighting};
pub use room_plan::{RoomPlan, RoomPlanError};
pub use scene::{Attributes, InstanceId, Material, Mesh, Object, Region, Scene, SceneError, Texture};
pub use summary::Summary;
