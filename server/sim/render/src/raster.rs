use crate::camera::Lens;
use crate::canvas::{Canvas, PixelRect, SIDE, Tile};
use crate::shade::{Shader, Surface};
use crate::triangle::{Outline, Plane};
use avln_geom::{Aabb, Point3, Vector3, Visitor};
use avln_scene::Scene;
use std::ops::Range;

/// Half a tile, from the centre of its first pixel to that of its last, and a little more against rounding, pixels.
const HALF_SIDE_PX: f32 = 0.5 * (SIDE - 1) as f32 + 0.01;
/// What is nearer to the plane of the pinhole is not projected, metres.
const NEAR_M: f32 = 1e-3;

/// Finds the nearest hit of every pixel's ray, box by box.
pub(crate) struct Raster<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) lens: Lens,
    pub(crate) canvas: Canvas,
    pub(crate) shader: &'a Shader,
}

/// A triangle about to be drawn.
struct Stroke<'a> {
    index: u32,
    outline: Outline,
    /// Pixels that it can cover.
    pixels: PixelRect,
    /// What decides where it has holes; `None` for an opaque one.
    holed: Option<Surface<'a>>,
}

impl Visitor for Raster<'_> {
    fn distance(&self, bounds: &Aabb) -> f32 {
        let eye = self.lens.eye();
        let gap = |axis: usize| (bounds.min[axis] - eye[axis]).max(eye[axis] - bounds.max[axis]).max(0.0);
        gap(0) * gap(0) + gap(1) * gap(1) + gap(2) * gap(2)
    }

    fn enters(&mut self, bounds: &Aabb) -> bool {
        let corners = std::array::from_fn::<_, 8, _>(|i| self.lens.camera_from_world(&corner(bounds, i)));
        let (nearest_m, farthest_m) = depth_range(&corners);
        if farthest_m <= 0.0 {
            return false;
        }
        if nearest_m < NEAR_M {
            return may_face(&corners, self.lens.half);
        }
        self.may_show(&self.pixels_around(&corners), nearest_m)
    }

    fn triangle(&mut self, index: u32) {
        let corners = self.lens.corners(self.scene, index);
        let (nearest_m, farthest_m) = depth_range(&corners);
        if farthest_m < NEAR_M {
            return;
        }
        let pixels =
            if nearest_m < NEAR_M { self.pixels_ahead(&corners) } else { self.pixels_around(&corners) };
        if !self.may_show(&pixels, nearest_m.max(NEAR_M)) {
            return;
        }
        let Some(outline) = Outline::new(&corners) else { return };
        let holed = self.shader.has_holes(self.scene, index);
        let holed = holed.then(|| self.shader.surface(self.scene, &self.lens, index, &corners, &outline));
        self.draw(&Stroke { index, outline, pixels, holed });
    }
}

impl Raster<'_> {
    /// Whether something in these pixels, no nearer than `nearest_m`, could be seen.
    #[inline]
    fn may_show(&self, pixels: &PixelRect, nearest_m: f32) -> bool {
        const ROUNDING: f32 = 1.0 + 1e-5;
        !pixels.is_empty() && self.canvas.shows(pixels, ROUNDING / nearest_m)
    }

    #[inline]
    fn draw(&mut self, stroke: &Stroke) {
        let tiles = stroke.pixels.tiles();
        for row in tiles.first[1]..tiles.end[1] {
            for column in tiles.first[0]..tiles.end[0] {
                self.draw_tile(stroke, [column, row]);
            }
        }
    }

    /// Draws a triangle into one tile.
    #[inline]
    fn draw_tile(&mut self, stroke: &Stroke, [column, row]: [usize; 2]) {
        let first =
            [(column * SIDE) as f32 + 0.5 - self.lens.half[0], (row * SIDE) as f32 + 0.5 - self.lens.half[1]];
        let middle = [first[0] + 0.5 * (SIDE - 1) as f32, first[1] + 0.5 * (SIDE - 1) as f32];
        let (tile, far) = self.canvas.tile_mut(column, row);
        let highest = |plane: &Plane| plane.at(middle[0], middle[1]) + plane.swing(HALF_SIDE_PX);
        let lowest = |plane: &Plane| plane.at(middle[0], middle[1]) - plane.swing(HALF_SIDE_PX);
        let outline = &stroke.outline;
        if highest(&outline.nearness) <= *far || outline.weights.iter().any(|w| highest(w) < 0.0) {
            return;
        }
        let changed = if stroke.holed.is_some() {
            perforate(tile, stroke, first)
        } else if outline.weights.iter().all(|w| lowest(w) > 0.0) {
            cover(tile, stroke, first)
        } else {
            cross(tile, stroke, first, stroke.pixels.rows_within(row))
        };
        if changed {
            *far = tile.farthest();
        }
    }

    /// The pixels that points ahead of the camera span.
    #[inline]
    fn pixels_around(&self, points: &[Vector3<f32>]) -> PixelRect {
        let (mut min, mut max) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for point in points {
            let inverse = 1.0 / point.z;
            for axis in 0..2 {
                let at = point[axis] * inverse;
                min[axis] = if at < min[axis] { at } else { min[axis] };
                max[axis] = if at > max[axis] { at } else { max[axis] };
            }
        }
        PixelRect::between(min, max, self.lens.half, self.canvas.size)
    }

    /// The pixels that the part of a triangle ahead of the camera spans.
    fn pixels_ahead(&self, corners: &[Vector3<f32>; 3]) -> PixelRect {
        let mut ahead: Vec<_> = corners.iter().copied().filter(|corner| corner.z >= NEAR_M).collect();
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (corners[a], corners[b])) {
            if (a.z < NEAR_M) != (b.z < NEAR_M) {
                ahead.push(crossing(&a, &b));
            }
        }
        self.pixels_around(&ahead)
    }
}

/// The smallest and the largest depth of some points, metres.
#[inline]
fn depth_range(points: &[Vector3<f32>]) -> (f32, f32) {
    points.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(least, most), point| {
        (if point.z < least { point.z } else { least }, if point.z > most { point.z } else { most })
    })
}

/// Corner `index` (0 to 7) of a box.
fn corner(bounds: &Aabb, index: usize) -> Point3<f32> {
    let side = |axis: usize| if index >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
    Point3::new(side(0), side(1), side(2))
}

/// Where the edge from `a` to `b` passes the depth at which projection begins.
fn crossing(a: &Vector3<f32>, b: &Vector3<f32>) -> Vector3<f32> {
    let at = a + (b - a) * ((NEAR_M - a.z) / (b.z - a.z));
    Vector3::new(at.x, at.y, NEAR_M)
}

/// Whether a box around or beside the pinhole can be in the picture: false when it lies beyond one of its borders.
fn may_face(corners: &[Vector3<f32>; 8], half: [f32; 2]) -> bool {
    [0, 1].into_iter().all(|axis| {
        let beyond = |sign: f32| corners.iter().all(|c| sign * c[axis] > half[axis] * c.z);
        !beyond(1.0) && !beyond(-1.0)
    })
}

/// Draws a triangle into a tile that lies within it; whether it changed.
#[inline]
fn cover(tile: &mut Tile, stroke: &Stroke, first: [f32; 2]) -> bool {
    let mut changed = false;
    for (row, (nearness, triangle)) in tile.rows(0..SIDE).enumerate() {
        let new = along_row(&stroke.outline.nearness, first[0], first[1] + row as f32);
        for i in 0..SIDE {
            let seen = new[i] > nearness[i];
            nearness[i] = if seen { new[i] } else { nearness[i] };
            triangle[i] = if seen { stroke.index } else { triangle[i] };
            changed |= seen;
        }
    }
    changed
}

/// Draws a triangle into those `rows` of a tile that its border passes through; whether it changed.
#[inline]
fn cross(tile: &mut Tile, stroke: &Stroke, first: [f32; 2], rows: Range<usize>) -> bool {
    let mut changed = false;
    let [a, b, c] = &stroke.outline.weights;
    for (row, (nearness, triangle)) in rows.clone().zip(tile.rows(rows)) {
        let y = first[1] + row as f32;
        let new = along_row(&stroke.outline.nearness, first[0], y);
        let (a, b, c) = (along_row(a, first[0], y), along_row(b, first[0], y), along_row(c, first[0], y));
        for i in 0..SIDE {
            let seen = (a[i] >= 0.0) & (b[i] >= 0.0) & (c[i] >= 0.0) & (new[i] > nearness[i]);
            nearness[i] = if seen { new[i] } else { nearness[i] };
            triangle[i] = if seen { stroke.index } else { triangle[i] };
            changed |= seen;
        }
    }
    changed
}

/// Draws a triangle that rays pass through where its surface has holes; whether the tile changed.
fn perforate(tile: &mut Tile, stroke: &Stroke, first: [f32; 2]) -> bool {
    let mut changed = false;
    for (at, (nearness, triangle)) in tile.nearness.iter_mut().zip(&mut tile.triangle).enumerate() {
        let (x, y) = (first[0] + (at % SIDE) as f32, first[1] + (at / SIDE) as f32);
        let new = stroke.outline.nearness.at(x, y);
        let inside = stroke.outline.weights.iter().all(|w| w.at(x, y) >= 0.0);
        let is_solid = |surface: &Surface| surface.is_solid(x, y, 1.0 / new);
        if inside && new > *nearness && stroke.holed.as_ref().is_none_or(is_solid) {
            (*nearness, *triangle) = (new, stroke.index);
            changed = true;
        }
    }
    changed
}

/// A plane's values at the pixels of a tile's row.
#[inline(always)]
fn along_row(plane: &Plane, first_x: f32, y: f32) -> [f32; SIDE] {
    let start = plane.y * y + plane.constant;
    let mut values = [0.0; SIDE];
    for (column, value) in values.iter_mut().enumerate() {
        *value = plane.x * (first_x + column as f32) + start;
    }
    values
}
