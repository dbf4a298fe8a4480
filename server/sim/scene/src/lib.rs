//! The scene model: mesh, materials, regions, objects and lamps of a building.
//!
//! Start at [`Scene`].
//!
//! *Never*: reads or writes files; depends on missions.

pub mod canonical;
pub mod categories;
pub mod colors;
pub mod describe;
pub mod digest;
pub mod limits;
pub mod polygon;
mod room_plan;
mod scene;
pub mod stats;

pub use room_plan::{RoomPlan, RoomPlanError};
pub use scene::{
    Attributes, InstanceId, Lamp, Lighting, Material, Mesh, Object, Region, Scene, SceneError, Texture,
};
pub use stats::Summary;
