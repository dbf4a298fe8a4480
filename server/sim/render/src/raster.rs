use crate::canvas::{Canvas, NOTHING, SIDE, Tile, TileRect};
use crate::camera::Lens;
use crate::shade::Shader;
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
        let gap = bounds.closest_point(&self.lens.eye()) - self.lens.eye();
        gap.norm_squared()
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
        let holes = self.shader.has_holes(index);
        for row in rect.first[1]..rect.end[1] {
            for column in rect.first[0]..rect.end[0] {
                self.draw(&outline, index, [column, row], holes);
            }
        }
    }
}

impl Raster<'_> {
    /// Draws a triangle into one tile.
    #[inline]
    fn draw(&mut self, outline: &Outline, index: u32, [column, row]: [usize; 2], holes: bool) {
        let first = [
            (column * SIDE) as f32 + 0.5 - self.lens.half[0],
            (row * SIDE) as f32 + 0.5 - self.lens.half[1],
        ];
        let middle = first.map(|at| at + 0.5 * (SIDE - 1) as f32);
        let (tile, far) = self.canvas.tile_mut(column, row);
        let highest = |plane: &Plane| plane.at(middle[0], middle[1]) + plane.swing(HALF_SIDE_PX);
        if highest(&outline.nearness) <= *far || outline.weights.iter().any(|w| highest(w) < 0.0) {
            return;
        }
        if holes {
            self.draw_with_holes(outline, index, [column, row], first);
            return;
        }
        let lowest = |plane: &Plane| plane.at(middle[0], middle[1]) - plane.swing(HALF_SIDE_PX);
        if outline.weights.iter().all(|w| lowest(w) > 0.0) {
            cover(tile, outline, index, first);
        } else {
            cross(tile, outline, index, first);
        }
        *far = tile.farthest();
    }

    /// Draws a triangle that rays may pass through where its texture has holes.
    fn draw_with_holes(&mut self, outline: &Outline, index: u32, [column, row]: [usize; 2], first: [f32; 2]) {
        let surface = self.shader.surface(self.scene, &self.lens, index);
        let (tile, far) = self.canvas.tile_mut(column, row);
        for (at, (nearness, triangle)) in tile.nearness.iter_mut().zip(&mut tile.triangle).enumerate() {
            let (x, y) = (first[0] + (at % SIDE) as f32, first[1] + (at / SIDE) as f32);
            let new = outline.nearness.at(x, y);
            let inside = outline.weights.iter().all(|w| w.at(x, y) >= 0.0);
            if inside && new > *nearness && self.shader.is_solid(&surface, x, y, new) {
                (*nearness, *triangle) = (new, index);
            }
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
                ahead.push(Vector3::from(a + (b - a) * ((NEAR_M - a.z) / (b.z - a.z))).map_z(NEAR_M));
            }
        }
        self.rect_around(&ahead)
    }
}

fn corner(bounds: &Aabb, index: usize) -> Point3<f32> {
    let side = |axis: usize| if index >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
    Point3::new(side(0), side(1), side(2))
}
