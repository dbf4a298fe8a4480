//! Axis-aligned boxes.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// An axis-aligned box in the world frame, metres; both ends inclusive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// Smallest corner.
    pub min: Point3<f32>,
    /// Largest corner.
    pub max: Point3<f32>,
}

impl Aabb {
    /// Returns the box between two corners in any order.
    pub fn new(a: Point3<f32>, b: Point3<f32>) -> Self {
        Self { min: a.inf(&b), max: a.sup(&b) }
    }

    /// Returns the smallest box around `points`; `None` without points.
    pub fn around<'a>(points: impl IntoIterator<Item = &'a Point3<f32>>) -> Option<Self> {
        let mut points = points.into_iter();
        let first = *points.next()?;
        Some(points.fold(Self { min: first, max: first }, |found, point| found.including(point)))
    }

    /// Extends the box to `point`.
    pub fn including(&self, point: &Point3<f32>) -> Self {
        Self { min: self.min.inf(point), max: self.max.sup(point) }
    }

    /// Returns the smallest box around both.
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }

    /// Moves every face outwards by `margin_m`.
    pub fn grown(&self, margin_m: f32) -> Self {
        let margin = Vector3::repeat(margin_m);
        Self { min: self.min - margin, max: self.max + margin }
    }

    /// Returns the centre.
    pub fn center(&self) -> Point3<f32> {
        nalgebra::center(&self.min, &self.max)
    }

    /// Returns the edge lengths in x, y, z.
    pub fn size(&self) -> Vector3<f32> {
        self.max - self.min
    }

    /// Returns true if `point` is inside or on the surface.
    pub fn contains(&self, point: &Point3<f32>) -> bool {
        (0..3).all(|axis| self.min[axis] <= point[axis] && point[axis] <= self.max[axis])
    }

    /// Returns true if the boxes share a point.
    pub fn intersects(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.min[axis] <= other.max[axis] && other.min[axis] <= self.max[axis])
    }

    /// Returns the box point nearest to `point`; `point` itself if inside.
    pub fn closest_point(&self, point: &Point3<f32>) -> Point3<f32> {
        point.sup(&self.min).inf(&self.max)
    }

    /// Returns the Euclidean distance from `point` to the box, metres; 0 inside.
    pub fn distance_m(&self, point: &Point3<f32>) -> f32 {
        (self.closest_point(point) - point).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_distance_is_zero_inside() {
        let unit = Aabb::new(Point3::new(1.0, 1.0, 1.0), Point3::origin());
        assert_eq!(unit.distance_m(&Point3::new(0.5, 0.5, 0.5)), 0.0);
        assert_eq!(unit.distance_m(&Point3::new(4.0, 5.0, 0.5)), 5.0);
        assert_eq!(unit.center(), Point3::new(0.5, 0.5, 0.5));
    }

    #[test]
    fn box_around_no_points_is_none() {
        assert_eq!(Aabb::around([]), None);
    }
}
