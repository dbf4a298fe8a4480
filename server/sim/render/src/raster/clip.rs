//! Triangles that reach behind the pinhole.

use super::batch::{Anchored, Batch, Plane, TriangleSetup};
use super::{NEAR_M, Raster};
use crate::lanes::LANES;
use crate::model::HOLED;
use avln_geom::{Point3, Vector3};

impl Raster<'_> {
    /// Draws triangle `at` of a cluster if it crosses the near plane; returns true in that case.
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
        let number = self.scratch.swatches.next();
        let per_area = planes.inverse_volume.abs() as f32;
        self.make_crossing_swatch(cluster, at, |values| planes.over_depth(values, middle), per_area);
        let outline = self.outline(&corners, &indices);
        let Some(farthest) = outline.iter().copied().min_by(|a, b| a[2].total_cmp(&b[2])) else { return };
        let nearness = planes.nearness(farthest, middle);
        for i in 2..outline.len() {
            let Some(stroke) = self.part([outline[0], outline[i - 1], outline[i]], nearness) else {
                continue;
            };
            match holed {
                None => {
                    self.scratch.screen.fill(&stroke, number);
                }
                Some(surface) => self.fill_holed(&stroke, surface, number),
            }
        }
    }

    fn position(&self, cluster: usize, index: usize) -> Point3<f32> {
        let [first, _, _, counts] = self.view.clusters[cluster];
        let padded = ((counts >> 16) as usize).next_multiple_of(LANES);
        Point3::from([0, 1, 2].map(|axis| self.view.coordinates[first as usize + axis * padded + index]))
    }

    /// Projected corners and reciprocal depths of the part beyond the near plane: three or four. Shared
    /// corners use the shared projection.
    fn outline(&self, corners: &[Vector3<f32>; 3], indices: &[usize; 3]) -> Vec<[f32; 3]> {
        let projected = &self.scratch.projected;
        let mut outline = Vec::with_capacity(4);
        for i in 0..3 {
            let next = (i + 1) % 3;
            let [is_ahead, next_is_ahead] = [i, next].map(|i| projected.depth_m[indices[i]] >= NEAR_M);
            if is_ahead {
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

    /// A triangle with corners on the screen (column, row, nearness) and this plane of nearness; `None` when it covers no
    /// pixel.
    fn part(&self, corners: [[f32; 3]; 3], nearness: Anchored) -> Option<TriangleSetup> {
        let screen = &self.scratch.screen;
        let batch = Batch::single(corners, [screen.width, screen.height]);
        let pixels = batch.pixels(0)?;
        Some(TriangleSetup { nearness, ..batch.stroke(0, pixels) })
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
    /// Creates the planes of a triangle in the camera frame; `None` if seen edge-on.
    fn new(corners: &[Vector3<f32>; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|corner| corner.cast::<f64>());
        let normals = [b.cross(&c), c.cross(&a), a.cross(&b)];
        let inverse_volume = 1.0 / a.dot(&normals[0]);
        inverse_volume.is_finite().then_some(Self { normals, inverse_volume })
    }

    /// The plane of values over depth, in pixels from the picture's middle: across, down, constant.
    fn gradient(&self, values: [f32; 3]) -> Vector3<f64> {
        let [a, b, c] = values.map(f64::from);
        (self.normals[0] * a + self.normals[1] * b + self.normals[2] * c) * self.inverse_volume
    }

    /// The plane over depth through three corners' values, given the picture's middle.
    fn over_depth(&self, values: [f32; 3], [middle_x, middle_y]: [f32; 2]) -> Plane {
        let sum = self.gradient(values);
        let constant = sum.z - sum.x * f64::from(middle_x) - sum.y * f64::from(middle_y);
        Plane { x: sum.x as f32, y: sum.y as f32, constant: constant as f32 }
    }

    /// The plane of nearness, anchored at a place on the screen.
    fn nearness(&self, [column, row, _]: [f32; 3], middle: [f32; 2]) -> Anchored {
        let sum = self.gradient([1.0; 3]);
        let [x, y] =
            [(column, middle[0]), (row, middle[1])].map(|(at, middle)| f64::from(at) - f64::from(middle));
        let value = (sum.x * x + sum.y * y + sum.z) as f32;
        Anchored { x: sum.x as f32, y: sum.y as f32, column, row, value }
    }
}
