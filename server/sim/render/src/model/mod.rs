//! A scene as it is drawn: clusters of triangles under a tree of boxes, and textures in all their sizes, in one block of
//! memory that can be kept in a file.

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

/// Marks triangles that have holes, beside the numbers of their corners.
pub(crate) const HOLED: u32 = 1 << 24;

/// Sections of a model, in their order.
const SECTIONS: usize = 10;

/// All that pictures of one scene are made from. It is not changed any more, and pictures may be made on many threads.
pub struct Model {
    bytes: Box<dyn AsRef<[u8]> + Send + Sync>,
    /// Where each section lies, bytes.
    sections: [Range<usize>; SECTIONS],
}

/// A model's lists.
#[derive(Clone, Copy, Default)]
pub(crate) struct View<'a> {
    /// Boxes: the smallest and the largest corner as bits of floats, then two numbers: that of a left child and 0, or
    /// that of a cluster and 1.
    pub(crate) nodes: &'a [[u32; 8]],
    pub(crate) clusters: &'a [Cluster],
    /// Of each cluster all x of its corners, metres, filled up to a multiple of [`LANES`], then all y, then all z.
    pub(crate) coordinates: &'a [f32],
    /// Texture coordinates and colours of corners, in the order of the clusters: u and v as bits of floats, then RGB.
    pub(crate) corners: &'a [[u32; 3]],
    /// Of each triangle its corners within the cluster, a byte each, and its surface.
    pub(crate) triangles: &'a [[u32; 2]],
    /// Material, instance.
    pub(crate) surfaces: &'a [[u32; 2]],
    /// Base colour RGBA; number of the first level of its texture, and below it, in [`LEVEL_BITS`], that of levels; alpha
    /// below which there is nothing; 0.
    pub(crate) materials: &'a [[u32; 4]],
    /// Sizes of textures: first texel; width in the low 16 bits and height in the high.
    pub(crate) levels: &'a [Level],
    /// RGBA, in blocks of 4 by 4.
    pub(crate) texels: &'a [u32],
    /// Numbers of the whole: what is seen beyond all surfaces, RGB; triangles that were left out.
    pub(crate) whole: &'a [u32],
}

/// Where a size of a texture begins, and how large it is; see [`View::levels`].
pub(crate) type Level = [u32; 2];

/// Where a cluster's lists begin: coordinate, corner, triangle; then triangles in the low 16 bits and corners in the high.
pub(crate) type Cluster = [u32; 4];

impl Model {
    /// A model in `bytes`, whose sections are known to fit.
    fn new(bytes: Box<dyn AsRef<[u8]> + Send + Sync>, sections: [Range<usize>; SECTIONS]) -> Self {
        Self { bytes, sections }
    }

    /// The model's lists.
    pub(crate) fn view(&self) -> View<'_> {
        let bytes = (*self.bytes).as_ref();
        let section = |index: usize| &bytes[self.sections[index].clone()];
        View {
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

    /// Triangles that can be seen; those without area or with corners that are not finite are left out.
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
