//! A scene prepared for rendering: clusters of triangles under a box tree, and textures in all sizes, in a
//! single memory block that can be stored in a file.

mod build;
mod cluster;
mod stored;
mod textures;
mod tree;

pub use stored::ModelError;
pub(crate) use textures::{BLOCK, LEVEL_BITS, NO_TEXTURE};
pub(crate) use tree::CLUSTER;

use std::ops::Range;

#[cfg(doc)]
use crate::lanes::LANES;

/// Corners of a cluster, at most.
pub(crate) const CORNERS: usize = 3 * CLUSTER;

/// Flag of triangles with holes, next to the corner numbers.
pub(crate) const HOLED: u32 = 1 << 24;

/// Sections of a model, in their order.
const SECTIONS: usize = 10;

/// Immutable render data of a scene, shared by threads.
pub struct Model {
    bytes: Box<dyn AsRef<[u8]> + Send + Sync>,
    /// Byte range of every section.
    sections: [Range<usize>; SECTIONS],
}

/// A model's lists.
#[derive(Clone, Copy, Default)]
pub(crate) struct ModelView<'a> {
    /// Boxes: smallest and largest corner as float bits, then the left child and 0, or a cluster and 1.
    pub(crate) nodes: &'a [[u32; 8]],
    pub(crate) clusters: &'a [Cluster],
    /// Per cluster: x of all corners in metres, padded to a multiple of [`LANES`], then y, then z.
    pub(crate) coordinates: &'a [f32],
    /// Texture coordinates and colours of corners, in cluster order: u and v as float bits, then RGB.
    pub(crate) corners: &'a [[u32; 3]],
    /// Per triangle: corners within the cluster, a byte each, and the surface.
    pub(crate) triangles: &'a [[u32; 2]],
    /// Material, instance.
    pub(crate) surfaces: &'a [[u32; 2]],
    /// Base colour RGBA; first texture level with the level count in the low [`LEVEL_BITS`] bits; alpha
    /// cutoff; 0.
    pub(crate) materials: &'a [[u32; 4]],
    /// Sizes of textures: first texel; width in the low 16 bits and height in the high.
    pub(crate) levels: &'a [Level],
    /// RGBA, in blocks of 4 by 4.
    pub(crate) texels: &'a [u32],
    /// Global values: background colour RGB; number of omitted triangles.
    pub(crate) whole: &'a [u32],
}

/// Start and size of a texture level; see [`View::levels`].
pub(crate) type Level = [u32; 2];

/// Start of the lists of a cluster: coordinate, corner, triangle; then triangle count in the low 16 bits and
/// corner count in the high.
pub(crate) type Cluster = [u32; 4];

impl Model {
    /// A model in `bytes` with validated sections.
    fn new(bytes: Box<dyn AsRef<[u8]> + Send + Sync>, sections: [Range<usize>; SECTIONS]) -> Self {
        Self { bytes, sections }
    }

    /// The model's lists.
    pub(crate) fn view(&self) -> ModelView<'_> {
        let bytes = (*self.bytes).as_ref();
        let section = |index: usize| &bytes[self.sections[index].clone()];
        ModelView {
            nodes: bytemuck::cast_slice(section(0)),
            clusters: bytemuck::cast_slice(section(1)),
            coordinates: bytemuck::cast_slice(section(2)),
            corners: bytemuck::cast_slice(section(3)),
            triangles: bytemuck::cast_slice(section(4)),
            surfaces: bytemuck::cast_slice(section(5)),
            materials: bytemuck::cast_slice(section(6)),
            levels: bytemuck::cast_slice(section(7)),
            texels: bytemuck::cast_slice(section(8)),
            whole: bytemuck::cast_slice(section(9)),
        }
    }

    /// Count of visible triangles, without degenerate or invalid triangles.
    pub fn triangle_count(&self) -> usize {
        self.view().triangles.len()
    }

    /// Bytes that the triangles take, tree included.
    pub fn geometry_bytes(&self) -> usize {
        self.sections[..6].iter().map(ExactSizeIterator::len).sum()
    }

    /// Bytes that textures take in all their sizes.
    pub fn texture_bytes(&self) -> usize {
        self.sections[8].len()
    }

    /// All bytes of the model.
    pub fn byte_count(&self) -> usize {
        (*self.bytes).as_ref().len()
    }
}
