//! Sensor noise for depth and colour, disabled by default.
//!
//! Noise depends only on seed, image number and pixel, so it is equal on every platform and in every thread.

use crate::camera::CameraImage;
use avln_geom::Rng;
use std::sync::LazyLock;

/// Noise models and their seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Noise {
    /// Depth noise.
    pub depth: DepthNoise,
    /// Colour noise.
    pub rgb: RgbNoise,
    /// Random seed.
    pub seed: u64,
}

/// A depth noise model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthNoise {
    /// No noise.
    #[default]
    None,
    /// A structured-light camera after Choi, Zhou and Koltun, "Robust Reconstruction of Indoor Scenes" (CVPR
    /// 2015), with the constants of Habitat's `RedwoodDepthNoiseModel`. A pixel reads the depth z at a
    /// position shifted by a normal deviate of 0.25 pixels, on every other pixel and row. The disparity 35.13
    /// m / z, in pixels, has a normal deviate of 1/36 and is rounded to 1/8; depth is 35.13 m over the
    /// result. Depth steps are z² / 281 m: 4 mm at 1 m, 32 mm at 3 m, 89 mm at 5 m; the overall deviation is
    /// 0.0455 z² / 35.13 m: 1.3 mm, 12 mm, 32 mm. No depth from 10 m. Omits the measured lens distortion
    /// (table `dist-model`), a position-dependent depth factor.
    Redwood,
}

/// A colour noise model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RgbNoise {
    /// No noise.
    #[default]
    None,
    /// A normal deviate of 51 grey levels per channel and pixel, clamped to 0 to 255: Habitat's
    /// `GaussianNoiseModel` with defaults (intensity 0.2, mean 0, sigma 1), rounded instead of truncated.
    Gaussian,
}

impl DepthNoise {
    /// Returns the model `none` or `redwood`.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "none" => Some(Self::None),
            "redwood" => Some(Self::Redwood),
            _ => None,
        }
    }
}

impl RgbNoise {
    /// Returns the model `none` or `gaussian`.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "none" => Some(Self::None),
            "gaussian" => Some(Self::Gaussian),
            _ => None,
        }
    }
}

impl Noise {
    /// Adds noise to image number `index`. A pixel without depth stays empty; noisy depth beyond
    /// `depth_max_m` becomes 0.
    pub fn apply(&self, frame: &mut CameraImage, index: u64, depth_max_m: f32) {
        let key = |sensor: u64| Rng::word(Rng::word(self.seed, sensor), index);
        match self.depth {
            DepthNoise::None => {}
            DepthNoise::Redwood => redwood(frame, key(0), depth_max_m),
        }
        match self.rgb {
            RgbNoise::None => {}
            RgbNoise::Gaussian => gaussian(frame, key(1)),
        }
    }
}

/// Deviation of the sideways shift, pixels.
const SHIFT_PX: f32 = 0.25;
/// Disparity at 1 m, pixels.
const DISPARITY_PX_M: f32 = 35.13;
/// Disparity deviation, pixels.
const DISPARITY_NOISE_PX: f32 = 1.0 / 36.0;
/// Disparity steps per pixel.
const STEPS_PER_PX: f32 = 8.0;
/// Model range, metres.
const REACH_M: f32 = 10.0;

fn redwood(frame: &mut CameraImage, key: u64, depth_max_m: f32) {
    let normal = Normal::table();
    let (width, height) = (frame.width as usize, frame.height as usize);
    let clean = std::mem::take(&mut frame.depth);
    let noisy = |row: usize, column: usize| {
        let pixel = row * width + column;
        if clean[pixel] == 0.0 {
            return 0.0;
        }
        let [right, down, of_disparity] = normal.three(key, pixel);
        let (x, y) = (place(column, right, width), place(row, down, height));
        let read_m = measured_m(clean[y * width + x], of_disparity);
        if read_m <= depth_max_m { read_m } else { 0.0 }
    };
    frame.depth.reserve(clean.len());
    for row in 0..height {
        frame.depth.extend((0..width).map(|column| noisy(row, column)));
    }
}

/// Returns the even row or column that is read instead of `index`.
#[inline]
fn place(index: usize, deviate: f32, count: usize) -> usize {
    let shifted = (index as f32 + deviate * SHIFT_PX + 0.5) as u32 as usize;
    shifted.min(count - 1) & !1
}

/// Returns the depth from the rounded disparity; 0 for no depth.
#[inline]
fn measured_m(depth_m: f32, deviate: f32) -> f32 {
    if depth_m <= 0.0 || depth_m >= REACH_M {
        return 0.0;
    }
    let disparity_px = DISPARITY_PX_M / depth_m + deviate * DISPARITY_NOISE_PX;
    let steps = (disparity_px * STEPS_PER_PX + 0.5) as u32;
    if steps == 0 { 0.0 } else { DISPARITY_PX_M * STEPS_PER_PX / steps as f32 }
}

const BITS: u32 = 12;
const COUNT: usize = 1 << BITS;

/// Normal deviates (mean 0, deviation 0.999) from a table with 4,096 equally likely values up to 3.67.
struct Normal {
    quantiles: Box<[f32; COUNT]>,
}

static NORMAL: LazyLock<Normal> = LazyLock::new(Normal::new);

impl Normal {
    fn table() -> &'static Self {
        &NORMAL
    }

    fn new() -> Self {
        let mut quantiles = Box::new([0.0; COUNT]);
        for index in COUNT / 2..COUNT {
            let value = quantile((index as f64 + 0.5) / COUNT as f64) as f32;
            quantiles[index] = value;
            quantiles[COUNT - 1 - index] = -value;
        }
        Self { quantiles }
    }

    /// Returns three independent deviates for position `index` in the stream `key`.
    #[inline]
    fn three(&self, key: u64, index: usize) -> [f32; 3] {
        let bits = Rng::word(key, index as u64);
        [0, BITS, 2 * BITS].map(|shift| self.quantiles[(bits >> shift) as usize % COUNT])
    }
}

/// Returns the quantile for a share from 0.5 to 0.9999, by bisection to 2^-40.
fn quantile(share: f64) -> f64 {
    let (mut low, mut high) = (0.0, 4.0);
    for _ in 0..42 {
        let middle = 0.5 * (low + high);
        let below = 0.5 * libm::erfc(-middle * std::f64::consts::FRAC_1_SQRT_2);
        if below < share { low = middle } else { high = middle }
    }
    low
}

/// Channel deviation, grey levels.
const DEVIATION: f32 = 0.2 * 255.0;

fn gaussian(frame: &mut CameraImage, key: u64) {
    let normal = Normal::table();
    for (pixel, color) in frame.rgb.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        for (channel, deviate) in color.iter_mut().zip(normal.three(key, pixel)) {
            // The conversion to u8 clamps to 0 to 255.
            *channel = (f32::from(*channel) + deviate * DEVIATION + 0.5) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_contains_normal_quantiles() {
        // From printed tables.
        for (share, value) in [(0.5, 0.0), (0.841_344_75, 1.0), (0.975, 1.959_964), (0.999, 3.090_232)] {
            assert!((quantile(share) - value).abs() < 1e-5, "{share}");
        }
        let table = Normal::table();
        assert!(table.quantiles.windows(2).all(|pair| pair[0] < pair[1]));
        let moment = |power: i32| {
            let sum: f64 = table.quantiles.iter().map(|value| f64::from(*value).powi(power)).sum();
            sum / COUNT as f64
        };
        assert!(
            moment(1).abs() < 1e-9
                && (moment(2).sqrt() - 0.999).abs() < 1e-3
                && (moment(4) - 3.0).abs() < 0.05
        );
        assert!((table.quantiles[COUNT - 1] - 3.67).abs() < 0.01);
    }

    #[test]
    fn deviates_at_a_position_are_independent() {
        let table = Normal::table();
        let mut products = [0.0_f64; 4];
        for index in 0..100_000 {
            let [a, b, c] = table.three(5, index).map(f64::from);
            let [next, ..] = table.three(5, index + 1).map(f64::from);
            for (sum, product) in products.iter_mut().zip([a * b, a * c, b * c, a * next]) {
                *sum += product / 100_000.0;
            }
        }
        assert!(products.iter().all(|mean| mean.abs() < 0.015), "{products:?}");
    }
}
