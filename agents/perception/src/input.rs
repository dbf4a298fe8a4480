use crate::map::Map;
use crate::network::{INPUTS, MULTIPLE_PX};
use crate::{Camera, Depth, Picture, SeeError};

/// Least and most pixels along a side of a picture.
const SIDES_PX: [usize; 2] = [8, 4096];

impl Picture<'_> {
    pub(crate) fn check(&self, depth: Option<&Depth>) -> Result<(), SeeError> {
        let Self { width, height, rgb } = *self;
        let fits = |side: usize| (SIDES_PX[0]..=SIDES_PX[1]).contains(&side);
        if !fits(width) || !fits(height) || rgb.len() != 3 * width * height {
            return Err(SeeError::Picture { width, height, bytes: rgb.len() });
        }
        match depth {
            Some(depth) if depth.metres.len() != width * height => {
                Err(SeeError::Depth { width, height, values: depth.metres.len() })
            }
            _ => Ok(()),
        }
    }

    /// The size at which a network that learnt from pictures of `side_px` sees this one: as wide, and about as high as its shape
    /// asks for.
    pub(crate) fn seen_size(&self, side_px: usize) -> [usize; 2] {
        let height = (side_px * self.height) as f32 / self.width as f32;
        let steps = (height / MULTIPLE_PX as f32).round().clamp(1.0, 4.0 * (side_px / MULTIPLE_PX) as f32);
        [side_px, steps as usize * MULTIPLE_PX]
    }

    /// Colour at a place between the middles of pixels, 0 to 255.
    fn blended(&self, at_x: &Between, at_y: &Between) -> [f32; 3] {
        let pixel =
            |x: usize, y: usize, channel: usize| f32::from(self.rgb[3 * (y * self.width + x) + channel]);
        std::array::from_fn(|channel| {
            let line = |y| at_x.blend(pixel(at_x.low, y, channel), pixel(at_x.high, y, channel));
            at_y.blend(line(at_y.low), line(at_y.high))
        })
    }
}

/// A place between two pixels.
struct Between {
    low: usize,
    high: usize,
    share: f32,
}

impl Between {
    /// Where pixel `index` of `count` lies among `from` pixels.
    fn new(index: usize, count: usize, from: usize) -> Self {
        let place = ((index as f32 + 0.5) * from as f32 / count as f32 - 0.5).max(0.0);
        let low = (place as usize).min(from - 1);
        Self { low, high: (low + 1).min(from - 1), share: place - low as f32 }
    }

    fn blend(&self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.share
    }
}

/// Fills the network's input: colours blended, depth of the nearest pixel, heights from the camera.
pub(crate) fn fill(input: &mut Map, picture: &Picture, depth: Option<(&Depth, &Camera)>) {
    let [width, height] = [input.width, input.height];
    let columns: Vec<Between> = (0..width).map(|x| Between::new(x, width, picture.width)).collect();
    for row in 0..height {
        let at_y = Between::new(row, height, picture.height);
        let from_row = row * picture.height / height;
        for (at_x, pixel) in columns.iter().zip(input.row_mut(row).chunks_exact_mut(INPUTS)) {
            let rgb = picture.blended(at_x, &at_y);
            pixel[..3].iter_mut().zip(rgb).for_each(|(to, level)| *to = (level / 255.0 - 0.5) * 4.0);
            pixel[3..].fill(0.0);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_other_sizes_are_blended_and_depth_is_not() {
        let rgb: Vec<u8> = (0..8 * 16).flat_map(|pixel| [if pixel % 8 < 4 { 0 } else { 255 }; 3]).collect();
        let metres: Vec<f32> = (0..8 * 16).map(|pixel| if pixel % 8 < 4 { 2.0 } else { 0.0 }).collect();
        let picture = Picture { width: 8, height: 16, rgb: &rgb };
        assert_eq!(picture.seen_size(32), [32, 64]);
        let camera = Camera { hfov_rad: std::f32::consts::FRAC_PI_2, height_m: 1.0, pitch_rad: 0.0 };
        let mut input = Map::new(32, 64, INPUTS);
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
    fn pictures_that_are_none_are_refused() {
        let rgb = [0; 3 * 64];
        let picture = Picture { width: 8, height: 8, rgb: &rgb };
        assert_eq!(picture.check(Some(&Depth { metres: &[1.0; 64] })), Ok(()));
        let depths = picture.check(Some(&Depth { metres: &[1.0; 63] }));
        assert_eq!(depths, Err(SeeError::Depth { width: 8, height: 8, values: 63 }));
        for (width, height) in [(0, 8), (7, 8), (8, 4097), (8, 9), (usize::MAX, 8)] {
            assert!(Picture { width, height, rgb: &rgb }.check(None).is_err(), "{width} x {height}");
        }
    }
}
