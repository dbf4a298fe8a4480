//! Rasterisation: the nearest hit of every pixel. The tree is traversed front to back; occluded boxes and
//! triangles are skipped.
//!
//! A pixel belongs to a projected triangle if the pixel centre is inside its three edges. Both sides of an
//! edge use equal numbers up to sign, and the top-left rule assigns centres on an edge, so surfaces have no
//! cracks and no double pixels.

mod batch;
mod clip;
mod edges;
mod fill;
mod screen;
mod swatch;
mod walk;

use screen::PixelRect;
pub(crate) use screen::Screen;
pub(crate) use swatch::ShadingRecords;

use crate::camera::Lens;
use crate::model::ModelView;
use avln_simd::Work;
use batch::{Batches, Projected};

/// Near plane, metres.
pub(crate) const NEAR_M: f32 = 1e-3;

/// Reusable memory for drawing.
#[derive(Default)]
pub(crate) struct Scratch {
    pub(crate) screen: Screen,
    pub(crate) swatches: ShadingRecords,
    projected: Box<Projected>,
    batches: Box<Batches>,
    /// Triangles of the present cluster to draw: numbers and covered pixels.
    waiting: Vec<(u8, PixelRect)>,
    /// Boxes to visit, the next one last.
    open: Vec<u32>,
}

/// Drawing of a single image.
pub(crate) struct Raster<'a> {
    pub(crate) view: ModelView<'a>,
    pub(crate) lens: Lens,
    pub(crate) scratch: &'a mut Scratch,
}

impl Work for Raster<'_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        self.draw();
    }
}
