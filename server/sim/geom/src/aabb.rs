//! Axis-aligned boxes, with queries by parry.

use crate::convert::{glam_from_point, point_from_glam};
use nalgebra::{Point3, Vector3};
use parry3d::{bounding_volume::Aabb as ParryAabb, bounding_volume::BoundingVolume, query::PointQuery};
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
        let point = glam_from_point(point);
        self.parry().contains(&ParryAabb::new(point, point))
    }

    /// Returns true if the boxes share a point.
    pub fn intersects(&self, other: &Self) -> bool {
        self.parry().intersects(&other.parry())
    }

    /// Returns the box point nearest to `point`; `point` itself if inside.
    pub fn closest_point(&self, point: &Point3<f32>) -> Point3<f32> {
        point_from_glam(self.parry().project_local_point(glam_from_point(point), true).point)
    }

    /// Returns the Euclidean distance from `point` to the box, metres; 0 inside.
    pub fn distance_m(&self, point: &Point3<f32>) -> f32 {
        self.parry().distance_to_local_point(glam_from_point(point), true)
    }

    fn parry(&self) -> ParryAabb {
        ParryAabb::new(glam_from_point(&self.min), glam_from_point(&self.max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    #[test]
    fn box_distance_is_zero_inside() {
        let unit = Aabb::new(Point3::new(1.0, 1.0, 1.0), Point3::origin());
        assert_eq!(unit.distance_m(&Point3::new(0.5, 0.5, 0.5)), 0.0);
        assert_eq!(unit.distance_m(&Point3::new(4.0, 5.0, 0.5)), 5.0);
        assert_eq!(unit.center(), Point3::new(0.5, 0.5, 0.5));
    }

    #[test]
    fn box_distance_equals_the_clamp_bit_for_bit() {
        let mut rng = Rng::new(3);
        let mut point = |reach: f32| Point3::from(Vector3::from_fn(|_, _| rng.range(-reach, reach)));
        for _ in 0..10_000 {
            let (bounds, place) = (Aabb::new(point(4.0), point(4.0)), point(9.0));
            let offset = place.sup(&bounds.min).inf(&bounds.max) - place;
            let clamped_m = (offset.x * offset.x + offset.y * offset.y + offset.z * offset.z).sqrt();
            assert_eq!(bounds.distance_m(&place).to_bits(), clamped_m.to_bits(), "{bounds:?}, {place}");
            assert!((bounds.closest_point(&place) - place - offset).norm() < 1e-5);
            assert_eq!(bounds.contains(&place), clamped_m == 0.0);
        }
    }

    #[test]
    fn points_without_numbers_are_outside() {
        let unit = Aabb::new(Point3::origin(), Point3::new(1.0, 1.0, 1.0));
        assert!(!unit.contains(&Point3::new(f32::NAN, 0.5, 0.5)));
        assert!(unit.contains(&unit.max) && !unit.contains(&Point3::new(0.5, 1.1, 0.5)));
    }

    #[test]
    fn touching_boxes_intersect() {
        let cube = |x: f32| Aabb::new(Point3::new(x, 0.0, 0.0), Point3::new(x + 1.0, 1.0, 1.0));
        assert!(cube(0.0).intersects(&cube(1.0)) && !cube(0.0).intersects(&cube(1.01)));
    }

    #[test]
    fn box_around_no_points_is_none() {
        assert_eq!(Aabb::around([]), None);
    }
}
