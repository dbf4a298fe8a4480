//! Depth buffer: the nearest hit by pixel, and the farthest of these by tile.

/// Pixels per vector and per tile side.
pub(crate) const SIDE: usize = 8;

// Rows are padded to whole tiles plus a tile, so that eight pixels can be read from any position.
#[derive(Default)]
pub(crate) struct Screen {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Row stride, pixels.
    pub(crate) stride: usize,
    /// Reciprocal planar depth, 1/metres; 0 without a hit.
    pub(crate) nearness: Vec<f32>,
    /// Shading record; undefined without a hit.
    pub(crate) record: Vec<u32>,
    /// Tiles per row.
    columns: usize,
    /// Lower bound on the nearness in a tile; 0 while a pixel is empty.
    far: Vec<f32>,
    /// Tiles with a possibly outdated `far`, without duplicates.
    stale: Vec<u32>,
    is_stale: Vec<bool>,
}

/// A pixel rectangle: first column and row, and the end after the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PixelRect {
    pub(crate) first: [u32; 2],
    pub(crate) end: [u32; 2],
}

impl Screen {
    /// Empties and resizes the buffer.
    pub(crate) fn clear(&mut self, width: usize, height: usize) {
        let rows = height.next_multiple_of(SIDE);
        (self.width, self.height) = (width, height);
        self.columns = width.div_ceil(SIDE);
        self.stride = (self.columns + 1) * SIDE;
        self.nearness.clear();
        self.nearness.resize(rows * self.stride, f32::INFINITY);
        for row in self.nearness.chunks_exact_mut(self.stride).take(height) {
            row[..width].fill(0.0);
        }
        self.record.resize(rows * self.stride, 0);
        let tiles = self.columns * (rows / SIDE);
        self.far.clear();
        self.far.resize(tiles, 0.0);
        self.stale.clear();
        self.is_stale.clear();
        self.is_stale.resize(tiles, false);
    }

    /// Returns true if a surface at this reciprocal depth may be visible in `pixels`.
    #[inline(always)]
    pub(crate) fn shows(&self, pixels: &PixelRect, nearness: f32) -> bool {
        let TileRect { first: [left, top], end: [right, bottom] } = pixels.tiles();
        for row in top..bottom {
            let start = row * self.columns;
            for far in &self.far[start + left..start + right] {
                if *far < nearness {
                    return true;
                }
            }
        }
        false
    }

    #[inline(always)]
    pub(crate) fn tile_shows(&self, column: usize, row: usize, nearness: f32) -> bool {
        self.far[row * self.columns + column] < nearness
    }

    /// Marks a changed tile.
    #[inline(always)]
    pub(crate) fn touch(&mut self, column: usize, row: usize) {
        let tile = row * self.columns + column;
        if !self.is_stale[tile] {
            self.is_stale[tile] = true;
            self.stale.push(tile as u32);
        }
    }

    /// Updates `far` for changed tiles.
    #[inline(always)]
    pub(crate) fn settle(&mut self) {
        while let Some(tile) = self.stale.pop() {
            let tile = tile as usize;
            self.is_stale[tile] = false;
            let first = tile / self.columns * SIDE * self.stride + tile % self.columns * SIDE;
            let mut farthest = [f32::INFINITY; SIDE];
            for row in 0..SIDE {
                let pixels = &self.nearness[first + row * self.stride..][..SIDE];
                for (farthest, &nearness) in farthest.iter_mut().zip(pixels) {
                    *farthest = if nearness < *farthest { nearness } else { *farthest };
                }
            }
            self.far[tile] = farthest.into_iter().fold(f32::INFINITY, |a, b| if b < a { b } else { a });
        }
    }
}

/// A tile rectangle: first column and row, and the end after the last.
pub(super) struct TileRect {
    pub(super) first: [usize; 2],
    pub(super) end: [usize; 2],
}

impl PixelRect {
    #[inline(always)]
    pub(super) fn tiles(&self) -> TileRect {
        let ([left, top], [right, bottom]) = (self.first, self.end);
        TileRect {
            first: [left as usize / SIDE, top as usize / SIDE],
            end: [(right as usize - 1) / SIDE + 1, (bottom as usize - 1) / SIDE + 1],
        }
    }

    /// Returns the image pixels with centres between `min` and `max`, relative to the first pixel's centre;
    /// `None` if empty.
    #[inline(always)]
    pub(crate) fn between(min: [f32; 2], max: [f32; 2], size: [usize; 2]) -> Option<Self> {
        let (mut first, mut after) = ([0; 2], [0; 2]);
        for axis in 0..2 {
            let end = size[axis] as f32 - 1.0;
            let low = min[axis] - SLACK_PX;
            let high = max[axis] + SLACK_PX;
            // Written so that NaN covers everything.
            let low = if low > 0.0 { if low < end + 1.0 { low } else { end + 1.0 } } else { 0.0 };
            let high = if high < end { if high > -1.0 { high } else { -1.0 } } else { end };
            let whole = low as i32;
            let from = if (whole as f32) < low { whole + 1 } else { whole };
            let to = if high < 0.0 { -1 } else { high as i32 };
            if from > to {
                return None;
            }
            (first[axis], after[axis]) = (from as u32, to as u32 + 1);
        }
        Some(Self { first, end: after })
    }
}

// Rounding can move a projection by less than this, pixels.
pub(crate) const SLACK_PX: f32 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangle_contains_pixels_by_their_centres() {
        let between = |min, max| PixelRect::between(min, max, [20, 10]);
        let rect = |first, end| Some(PixelRect { first, end });
        assert_eq!(between([-99.0, -99.0], [99.0, 1e30]), rect([0, 0], [20, 10]));
        assert_eq!(between([11.9, 3.9], [12.1, 4.1]), rect([12, 4], [13, 5]));
        assert_eq!(between([12.1, 3.9], [12.9, 4.1]), None, "between two columns");
        assert_eq!(between([-50.0, -50.0], [-0.5, 50.0]), None, "left of the picture");
        assert_eq!(between([19.5, 0.0], [30.0, 5.0]), None, "right of the picture");
        assert_eq!(between([1e30, 0.0], [f32::INFINITY, 5.0]), None, "far to the right");
        assert_eq!(between([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]), None, "around nothing");
        assert_eq!(between([f32::NAN; 2], [f32::NAN; 2]), rect([0, 0], [20, 10]));
    }

    #[test]
    fn tile_is_full_when_all_image_pixels_are() {
        let mut screen = Screen::default();
        screen.clear(11, 9);
        assert_eq!((screen.stride, screen.nearness.len()), (24, 16 * 24));
        let all = PixelRect { first: [8, 8], end: [11, 9] };
        screen.nearness[8 * 24 + 8..8 * 24 + 11].copy_from_slice(&[2.0, 0.0, 3.0]);
        screen.touch(1, 1);
        screen.settle();
        assert!(screen.shows(&all, 0.1), "one pixel is empty");
        screen.nearness[8 * 24 + 9] = 4.0;
        screen.touch(1, 1);
        screen.touch(1, 1);
        screen.settle();
        assert!(!screen.shows(&all, 2.0) && screen.shows(&all, 2.1));
        assert!(screen.tile_shows(0, 1, 0.1) && !screen.tile_shows(1, 1, 1.0));
    }
}
