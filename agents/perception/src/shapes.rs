//! Shape: lifting segments to boxes, and a second, small network that classifies a segment by appearance and box.

use crate::network::{CameraModel, Depth, Picture};
use crate::segmentation::{Segment, Segmentation};
use crate::{WeightsError, WeightsFile};

/// Shape features; the log-probabilities follow them.
const SHAPE: usize = 14;
const HIDDEN: usize = 64;
/// Offsets for lengths and probabilities before the logarithm.
const LENGTH_M: f32 = 0.05;
const LIKELIHOOD: f32 = 1e-3;

pub(crate) struct ShapeClassifier {
    first: DenseLayer,
    second: DenseLayer,
    /// Factor on the log-probabilities in the sum.
    trust: f32,
}

/// Weights by input and output; bias by output.
struct DenseLayer {
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl ShapeClassifier {
    /// Reads the classifier; `None` if the file has none.
    pub(crate) fn read(weights: &WeightsFile) -> Result<Option<Self>, WeightsError> {
        if !weights.has("shapes.trust") {
            // export.py writes files without shape weights; shapes.py adds them.
            return Ok(None);
        }
        let kinds = weights.info.categories.len();
        let dense = |name: &str, inputs, outputs| {
            let bias = weights.tensor(&format!("{name}.bias"), &[outputs])?;
            Ok(DenseLayer { weights: weights.tensor(&format!("{name}.weight"), &[inputs, outputs])?, bias })
        };
        Ok(Some(Self {
            first: dense("shapes.first", SHAPE + kinds, HIDDEN)?,
            second: dense("shapes.second", HIDDEN, kinds)?,
            trust: weights.tensor("shapes.trust", &[1])?[0],
        }))
    }

    /// Returns the category probabilities from [`features`].
    pub(crate) fn judge(&self, features: &[f32]) -> Vec<f32> {
        let mut hidden = self.first.apply(features);
        hidden.iter_mut().for_each(|value| *value = value.max(0.0));
        let mut told = self.second.apply(&hidden);
        told.iter_mut().zip(&features[SHAPE..]).for_each(|(told, likely)| *told += self.trust * likely);
        let most = told.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        told.iter_mut().for_each(|told| *told = libm::expf(*told - most));
        let sum: f32 = told.iter().sum();
        told.iter_mut().for_each(|told| *told /= sum);
        told
    }
}

impl DenseLayer {
    fn apply(&self, inputs: &[f32]) -> Vec<f32> {
        let mut sums = self.bias.clone();
        for (input, weights) in inputs.iter().zip(self.weights.chunks_exact(sums.len())) {
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += input * weight);
        }
        sums
    }
}

/// Returns the features, in metres: the box's bottom, top, height, longer and shorter side; log width, height
/// and depth; distance; square root of the image share; border contacts (left, right, top, bottom);
/// log-probabilities.
pub(crate) fn features(seen: &Segmentation, segment: &Segment, solid: &ObjectBox) -> Vec<f32> {
    let [wide_m, high_m, deep_m] = std::array::from_fn(|axis| solid.max_m[axis] - solid.min_m[axis]);
    let middle = |axis: usize| 0.5 * (solid.min_m[axis] + solid.max_m[axis]);
    let [left, right] = segment.bounds.columns;
    let [top, bottom] = segment.bounds.rows;
    let shape: [f32; SHAPE] = [
        solid.min_m[1],
        solid.max_m[1],
        high_m,
        wide_m.max(deep_m),
        wide_m.min(deep_m),
        libm::logf(wide_m + LENGTH_M),
        libm::logf(high_m + LENGTH_M),
        libm::logf(deep_m + LENGTH_M),
        (middle(0).powi(2) + middle(2).powi(2)).sqrt(),
        (segment.mask.len() as f32 / (seen.width * seen.height) as f32).sqrt(),
        f32::from(left == 0),
        f32::from(right as usize + 1 == seen.width),
        f32::from(top == 0),
        f32::from(bottom as usize + 1 == seen.height),
    ];
    let likely = segment.categories.iter().map(|likelihood| libm::logf(likelihood + LIKELIHOOD));
    shape.into_iter().chain(likely).collect()
}

/// Outlier share at both ends: depth edges belong to the background.
const OUTLIERS: f32 = 0.03;

/// A box around an instance's visible part, in the body frame: x right, y up from the floor, z back, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectBox {
    /// Lowest corner.
    pub min_m: [f32; 3],
    /// Highest corner.
    pub max_m: [f32; 3],
}

/// Lifts a segment to a box; `None` without depth.
pub fn lift(
    seen: &Segmentation,
    segment: &Segment,
    picture: &Picture,
    depth: &Depth,
    camera: &CameraModel,
) -> Option<ObjectBox> {
    let mut axes: [Vec<f32>; 3] = Default::default();
    for &pixel in &segment.mask {
        let (row, column) = (pixel as usize / seen.width, pixel as usize % seen.width);
        let (x, y) = (column * picture.width / seen.width, row * picture.height / seen.height);
        let depth_m = *depth.metres.get(y * picture.width + x)?;
        if depth_m > 0.0 && depth_m.is_finite() {
            let [right, up, ahead] = camera.ray([picture.width, picture.height], [x as f32, y as f32]);
            axes[0].push(right * depth_m);
            axes[1].push(camera.height_m + up * depth_m);
            axes[2].push(-ahead * depth_m);
        }
    }
    let [x, y, z] = axes.map(extent);
    let (x, y, z) = (x?, y?, z?);
    Some(ObjectBox { min_m: [x[0], y[0], z[0]], max_m: [x[1], y[1], z[1]] })
}

/// Returns the extent of coordinates without outliers; `None` if empty.
pub fn extent(mut numbers: Vec<f32>) -> Option<[f32; 2]> {
    // Quantiles instead of extremes: single depth errors would stretch the box.
    numbers.sort_unstable_by(f32::total_cmp);
    let last = numbers.len().checked_sub(1)?;
    let left_out = (OUTLIERS * last as f32) as usize;
    Some([numbers[left_out], numbers[last - left_out]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::segmentation::{Histogram, PixelBox};

    /// A segment, 8 by 6 pixels, at the left border in a 16 by 16 image.
    fn example() -> (Segmentation, Segment, ObjectBox) {
        let mask: Vec<u32> =
            (0..6).flat_map(|row| (0..8).map(move |column| 16 * (row + 4) + column)).collect();
        let segment = Segment {
            bounds: PixelBox::around(&mask, 16).expect("pixels"),
            mask,
            categories: vec![0.75, 0.25],
            embedding: vec![1.0],
            histogram: Histogram::default(),
        };
        let seen = Segmentation {
            width: 16,
            height: 16,
            categories: vec![0; 256],
            confidences: vec![1.0; 256],
            segments: vec![],
        };
        (seen, segment, ObjectBox { min_m: [-2.0, 0.0, -4.0], max_m: [-1.0, 0.5, -3.8] })
    }

    #[test]
    fn features_describe_the_box() {
        let (seen, segment, solid) = example();
        let features = features(&seen, &segment, &solid);
        assert_eq!(features.len(), SHAPE + 2);
        let wanted = [0.0, 0.5, 0.5, 1.0, 0.2, libm::logf(1.05), libm::logf(0.55), libm::logf(0.25)];
        assert!(features.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5), "{features:?}");
        // The middle is 1.5 m to the left and 3.9 m ahead; 48 of 256 pixels.
        assert!((features[8] - 4.1785).abs() < 1e-3 && (features[9] - 0.433).abs() < 1e-3);
        assert_eq!(features[10..14], [1.0, 0.0, 0.0, 0.0]);
        assert!((features[14] - libm::logf(0.751)).abs() < 1e-6);
    }

    #[test]
    fn probabilities_match_a_manual_sum() {
        let (seen, segment, solid) = example();
        let features = features(&seen, &segment, &solid);
        // The only active hidden unit is the box's top; a metre makes the second category e^4 times as likely.
        let mut first = DenseLayer { weights: vec![0.0; (SHAPE + 2) * HIDDEN], bias: vec![0.0; HIDDEN] };
        first.weights[HIDDEN] = 1.0;
        let mut second = DenseLayer { weights: vec![0.0; 2 * HIDDEN], bias: vec![0.0; 2] };
        second.weights[1] = 4.0;
        let told = ShapeClassifier { first, second, trust: 1.0 }.judge(&features);
        let ratio = 0.251 / 0.751 * libm::expf(2.0);
        assert!(
            (told[1] / told[0] - ratio).abs() < 1e-4 && (told[0] + told[1] - 1.0).abs() < 1e-6,
            "{told:?}"
        );
    }

    #[test]
    fn tabletop_is_raised_to_its_position() {
        // The whole of a 90 degree picture shows a board 2 m ahead: 4 m wide and high.
        let mask: Vec<u32> = (0..64).collect();
        let segment = Segment {
            bounds: PixelBox::around(&mask, 8).expect("pixels"),
            mask,
            categories: vec![1.0],
            embedding: vec![1.0],
            histogram: Histogram::default(),
        };
        let seen = Segmentation {
            width: 8,
            height: 8,
            categories: vec![0; 64],
            confidences: vec![1.0; 64],
            segments: vec![],
        };
        let (rgb, metres) = ([0; 3 * 256], [2.0; 256]);
        let picture = Picture { width: 16, height: 16, rgb: &rgb };
        let camera = CameraModel { hfov_rad: std::f32::consts::FRAC_PI_2, height_m: 1.0, pitch_rad: 0.0 };
        let solid = lift(&seen, &segment, &picture, &Depth { metres: &metres }, &camera).expect("depth");
        // Every second pixel counts, their middles from 1/16 to 13/16 of a half.
        let near = |a: f32, b: f32| (a - b).abs() < 0.3;
        assert!(near(solid.min_m[0], -1.9) && near(solid.max_m[0], 1.7), "{solid:?}");
        assert!(near(solid.min_m[1], -0.7) && near(solid.max_m[1], 2.9), "{solid:?}");
        assert_eq!((solid.min_m[2], solid.max_m[2]), (-2.0, -2.0));
        let blind = lift(&seen, &segment, &picture, &Depth { metres: &[0.0; 256] }, &camera);
        assert_eq!(blind, None);
    }
}
