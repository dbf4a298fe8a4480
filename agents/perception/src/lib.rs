//! Sight for agents: what a picture shows, told by a small network that comes with this crate.
//!
//! [`Eyes`] looks at a picture, with depth or without, and tells what is [`Seen`]: the category of every pixel and the
//! [`Segment`]s, which are instances as far as one picture shows them. The network learnt from houses of the training pool
//! alone ([`Eyes::about`] names their seeds); `training/` makes it. Agents that bring other eyes implement [`Perception`].
//!
//! Start reading at [`Eyes::see`].
//!
//! *Never*: depends on the simulator; reads a clock or draws at random.

mod histogram;
mod input;
mod lift;
mod map;
mod network;
mod picture;
mod seen;
mod segments;
mod shapes;
mod weights;

pub use histogram::Histogram;
pub use lift::{Solid, extent, lift};
pub use picture::{Camera, Depth, Picture, SeeError};
pub use seen::{PixelBox, Seen, Segment};
pub use weights::{About, Training, WeightsError};

use network::Network;

/// The network that comes with the crate.
const WEIGHTS: &[u8] = include_bytes!("../weights/eyes.safetensors");

/// What tells agents what they see.
pub trait Perception {
    /// Names of the categories that it tells apart, by number.
    fn categories(&self) -> &[String];

    /// What a picture shows; with `depth`, taken by `camera`, it is told better.
    ///
    /// # Errors
    /// When the picture cannot be looked at.
    fn see(&mut self, picture: &Picture, depth: Option<(&Depth, &Camera)>) -> Result<Seen, SeeError>;

    /// The object in the middle of a reference picture; `None` where only the building is.
    ///
    /// # Errors
    /// When the picture cannot be looked at.
    fn look_at_picture(&mut self, picture: &Picture) -> Result<Option<Segment>, SeeError> {
        Ok(self.see(picture, None)?.in_the_middle().cloned())
    }
}

/// The network that comes with the crate, ready to look.
///
/// It keeps its memory from picture to picture. On one machine equal pictures give equal bits.
pub struct Eyes {
    network: Network,
}

impl Eyes {
    /// The network that comes with the crate.
    ///
    /// # Errors
    /// Never, as its tests show.
    pub fn new() -> Result<Self, WeightsError> {
        Self::from_bytes(WEIGHTS)
    }

    /// A network from a file that `training/export.py` has written.
    ///
    /// # Errors
    /// When it is none.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, WeightsError> {
        Ok(Self { network: Network::read(bytes)? })
    }

    /// What the network says of itself, and what it learnt from.
    pub fn about(&self) -> &About {
        &self.network.about
    }

    /// Likelihood of each category for a segment of `seen`, by its likeness and by the box around it; they add up to 1. Without
    /// weights for shapes they are those of the segment.
    pub fn judge(&self, seen: &Seen, segment: &Segment, solid: &Solid) -> Vec<f32> {
        let shapes = self.network.shapes.as_ref();
        shapes.map_or_else(
            || segment.categories.clone(),
            |shapes| shapes.judge(&Self::features(seen, segment, solid)),
        )
    }

    /// What a segment is judged by: 14 numbers about its box and its place in the picture, then the logarithms of its
    /// likelihoods.
    pub fn features(seen: &Seen, segment: &Segment, solid: &Solid) -> Vec<f32> {
        shapes::features(seen, segment, solid)
    }

    /// The bare numbers that the network gives for every second pixel of a picture whose sides are multiples of 16, row by row:
    /// logits of categories, offset (x, y) to the middle of the instance, embedding.
    ///
    /// # Errors
    /// When the picture cannot be looked at.
    pub fn raw(&mut self, picture: &Picture, depth: Option<(&Depth, &Camera)>) -> Result<Vec<f32>, SeeError> {
        picture.check(depth.map(|(depth, _)| depth))?;
        let odd = |side: usize| !side.is_multiple_of(network::MULTIPLE_PX);
        if odd(picture.width) || odd(picture.height) {
            let (width, height, bytes) = (picture.width, picture.height, picture.rgb.len());
            return Err(SeeError::Picture { width, height, bytes });
        }
        input::fill(self.network.input(picture.width, picture.height), picture, depth);
        let output = self.network.run();
        Ok((0..output.height).flat_map(|row| output.row(row)).copied().collect())
    }
}

impl Perception for Eyes {
    fn categories(&self) -> &[String] {
        &self.network.about.categories
    }

    fn see(&mut self, picture: &Picture, depth: Option<(&Depth, &Camera)>) -> Result<Seen, SeeError> {
        picture.check(depth.map(|(depth, _)| depth))?;
        let [width, height] = picture.seen_size(self.network.about.side_px);
        input::fill(self.network.input(width, height), picture, depth);
        self.network.run();
        Ok(segments::seen(&mut self.network, picture))
    }
}
