//! Image segmentation for agents by a small bundled network, trained only on the training pool's houses.
//!
//! ```
//! use avln_perception::{Perception, Picture, VisionNetwork};
//!
//! let mut network = VisionNetwork::new()?;
//! let picture = Picture { width: 128, height: 128, rgb: &[128; 128 * 128 * 3] };
//! let seen = network.see(&picture, None)?;
//! for segment in &seen.segments {
//!     println!("an object with {} probabilities", segment.categories.len());
//! }
//! # Ok::<_, Box<dyn std::error::Error>>(())
//! ```
//!
//! Start reading at [`VisionNetwork::see`]. [`VisionNetwork::info`] lists the training seeds.
//!
//! This crate never depends on the simulator, reads a clock, or uses random numbers.

mod feature_map;
mod network;
mod segmentation;
mod shapes;

pub use network::{CameraModel, Depth, DepthView, Picture, PictureError};
pub use segmentation::{Histogram, PixelBox, Segment, Segmentation};
pub use shapes::{ObjectBox, extent, lift};

use half::f16;
use network::{MULTIPLE_PX, UNet};
use safetensors::{Dtype, SafeTensors};
use serde::Deserialize;
use shapes::ShapeClassifier;

/// An image segmentation.
pub trait Perception {
    /// Returns the category names by index.
    fn categories(&self) -> &[String];

    /// Segments an image; depth and camera improve the result. Fails if a size is invalid.
    fn see(&mut self, picture: &Picture, depth: Option<DepthView>) -> Result<Segmentation, PictureError>;

    /// Returns the object in an image's middle; `None` for the building. Fails if the size is invalid.
    fn look_at_picture(&mut self, picture: &Picture) -> Result<Option<Segment>, PictureError> {
        Ok(self.see(picture, None)?.in_the_middle().cloned())
    }
}

/// The segmentation network; reuses buffers. Equal images give equal bits on one machine.
pub struct VisionNetwork {
    network: UNet,
    shapes: Option<ShapeClassifier>,
    info: NetworkInfo,
}

impl VisionNetwork {
    /// The bundled weights file.
    pub const WEIGHTS: &'static [u8] = include_bytes!("../weights/network.safetensors");

    /// Loads the bundled weights; fails if they are invalid, which a test excludes.
    pub fn new() -> Result<Self, WeightsError> {
        Self::from_bytes(Self::WEIGHTS)
    }

    /// Loads weights that `training/export.py` has written; fails if the file is malformed.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WeightsError> {
        let weights = WeightsFile::read(bytes)?;
        let network = UNet::read(&weights)?;
        Ok(Self { network, shapes: ShapeClassifier::read(&weights)?, info: weights.info })
    }

    /// Returns the description and training data.
    pub fn info(&self) -> &NetworkInfo {
        &self.info
    }

    /// Returns a segment's category probabilities by appearance and box; without shape weights, by appearance only.
    pub fn judge(&self, seen: &Segmentation, segment: &Segment, solid: &ObjectBox) -> Vec<f32> {
        let shapes = self.shapes.as_ref();
        shapes.map_or_else(
            || segment.categories.clone(),
            |shapes| shapes.judge(&Self::features(seen, segment, solid)),
        )
    }

    /// Returns the shape classifier's input: 14 numbers about the box and its place, then log-probabilities.
    pub fn features(seen: &Segmentation, segment: &Segment, solid: &ObjectBox) -> Vec<f32> {
        shapes::features(seen, segment, solid)
    }

    /// Returns the output for every second pixel, row by row: category logits, offset (x, y) to the instance
    /// centre, embedding. Fails for invalid sizes; sides must be multiples of 16.
    pub fn raw(&mut self, picture: &Picture, depth: Option<DepthView>) -> Result<Vec<f32>, PictureError> {
        picture.check(depth.map(|(depth, _)| depth))?;
        let odd = |side: usize| !side.is_multiple_of(MULTIPLE_PX);
        if odd(picture.width) || odd(picture.height) {
            let (width, height, bytes) = (picture.width, picture.height, picture.rgb.len());
            return Err(PictureError::Picture { width, height, bytes });
        }
        network::fill(self.network.input(picture.width, picture.height), picture, depth);
        let output = self.network.run();
        Ok((0..output.height).flat_map(|row| output.row(row)).copied().collect())
    }
}

impl Perception for VisionNetwork {
    fn categories(&self) -> &[String] {
        &self.info.categories
    }

    fn see(&mut self, picture: &Picture, depth: Option<DepthView>) -> Result<Segmentation, PictureError> {
        picture.check(depth.map(|(depth, _)| depth))?;
        let [width, height] = picture.seen_size(self.info.side_px);
        network::fill(self.network.input(width, height), picture, depth);
        Ok(segmentation::seen(&self.info, self.network.run(), picture))
    }
}

/// The network description in a weights file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct NetworkInfo {
    /// Layout version: 1.
    pub version: u32,
    /// Category names; mpcat40's where possible.
    pub categories: Vec<String>,
    /// Number of leading categories for the building itself, without instances.
    pub building: usize,
    /// Embedding length.
    pub embedding: usize,
    /// Unit for centre offsets, output pixels.
    pub offset_px: f32,
    /// Side of the training images, pixels.
    pub side_px: usize,
    /// Training data.
    pub training: TrainingInfo,
}

/// A network's training data.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct TrainingInfo {
    /// House recipe.
    pub recipe: String,
    /// Recipe split.
    pub split: String,
    /// House seeds.
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
pub(crate) const PANEL: usize = 16;

#[derive(Clone, Debug, Default)]
pub(crate) struct ConvLayer {
    /// Weights by panel of [`PANEL`] outputs, tap (row by row), input and output; 0 beyond the last output.
    pub(crate) panels: Vec<[f32; PANEL]>,
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

/// A weights file: safetensors with 16-bit floats, and the description as metadata.
pub(crate) struct WeightsFile<'a> {
    pub(crate) info: NetworkInfo,
    tensors: SafeTensors<'a>,
}

impl<'a> WeightsFile<'a> {
    pub(crate) fn read(bytes: &'a [u8]) -> Result<Self, WeightsError> {
        let malformed = |error| unusable(format!("the file is malformed: {error}"));
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(malformed)?;
        // Files from before the crate was renamed have the old key.
        let keys = ["avln-perception", "avln-eyes"];
        let metadata = header.metadata().as_ref();
        let info = metadata.and_then(|metadata| keys.iter().find_map(|key| metadata.get(*key)));
        let info = info.ok_or_else(|| unusable("the header has no description"))?;
        let info: NetworkInfo = serde_json::from_str(info)
            .map_err(|error| unusable(format!("the description is malformed: {error}")))?;
        if info.version != 1 {
            let version = info.version;
            return Err(unusable(format!("version {version} is not supported; this build reads version 1")));
        }
        Ok(Self { info, tensors: SafeTensors::deserialize(bytes).map_err(malformed)? })
    }

    /// Reads a convolution with weights by tap, input and output.
    pub(crate) fn layer(&self, name: &str, shape: [usize; 3]) -> Result<ConvLayer, WeightsError> {
        let weights = self.tensor(&format!("{name}.weight"), &shape)?;
        Ok(ConvLayer::new(&weights, self.tensor(&format!("{name}.bias"), &shape[2..])?))
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.tensors.tensor(name).is_ok()
    }

    pub(crate) fn tensor(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, WeightsError> {
        let tensor = self.tensors.tensor(name);
        let tensor = tensor.map_err(|_| unusable(format!("tensor `{name}` is missing")))?;
        if tensor.dtype() != Dtype::F16 || tensor.shape() != shape {
            let (dtype, is) = (tensor.dtype(), tensor.shape());
            return Err(unusable(format!("tensor `{name}` is {dtype:?} {is:?}, not F16 {shape:?}")));
        }
        let (halves, _) = tensor.data().as_chunks();
        Ok(halves.iter().map(|half| f16::from_le_bytes(*half).to_f32()).collect())
    }
}

fn unusable(reason: impl Into<String>) -> WeightsError {
    WeightsError { reason: reason.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file without tensors.
    fn file(header: &str) -> Vec<u8> {
        [&(header.len() as u64).to_le_bytes(), header.as_bytes()].concat()
    }

    #[test]
    fn malformed_files_are_refused() {
        let error = |bytes: &[u8]| WeightsFile::read(bytes).err().expect("refused").to_string();
        assert!(error(b"abc").contains("malformed"));
        assert!(error(&u64::MAX.to_le_bytes()).contains("malformed"));
        assert!(error(&file("{]")).contains("malformed"));
        assert!(error(&file("{}")).contains("no description"));
    }

    #[test]
    fn huge_embeddings_are_refused() {
        let training = r#"{"recipe":"","split":"","seeds":[],"views":0,"steps":0,"batch":0}"#;
        let info = format!(
            r#"{{"version":1,"categories":[],"building":0,"embedding":{},"offset_px":1,"side_px":16,"training":{training}}}"#,
            u64::MAX
        );
        let header = serde_json::json!({ "__metadata__": { "avln-perception": info } });
        let error = VisionNetwork::from_bytes(&file(&header.to_string())).err().expect("refused").to_string();
        assert!(error.contains("`stem.weight` is missing"), "{error}");
    }
}
