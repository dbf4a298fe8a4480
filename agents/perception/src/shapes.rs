//! What an instance is, by its likeness and its shape together: a second, small network over what the first one tells of a
//! segment and how its box stands in the room.

use crate::weights::{Weights, WeightsError};
use crate::{Seen, Segment, Solid};

/// Numbers that tell the shape of a segment; the logarithms of the likelihoods follow them.
const SHAPE: usize = 14;
const HIDDEN: usize = 64;
/// What is added to lengths and to likelihoods before the logarithm is taken.
const LENGTH_M: f32 = 0.05;
const LIKELIHOOD: f32 = 1e-3;

pub(crate) struct Shapes {
    first: Dense,
    second: Dense,
    /// Factor on the logarithms of the likelihoods in the sum.
    trust: f32,
}

/// For each input the weights of all outputs; for each output its bias.
struct Dense {
    weights: Vec<f32>,
    bias: Vec<f32>,
}

impl Shapes {
    /// `None` where the file has none.
    pub(crate) fn read(weights: &Weights) -> Result<Option<Self>, WeightsError> {
        if !weights.has("shapes.trust") {
            return Ok(None);
        }
        let kinds = weights.about.categories.len();
        let dense = |name: &str, inputs, outputs| {
            let bias = weights.tensor(&format!("{name}.bias"), &[outputs])?;
            Ok(Dense { weights: weights.tensor(&format!("{name}.weight"), &[inputs, outputs])?, bias })
        };
        Ok(Some(Self {
            first: dense("shapes.first", SHAPE + kinds, HIDDEN)?,
            second: dense("shapes.second", HIDDEN, kinds)?,
            trust: weights.tensor("shapes.trust", &[1])?[0],
        }))
    }

    /// Likelihood of each category from [`features`]; they add up to 1.
    pub(crate) fn judge(&self, features: &[f32]) -> Vec<f32> {
        let mut hidden = self.first.apply(features);
        hidden.iter_mut().for_each(|value| *value = value.max(0.0));
        let mut told = self.second.apply(&hidden);
        told.iter_mut().zip(&features[SHAPE..]).for_each(|(told, likely)| *told += self.trust * likely);
        let most = told.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        told.iter_mut().for_each(|told| *told = (*told - most).exp());
        let sum: f32 = told.iter().sum();
        told.iter_mut().for_each(|told| *told /= sum);
        told
    }
}

impl Dense {
    fn apply(&self, inputs: &[f32]) -> Vec<f32> {
        let mut sums = self.bias.clone();
        for (input, weights) in inputs.iter().zip(self.weights.chunks_exact(sums.len())) {
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += input * weight);
        }
        sums
    }
}

/// What a segment is judged by: lowest and highest point and height of its box, its longer and shorter side on the floor and the
/// logarithms of all three, distance from the camera, metres; the share of the picture that it fills, as a side; at which
/// borders of the picture it ends (left, right, top, bottom); then the logarithms of its likelihoods.
pub(crate) fn features(seen: &Seen, segment: &Segment, solid: &Solid) -> Vec<f32> {
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
        (wide_m + LENGTH_M).ln(),
        (high_m + LENGTH_M).ln(),
        (deep_m + LENGTH_M).ln(),
        (middle(0).powi(2) + middle(2).powi(2)).sqrt(),
        (segment.mask.len() as f32 / (seen.width * seen.height) as f32).sqrt(),
        f32::from(left == 0),
        f32::from(right as usize + 1 == seen.width),
        f32::from(top == 0),
        f32::from(bottom as usize + 1 == seen.height),
    ];
    let likely = segment.categories.iter().map(|likelihood| (likelihood + LIKELIHOOD).ln());
    shape.into_iter().chain(likely).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Histogram, PixelBox};

    /// A segment of 8 by 6 pixels at the left border of a picture of 16 by 16.
    fn example() -> (Seen, Segment, Solid) {
        let mask: Vec<u32> =
            (0..6).flat_map(|row| (0..8).map(move |column| 16 * (row + 4) + column)).collect();
        let segment = Segment {
            bounds: PixelBox::around(&mask, 16).expect("pixels"),
            mask,
            categories: vec![0.75, 0.25],
            embedding: vec![1.0],
            histogram: Histogram::default(),
        };
        let seen = Seen {
            width: 16,
            height: 16,
            categories: vec![0; 256],
            confidences: vec![1.0; 256],
            segments: vec![],
        };
        (seen, segment, Solid { min_m: [-2.0, 0.0, -4.0], max_m: [-1.0, 0.5, -3.8] })
    }

    #[test]
    fn features_are_those_of_the_box() {
        let (seen, segment, solid) = example();
        let features = features(&seen, &segment, &solid);
        assert_eq!(features.len(), SHAPE + 2);
        let wanted = [0.0, 0.5, 0.5, 1.0, 0.2, 1.05_f32.ln(), 0.55_f32.ln(), 0.25_f32.ln()];
        assert!(features.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5), "{features:?}");
        // The middle is 1.5 m to the left and 3.9 m ahead; 48 of 256 pixels.
        assert!((features[8] - 4.1785).abs() < 1e-3 && (features[9] - 0.433).abs() < 1e-3);
        assert_eq!(features[10..14], [1.0, 0.0, 0.0, 0.0]);
        assert!((features[14] - 0.751_f32.ln()).abs() < 1e-6);
    }

    #[test]
    fn likelihoods_are_sums_by_hand() {
        let (seen, segment, solid) = example();
        let features = features(&seen, &segment, &solid);
        // The only hidden number that counts is how high the thing reaches; each metre makes the second category e^4 as likely.
        let mut first = Dense { weights: vec![0.0; (SHAPE + 2) * HIDDEN], bias: vec![0.0; HIDDEN] };
        first.weights[HIDDEN] = 1.0;
        let mut second = Dense { weights: vec![0.0; 2 * HIDDEN], bias: vec![0.0; 2] };
        second.weights[1] = 4.0;
        let told = Shapes { first, second, trust: 1.0 }.judge(&features);
        let ratio = 0.251 / 0.751 * 2_f32.exp();
        assert!(
            (told[1] / told[0] - ratio).abs() < 1e-4 && (told[0] + told[1] - 1.0).abs() < 1e-6,
            "{told:?}"
        );
    }
}
