use super::normal::Normal;
use crate::CameraImage;

/// Deviation of each channel, grey levels.
const DEVIATION: f32 = 0.2 * 255.0;

/// See [`RgbNoise::Gaussian`](super::RgbNoise::Gaussian).
pub(super) fn gaussian(frame: &mut CameraImage, key: u64) {
    let normal = Normal::table();
    for (pixel, color) in frame.rgb.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        for (channel, deviate) in color.iter_mut().zip(normal.three(key, pixel)) {
            // The conversion to u8 clamps to 0 to 255.
            *channel = (f32::from(*channel) + deviate * DEVIATION + 0.5) as u8;
        }
    }
}
