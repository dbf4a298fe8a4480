use serde::Deserialize;
use std::collections::BTreeMap;

/// What the file of a network says of itself.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct About {
    /// Version of the file's layout: 1.
    pub version: u32,
    /// Names of categories by number, mpcat40's where there is one.
    pub categories: Vec<String>,
    /// How many of them, the first ones, are the building itself: they have no instances.
    pub building: usize,
    /// Numbers of an embedding.
    pub embedding: usize,
    /// Pixels of the output in which offsets to the middle of instances are told.
    pub offset_px: f32,
    /// Pixels along a side of the pictures that it learnt from.
    pub side_px: usize,
    /// What it learnt from.
    pub training: Training,
}

/// What a network learnt from.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Training {
    /// The recipe whose houses were drawn.
    pub recipe: String,
    /// The split of the recipe.
    pub split: String,
    /// Seeds of the houses.
    pub seeds: Vec<u64>,
    /// Pictures of each house.
    pub views: u32,
    /// Steps of training.
    pub steps: u32,
    /// Pictures in a step.
    pub batch: u32,
}

/// Why the bytes of a network cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("weights cannot be used: {reason}")]
pub struct WeightsError {
    reason: String,
}

/// Outputs whose weights lie beside each other.
pub(crate) const PANEL: usize = 8;

/// A convolution.
#[derive(Clone, Debug, Default)]
pub(crate) struct Layer {
    /// For each [`PANEL`] of outputs, for each tap (row by row), for each input: the weight of each output, 0 beyond the last one.
    pub(crate) panels: Vec<[f32; PANEL]>,
    /// For each output.
    pub(crate) bias: Vec<f32>,
}

impl Layer {
    /// `weights` are for each tap, for each input, for each output.
    pub(crate) fn new(weights: &[f32], bias: Vec<f32>) -> Self {
        let outputs = bias.len();
        let panel = |first: usize| {
            weights.chunks_exact(outputs).map(move |weights| {
                std::array::from_fn(|index| weights.get(first + index).copied().unwrap_or(0.0))
            })
        };
        Self { panels: (0..outputs).step_by(PANEL).flat_map(panel).collect(), bias }
    }
}

/// A file in the layout of safetensors: length of the header (8 bytes), header (JSON), numbers (16-bit floats).
pub(crate) struct Weights<'a> {
    pub(crate) about: About,
    tensors: BTreeMap<String, Tensor>,
    values: &'a [u8],
}

#[derive(Deserialize)]
struct Tensor {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

impl<'a> Weights<'a> {
    pub(crate) fn read(bytes: &'a [u8]) -> Result<Self, WeightsError> {
        let (length, rest) = bytes.split_first_chunk().ok_or_else(|| unusable("the file is cut off"))?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (header, values) =
            rest.split_at_checked(length).ok_or_else(|| unusable("the file ends within its header"))?;
        let malformed = |error: serde_json::Error| unusable(format!("its header is malformed: {error}"));
        let mut header: BTreeMap<String, serde_json::Value> =
            serde_json::from_slice(header).map_err(malformed)?;
        let told = header.remove("__metadata__").unwrap_or_default();
        let told = told["avln-perception"].as_str().ok_or_else(|| unusable("it does not say what it is"))?;
        let about: About = serde_json::from_str(told).map_err(malformed)?;
        if about.version != 1 {
            return Err(unusable(format!("it has version {}, this build reads 1", about.version)));
        }
        let tensors = header.into_iter().map(|(name, value)| Ok((name, serde_json::from_value(value)?)));
        Ok(Self { about, tensors: tensors.collect::<Result<_, _>>().map_err(malformed)?, values })
    }

    /// The convolution called `name`, of `taps` taps.
    pub(crate) fn layer(
        &self,
        name: &str,
        taps: usize,
        inputs: usize,
        outputs: usize,
    ) -> Result<Layer, WeightsError> {
        let weights = self.tensor(&format!("{name}.weight"), &[taps, inputs, outputs])?;
        Ok(Layer::new(&weights, self.tensor(&format!("{name}.bias"), &[outputs])?))
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    pub(crate) fn tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, WeightsError> {
        let found = self.tensors.get(name).ok_or_else(|| unusable(format!("it has no `{name}`")))?;
        if found.dtype != "F16" || found.shape != shape {
            let (dtype, is) = (&found.dtype, &found.shape);
            return Err(unusable(format!("`{name}` is {dtype} {is:?}, not F16 {shape:?}")));
        }
        let [start, end] = found.data_offsets;
        let bytes = self.values.get(start..end).unwrap_or_default();
        if bytes.len() != 2 * shape.iter().product::<usize>() {
            return Err(unusable(format!("`{name}` has {} bytes", bytes.len())));
        }
        let (halves, _) = bytes.as_chunks();
        Ok(halves.iter().map(|half| from_half(u16::from_le_bytes(*half))).collect())
    }
}

fn unusable(reason: impl Into<String>) -> WeightsError {
    WeightsError { reason: reason.into() }
}

/// The number of a 16-bit float (IEEE 754 binary16).
fn from_half(half: u16) -> f32 {
    let sign = if half >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(half >> 10 & 31), f32::from(half & 1023));
    sign * match exponent {
        0 => fraction * 2_f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1.0 + fraction / 1024.0) * 2_f32.powi(exponent - 15),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_what_the_standard_says() {
        for (half, value) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0400, 6.103_515_6e-5),
            (0x0001, 5.960_464_5e-8),
            (0x3555, 0.333_251_95),
            (0x8000, 0.0),
        ] {
            assert_eq!(from_half(half), value, "{half:x}");
        }
        assert!(from_half(0x7c00).is_infinite() && from_half(0x7e00).is_nan());
    }

    #[test]
    fn files_that_are_none_are_refused() {
        let file = |header: &str| [&(header.len() as u64).to_le_bytes(), header.as_bytes()].concat();
        let said = |bytes: &[u8]| Weights::read(bytes).err().expect("refused").to_string();
        assert!(said(b"abc").contains("cut off"));
        assert!(said(&u64::MAX.to_le_bytes()).contains("within its header"));
        assert!(said(&file("{]")).contains("malformed"));
        assert!(said(&file("{}")).contains("what it is"));
    }
}
