//! Removal of sensor noise from colour images.

use avln_client::{DepthImage, RgbImage};
use std::borrow::Cow;

/// Noise above which an image is smoothed, grey levels. Textures and edges of images without noise stay below.
const NOISY: f32 = 20.0;
/// Pixels to each side in the smoothing window.
const REACH: usize = 3;
/// Largest relative depth difference on one surface.
const SAME_SURFACE: f32 = 0.04;

/// Returns an image without its noise, or the image itself if it has little noise.
///
/// A pixel becomes the mean over its window's pixels on the same surface by depth, corrected for the clipping of noisy values to 0 to
/// 255.
pub(crate) fn denoised<'a>(image: &'a RgbImage, depth: &DepthImage) -> Cow<'a, RgbImage> {
    let sigma = noise_of(image);
    let [width, height] = [image.width as usize, image.height as usize];
    if sigma < NOISY || depth.metres.len() != width * height {
        return Cow::Borrowed(image);
    }
    let unclipped = unclipped(sigma);
    let mut pixels = Vec::with_capacity(image.pixels.len());
    for row in 0..height {
        for column in 0..width {
            let mean = mean_on_surface(image, depth, [column, row]);
            pixels.extend(mean.map(|level| unclipped[usize::from(level)]));
        }
    }
    Cow::Owned(RgbImage { pixels, ..image.clone() })
}

/// Estimates the standard deviation of the noise in the green channel, grey levels (Immerkær 1996).
fn noise_of(image: &RgbImage) -> f32 {
    let [width, height] = [image.width as usize, image.height as usize];
    if width < 3 || height < 3 {
        return 0.0;
    }
    let green = |column: usize, row: usize| i64::from(image.pixels[3 * (row * width + column) + 1]);
    let mut sum = 0;
    for row in 1..height - 1 {
        for column in 1..width - 1 {
            let line = |row: usize| green(column - 1, row) - 2 * green(column, row) + green(column + 1, row);
            sum += (line(row - 1) - 2 * line(row) + line(row + 1)).abs();
        }
    }
    let count = ((width - 2) * (height - 2)) as f32;
    libm::sqrtf(0.5 * std::f32::consts::PI) * sum as f32 / (6.0 * count)
}

/// Returns the mean colour of a pixel's surface.
fn mean_on_surface(image: &RgbImage, depth: &DepthImage, [column, row]: [usize; 2]) -> [u8; 3] {
    let [width, height] = [image.width as usize, image.height as usize];
    let here_m = depth.metres[row * width + column];
    let (mut sums, mut count) = ([0_u32; 3], 0);
    for y in row.saturating_sub(REACH)..(row + REACH + 1).min(height) {
        for x in column.saturating_sub(REACH)..(column + REACH + 1).min(width) {
            let index = y * width + x;
            if (depth.metres[index] - here_m).abs() <= SAME_SURFACE * here_m {
                let pixel = &image.pixels[3 * index..3 * index + 3];
                sums.iter_mut().zip(pixel).for_each(|(sum, level)| *sum += u32::from(*level));
                count += 1;
            }
        }
    }
    sums.map(|sum| ((sum + count / 2) / count.max(1)) as u8)
}

/// Returns by mean of clipped noisy values the level without noise.
fn unclipped(sigma: f32) -> [u8; 256] {
    let means: Vec<f32> = (0..=255_u8).map(|level| clipped_mean(f32::from(level), sigma)).collect();
    std::array::from_fn(|mean| means.partition_point(|clipped| *clipped < mean as f32).min(255) as u8)
}

/// Returns the mean of a normal deviate around `level`, clipped to 0 to 255.
fn clipped_mean(level: f32, sigma: f32) -> f32 {
    let [low, high] = [-level / sigma, (255.0 - level) / sigma];
    let below = |x: f32| 0.5 * (1.0 + libm::erff(x * std::f32::consts::FRAC_1_SQRT_2));
    let density = |x: f32| libm::expf(-0.5 * x * x) / libm::sqrtf(std::f32::consts::TAU);
    255.0 * (1.0 - below(high)) + level * (below(high) - below(low)) + sigma * (density(low) - density(high))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 32;

    /// Two surfaces side by side, at 1 m and 2 m.
    fn depth() -> DepthImage {
        let metres = (0..SIDE * SIDE).map(|index| if index % SIDE < SIDE / 2 { 1.0 } else { 2.0 }).collect();
        DepthImage { width: SIDE as u32, height: SIDE as u32, metres }
    }

    /// Dark left half and bright right half, with uniform noise of this deviation.
    fn image(sigma: f32) -> RgbImage {
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            ((state >> 8) as f32 / (1 << 24) as f32 - 0.5) * sigma * 12_f32.sqrt()
        };
        let level = |index: usize| if index % SIDE < SIDE / 2 { 60.0 } else { 180.0 };
        let pixels: Vec<u8> =
            (0..3 * SIDE * SIDE).map(|byte| (level(byte / 3) + noise()).clamp(0.0, 255.0) as u8).collect();
        RgbImage { width: SIDE as u32, height: SIDE as u32, pixels }
    }

    #[test]
    fn clean_images_stay_unchanged() {
        assert!(matches!(denoised(&image(0.0), &depth()), Cow::Borrowed(_)));
        assert!((noise_of(&image(40.0)) - 40.0).abs() < 5.0, "{}", noise_of(&image(40.0)));
    }

    #[test]
    fn surfaces_get_their_colour_back() {
        let seen = image(45.0);
        let clean = denoised(&seen, &depth());
        let errors = (0..SIDE * SIDE).map(|index| {
            let wanted = if index % SIDE < SIDE / 2 { 60.0 } else { 180.0 };
            (f32::from(clean.pixels[3 * index]) - wanted).abs()
        });
        let mean = errors.sum::<f32>() / (SIDE * SIDE) as f32;
        assert!(mean < 8.0, "{mean}");
    }

    #[test]
    fn clipping_is_inverted() {
        for level in [20_u8, 90, 128, 200, 240] {
            let mean = clipped_mean(f32::from(level), 51.0).round() as usize;
            let back = i32::from(unclipped(51.0)[mean]);
            assert!((back - i32::from(level)).abs() <= 3, "{level}: {mean}, {back}");
        }
    }
}
