use super::normal::Normal;
use crate::CameraImage;

/// Deviation of the shift to the side, pixels.
const SHIFT_PX: f32 = 0.25;
/// Disparity at 1 m, pixels.
const DISPARITY_PX_M: f32 = 35.13;
/// Deviation of disparity, pixels.
const DISPARITY_NOISE_PX: f32 = 1.0 / 36.0;
/// Steps of disparity in a pixel.
const STEPS_PER_PX: f32 = 8.0;
/// Range of the model, metres.
const REACH_M: f32 = 10.0;

/// See [`DepthNoise::Redwood`](super::DepthNoise::Redwood).
pub(super) fn redwood(frame: &mut CameraImage, key: u64, depth_max_m: f32) {
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

/// The even row or column that is read instead of `index`, of `count`.
#[inline]
fn place(index: usize, deviate: f32, count: usize) -> usize {
    let shifted = (index as f32 + deviate * SHIFT_PX + 0.5) as u32 as usize;
    shifted.min(count - 1) & !1
}

/// Depth from the rounded disparity; 0 for no depth.
#[inline]
fn measured_m(depth_m: f32, deviate: f32) -> f32 {
    if depth_m <= 0.0 || depth_m >= REACH_M {
        return 0.0;
    }
    let disparity_px = DISPARITY_PX_M / depth_m + deviate * DISPARITY_NOISE_PX;
    let steps = (disparity_px * STEPS_PER_PX + 0.5) as u32;
    if steps == 0 { 0.0 } else { DISPARITY_PX_M * STEPS_PER_PX / steps as f32 }
}
