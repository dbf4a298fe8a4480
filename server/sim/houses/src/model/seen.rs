//! Removal of invisible faces: they cost time, and real scans have none.

use super::{Corner, Model};
use avln_geom::{Aabb, Point3, Vector3};

/// Distance in front of a face that must be solid to hide it, metres.
const BEFORE_M: f32 = 0.002;

impl Model {
    /// The model without faces inside its own boxes.
    pub(crate) fn seen(&self) -> Model {
        let boxes: Vec<Aabb> = self.solids.iter().map(|solid| solid.grown(1e-4)).collect();
        self.without(|face| {
            let before = face.moved(BEFORE_M);
            boxes.iter().any(|solid| before.iter().all(|point| solid.contains(point)))
        })
    }

    /// The model without `hidden` triangles.
    pub(crate) fn without(&self, hidden: impl Fn(&Facet) -> bool) -> Model {
        let mut model = Model { solids: self.solids.clone(), lamps: self.lamps.clone(), ..Model::default() };
        let mut moved: Vec<Option<u32>> = vec![None; self.corners.len()];
        for &(corners, paint) in &self.triangles {
            let points = corners.map(|corner| self.corners[corner as usize].position);
            if Facet::of(points).is_some_and(|facet| !hidden(&facet)) {
                let kept = corners.map(|corner| {
                    *moved[corner as usize].get_or_insert_with(|| push(&mut model.corners, self, corner))
                });
                model.triangles.push((kept, paint));
            }
        }
        model
    }
}

/// A triangle in space.
pub(crate) struct Facet {
    points: [Point3<f32>; 3],
    normal: Vector3<f32>,
}

impl Facet {
    /// `None` for a triangle without area.
    fn of(points: [Point3<f32>; 3]) -> Option<Self> {
        let [a, b, c] = points;
        let normal = (b - a).cross(&(c - a)).try_normalize(1e-12)?;
        Some(Self { points, normal })
    }

    /// Corners moved by `distance_m` towards the visible side.
    pub(crate) fn moved(&self, distance_m: f32) -> [Point3<f32>; 3] {
        self.points.map(|point| point + self.normal * distance_m)
    }

    /// Returns true if the face points straight down below `height_m`.
    pub(crate) fn is_underside(&self, height_m: f32) -> bool {
        self.normal.y < -0.99 && self.points.iter().all(|point| point.y < height_m)
    }
}

fn push(corners: &mut Vec<Corner>, from: &Model, corner: u32) -> u32 {
    corners.push(from.corners[corner as usize]);
    corners.len() as u32 - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paint::Paint;

    #[test]
    fn what_touches_inside_of_a_larger_face_is_left_out_and_all_else_stays() {
        let mut model = Model::new();
        model.block([-1.0, 1.0], [1.0, 1.1], [-1.0, 1.0], Paint::CHROME);
        model.block([0.0, 0.1], [0.0, 1.0], [0.0, 0.1], Paint::CHROME);
        let seen = model.seen();
        assert_eq!((model.triangles.len(), seen.triangles.len()), (24, 22), "the top of the leg");
        assert_eq!(seen.bounds(), model.bounds());
        let turned = model.moved(1, Vector3::new(3.0, 0.0, 0.0)).seen();
        assert_eq!(turned.triangles.len(), 22);
    }
}
