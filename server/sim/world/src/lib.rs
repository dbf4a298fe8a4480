//! A body that moves in a building, step by step.
//!
//! [`SceneAssets`] is shared by all episodes in a building; a [`World`] is a body inside. Equal assets,
//! options and motions give equal senses and equal [`World::state_hash`]es.
//!
//! Start reading at [`World`].
//!
//! This crate never depends on goals, budgets or scores, reads a clock, or starts threads.

mod assets;
pub mod stats;
mod world;

pub use assets::{Cache, Cached, PrepareError, SceneAssets, SoundSource, Struck};
pub use avln_acoustics::{
    Bank, Clip, ClipLevels, ClipPool, FirstSound, Head, HeardLevels, LEVEL_BANDS, LevelMeter, Listener,
    SoundCache,
};
pub use avln_geom::{Aabb, Point3, Pose, Rng, Vector3};
pub use avln_navmesh::{Body, DistanceField, NavMesh, NavPoint, Places};
pub use avln_render::{
    Camera, CameraImage, DepthNoise, Detail, Model, ModelCache, ModelCacheEntry, Noise, RgbNoise,
};
pub use avln_scene::{
    Attributes, InstanceId, Lighting, Material, Mesh, Object, Scene, categories::mpcat40_number,
};
pub use world::{CameraView, Motion, Moved, Senses, StartError, World, WorldOptions};
