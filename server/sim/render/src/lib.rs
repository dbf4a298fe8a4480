//! Rendering: RGB, planar depth and hidden instance ids.
//!
//! A [`Model`] contains a scene's triangles in clusters under a box tree, and textures with mipmaps. An image
//! takes two passes: the tree is traversed front to back and visible triangles are drawn, eight pixels at a
//! time (`raster`); then every pixel is shaded once (`shade`). Surfaces are emissive; for scenes with lamps,
//! light is baked before the first image. At half a pixel, simplified replacements are drawn
//! for distant boxes (`model/replacement`).
//!
//! Start reading at [`Renderer`].
//!
//! This crate never starts threads, opens files, or depends on agents, missions or sound.

mod camera;
mod lanes;
mod light;
mod model;
mod noise;
mod raster;
mod renderer;
mod shade;

pub use avln_simd::Width;
pub use camera::{Camera, CameraImage};
pub use model::{Model, ModelError};
pub use noise::{DepthNoise, Noise, RgbNoise};
pub use renderer::{Detail, ModelCache, ModelCacheEntry, Renderer};
