//! What real sensors do to a picture. Off unless asked for; instances are never touched.
//!
//! Noise depends on the seed, the number of the picture and the pixel alone, so that it is the same on every platform
//! and in every thread.

mod depth;
mod normal;
mod rgb;

use crate::Frame;
use avln_geom::Rng;

/// The sensors' noise and the seed that it is drawn with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Noise {
    /// Of depth.
    pub depth: DepthNoise,
    /// Of colours.
    pub rgb: RgbNoise,
    /// What it is drawn with.
    pub seed: u64,
}

/// Noise of depth, by the name of its model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthNoise {
    /// Depth as it is.
    #[default]
    None,
    /// A structured-light camera after Choi, Zhou and Koltun, "Robust Reconstruction of Indoor Scenes" (CVPR 2015), with the
    /// numbers of Habitat's `RedwoodDepthNoiseModel`. A pixel reads the depth z of a place that is shifted by a normal
    /// deviate of 0.25 pixels to either side and lies on every other pixel and row. Its disparity 35.13 m / z, in pixels,
    /// gets a normal deviate of 1/36 and is rounded to 1/8; depth is 35.13 m over the result. So steps of depth are
    /// z² / 281 m: 4 mm at 1 m, 32 mm at 3 m, 89 mm at 5 m; and the deviation over all depths is 0.0455 z² / 35.13 m:
    /// 1.3 mm, 12 mm, 32 mm. From 10 m on it reads nothing. Left out: the lens distortion measured for one camera (table
    /// `dist-model`), which shifts depth by a factor that depends on the place in the picture.
    Redwood,
}

/// Noise of colours, by the name of its model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RgbNoise {
    /// Colours as they are.
    #[default]
    None,
    /// A normal deviate of 51 grey levels in every channel of every pixel, then cut off at 0 and 255: Habitat's
    /// `GaussianNoiseModel` as it is unless told otherwise (intensity 0.2, mean 0, sigma 1), rounded instead of truncated.
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
    /// Adds the noise of picture number `index` to a frame whose depth reaches up to `depth_max_m`, metres. A pixel
    /// without depth stays without; noisy depth beyond the reach is 0 as well.
    pub fn apply(&self, frame: &mut Frame, index: u64, depth_max_m: f32) {
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
