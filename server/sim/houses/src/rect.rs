//! Floor rectangles, room sides and floor lattices.

use avln_geom::{Aabb, Point3};

/// A rectangle on the floor, metres in world x and z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rect {
    pub(super) x: [f32; 2],
    pub(super) z: [f32; 2],
}

impl Rect {
    pub(super) fn new(x: [f32; 2], z: [f32; 2]) -> Self {
        Self { x: sorted(x), z: sorted(z) }
    }

    pub(super) fn around(center: [f32; 2], size: [f32; 2]) -> Self {
        let span = |axis: usize| [center[axis] - size[axis] / 2.0, center[axis] + size[axis] / 2.0];
        Self::new(span(0), span(1))
    }

    pub(super) fn of(bounds: &Aabb) -> Self {
        Self { x: [bounds.min.x, bounds.max.x], z: [bounds.min.z, bounds.max.z] }
    }

    pub(super) fn size(&self) -> [f32; 2] {
        [self.x[1] - self.x[0], self.z[1] - self.z[0]]
    }

    pub(super) fn area_m2(&self) -> f32 {
        let [width, depth] = self.size();
        width * depth
    }

    pub(super) fn center(&self) -> [f32; 2] {
        [(self.x[0] + self.x[1]) / 2.0, (self.z[0] + self.z[1]) / 2.0]
    }

    /// Moves every side inwards by `margin_m`; outwards if negative.
    pub(super) fn inset(&self, margin_m: f32) -> Self {
        let shrink = |[low, high]: [f32; 2]| [low + margin_m, high - margin_m];
        Self { x: shrink(self.x), z: shrink(self.z) }
    }

    /// Returns true if the rectangles share more than an edge.
    pub(super) fn overlaps(&self, other: &Self) -> bool {
        common(self.x, other.x) > 1e-4 && common(self.z, other.z) > 1e-4
    }

    pub(super) fn holds(&self, inner: &Self) -> bool {
        let within =
            |outer: [f32; 2], inner: [f32; 2]| outer[0] <= inner[0] + 1e-4 && inner[1] <= outer[1] + 1e-4;
        within(self.x, inner.x) && within(self.z, inner.z)
    }

    /// Euclidean distance from a point to the rectangle; 0 inside.
    pub(super) fn distance_m(&self, [x, z]: [f32; 2]) -> f32 {
        let beyond = |[low, high]: [f32; 2], value: f32| (low - value).max(value - high).max(0.0);
        let (dx, dz) = (beyond(self.x, x), beyond(self.z, z));
        (dx * dx + dz * dz).sqrt()
    }

    /// Box over the rectangle between two heights.
    pub(super) fn raised(&self, y: [f32; 2]) -> Aabb {
        Aabb::new(Point3::new(self.x[0], y[0], self.z[0]), Point3::new(self.x[1], y[1], self.z[1]))
    }
}

/// Common length of two ranges; negative for a gap.
pub(super) fn common(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[1].min(b[1]) - a[0].max(b[0])
}

fn sorted([a, b]: [f32; 2]) -> [f32; 2] {
    [a.min(b), a.max(b)]
}

/// A room side, named by compass: north is at the smallest z and faces +z, west is at the smallest x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    North,
    West,
    South,
    East,
}

impl Side {
    pub(super) const ALL: [Side; 4] = [Side::North, Side::West, Side::South, Side::East];

    /// Quarter turns about +Y (counter-clockwise from above) that bring +z into the room.
    pub(super) fn quarter(self) -> u8 {
        self as u8
    }

    pub(super) fn opposite(self) -> Self {
        Self::ALL[(self as usize + 2) % 4]
    }

    /// Returns true if the wall is parallel to x (otherwise z).
    pub(super) fn runs_along_x(self) -> bool {
        matches!(self, Self::North | Self::South)
    }

    /// Wall position on the perpendicular axis.
    pub(super) fn line_m(self, room: &Rect) -> f32 {
        match self {
            Self::North => room.z[0],
            Self::South => room.z[1],
            Self::West => room.x[0],
            Self::East => room.x[1],
        }
    }

    /// Wall range on the wall axis.
    pub(super) fn span(self, room: &Rect) -> [f32; 2] {
        if self.runs_along_x() { room.x } else { room.z }
    }

    /// 1 if the room is on the larger side of the wall, otherwise -1.
    pub(super) fn inward(self) -> f32 {
        if matches!(self, Self::North | Self::West) { 1.0 } else { -1.0 }
    }

    /// Rectangle at this wall of `room` over the range `along`, `depth_m` deep.
    pub(super) fn strip(self, room: &Rect, along: [f32; 2], depth_m: f32) -> Rect {
        self.band(room, along, [0.0, depth_m])
    }

    /// Rectangle over the range `along` between two distances from this wall of `room`.
    pub(super) fn band(self, room: &Rect, along: [f32; 2], depths_m: [f32; 2]) -> Rect {
        let across = depths_m.map(|depth| self.line_m(room) + self.inward() * depth);
        if self.runs_along_x() { Rect::new(along, across) } else { Rect::new(across, along) }
    }
}

/// Turns `[x, z]` by `quarter` quarter turns about +Y.
pub(super) fn turned(quarter: u8, [x, z]: [f32; 2]) -> [f32; 2] {
    match quarter % 4 {
        0 => [x, z],
        1 => [z, -x],
        2 => [-x, -z],
        _ => [-z, x],
    }
}

pub(super) const CELL_M: f32 = 0.1;

/// Square cells over one or two storeys, storey by storey, row by row.
pub(super) struct Lattice {
    origin: [f32; 2],
    columns: usize,
    rows: usize,
    storeys: usize,
}

impl Lattice {
    /// Covers `extent` with cells, and `margin` more in either direction.
    pub(super) fn over(extent: &Rect, margin: usize, storeys: usize) -> Self {
        let [columns, rows] = extent.size().map(|length| (length / CELL_M).ceil() as usize + margin);
        Self { origin: [extent.x[0], extent.z[0]], columns, rows, storeys }
    }

    pub(super) fn count(&self) -> usize {
        self.columns * self.rows * self.storeys
    }

    /// Cell centre, x and z.
    pub(super) fn center(&self, cell: usize) -> [f32; 2] {
        let (column, row) = (cell % self.columns, cell / self.columns % self.rows);
        let at = |origin: f32, index: usize| origin + (index as f32 + 0.5) * CELL_M;
        [at(self.origin[0], column), at(self.origin[1], row)]
    }

    /// Cells with centres in `rect` on a storey.
    pub(super) fn cells_in(&self, storey: usize, rect: Rect) -> impl Iterator<Item = usize> + use<> {
        let range = |span: [f32; 2], origin: f32, count: usize| {
            let index =
                |value: f32| ((value - origin) / CELL_M - 0.5).ceil().clamp(0.0, count as f32) as usize;
            index(span[0])..index(span[1])
        };
        let columns = range(rect.x, self.origin[0], self.columns);
        let rows = range(rect.z, self.origin[1], self.rows);
        let (width, height) = (self.columns, self.rows);
        rows.flat_map(move |row| columns.clone().map(move |column| (storey * height + row) * width + column))
    }

    /// Up to four adjacent cells on the storey.
    pub(super) fn neighbours(&self, cell: usize) -> impl Iterator<Item = usize> {
        let (column, row) = (cell % self.columns, cell / self.columns % self.rows);
        let left = (column > 0).then(|| cell - 1);
        let right = (column + 1 < self.columns).then(|| cell + 1);
        let above = (row > 0).then(|| cell - self.columns);
        let below = (row + 1 < self.rows).then(|| cell + self.columns);
        [left, right, above, below].into_iter().flatten()
    }
}
