//! Light: RGB, planar depth and hidden instance ids.
//!
//! Every pixel's ray is met with every triangle that it may hit, many rays at a time: the building's tree is walked
//! from near to far, and boxes behind what was seen already are left out. Surfaces shine by their own colour; where
//! a scene has lamps, their light is worked into it before the first picture.
//!
//! Start reading at [`Renderer`].
//!
//! *Never*: starts threads; knows of agents, missions or sound.

mod camera;
mod canvas;
mod light;
mod noise;
mod raster;
mod renderer;
mod shade;
mod texture;
mod triangle;

pub use camera::{Camera, Frame};
pub use noise::{DepthNoise, Noise, RgbNoise};
pub use renderer::Renderer;
