use serde::Deserialize;
use std::collections::BTreeMap;

/// The network description in a weights file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct NetworkInfo {
    /// Version of the layout: 1.
    pub version: u32,
    /// Category names; mpcat40's where possible.
    pub categories: Vec<String>,
    /// Number of leading categories for the building itself, without instances.
    pub building: usize,
    /// Length of an embedding.
    pub embedding: usize,
    /// Unit for centre offsets, output pixels.
    pub offset_px: f32,
    /// Side of the training images, pixels.
    pub side_px: usize,
    /// Training data.
    pub training: TrainingInfo,
}

/// The training data of a network.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct TrainingInfo {
    /// Recipe of the houses.
    pub recipe: String,
    /// Split of the recipe.
    pub split: String,
    /// Seeds of the houses.
    pub seeds: Vec<u64>,
    /// Images per house.
    pub views: u32,
    /// Training steps.
    pub steps: u32,
    /// Images per step.
    pub batch: u32,
}

/// Reasons for invalid weights.
#[derive(Debug, thiserror::Error)]
#[error("invalid weights: {reason}")]
pub struct WeightsError {
    reason: String,
}

/// Outputs with interleaved weights.
pub(crate) const PANEL: usize = 8;

/// A convolution.
#[derive(Clone, Debug, Default)]
pub(crate) struct ConvLayer {
    /// Weights by panel of [`PANEL`] outputs, tap (row by row), input and output; 0 beyond the last output.
    pub(crate) panels: Vec<[f32; PANEL]>,
    /// Bias by output.
    pub(crate) bias: Vec<f32>,
}

impl ConvLayer {
    /// Creates a layer from weights by tap, input and output.
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

/// A weights file in the safetensors layout: header length (8 bytes), header (JSON), 16-bit floats.
pub(crate) struct WeightsFile<'a> {
    pub(crate) info: NetworkInfo,
    tensors: BTreeMap<String, Tensor>,
    values: &'a [u8],
}

#[derive(Deserialize)]
struct Tensor {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

impl<'a> WeightsFile<'a> {
    pub(crate) fn read(bytes: &'a [u8]) -> Result<Self, WeightsError> {
        let (length, rest) = bytes.split_first_chunk().ok_or_else(|| unusable("the file is truncated"))?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (header, values) =
            rest.split_at_checked(length).ok_or_else(|| unusable("the file ends inside its header"))?;
        let malformed = |error: serde_json::Error| unusable(format!("the header is malformed: {error}"));
        let mut header: BTreeMap<String, serde_json::Value> =
            serde_json::from_slice(header).map_err(malformed)?;
        let told = header.remove("__metadata__").unwrap_or_default();
        let told =
            told["avln-perception"].as_str().ok_or_else(|| unusable("the header has no description"))?;
        let info: NetworkInfo = serde_json::from_str(told).map_err(malformed)?;
        if info.version != 1 {
            return Err(unusable(format!(
                "version {} is not supported; this build reads version 1",
                info.version
            )));
        }
        let tensors = header.into_iter().map(|(name, value)| Ok((name, serde_json::from_value(value)?)));
        Ok(Self { info, tensors: tensors.collect::<Result<_, _>>().map_err(malformed)?, values })
    }

    /// Reads a convolution with `taps` taps.
    pub(crate) fn layer(
        &self,
        name: &str,
        taps: usize,
        inputs: usize,
        outputs: usize,
    ) -> Result<ConvLayer, WeightsError> {
        let weights = self.tensor(&format!("{name}.weight"), &[taps, inputs, outputs])?;
        Ok(ConvLayer::new(&weights, self.tensor(&format!("{name}.bias"), &[outputs])?))
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    pub(crate) fn tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, WeightsError> {
        let found = self.tensors.get(name).ok_or_else(|| unusable(format!("tensor `{name}` is missing")))?;
        if found.dtype != "F16" || found.shape != shape {
            let (dtype, is) = (&found.dtype, &found.shape);
            return Err(unusable(format!("tensor `{name}` is {dtype} {is:?}, not F16 {shape:?}")));
        }
        let [start, end] = found.data_offsets;
        let bytes = self.values.get(start..end).unwrap_or_default();
        if bytes.len() != 2 * shape.iter().product::<usize>() {
            return Err(unusable(format!("tensor `{name}` has {} bytes", bytes.len())));
        }
        let (halves, _) = bytes.as_chunks();
        Ok(halves.iter().map(|half| from_half(u16::from_le_bytes(*half))).collect())
    }
}

fn unusable(reason: impl Into<String>) -> WeightsError {
    WeightsError { reason: reason.into() }
}

/// Converts a 16-bit float (IEEE 754 binary16).
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
    fn half_floats_follow_the_standard() {
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
    fn malformed_files_are_refused() {
        let file = |header: &str| [&(header.len() as u64).to_le_bytes(), header.as_bytes()].concat();
        let said = |bytes: &[u8]| WeightsFile::read(bytes).err().expect("refused").to_string();
        assert!(said(b"abc").contains("truncated"));
        assert!(said(&u64::MAX.to_le_bytes()).contains("inside its header"));
        assert!(said(&file("{]")).contains("malformed"));
        assert!(said(&file("{}")).contains("no description"));
    }
}
