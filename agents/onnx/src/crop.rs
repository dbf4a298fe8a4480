use crate::config::ModelFile;
use avln_client::Image;

/// A rectangle of a picture, in shares of its sides: left, top, right, bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame(pub(crate) [f32; 4]);

impl Frame {
    /// The whole picture.
    pub(crate) const ALL: Self = Self([0.0, 0.0, 1.0, 1.0]);

    /// As far as it is inside of the picture; `None` where nothing is.
    pub(crate) fn inside(self) -> Option<Self> {
        let [left, top, right, bottom] = self.0.map(|share| share.clamp(0.0, 1.0));
        (left < right && top < bottom).then_some(Self([left, top, right, bottom]))
    }

    /// The columns or rows of a side of `pixels` between two shares of it.
    fn span(from: f32, to: f32, pixels: usize) -> std::ops::Range<usize> {
        let first = ((from * pixels as f32) as usize).min(pixels.saturating_sub(1));
        first..((to * pixels as f32).ceil() as usize).clamp(first + 1, pixels.max(first + 1))
    }

    /// Its columns in a picture of this width.
    pub(crate) fn columns(self, width: usize) -> std::ops::Range<usize> {
        Self::span(self.0[0], self.0[2], width)
    }

    /// Its rows in a picture of this height.
    pub(crate) fn rows(self, height: usize) -> std::ops::Range<usize> {
        Self::span(self.0[1], self.0[3], height)
    }

    /// The middle half of it.
    pub(crate) fn middle(self) -> Self {
        let [left, top, right, bottom] = self.0;
        let (x, y) = (0.25 * (right - left), 0.25 * (bottom - top));
        Self([left + x, top + y, right - x, bottom - y])
    }
}

/// What a frame of a picture shows, as a model takes it: red, green and blue plane, row by row, stretched to a square by bilinear
/// interpolation.
pub(crate) fn planes(image: &Image, frame: Frame, model: &ModelFile) -> Vec<f32> {
    let (side, width, height) = (model.side_px, image.width as usize, image.height as usize);
    let [left, top, right, bottom] = frame.0;
    let taps = |low: f32, high: f32, pixels: usize| -> Vec<(usize, usize, f32)> {
        let at =
            |index: usize| (low + (high - low) * (index as f32 + 0.5) / side as f32) * pixels as f32 - 0.5;
        let most = pixels.saturating_sub(1);
        let tap = |at: f32| ((at as usize).min(most), (at as usize + 1).min(most), at.fract());
        (0..side).map(|index| tap(at(index).max(0.0))).collect()
    };
    let (columns, rows) = (taps(left, right, width), taps(top, bottom, height));
    let mut planes = Vec::with_capacity(3 * side * side);
    for channel in 0..3 {
        let value = |x: usize, y: usize| f32::from(image.pixels[3 * (y * width + x) + channel]) / 255.0;
        for &(y0, y1, down) in &rows {
            for &(x0, x1, across) in &columns {
                let upper = value(x0, y0) * (1.0 - across) + value(x1, y0) * across;
                let lower = value(x0, y1) * (1.0 - across) + value(x1, y1) * across;
                let mixed = upper * (1.0 - down) + lower * down;
                planes.push((mixed - model.mean[channel]) / model.std[channel]);
            }
        }
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(side_px: usize) -> ModelFile {
        ModelFile { file: "m".into(), side_px, mean: [0.5, 0.0, 0.0], std: [0.5, 1.0, 1.0] }
    }

    /// Left half red, right half blue.
    fn flag() -> Image {
        let pixels = (0..8 * 8).flat_map(|i| if i % 8 < 4 { [255, 0, 0] } else { [0, 0, 255] }).collect();
        Image { width: 8, height: 8, pixels }
    }

    #[test]
    fn a_frame_becomes_three_planes() {
        let red = planes(&flag(), Frame([0.0, 0.0, 0.4, 1.0]), &model(4));
        assert!(red[..16].iter().all(|&value| value == 1.0) && red[16..].iter().all(|&value| value == 0.0));
        let all = planes(&flag(), Frame::ALL, &model(8));
        assert_eq!((all[0], all[7], all[128], all[135]), (1.0, -1.0, 0.0, 1.0));
    }

    #[test]
    fn frames_keep_to_the_picture() {
        assert_eq!(Frame([-0.5, 0.2, 0.5, 1.7]).inside(), Some(Frame([0.0, 0.2, 0.5, 1.0])));
        assert_eq!(Frame([0.5, 0.2, 0.5, 0.3]).inside(), None);
        assert_eq!(Frame([f32::NAN, 0.0, 1.0, 1.0]).inside(), None);
        let thin = Frame([0.99, 0.0, 1.0, 1.0]);
        assert_eq!((thin.columns(8), thin.rows(8)), (7..8, 0..8));
    }
}
