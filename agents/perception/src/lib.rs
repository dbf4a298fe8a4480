//! Image segmentation for agents by a small bundled network.
//!
//! [`VisionNetwork`] segments an image, with or without depth, into a [`Segmentation`]: a category per pixel, and
//! [`Segment`]s, the visible parts of instances. The training used only houses from the training pool
//! ([`VisionNetwork::info`] lists their seeds); `training/` contains the scripts. Other networks implement
//! [`Perception`].
//!
//! Start reading at [`VisionNetwork::see`].
//!
//! *Never*: depends on the simulator; reads a clock; uses random numbers.

mod feature_map;
mod network;
mod picture;
mod segmentation;
mod segments;
mod shapes;
mod weights;

pub use picture::{CameraModel, Depth, Picture, PictureError};
pub use segmentation::{Histogram, PixelBox, Segment, Segmentation};
pub use shapes::{ObjectBox, extent, lift};
pub use weights::{NetworkInfo, TrainingInfo, WeightsError};

use network::UNet;
use picture::MULTIPLE_PX;

/// The bundled weights.
const WEIGHTS: &[u8] = include_bytes!("../weights/network.safetensors");

/// An image segmentation.
pub trait Perception {
    /// Returns the category names by index.
    fn categories(&self) -> &[String];

    /// Segments an image; `depth`, taken by the given camera, improves the result.
    ///
    /// # Errors
    /// If the image or depth has an invalid size.
    fn see(
        &mut self,
        picture: &Picture,
        depth: Option<(&Depth, &CameraModel)>,
    ) -> Result<Segmentation, PictureError>;

    /// Returns the object in a reference image's middle; `None` for the building.
    ///
    /// # Errors
    /// If the image has an invalid size.
    fn look_at_picture(&mut self, picture: &Picture) -> Result<Option<Segment>, PictureError> {
        Ok(self.see(picture, None)?.in_the_middle().cloned())
    }
}

/// The segmentation network.
///
/// Buffers persist between images. Equal images give equal bits on one machine.
pub struct VisionNetwork {
    network: UNet,
}

impl VisionNetwork {
    /// Loads the bundled weights.
    ///
    /// # Errors
    /// If they are invalid, which a test excludes.
    pub fn new() -> Result<Self, WeightsError> {
        Self::from_bytes(WEIGHTS)
    }

    /// Loads weights that `training/export.py` has written.
    ///
    /// # Errors
    /// If the file is malformed.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WeightsError> {
        Ok(Self { network: UNet::read(bytes)? })
    }

    /// Returns the description and training data.
    pub fn info(&self) -> &NetworkInfo {
        &self.network.info
    }

    /// Returns a segment's category probabilities by appearance and box; without shape weights, by appearance only.
    pub fn judge(&self, seen: &Segmentation, segment: &Segment, solid: &ObjectBox) -> Vec<f32> {
        let shapes = self.network.shapes.as_ref();
        shapes.map_or_else(
            || segment.categories.clone(),
            |shapes| shapes.judge(&Self::features(seen, segment, solid)),
        )
    }

    /// Returns the shape classifier's input: 14 numbers about the box and its position in the image, then the
    /// log-probabilities.
    pub fn features(seen: &Segmentation, segment: &Segment, solid: &ObjectBox) -> Vec<f32> {
        shapes::features(seen, segment, solid)
    }

    /// Returns the network's output for every second pixel, row by row: category logits, offset (x, y) to the
    /// instance centre, embedding. Image sides must be multiples of 16.
    ///
    /// # Errors
    /// If the image or depth has an invalid size.
    pub fn raw(
        &mut self,
        picture: &Picture,
        depth: Option<(&Depth, &CameraModel)>,
    ) -> Result<Vec<f32>, PictureError> {
        picture.check(depth.map(|(depth, _)| depth))?;
        let odd = |side: usize| !side.is_multiple_of(MULTIPLE_PX);
        if odd(picture.width) || odd(picture.height) {
            let (width, height, bytes) = (picture.width, picture.height, picture.rgb.len());
            return Err(PictureError::Picture { width, height, bytes });
        }
        picture::fill(self.network.input(picture.width, picture.height), picture, depth);
        let output = self.network.run();
        Ok((0..output.height).flat_map(|row| output.row(row)).copied().collect())
    }
}

impl Perception for VisionNetwork {
    fn categories(&self) -> &[String] {
        &self.network.info.categories
    }

    fn see(
        &mut self,
        picture: &Picture,
        depth: Option<(&Depth, &CameraModel)>,
    ) -> Result<Segmentation, PictureError> {
        picture.check(depth.map(|(depth, _)| depth))?;
        let [width, height] = picture.seen_size(self.network.info.side_px);
        picture::fill(self.network.input(width, height), picture, depth);
        self.network.run();
        Ok(segments::seen(&mut self.network, picture))
    }
}
