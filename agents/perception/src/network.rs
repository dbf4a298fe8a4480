//! The network with its input images.

use crate::feature_map::FeatureMap;
use crate::{ConvLayer, WeightsError, WeightsFile};

/// Channels of the network input: red, green, blue, depth, height, and a flag for known depth.
pub(crate) const INPUTS: usize = 6;
/// Granularity of input sides, pixels.
pub(crate) const MULTIPLE_PX: usize = 16;
/// An image: `height × width × 3` bytes, sRGB, row by row from the top-left; 8 to 4096 pixels per side.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The bytes.
    pub rgb: &'a [u8],
}

/// Depth by pixel in the viewing direction, metres; 0 if unknown.
#[derive(Clone, Copy, Debug)]
pub struct Depth<'a> {
    /// Row by row from the top-left; same size as the image.
    pub metres: &'a [f32],
}

/// The camera: square pixels, position above the floor and orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Horizontal field of view, radians, in (0, pi).
    pub hfov_rad: f32,
    /// Height above the body's floor, metres.
    pub height_m: f32,
    /// Camera elevation, radians.
    pub pitch_rad: f32,
}

/// Depth with its camera.
pub type DepthView<'a> = (&'a Depth<'a>, &'a CameraModel);

/// Reasons for a rejected image.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum PictureError {
    /// The size is out of range, or differs from the byte count.
    #[error("invalid image: {width} x {height} pixels in {bytes} bytes; sides must be 8 to 4096 pixels")]
    Picture {
        /// Pixels per row.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes.
        bytes: usize,
    },
    /// The depth has another size than the image.
    #[error("invalid depth: {values} values for an image of {width} x {height} pixels")]
    Depth {
        /// Pixels per row.
        width: usize,
        /// Rows.
        height: usize,
        /// Depths.
        values: usize,
    },
}

impl CameraModel {
    /// Returns a pixel's ray at 1 m depth: metres to the right, up and ahead, for a level camera.
    pub(crate) fn ray(&self, [width, height]: [usize; 2], [column, row]: [f32; 2]) -> [f32; 3] {
        // Equal bits on every platform, as for the convolutions (docs/decisions/0019).
        let metres_per_px = 2.0 * libm::tanf(0.5 * self.hfov_rad) / width as f32;
        let right = (column + 0.5 - 0.5 * width as f32) * metres_per_px;
        let up = (0.5 * height as f32 - row - 0.5) * metres_per_px;
        let (sin, cos) = libm::sincosf(self.pitch_rad);
        [right, up * cos + sin, cos - up * sin]
    }
}

/// Smallest and largest image side, pixels.
const SIDES_PX: [usize; 2] = [8, 4096];

impl Picture<'_> {
    pub(crate) fn check(&self, depth: Option<&Depth>) -> Result<(), PictureError> {
        let Self { width, height, rgb } = *self;
        let fits = |side: usize| (SIDES_PX[0]..=SIDES_PX[1]).contains(&side);
        if !fits(width) || !fits(height) || rgb.len() != 3 * width * height {
            return Err(PictureError::Picture { width, height, bytes: rgb.len() });
        }
        match depth {
            Some(depth) if depth.metres.len() != width * height => {
                Err(PictureError::Depth { width, height, values: depth.metres.len() })
            }
            _ => Ok(()),
        }
    }

    /// Returns the input size: `side_px` wide, and about the image's aspect ratio.
    pub(crate) fn seen_size(&self, side_px: usize) -> [usize; 2] {
        let height = (side_px * self.height) as f32 / self.width as f32;
        let steps = (height / MULTIPLE_PX as f32).round().clamp(1.0, 4.0 * (side_px / MULTIPLE_PX) as f32);
        [side_px, steps as usize * MULTIPLE_PX]
    }

    /// Interpolates the colour at a point between pixel centres, 0 to 255.
    fn blended(&self, at_x: &PixelBlend, at_y: &PixelBlend) -> [f32; 3] {
        let pixel =
            |x: usize, y: usize, channel: usize| f32::from(self.rgb[3 * (y * self.width + x) + channel]);
        std::array::from_fn(|channel| {
            let line = |y| at_x.blend(pixel(at_x.low, y, channel), pixel(at_x.high, y, channel));
            at_y.blend(line(at_y.low), line(at_y.high))
        })
    }
}

struct PixelBlend {
    low: usize,
    high: usize,
    share: f32,
}

impl PixelBlend {
    /// Maps pixel `index` in `count` to `from` pixels.
    fn new(index: usize, count: usize, from: usize) -> Self {
        let place = ((index as f32 + 0.5) * from as f32 / count as f32 - 0.5).max(0.0);
        let low = (place as usize).min(from - 1);
        Self { low, high: (low + 1).min(from - 1), share: place - low as f32 }
    }

    fn blend(&self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.share
    }
}

/// Fills the network input: interpolated colours, depth of the nearest pixel, and heights.
pub(crate) fn fill(input: &mut FeatureMap, picture: &Picture, depth: Option<DepthView>) {
    let [width, height] = [input.width, input.height];
    let columns: Vec<PixelBlend> = (0..width).map(|x| PixelBlend::new(x, width, picture.width)).collect();
    for row in 0..height {
        let at_y = PixelBlend::new(row, height, picture.height);
        let from_row = row * picture.height / height;
        for (at_x, pixel) in columns.iter().zip(input.row_mut(row).chunks_exact_mut(INPUTS)) {
            let rgb = picture.blended(at_x, &at_y);
            pixel[..3].iter_mut().zip(rgb).for_each(|(to, level)| *to = (level / 255.0 - 0.5) * 4.0);
            pixel[3..].fill(0.0);
        }
        // Depth is not interpolated: a value between an object and its background belongs to neither.
        let Some((depth, camera)) = depth else { continue };
        let climb = camera.ray([picture.width, picture.height], [0.0, from_row as f32])[1];
        let metres = &depth.metres[from_row * picture.width..][..picture.width];
        for (column, pixel) in input.row_mut(row).chunks_exact_mut(INPUTS).enumerate() {
            let depth_m = metres[column * picture.width / width];
            if depth_m > 0.0 && depth_m.is_finite() {
                let height_m = camera.height_m + depth_m * climb;
                pixel[3..].copy_from_slice(&[depth_m / 4.0, height_m - 1.0, 1.0]);
            }
        }
    }
}

/// Channels at 1/2, 1/4, 1/8 and 1/16 size, and in the head's input.
const WIDTHS: [usize; 4] = [24, 48, 96, 192];
const LAST: usize = 32;

/// A U-Net of 3 × 3 convolutions with additive skips.
pub(crate) struct UNet {
    stem: ConvLayer,
    /// Convolutions by level on the way down, and strided convolutions between levels.
    levels: [ConvLayer; 4],
    downs: [ConvLayer; 3],
    whole: ConvLayer,
    /// Projections from the next smaller level, and convolutions on the way up.
    lifts: [ConvLayer; 3],
    backs: [ConvLayer; 3],
    head: ConvLayer,
    memory: UNetBuffers,
}

#[derive(Default)]
struct UNetBuffers {
    input: FeatureMap,
    /// Two alternating maps per level.
    levels: [[FeatureMap; 2]; 4],
    lifted: [FeatureMap; 3],
    last: FeatureMap,
    output: FeatureMap,
    mean: Vec<f32>,
    sum: Vec<f32>,
}

impl UNetBuffers {
    fn new(width: usize, height: usize, outputs: usize) -> Self {
        let (half, level) =
            ([width / 2, height / 2], |level: usize| [width >> (level + 1), height >> (level + 1)]);
        let map = |[width, height]: [usize; 2], channels| FeatureMap::new(width, height, channels);
        Self {
            input: map([width, height], INPUTS),
            levels: std::array::from_fn(|n| [map(level(n), WIDTHS[n]), map(level(n), WIDTHS[n])]),
            lifted: std::array::from_fn(|n| map(level(n + 1), WIDTHS[n])),
            last: map(half, LAST),
            output: map(half, outputs),
            ..Self::default()
        }
    }
}

impl UNet {
    pub(crate) fn read(weights: &WeightsFile) -> Result<Self, WeightsError> {
        // No layer has a saturated number of outputs, so a huge embedding is refused below.
        let outputs = (weights.info.categories.len() + 2).saturating_add(weights.info.embedding);
        let conv = |name: &str, inputs, outputs| weights.layer(name, [9, inputs, outputs]);
        let point = |name: &str, inputs, outputs| weights.layer(name, [1, inputs, outputs]);
        let [a, b, c, d] = WIDTHS;
        Ok(Self {
            stem: conv("stem", INPUTS, a)?,
            levels: [
                conv("level_1", a, a)?,
                conv("level_2", b, b)?,
                conv("level_3", c, c)?,
                conv("level_4", d, d)?,
            ],
            downs: [conv("down_2", a, b)?, conv("down_3", b, c)?, conv("down_4", c, d)?],
            whole: point("whole", d, d)?,
            lifts: [point("lift_1", b, a)?, point("lift_2", c, b)?, point("lift_3", d, c)?],
            backs: [conv("back_1", a, LAST)?, conv("back_2", b, b)?, conv("back_3", c, c)?],
            head: point("head", LAST, outputs)?,
            memory: UNetBuffers::default(),
        })
    }

    /// Returns the input map for an image size, in multiples of [`MULTIPLE_PX`].
    pub(crate) fn input(&mut self, width: usize, height: usize) -> &mut FeatureMap {
        let outputs = self.head.bias.len();
        // Buffers are reused: sizes rarely change within a run.
        if (self.memory.input.width, self.memory.input.height) != (width, height) {
            self.memory = UNetBuffers::new(width, height, outputs);
        }
        &mut self.memory.input
    }

    /// Runs the network: for every second pixel category logits, offset (x, y) to the centre, embedding.
    pub(crate) fn run(&mut self) -> &mut FeatureMap {
        let UNetBuffers { input, levels, lifted, last, output, mean, sum } = &mut self.memory;
        levels[0][0].convolve(input, &self.stem);
        for (level, layer) in self.levels.iter().enumerate() {
            let (finer, here) = levels.split_at_mut(level);
            let [before, after] = &mut here[0];
            if let Some([_, from]) = finer.last() {
                before.convolve(from, &self.downs[level - 1]);
            }
            after.convolve(before, layer);
        }
        let [one, two, three, four] = levels;
        four[1].add_whole(&self.whole, mean, sum);
        let back = |level: usize,
                    lifted: &mut FeatureMap,
                    from: &FeatureMap,
                    skip: &mut FeatureMap,
                    to: &mut FeatureMap| {
            lifted.project(from, &self.lifts[level]);
            skip.add_twice(lifted);
            to.convolve(skip, &self.backs[level]);
        };
        let [[three_0, three_1], [two_0, two_1], [_, one_1]] = [three, two, one];
        back(2, &mut lifted[2], &four[1], three_1, three_0);
        back(1, &mut lifted[1], three_0, two_1, two_0);
        back(0, &mut lifted[0], two_0, one_1, last);
        output.project(last, &self.head);
        output
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_follow_the_pinhole_model() {
        let level = CameraModel { hfov_rad: 1.570_796_4, height_m: 1.0, pitch_rad: 0.0 };
        let [right, up, ahead] = level.ray([4, 4], [3.5, -0.5]);
        assert!((right - 1.0).abs() < 1e-6 && (up - 1.0).abs() < 1e-6 && ahead == 1.0);
        // The lowest row of 4 looks down by 0.75 m a metre.
        assert!((level.ray([4, 4], [0.0, 3.0])[1] + 0.75).abs() < 1e-6);
        let up = CameraModel { pitch_rad: 0.5, ..level };
        assert!((up.ray([2, 2], [0.5, 0.5])[1] - libm::sinf(0.5)).abs() < 1e-6);
    }

    #[test]
    fn colours_are_interpolated_and_depth_is_not() {
        let rgb: Vec<u8> = (0..8 * 16).flat_map(|pixel| [if pixel % 8 < 4 { 0 } else { 255 }; 3]).collect();
        let metres: Vec<f32> = (0..8 * 16).map(|pixel| if pixel % 8 < 4 { 2.0 } else { 0.0 }).collect();
        let picture = Picture { width: 8, height: 16, rgb: &rgb };
        assert_eq!(picture.seen_size(32), [32, 64]);
        let camera = CameraModel { hfov_rad: std::f32::consts::FRAC_PI_2, height_m: 1.0, pitch_rad: 0.0 };
        let mut input = FeatureMap::new(32, 64, INPUTS);
        fill(&mut input, &picture, Some((&Depth { metres: &metres }, &camera)));
        let levels = [0, 13, 14, 15, 16, 17, 18, 31].map(|column| input.at(column, 20)[0] / 4.0 + 0.5);
        for (level, wanted) in levels.into_iter().zip([0.0, 0.0, 0.125, 0.375, 0.625, 0.875, 1.0, 1.0]) {
            assert!((level - wanted).abs() < 1e-6, "{levels:?}");
        }
        // Rows 0 to 3 are row 0 of 16, 7.5 pixels of a quarter of a metre above the middle for each metre of depth.
        let solid = &input.at(15, 3)[3..];
        assert!(
            (solid[0] - 0.5).abs() < 1e-6 && (solid[1] - 3.75).abs() < 1e-5 && solid[2] == 1.0,
            "{solid:?}"
        );
        assert_eq!(input.at(16, 3)[3..], [0.0; 3]);
        fill(&mut input, &picture, None);
        assert_eq!(input.at(15, 3)[3..], [0.0; 3]);
    }

    #[test]
    fn invalid_sizes_are_refused() {
        let rgb = [0; 3 * 64];
        let picture = Picture { width: 8, height: 8, rgb: &rgb };
        assert_eq!(picture.check(Some(&Depth { metres: &[1.0; 64] })), Ok(()));
        let depths = picture.check(Some(&Depth { metres: &[1.0; 63] }));
        assert_eq!(depths, Err(PictureError::Depth { width: 8, height: 8, values: 63 }));
        for (width, height) in [(0, 8), (7, 8), (8, 4097), (8, 9), (usize::MAX, 8)] {
            assert!(Picture { width, height, rgb: &rgb }.check(None).is_err(), "{width} x {height}");
        }
    }
}
