//! Light: RGB, planar depth and hidden instance ids.
//!
//! A [`Model`] holds a scene's triangles in clusters under a tree of boxes, and its textures in all their sizes. A picture
//! is made in two steps: the tree is walked from near to far and what is not hidden is drawn, eight pixels at a time
//! (`raster`); then every pixel is coloured once (`shade`). Surfaces shine by their own colour; where a scene has lamps,
//! their light is worked into it before the first picture.
//!
//! Start reading at [`Renderer`].
//!
//! *Never*: starts threads; opens files; knows of agents, missions or sound.

mod camera;
mod lanes;
mod light;
mod model;
mod noise;
mod raster;
mod renderer;
mod shade;

pub use avln_simd::Width;
pub use camera::{Camera, Frame};
pub use model::{Model, ModelError};
pub use noise::{DepthNoise, Noise, RgbNoise};
pub use renderer::{Place, Renderer, Shelf};
