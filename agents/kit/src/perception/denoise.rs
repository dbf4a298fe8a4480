//! Removal of sensor noise from colour images.

use avln_client::{DepthImage, RgbImage};
use std::borrow::Cow;

/// Noise above which an image is smoothed, grey levels. Textures and edges of images without noise stay below.
const NOISY: f32 = 20.0;
/// Pixels to each side in the windows of the guide and of the result.
const GUIDE_REACH: usize = 1;
const REACH: usize = 6;
/// Largest relative depth difference on one surface.
const SAME_SURFACE: f32 = 0.04;
/// Standard deviation of colour differences in the guide that count as one colour, grey levels.
const SAME_COLOUR: f32 = 40.0;

/// Returns an image without its noise, or the image itself if it has little noise.
///
/// A pixel becomes the mean over its window's pixels on the same surface by depth and of similar colour by a guide, corrected for the
/// clipping of noisy values to 0 to 255: a joint bilateral filter (Petschnigg et al. 2004). The guide is a mean over a small window.
pub(crate) fn denoised<'a>(image: &'a RgbImage, depth: &DepthImage) -> Cow<'a, RgbImage> {
    let sigma = noise_of(image);
    let [width, height] = [image.width as usize, image.height as usize];
    if sigma < NOISY || depth.metres.len() != width * height {
        return Cow::Borrowed(image);
    }
    let unclipped = unclipped(sigma);
    let colours = |mean: &dyn Fn(usize) -> [u8; 3]| -> Vec<[u8; 3]> {
        (0..width * height).map(|pixel| mean(pixel).map(|level| unclipped[usize::from(level)])).collect()
    };
    let window = Window { side: [width, height], pixels: image.pixels.as_chunks().0, depth_m: &depth.metres };
    let guide = colours(&|pixel| window.mean(pixel, GUIDE_REACH, |_| 1));
    let weights = ColourWeights::new();
    let pixels = colours(&|pixel| window.mean(pixel, REACH, |other| weights.of(guide[pixel], guide[other])));
    Cow::Owned(RgbImage { pixels: pixels.into_iter().flatten().collect(), ..image.clone() })
}

/// Weights of pixels by the difference of their colours in the guide.
struct ColourWeights(Vec<u32>);

impl ColourWeights {
    /// Squared differences per step.
    const STEP: u32 = 64;
    /// Steps with a weight; the table has an entry for the largest difference, so that no colour needs a comparison.
    const STEPS: u32 = 256;
    const ENTRIES: u32 = 3 * 255 * 255 / Self::STEP + 1;
    /// Weight of equal colours. The sums over a window stay below 2^32.
    const WHOLE: f32 = 1000.0;

    fn new() -> Self {
        let weight = |step: u32| {
            let square = (step * Self::STEP) as f32;
            (Self::WHOLE * libm::expf(-0.5 * square / (SAME_COLOUR * SAME_COLOUR))) as u32
        };
        Self((0..Self::ENTRIES).map(|step| if step < Self::STEPS { weight(step) } else { 0 }).collect())
    }

    fn of(&self, a: [u8; 3], b: [u8; 3]) -> u32 {
        let square = |channel: usize| u32::from(a[channel].abs_diff(b[channel])).pow(2);
        self.0[((square(0) + square(1) + square(2)) / Self::STEP) as usize]
    }
}

/// An image with the surfaces by depth.
struct Window<'a> {
    side: [usize; 2],
    pixels: &'a [[u8; 3]],
    depth_m: &'a [f32],
}

impl Window<'_> {
    /// Returns the weighted mean colour of a pixel's surface within `reach` pixels to each side.
    fn mean(&self, pixel: usize, reach: usize, weight: impl Fn(usize) -> u32) -> [u8; 3] {
        let [width, height] = self.side;
        let (row, column, here_m) = (pixel / width, pixel % width, self.depth_m[pixel]);
        let columns = column.saturating_sub(reach)..(column + reach + 1).min(width);
        let (mut sums, mut total) = ([0_u32; 3], 0);
        for y in row.saturating_sub(reach)..(row + reach + 1).min(height) {
            let others = y * width + columns.start..y * width + columns.end;
            let (pixels, depth_m) = (&self.pixels[others.clone()], &self.depth_m[others.clone()]);
            for ((other, levels), other_m) in others.zip(pixels).zip(depth_m) {
                let is_same = (other_m - here_m).abs() <= SAME_SURFACE * here_m;
                let weight = if is_same { weight(other) } else { 0 };
                (0..3).for_each(|channel| sums[channel] += weight * u32::from(levels[channel]));
                total += weight;
            }
        }
        sums.map(|sum| ((sum + total / 2) / total.max(1)) as u8)
    }
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
    fn colours_of_one_surface_stay_apart() {
        let flat = DepthImage { metres: vec![1.0; SIDE * SIDE], ..depth() };
        let seen = image(45.0);
        let clean = denoised(&seen, &flat);
        let mean_beside = |column: usize| {
            let levels = (0..SIDE).map(|row| f32::from(clean.pixels[3 * (row * SIDE + column)]));
            levels.sum::<f32>() / SIDE as f32
        };
        let [dark, bright] = [mean_beside(SIDE / 2 - 1), mean_beside(SIDE / 2)];
        // Without the guide, the means would differ by a thirteenth of the contrast of 120.
        assert!(bright - dark > 60.0, "{dark} {bright}");
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
