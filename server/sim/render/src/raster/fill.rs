//! Draws triangles pixel by pixel, eight at a time.

use super::Raster;
use super::batch::{Anchored, Edge, Plane, TriangleSetup};
use super::screen::{SIDE, Screen, TileRect};
use crate::lanes::{Floats, Truths};
use crate::shade::is_solid;

/// Eight columns of a triangle: increments of edge planes and reciprocal depth from column 0, and edge
/// limits.
struct Strip<'a> {
    stroke: &'a TriangleSetup,
    edges: [Floats; 3],
    limits: [Floats; 3],
    nearness: Floats,
    column: usize,
    /// The number to be noted for pixels that are covered.
    swatch: u32,
}

impl TriangleSetup {
    #[inline(always)]
    fn strip(&self, column: usize, swatch: u32) -> Strip<'_> {
        let columns = Floats(std::array::from_fn(|i| (column + i) as i32 as f32));
        let [a, b, c] = &self.edges;
        let along = |plane: &Plane| Floats::of(plane.x) * columns;
        Strip {
            stroke: self,
            edges: [along(&a.plane), along(&b.plane), along(&c.plane)],
            limits: [Floats::of(a.limit), Floats::of(b.limit), Floats::of(c.limit)],
            nearness: Floats::of(self.nearness.x) * (columns - Floats::of(self.nearness.column)),
            column,
            swatch,
        }
    }

    /// Returns true if no pixel of a tile can be inside.
    #[inline(always)]
    fn misses(&self, first: [usize; 2]) -> bool {
        /// Distance from a tile centre to its outermost pixel centres, with a rounding margin.
        const HALF: f32 = 0.5 * (SIDE - 1) as f32 + 0.01;
        let [x, y] = first.map(|at| at as f32 + 0.5 * (SIDE - 1) as f32);
        let outside = |Edge { plane, .. }: &Edge| {
            plane.at(x, y) + (plane.x.abs() + plane.y.abs()) * HALF < -1e-6 * plane.constant.abs()
        };
        self.edges.iter().any(outside)
    }
}

impl Screen {
    /// Draws a triangle, to be noted under the number `swatch`; whether it is seen anywhere.
    #[inline(always)]
    pub(super) fn fill(&mut self, stroke: &TriangleSetup, swatch: u32) -> bool {
        let [left, top] = stroke.pixels.first.map(|at| at as usize);
        let [right, bottom] = stroke.pixels.end.map(|at| at as usize);
        if right - left <= SIDE && bottom - top <= 2 * SIDE {
            let is_seen = self.fill_strip(&stroke.strip(left, swatch), top, bottom);
            if is_seen {
                self.touch_all(&stroke.pixels.tiles());
            }
            return is_seen;
        }
        let TileRect { first, end } = stroke.pixels.tiles();
        let mut is_seen = false;
        for column in first[0]..end[0] {
            let strip = stroke.strip(column * SIDE, swatch);
            for row in first[1]..end[1] {
                let is_hidden = !self.tile_shows(column, row, stroke.nearest);
                if is_hidden || stroke.misses([column * SIDE, row * SIDE]) {
                    continue;
                }
                let (from, to) = ((row * SIDE).max(top), (row * SIDE + SIDE).min(bottom));
                if self.fill_strip(&strip, from, to) {
                    self.touch(column, row);
                    is_seen = true;
                }
            }
        }
        is_seen
    }

    #[inline(always)]
    fn touch_all(&mut self, tiles: &TileRect) {
        for row in tiles.first[1]..tiles.end[1] {
            for column in tiles.first[0]..tiles.end[0] {
                self.touch(column, row);
            }
        }
    }

    /// Draws eight pixels of each row from `top` to before `bottom`; whether any changed.
    #[inline(always)]
    fn fill_strip(&mut self, strip: &Strip, top: usize, bottom: usize) -> bool {
        let (stride, first) = (self.stride, top * self.stride + strip.column);
        let (mut nearness, mut swatch) = (&mut self.nearness[first..], &mut self.swatch[first..]);
        let mut changed = Truths::default();
        for row in top..bottom {
            let (Some(near), Some(seen)) = (nearness.first_chunk_mut(), swatch.first_chunk_mut()) else {
                break;
            };
            changed = changed | strip.fill(row as i32 as f32, near, seen);
            nearness = nearness.get_mut(stride..).unwrap_or_default();
            swatch = swatch.get_mut(stride..).unwrap_or_default();
        }
        changed.any()
    }
}

impl Strip<'_> {
    /// Draws eight pixels of a row; those that changed.
    #[inline(always)]
    fn fill(&self, row: f32, nearness: &mut [f32; SIDE], swatch: &mut [u32; SIDE]) -> Truths {
        let start = |plane: &Plane| Floats::of(plane.y * row + plane.constant);
        let inside =
            |edge: usize| (self.edges[edge] + start(&self.stroke.edges[edge].plane)) - self.limits[edge];
        let inmost = inside(0).least(inside(1)).least(inside(2));
        let Anchored { y, row: from, value, .. } = self.stroke.nearness;
        let new = self.nearness + Floats::of(y * (row - from) + value);
        let new = inmost.above(Floats::of(0.0)).keep(new);
        let seen = new.above(Floats(*nearness));
        *nearness = new.most(Floats(*nearness)).0;
        *swatch = seen.choose_number(self.swatch, swatch);
        seen
    }
}

impl Raster<'_> {
    /// Draws a triangle of a surface with holes and the shading record `swatch`.
    pub(super) fn fill_holed(&mut self, stroke: &TriangleSetup, surface: u32, swatch: u32) {
        let planes = self.scratch.swatches.planes[swatch as usize];
        let screen = &mut self.scratch.screen;
        for y in stroke.pixels.first[1]..stroke.pixels.end[1] {
            for x in stroke.pixels.first[0]..stroke.pixels.end[0] {
                let (column, row) = (x as f32, y as f32);
                let new = stroke.nearness.at(column, row);
                let at = y as usize * screen.stride + x as usize;
                let is_inside = stroke.edges.iter().all(|edge| edge.plane.at(column, row) > edge.limit);
                if is_inside
                    && new > screen.nearness[at]
                    && is_solid(&self.view, surface, &planes, [column, row], new)
                {
                    (screen.nearness[at], screen.swatch[at]) = (new, swatch);
                    screen.touch(x as usize / SIDE, y as usize / SIDE);
                }
            }
        }
    }
}
