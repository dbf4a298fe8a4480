//! Sensor noise, disabled by default. Instances are unaffected.
//!
//! Noise depends only on seed, image number and pixel, so it is equal on every platform and in every thread.

mod depth;
mod normal;
mod rgb;

use crate::CameraImage;
use avln_geom::Rng;

/// The sensors' noise and the seed that it is drawn with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Noise {
    /// Of depth.
    pub depth: DepthNoise,
    /// Of colours.
    pub rgb: RgbNoise,
    /// Seed of the draws.
    pub seed: u64,
}

/// Depth noise by model name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthNoise {
    /// Depth as it is.
    #[default]
    None,
    /// A structured-light camera after Choi, Zhou and Koltun, "Robust Reconstruction of Indoor Scenes" (CVPR
    /// 2015), with the constants of Habitat's `RedwoodDepthNoiseModel`. A pixel reads the depth z at a
    /// position shifted by a normal deviate of 0.25 pixels, on every other pixel and row. The disparity 35.13
    /// m / z, in pixels, has a normal deviate of 1/36 and is rounded to 1/8; depth is 35.13 m over the
    /// result. Depth steps are z² / 281 m: 4 mm at 1 m, 32 mm at 3 m, 89 mm at 5 m; the overall deviation is
    /// 0.0455 z² / 35.13 m: 1.3 mm, 12 mm, 32 mm. No depth from 10 m. Omits the measured lens distortion of a
    /// specific camera (table `dist-model`), a position-dependent depth factor.
    Redwood,
}

/// Colour noise by model name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RgbNoise {
    /// Colours as they are.
    #[default]
    None,
    /// A normal deviate of 51 grey levels per channel and pixel, clamped to 0 to 255: Habitat's
    /// `GaussianNoiseModel` with defaults (intensity 0.2, mean 0, sigma 1), rounded instead of truncated.
    Gaussian,
}

impl DepthNoise {
    /// The model called `name`: `none` or `redwood`.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "none" => Some(Self::None),
            "redwood" => Some(Self::Redwood),
            _ => None,
        }
    }
}

impl RgbNoise {
    /// The model called `name`: `none` or `gaussian`.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "none" => Some(Self::None),
            "gaussian" => Some(Self::Gaussian),
            _ => None,
        }
    }
}

impl Noise {
    /// Adds noise for image number `index` to a frame with a depth range of `depth_max_m`, metres. A pixel
    /// without depth stays empty; noisy depth beyond the range becomes 0.
    pub fn apply(&self, frame: &mut CameraImage, index: u64, depth_max_m: f32) {
        let key = |sensor: u64| Rng::word(Rng::word(self.seed, sensor), index);
        match self.depth {
            DepthNoise::None => {}
            DepthNoise::Redwood => depth::redwood(frame, key(0), depth_max_m),
        }
        match self.rgb {
            RgbNoise::None => {}
            RgbNoise::Gaussian => rgb::gaussian(frame, key(1)),
        }
    }
}
