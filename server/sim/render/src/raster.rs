use crate::camera::Lens;
use crate::canvas::{Canvas, SIDE, Tile, TileRect};
use crate::shade::{Shader, Surface};
use crate::triangle::{Outline, Plane};
use avln_geom::{Aabb, Point3, Vector3, Visitor};
use avln_scene::Scene;

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

impl Visitor for Raster<'_> {
    fn distance(&self, bounds: &Aabb) -> f32 {
        let eye = self.lens.eye();
        (bounds.closest_point(&eye) - eye).norm_squared()
    }

    fn enters(&mut self, bounds: &Aabb) -> bool {
        let corners = std::array::from_fn::<_, 8, _>(|i| self.lens.camera_from_world(&corner(bounds, i)));
        let nearest_m = corners.iter().fold(f32::INFINITY, |least, c| least.min(c.z));
        let farthest_m = corners.iter().fold(f32::NEG_INFINITY, |most, c| most.max(c.z));
        if farthest_m <= 0.0 {
            return false;
        }
        if nearest_m < NEAR_M {
            return may_face(&corners, self.lens.half);
        }
        let rect = self.rect_around(&corners);
        !rect.is_empty() && self.canvas.shows(&rect, 1.0 / nearest_m * (1.0 + 1e-5))
    }

    fn triangle(&mut self, index: u32) {
        let corners = self.scene.corners(index as usize).map(|corner| self.lens.camera_from_world(&corner));
        let rect = self.rect_of_triangle(&corners);
        if rect.is_empty() {
            return;
        }
        let Some(outline) = Outline::new(&corners) else { return };
        let holed = self.shader.has_holes(self.scene, index);
        let surface = holed.then(|| self.shader.surface(self.scene, &self.lens, index, &corners, &outline));
        for row in rect.first[1]..rect.end[1] {
            for column in rect.first[0]..rect.end[0] {
                self.draw(&outline, index, [column, row], surface.as_ref());
            }
        }
    }
}

impl Raster<'_> {
    /// Draws a triangle into one tile; `holed` is what decides where it has holes.
    #[inline]
    fn draw(&mut self, outline: &Outline, index: u32, [column, row]: [usize; 2], holed: Option<&Surface>) {
        let first = [column, row].map(|at| (at * SIDE) as f32 + 0.5);
        let first = [first[0] - self.lens.half[0], first[1] - self.lens.half[1]];
        let middle = first.map(|at| at + 0.5 * (SIDE - 1) as f32);
        let (tile, far) = self.canvas.tile_mut(column, row);
        let highest = |plane: &Plane| plane.at(middle[0], middle[1]) + plane.swing(HALF_SIDE_PX);
        if highest(&outline.nearness) <= *far || outline.weights.iter().any(|w| highest(w) < 0.0) {
            return;
        }
        let lowest = |plane: &Plane| plane.at(middle[0], middle[1]) - plane.swing(HALF_SIDE_PX);
        match holed {
            Some(surface) => perforate(tile, outline, index, first, surface),
            None if outline.weights.iter().all(|w| lowest(w) > 0.0) => cover(tile, outline, index, first),
            None => cross(tile, outline, index, first),
        }
        *far = tile.farthest();
    }

    /// The tiles that points ahead of the camera span.
    fn rect_around(&self, points: &[Vector3<f32>]) -> TileRect {
        let (mut min, mut max) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for point in points {
            let inverse = 1.0 / point.z;
            for axis in 0..2 {
                let at = point[axis] * inverse;
                min[axis] = if at < min[axis] { at } else { min[axis] };
                max[axis] = if at > max[axis] { at } else { max[axis] };
            }
        }
        self.canvas.rect(min, max, self.lens.half)
    }

    /// The tiles that the part of a triangle ahead of the camera spans.
    fn rect_of_triangle(&self, corners: &[Vector3<f32>; 3]) -> TileRect {
        if corners.iter().all(|corner| corner.z >= NEAR_M) {
            return self.rect_around(corners);
        }
        let mut ahead: Vec<_> = corners.iter().copied().filter(|corner| corner.z >= NEAR_M).collect();
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (corners[a], corners[b])) {
            if (a.z < NEAR_M) != (b.z < NEAR_M) {
                ahead.push(crossing(&a, &b));
            }
        }
        self.rect_around(&ahead)
    }
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

/// Draws a triangle into a tile that lies within it.
#[inline]
fn cover(tile: &mut Tile, outline: &Outline, index: u32, first: [f32; 2]) {
    let rows =
        tile.nearness.as_chunks_mut::<SIDE>().0.iter_mut().zip(tile.triangle.as_chunks_mut::<SIDE>().0);
    for (row, (nearness, triangle)) in rows.enumerate() {
        let new = along_row(&outline.nearness, first[0], first[1] + row as f32);
        for i in 0..SIDE {
            let seen = new[i] > nearness[i];
            nearness[i] = if seen { new[i] } else { nearness[i] };
            triangle[i] = if seen { index } else { triangle[i] };
        }
    }
}

/// Draws a triangle into a tile that its border passes through.
#[inline]
fn cross(tile: &mut Tile, outline: &Outline, index: u32, first: [f32; 2]) {
    let rows =
        tile.nearness.as_chunks_mut::<SIDE>().0.iter_mut().zip(tile.triangle.as_chunks_mut::<SIDE>().0);
    for (row, (nearness, triangle)) in rows.enumerate() {
        let y = first[1] + row as f32;
        let new = along_row(&outline.nearness, first[0], y);
        let [a, b, c] = [0, 1, 2].map(|corner| along_row(&outline.weights[corner], first[0], y));
        for i in 0..SIDE {
            let seen = (a[i] >= 0.0) & (b[i] >= 0.0) & (c[i] >= 0.0) & (new[i] > nearness[i]);
            nearness[i] = if seen { new[i] } else { nearness[i] };
            triangle[i] = if seen { index } else { triangle[i] };
        }
    }
}

/// Draws a triangle that rays pass through where `surface` has holes.
fn perforate(tile: &mut Tile, outline: &Outline, index: u32, first: [f32; 2], surface: &Surface) {
    for (at, (nearness, triangle)) in tile.nearness.iter_mut().zip(&mut tile.triangle).enumerate() {
        let (x, y) = (first[0] + (at % SIDE) as f32, first[1] + (at / SIDE) as f32);
        let new = outline.nearness.at(x, y);
        let inside = outline.weights.iter().all(|w| w.at(x, y) >= 0.0);
        if inside && new > *nearness && surface.is_solid(x, y, 1.0 / new) {
            (*nearness, *triangle) = (new, index);
        }
    }
}

/// A plane's values at the pixels of a tile's row.
#[inline(always)]
fn along_row(plane: &Plane, first_x: f32, y: f32) -> [f32; SIDE] {
    std::array::from_fn(|column| plane.at(first_x + column as f32, y))
}
