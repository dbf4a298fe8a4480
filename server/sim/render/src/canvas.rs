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

    /// Whether something of this nearness could be seen anywhere in `rect`.
    #[inline]
    pub(crate) fn shows(&self, rect: &TileRect, nearness: f32) -> bool {
        (rect.first[1]..rect.end[1]).any(|row| {
            let start = row * self.tiles[0];
            self.far[start + rect.first[0]..start + rect.end[0]].iter().any(|&far| far < nearness)
        })
    }

    /// The tiles that the rectangle between two picture points touches, both in pixels from the middle of the picture.
    #[inline]
    pub(crate) fn rect(&self, min: [f32; 2], max: [f32; 2], half: [f32; 2]) -> TileRect {
        // Casts from float saturate: borders far outside of the picture end at its edge.
        let tile_of =
            |axis: usize, at: f32| ((at + half[axis]).max(0.0) as usize / SIDE).min(self.tiles[axis]);
        let first = [0, 1].map(|axis| tile_of(axis, min[axis]));
        let outside = |axis: usize| max[axis] + half[axis] < 0.0;
        let end = [0, 1].map(|axis| {
            let last = tile_of(axis, max[axis]);
            if outside(axis) { 0 } else { (last + 1).min(self.tiles[axis]) }
        });
        TileRect { first, end }
    }
}

impl TileRect {
    pub(crate) fn is_empty(&self) -> bool {
        self.first[0] >= self.end[0] || self.first[1] >= self.end[1]
    }
}

impl Tile {
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
