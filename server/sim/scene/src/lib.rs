//! The scene model: mesh, materials, regions, objects and lamps of a building.
//!
//! Start at [`Scene`].
//!
//! This crate never reads or writes files or depends on missions.

pub mod categories;
pub mod colors;
pub mod describe;
pub mod digest;
pub mod polygon;
mod room_plan;
mod scene;
pub mod stats;

pub use room_plan::{RoomPlan, RoomPlanError};
pub use scene::{
    Attributes, InstanceId, Lamp, Lighting, Material, Mesh, Object, Region, Scene, SceneError, Texture,
};
pub use stats::Summary;

/// Size limits of scene files and scenes; importers check them before they reserve memory.
pub mod limits {
    // A fuzzer soon finds small files of the greatest scenes, which take minutes and gigabytes.
    const IS_FUZZED: bool = cfg!(fuzzing);

    /// Bytes in a scene file, or in all external files together.
    pub const MAX_FILE_BYTES: u64 = 2 << 30;
    /// Bytes in the JSON part.
    pub const MAX_JSON_BYTES: usize = 64 << 20;
    /// Entries in a JSON list (nodes, accessors, materials …).
    pub const MAX_ENTRIES: usize = 1 << 18;
    /// Triangles in a scene.
    pub const MAX_TRIANGLES: usize = if IS_FUZZED { 10_000 } else { 8_000_000 };
    /// Vertices in a scene; a shared vertex counts once per primitive.
    pub const MAX_VERTICES: usize = 3 * MAX_TRIANGLES;
    /// Texels on a texture's side.
    pub const MAX_TEXTURE_SIDE: u32 = if IS_FUZZED { 512 } else { 16_384 };
    /// Texels in all textures together.
    pub const MAX_TEXELS: u64 = if IS_FUZZED { 1 << 20 } else { 1 << 29 };
    /// Least building length in the longest direction, metres.
    pub const MIN_SCENE_SIDE_M: f32 = 1.0;
    /// Greatest building length in the longest direction, metres.
    pub const MAX_SCENE_SIDE_M: f32 = 300.0;
    /// Characters in a category or attribute.
    pub const MAX_WORD_CHARS: usize = 100;
}
