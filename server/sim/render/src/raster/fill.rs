//! Drawing pixel by pixel, eight at a time, and clipping at the near plane.

use super::batch::{Anchored, Batch, Edge, Plane, TriangleSetup};
use super::screen::{SIDE, Screen, TileRect};
use super::{NEAR_M, Raster};
use crate::lanes::{Floats, LANES, Truths};
use crate::model::HOLED;
use crate::shade::is_solid;
use avln_geom::{Point3, Vector3};

/// Eight columns of a triangle: plane increments from column 0, and edge limits.
struct Strip<'a> {
    setup: &'a TriangleSetup,
    edges: [Floats; 3],
    limits: [Floats; 3],
    nearness: Floats,
    column: usize,
    /// Shading record for covered pixels.
    record: u32,
}

impl TriangleSetup {
    #[inline(always)]
    fn strip(&self, column: usize, record: u32) -> Strip<'_> {
        let columns = Floats(std::array::from_fn(|i| (column + i) as i32 as f32));
        let [a, b, c] = &self.edges;
        let along = |plane: &Plane| Floats::of(plane.x) * columns;
        Strip {
            setup: self,
            edges: [along(&a.plane), along(&b.plane), along(&c.plane)],
            limits: [Floats::of(a.limit), Floats::of(b.limit), Floats::of(c.limit)],
            nearness: Floats::of(self.nearness.x) * (columns - Floats::of(self.nearness.column)),
            column,
            record,
        }
    }

    /// Returns true if no pixel in a tile can be inside.
    #[inline(always)]
    fn misses(&self, first: [usize; 2]) -> bool {
        // From a tile centre to its outermost pixel centres, with a rounding margin.
        const HALF: f32 = 0.5 * (SIDE - 1) as f32 + 0.01;
        let [x, y] = first.map(|at| at as f32 + 0.5 * (SIDE - 1) as f32);
        let outside = |Edge { plane, .. }: &Edge| {
            plane.at(x, y) + (plane.x.abs() + plane.y.abs()) * HALF < -1e-6 * plane.constant.abs()
        };
        self.edges.iter().any(outside)
    }
}

impl Screen {
    /// Draws a triangle; returns true if any pixel changed.
    #[inline(always)]
    pub(super) fn fill(&mut self, setup: &TriangleSetup, record: u32) -> bool {
        let [left, top] = setup.pixels.first.map(|at| at as usize);
        let [right, bottom] = setup.pixels.end.map(|at| at as usize);
        if right - left <= SIDE && bottom - top <= 2 * SIDE {
            let is_seen = self.fill_strip(&setup.strip(left, record), top, bottom);
            if is_seen {
                self.touch_all(&setup.pixels.tiles());
            }
            return is_seen;
        }
        let TileRect { first, end } = setup.pixels.tiles();
        let mut is_seen = false;
        for column in first[0]..end[0] {
            let strip = setup.strip(column * SIDE, record);
            for row in first[1]..end[1] {
                let is_hidden = !self.tile_shows(column, row, setup.nearest);
                if is_hidden || setup.misses([column * SIDE, row * SIDE]) {
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

    /// Draws eight pixels in all rows from `top` to `bottom`; returns true if any changed.
    #[inline(always)]
    fn fill_strip(&mut self, strip: &Strip, top: usize, bottom: usize) -> bool {
        let (stride, first) = (self.stride, top * self.stride + strip.column);
        let (mut nearness, mut record) = (&mut self.nearness[first..], &mut self.record[first..]);
        let mut changed = Truths::default();
        for row in top..bottom {
            let (Some(near), Some(seen)) = (nearness.first_chunk_mut(), record.first_chunk_mut()) else {
                break;
            };
            changed = changed | strip.fill(row as i32 as f32, near, seen);
            nearness = nearness.get_mut(stride..).unwrap_or_default();
            record = record.get_mut(stride..).unwrap_or_default();
        }
        changed.any()
    }
}

impl Strip<'_> {
    /// Draws eight pixels in a row; returns the changed ones.
    #[inline(always)]
    fn fill(&self, row: f32, nearness: &mut [f32; SIDE], record: &mut [u32; SIDE]) -> Truths {
        let start = |plane: &Plane| Floats::of(plane.y * row + plane.constant);
        let inside =
            |edge: usize| (self.edges[edge] + start(&self.setup.edges[edge].plane)) - self.limits[edge];
        let inmost = inside(0).least(inside(1)).least(inside(2));
        let Anchored { y, row: from, value, .. } = self.setup.nearness;
        let new = self.nearness + Floats::of(y * (row - from) + value);
        let new = inmost.above(Floats::of(0.0)).keep(new);
        let seen = new.above(Floats(*nearness));
        *nearness = new.most(Floats(*nearness)).0;
        *record = seen.choose_number(self.record, record);
        seen
    }
}

impl Raster<'_> {
    /// Draws a triangle with holes.
    pub(super) fn fill_holed(&mut self, setup: &TriangleSetup, surface: u32, record: u32) {
        let planes = self.scratch.records.planes[record as usize];
        let screen = &mut self.scratch.screen;
        for y in setup.pixels.first[1]..setup.pixels.end[1] {
            for x in setup.pixels.first[0]..setup.pixels.end[0] {
                let (column, row) = (x as f32, y as f32);
                let new = setup.nearness.at(column, row);
                let at = y as usize * screen.stride + x as usize;
                let is_inside = setup.edges.iter().all(|edge| edge.plane.at(column, row) > edge.limit);
                if is_inside
                    && new > screen.nearness[at]
                    && is_solid(&self.view, surface, &planes, [column, row], new)
                {
                    (screen.nearness[at], screen.record[at]) = (new, record);
                    screen.touch(x as usize / SIDE, y as usize / SIDE);
                }
            }
        }
    }
}

impl Raster<'_> {
    /// Draws triangle `at` if it crosses the near plane; returns true in that case.
    pub(super) fn clip(&mut self, cluster: usize, at: usize) -> bool {
        let [word, surface] = self.view.triangles[self.view.clusters[cluster][2] as usize + at];
        let [a, b, c, _] = word.to_le_bytes();
        let indices = [a, b, c].map(usize::from);
        let is_ahead = indices.map(|index| self.scratch.projected.depth_m[index] >= NEAR_M);
        if is_ahead == [true; 3] {
            return false;
        }
        if is_ahead != [false; 3] {
            self.draw_crossing(cluster, at, indices, (word & HOLED != 0).then_some(surface));
        }
        true
    }

    fn draw_crossing(&mut self, cluster: usize, at: usize, indices: [usize; 3], holed: Option<u32>) {
        let corners = indices.map(|index| self.lens.camera_from_world(&self.position(cluster, index)));
        let Some(planes) = Homogeneous::new(&corners) else { return };
        let middle = self.lens.middle;
        let number = self.scratch.records.next();
        let per_area = planes.inverse_volume.abs() as f32;
        self.make_crossing_record(cluster, at, |values| planes.over_depth(values, middle), per_area);
        let outline = self.outline(&corners, &indices);
        let Some(farthest) = outline.iter().copied().min_by(|a, b| a[2].total_cmp(&b[2])) else { return };
        let nearness = planes.nearness(farthest, middle);
        for i in 2..outline.len() {
            let Some(setup) = self.part([outline[0], outline[i - 1], outline[i]], nearness) else {
                continue;
            };
            match holed {
                None => {
                    self.scratch.screen.fill(&setup, number);
                }
                Some(surface) => self.fill_holed(&setup, surface, number),
            }
        }
    }

    fn position(&self, cluster: usize, index: usize) -> Point3<f32> {
        let [first, _, _, counts] = self.view.clusters[cluster];
        let padded = ((counts >> 16) as usize).next_multiple_of(LANES);
        Point3::from([0, 1, 2].map(|axis| self.view.coordinates[first as usize + axis * padded + index]))
    }

    /// Returns three or four projected corners with reciprocal depths, for the part beyond the near plane.
    fn outline(&self, corners: &[Vector3<f32>; 3], indices: &[usize; 3]) -> Vec<[f32; 3]> {
        let projected = &self.scratch.projected;
        let mut outline = Vec::with_capacity(4);
        for i in 0..3 {
            let next = (i + 1) % 3;
            let [is_ahead, next_is_ahead] = [i, next].map(|i| projected.depth_m[indices[i]] >= NEAR_M);
            if is_ahead {
                // Shared corners use the shared projection: neighbours stay free of cracks.
                let index = indices[i];
                outline.push([projected.x[index], projected.y[index], projected.nearness[index]]);
            }
            if is_ahead != next_is_ahead {
                let (ahead, behind) = if is_ahead { (i, next) } else { (next, i) };
                let (ahead, behind) = (corners[ahead], corners[behind]);
                let at = ahead + (behind - ahead) * ((NEAR_M - ahead.z) / (behind.z - ahead.z));
                let [middle_x, middle_y] = self.lens.middle;
                outline.push([at.x / NEAR_M + middle_x, at.y / NEAR_M + middle_y, 1.0 / NEAR_M]);
            }
        }
        outline
    }

    /// Returns the setup for a part on the screen (column, row, nearness); `None` without a pixel.
    fn part(&self, corners: [[f32; 3]; 3], nearness: Anchored) -> Option<TriangleSetup> {
        let screen = &self.scratch.screen;
        let batch = Batch::single(corners, [screen.width, screen.height]);
        let pixels = batch.pixels(0)?;
        Some(TriangleSetup { nearness, ..batch.setup(0, pixels) })
    }
}

/// A triangle in homogeneous coordinates, with corners anywhere.
///
/// Source: Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates" (1997).
struct Homogeneous {
    normals: [Vector3<f64>; 3],
    inverse_volume: f64,
}

impl Homogeneous {
    /// Returns the planes of a triangle in the camera frame; `None` if seen edge-on.
    fn new(corners: &[Vector3<f32>; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|corner| corner.cast::<f64>());
        let normals = [b.cross(&c), c.cross(&a), a.cross(&b)];
        let inverse_volume = 1.0 / a.dot(&normals[0]);
        inverse_volume.is_finite().then_some(Self { normals, inverse_volume })
    }

    /// Returns the plane of values over depth, in pixels from the image centre: across, down, constant.
    fn gradient(&self, values: [f32; 3]) -> Vector3<f64> {
        let [a, b, c] = values.map(f64::from);
        (self.normals[0] * a + self.normals[1] * b + self.normals[2] * c) * self.inverse_volume
    }

    /// Returns the plane over depth through values at the corners.
    fn over_depth(&self, values: [f32; 3], [middle_x, middle_y]: [f32; 2]) -> Plane {
        let sum = self.gradient(values);
        let constant = sum.z - sum.x * f64::from(middle_x) - sum.y * f64::from(middle_y);
        Plane { x: sum.x as f32, y: sum.y as f32, constant: constant as f32 }
    }

    /// Returns the plane of nearness, anchored at a screen position.
    fn nearness(&self, [column, row, _]: [f32; 3], middle: [f32; 2]) -> Anchored {
        let sum = self.gradient([1.0; 3]);
        let [x, y] =
            [(column, middle[0]), (row, middle[1])].map(|(at, middle)| f64::from(at) - f64::from(middle));
        let value = (sum.x * x + sum.y * y + sum.z) as f32;
        Anchored { x: sum.x as f32, y: sum.y as f32, column, row, value }
    }
}
