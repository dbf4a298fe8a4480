use std::ops::Range;

/// Pixels along the side of a tile.
pub(crate) const SIDE: usize = 8;
/// Pixels of a tile.
pub(crate) const AREA: usize = SIDE * SIDE;
/// No triangle.
pub(crate) const NOTHING: u32 = u32::MAX;

/// What the rays have met so far, in square tiles.
pub(crate) struct Canvas {
    /// Pixels in a row and rows of the picture.
    pub(crate) size: [usize; 2],
    /// Tiles in a row and rows of tiles; those at the right and lower border reach over the picture.
    pub(crate) tiles: [usize; 2],
    tile: Vec<Tile>,
    /// Of each tile the farthest hit's nearness; 0 while some pixel has met nothing.
    far: Vec<f32>,
}

/// A square of pixels, row-major.
#[derive(Clone)]
pub(crate) struct Tile {
    /// One over the planar depth of the nearest hit, 1/metres; 0 for none.
    pub(crate) nearness: [f32; AREA],
    /// The triangle that was hit.
    pub(crate) triangle: [u32; AREA],
}

/// A rectangle of pixels: first column and row, and those after the last. It may be empty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PixelRect {
    first: [usize; 2],
    end: [usize; 2],
}

/// A rectangle of tiles: first column and row, and those after the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TileRect {
    pub(crate) first: [usize; 2],
    pub(crate) end: [usize; 2],
}

impl Canvas {
    /// An empty picture.
    pub(crate) fn new(size: [usize; 2]) -> Self {
        let tiles = size.map(|pixels| pixels.div_ceil(SIDE));
        let empty = Tile { nearness: [0.0; AREA], triangle: [NOTHING; AREA] };
        let count = tiles[0] * tiles[1];
        Self { size, tiles, tile: vec![empty; count], far: vec![0.0; count] }
    }

    /// The tile in this column and row.
    pub(crate) fn tile(&self, column: usize, row: usize) -> &Tile {
        &self.tile[row * self.tiles[0] + column]
    }

    /// The tile in this column and row, and the nearness that a new hit must exceed to be seen at all.
    #[inline]
    pub(crate) fn tile_mut(&mut self, column: usize, row: usize) -> (&mut Tile, &mut f32) {
        let at = row * self.tiles[0] + column;
        (&mut self.tile[at], &mut self.far[at])
    }

    /// Whether something of this nearness could be seen anywhere in `pixels`.
    #[inline]
    pub(crate) fn shows(&self, pixels: &PixelRect, nearness: f32) -> bool {
        let tiles = pixels.tiles();
        (tiles.first[1]..tiles.end[1]).any(|row| {
            let start = row * self.tiles[0];
            self.far[start + tiles.first[0]..start + tiles.end[0]].iter().any(|&far| far < nearness)
        })
    }
}

impl PixelRect {
    /// The pixels of a picture of this `size` whose centres may lie between two points, both in pixels from the middle.
    #[inline]
    pub(crate) fn between(min: [f32; 2], max: [f32; 2], half: [f32; 2], size: [usize; 2]) -> Self {
        /// Room for rounding, pixels.
        const SLACK: f32 = 0.02;
        let (mut first, mut end) = ([0; 2], [0; 2]);
        for axis in 0..2 {
            // Casts from float saturate: borders far outside of the picture end at its edge.
            let low = min[axis] + (half[axis] - 0.5 - SLACK);
            let high = max[axis] + (half[axis] - 0.5 + SLACK);
            let whole = low as usize;
            first[axis] = if whole as f32 >= low { whole } else { whole.saturating_add(1) };
            end[axis] = if high >= 0.0 { (high as usize).saturating_add(1).min(size[axis]) } else { 0 };
        }
        Self { first, end }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.first[0] >= self.end[0] || self.first[1] >= self.end[1]
    }

    /// The tiles that these pixels lie in; some, if there are any pixels.
    #[inline]
    pub(crate) fn tiles(&self) -> TileRect {
        let [left, top] = self.first;
        let [right, bottom] = self.end;
        TileRect { first: [left / SIDE, top / SIDE], end: [right.div_ceil(SIDE), bottom.div_ceil(SIDE)] }
    }

    /// Which rows of the tiles in this row of tiles lie within.
    #[inline]
    pub(crate) fn rows_within(&self, tile_row: usize) -> Range<usize> {
        let top = tile_row * SIDE;
        self.first[1].saturating_sub(top)..(self.end[1] - top).min(SIDE)
    }
}

impl Tile {
    /// Nearness and triangle of some rows.
    #[inline]
    pub(crate) fn rows(
        &mut self,
        rows: Range<usize>,
    ) -> impl Iterator<Item = (&mut [f32; SIDE], &mut [u32; SIDE])> {
        let nearness = &mut self.nearness.as_chunks_mut::<SIDE>().0[rows.clone()];
        nearness.iter_mut().zip(&mut self.triangle.as_chunks_mut::<SIDE>().0[rows])
    }

    /// The nearness of the farthest hit; 0 when some pixel has met nothing.
    #[inline]
    pub(crate) fn farthest(&self) -> f32 {
        let mut lanes = [f32::INFINITY; SIDE];
        for row in self.nearness.chunks_exact(SIDE) {
            for (lane, &nearness) in lanes.iter_mut().zip(row) {
                *lane = if nearness < *lane { nearness } else { *lane };
            }
        }
        lanes.into_iter().fold(f32::INFINITY, f32::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_holds_the_pixels_whose_centres_lie_between_its_corners() {
        let between = |min, max| PixelRect::between(min, max, [10.0, 5.0], [20, 10]);
        let all = between([-99.0, -99.0], [99.0, 1e30]);
        assert_eq!((all.first, all.end), ([0, 0], [20, 10]));
        // Column 12 has its centre 2.5 pixels to the right of the middle; row 4 half a pixel above it.
        let one = between([2.4, -0.6], [2.6, -0.4]);
        assert_eq!((one.first, one.end), ([12, 4], [13, 5]));
        assert_eq!((one.tiles().first, one.tiles().end), ([1, 0], [2, 1]));
        assert!(between([2.6, -0.6], [3.4, -0.4]).is_empty(), "between two columns");
        assert!(between([-50.0, -50.0], [-11.0, 50.0]).is_empty(), "left of the picture");
        assert!(between([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]).is_empty(), "around nothing");
        assert_eq!(between([0.0, -2.0], [1.0, 4.6]).rows_within(1), 0..2);
    }
}
