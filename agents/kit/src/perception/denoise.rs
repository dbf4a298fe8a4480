//! Removal of sensor noise from colour images.

use avln_client::{DepthImage, RgbImage};
use avln_simd::{Width, Work, run_at};
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
    let (unclipped, weights) = (unclipped(sigma), colour_weights());
    let depth_m = bordered(depth.metres.iter().copied(), width, f32::NAN);
    let mean = |image: &Channels, guide: &Channels, reach: usize| {
        let means =
            WindowMeans { size: [width, height], image, depth_m: &depth_m, guide, weights: &weights, reach };
        let levels = run_at(Width::Sixteen, means);
        levels.into_iter().map(|level| unclipped[usize::from(level)]).collect::<Vec<u8>>()
    };
    let noisy = Channels::new(&image.pixels, width);
    // With a black guide, all pixels of a surface count equally.
    let black = Channels::new(&vec![0; image.pixels.len()], width);
    let guide = Channels::new(&mean(&noisy, &black, GUIDE_REACH), width);
    Cow::Owned(RgbImage { pixels: mean(&noisy, &guide, REACH), ..image.clone() })
}

/// Pixels of a row that are computed at once.
const LANES: usize = 16;

/// Returns rows of `width` > 0 with a border of [`REACH`] at both ends, filled up to a multiple of [`LANES`].
fn bordered<T: Copy>(values: impl Iterator<Item = T>, width: usize, border: T) -> Vec<T> {
    let mut values = values.peekable();
    let mut rows = Vec::new();
    while values.peek().is_some() {
        rows.extend([border; REACH]);
        rows.extend(values.by_ref().take(width));
        rows.resize(rows.len().next_multiple_of(row_length(width)), border);
    }
    rows
}

fn row_length(width: usize) -> usize {
    width.next_multiple_of(LANES) + 2 * REACH
}

/// Red, green and blue of an image in separate [`bordered`] rows.
struct Channels([Vec<u8>; 3]);

impl Channels {
    fn new(pixels: &[u8], width: usize) -> Self {
        Self([0, 1, 2].map(|channel| bordered(pixels.iter().skip(channel).step_by(3).copied(), width, 0)))
    }

    #[inline(always)]
    fn lanes(&self, at: usize) -> [&[u8; LANES]; 3] {
        self.0.each_ref().map(|levels| lanes(levels, at))
    }
}

#[inline(always)]
fn lanes<T>(values: &[T], at: usize) -> &[T; LANES] {
    values[at..].first_chunk().expect("a border at the end of each row")
}

/// Squared colour differences per entry in the table of weights.
const STEP: u32 = 64;
/// Entry without weight, for all larger differences.
const NO_WEIGHT: u32 = 256;

/// Returns weights by the squared difference of two colours in the guide. The sums over a window stay below 2^32.
fn colour_weights() -> [u32; NO_WEIGHT as usize + 1] {
    const EQUAL: f32 = 1000.0;
    let weight = |square: f32| EQUAL * libm::expf(-0.5 * square / (SAME_COLOUR * SAME_COLOUR));
    std::array::from_fn(|step| match step as u32 {
        NO_WEIGHT => 0,
        step => weight((step * STEP) as f32) as u32,
    })
}

/// The weighted mean colour of every pixel's surface within `reach` pixels to each side, at most [`REACH`]: red, green and blue by
/// pixel.
struct WindowMeans<'a> {
    size: [usize; 2],
    image: &'a Channels,
    depth_m: &'a [f32],
    guide: &'a Channels,
    weights: &'a [u32; NO_WEIGHT as usize + 1],
    reach: usize,
}

impl Work for WindowMeans<'_> {
    type Output = Vec<u8>;

    #[inline(always)]
    fn run(self) -> Vec<u8> {
        let [width, height] = self.size;
        let mut means = Vec::with_capacity(3 * width * height);
        for row in 0..height {
            for column in (0..width).step_by(LANES) {
                let ([red, green, blue], total) = self.sums(row, column);
                for lane in 0..LANES.min(width - column) {
                    let total = total[lane];
                    let mean = |sums: &[u32; LANES]| ((sums[lane] + total / 2) / total.max(1)) as u8;
                    means.extend([mean(&red), mean(&green), mean(&blue)]);
                }
            }
        }
        means
    }
}

impl WindowMeans<'_> {
    /// Returns weighted sums of the channels, and the weights, for adjacent pixels of a row.
    #[inline(always)]
    fn sums(&self, row: usize, column: usize) -> ([[u32; LANES]; 3], [u32; LANES]) {
        let ([width, height], reach) = (self.size, self.reach);
        let start = |row: usize| row * row_length(width) + REACH + column;
        let (here_m, here) = (lanes(self.depth_m, start(row)), self.guide.lanes(start(row)));
        let (mut sums, mut total) = ([[0; LANES]; 3], [0; LANES]);
        for row in row.saturating_sub(reach)..(row + reach + 1).min(height) {
            for at in start(row) - reach..=start(row) + reach {
                let (other_m, other, levels) =
                    (lanes(self.depth_m, at), self.guide.lanes(at), self.image.lanes(at));
                // Two loops: the compiler vectorises each, but not both in one for AVX2.
                let mut weights = [0; LANES];
                for lane in 0..LANES {
                    let square = |channel: usize| {
                        let difference = i32::from(here[channel][lane]) - i32::from(other[channel][lane]);
                        (difference * difference) as u32
                    };
                    let step = ((square(0) + square(1) + square(2)) / STEP).min(NO_WEIGHT);
                    let weight = self.weights[step as usize];
                    // False for the border, where depth is not a number.
                    let is_same = (other_m[lane] - here_m[lane]).abs() <= SAME_SURFACE * here_m[lane];
                    weights[lane] = if is_same { weight } else { 0 };
                }
                for lane in 0..LANES {
                    let weight = weights[lane];
                    (0..3)
                        .for_each(|channel| sums[channel][lane] += weight * u32::from(levels[channel][lane]));
                    total[lane] += weight;
                }
            }
        }
        (sums, total)
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

    /// Means by their definition, pixel by pixel.
    fn plain_means(
        [width, height]: [usize; 2],
        pixels: &[[u8; 3]],
        depths_m: &[f32],
        guide: &[[u8; 3]],
        reach: usize,
    ) -> Vec<u8> {
        let weights = colour_weights();
        let weight = |here: usize, other: usize| {
            let apart = [(other / width).abs_diff(here / width), (other % width).abs_diff(here % width)];
            let is_same = (depths_m[other] - depths_m[here]).abs() <= SAME_SURFACE * depths_m[here];
            let is_near = apart.iter().all(|pixels| *pixels <= reach);
            let squares = guide[here].iter().zip(guide[other]).map(|(a, b)| u32::from(a.abs_diff(b)).pow(2));
            let step = (squares.sum::<u32>() / STEP).min(NO_WEIGHT);
            if is_near && is_same { weights[step as usize] } else { 0 }
        };
        let mean = |here: usize| {
            let weights: Vec<u32> = (0..width * height).map(|other| weight(here, other)).collect();
            let total: u32 = weights.iter().sum();
            [0, 1, 2].map(|channel| {
                let levels = pixels.iter().map(|pixel| u32::from(pixel[channel]));
                let sum: u32 = weights.iter().zip(levels).map(|(weight, level)| weight * level).sum();
                ((sum + total / 2) / total.max(1)) as u8
            })
        };
        (0..width * height).flat_map(mean).collect()
    }

    #[test]
    fn means_match_the_definition_at_every_vector_width() {
        let depth_m = |pixel: usize| [1.0, 1.02, 2.0, 0.0, f32::NAN, f32::INFINITY, 1.01][pixel % 7];
        // Rows shorter and longer than a vector, and whole vectors.
        for size @ [width, height] in [[3, 4], [16, 5], [21, 9], [32, 8]] {
            let count = width * height;
            // Small differences, which have weights, and large ones.
            let level = |byte: usize, pixel: usize| {
                (byte * 7919 % if pixel.is_multiple_of(5) { 256 } else { 97 }) as u8
            };
            let pixels: Vec<[u8; 3]> =
                (0..count).map(|pixel| [0, 1, 2].map(|channel| level(3 * pixel + channel, pixel))).collect();
            let depths_m: Vec<f32> = (0..count).map(depth_m).collect();
            let bordered_m = bordered(depths_m.iter().copied(), width, f32::NAN);
            let (image, weights) = (Channels::new(pixels.as_flattened(), width), colour_weights());
            for (guide, reach) in [(vec![[0; 3]; count], GUIDE_REACH), (pixels.clone(), REACH)] {
                let wanted = plain_means(size, &pixels, &depths_m, &guide, reach);
                let guide = Channels::new(guide.as_flattened(), width);
                for vectors in [Width::Portable, Width::Eight, Width::Sixteen] {
                    let (depth_m, weights) = (&bordered_m, &weights);
                    let means = WindowMeans { size, image: &image, depth_m, guide: &guide, weights, reach };
                    assert_eq!(run_at(vectors, means), wanted, "{size:?} {vectors:?}");
                }
            }
        }
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
