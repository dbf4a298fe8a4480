//! Finds the nearest hit of every pixel's ray: the tree is walked from near to far, boxes and triangles behind what was
//! seen already are left out, and the others are drawn.
//!
//! A triangle is projected, and a pixel belongs to it when the pixel's centre lies within its three edges. Both sides of an
//! edge work with the same numbers up to sign, and a centre on an edge belongs to the side that the top-left rule names, so
//! that surfaces have neither cracks nor seams.

mod batch;
mod clip;
mod edges;
mod fill;
mod screen;
mod swatch;
mod walk;

use screen::PixelRect;
pub(crate) use screen::Screen;
pub(crate) use swatch::Swatches;

use crate::camera::Lens;
use crate::model::View;
use avln_simd::Work;
use batch::{Batches, Projected};

/// What is nearer to the plane of the pinhole is not seen, metres.
pub(crate) const NEAR_M: f32 = 1e-3;

/// Memory that pictures are drawn in; it may be used again and again.
#[derive(Default)]
pub(crate) struct Scratch {
    pub(crate) screen: Screen,
    pub(crate) swatches: Swatches,
    projected: Box<Projected>,
    batches: Box<Batches>,
    /// Triangles of the current cluster that are about to be drawn: their numbers and the pixels that they can cover.
    waiting: Vec<(u8, PixelRect)>,
    /// Boxes that are still to be looked into, the next one last.
    open: Vec<u32>,
}

/// Draws one picture.
pub(crate) struct Raster<'a> {
    pub(crate) view: View<'a>,
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
