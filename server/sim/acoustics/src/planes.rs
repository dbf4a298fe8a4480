//! Large planar building parts, which mirror sound.

mod fit;

use avln_geom::{Point3, Vector3};
use avln_scene::Scene;

/// Plane number in a building; the largest plane is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PlaneId(pub(crate) u16);

/// A building's planes, independent of the triangulation.
#[derive(Debug)]
pub(crate) struct Planes {
    planes: Vec<Plane>,
    /// Per triangle: its plane, [`NO_PLANE`] for small or curved parts.
    plane_of: Vec<u16>,
}

const NO_PLANE: u16 = u16::MAX;

/// All points with `normal` product `offset_m`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    /// Unit length, to either side.
    pub(crate) normal: Vector3<f32>,
    /// Signed distance from the origin, metres.
    pub(crate) offset_m: f32,
    /// Largest triangle distance from the plane, metres.
    pub(crate) slack_m: f32,
}

impl Plane {
    /// Signed distance, metres; positive along the normal.
    pub(crate) fn height_m(&self, point: &Point3<f32>) -> f32 {
        self.normal.dot(&point.coords) - self.offset_m
    }

    /// Mirror image of `point`.
    pub(crate) fn mirrored(&self, point: &Point3<f32>) -> Point3<f32> {
        point - self.normal * (2.0 * self.height_m(point))
    }

    /// Mirrored ray direction.
    pub(crate) fn reflected(&self, direction: &Vector3<f32>) -> Vector3<f32> {
        direction - self.normal * (2.0 * self.normal.dot(direction))
    }
}

impl Planes {
    pub(crate) fn new(scene: &Scene) -> Self {
        let (planes, plane_of) = fit::planes(scene);
        Self { planes, plane_of }
    }

    /// Returns a triangle's plane; `None` for small or curved parts.
    pub(crate) fn of(&self, triangle: u32) -> Option<PlaneId> {
        let plane = self.plane_of[triangle as usize];
        (plane != NO_PLANE).then_some(PlaneId(plane))
    }

    pub(crate) fn plane(&self, id: PlaneId) -> &Plane {
        &self.planes[usize::from(id.0)]
    }

    pub(crate) fn len(&self) -> usize {
        self.planes.len()
    }

    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.planes.as_slice()) + size_of_val(self.plane_of.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{Soup, scene};
    use avln_geom::Rng;

    fn planes_of(soup: &Soup) -> Planes {
        Planes::new(&scene(soup))
    }

    #[test]
    fn a_room_has_six_planes_however_finely_it_is_cut() {
        for pieces in [1, 7, 40] {
            let planes = planes_of(&Soup::room([6.0, 3.0, 5.0], pieces));
            assert_eq!(planes.planes.len(), 6, "{pieces}");
            assert!(planes.plane_of.iter().all(|plane| *plane != NO_PLANE));
            let largest = planes.planes[0];
            assert!(largest.normal.y.abs() > 0.999_999, "floor and ceiling are the largest: {largest:?}");
        }
    }

    #[test]
    fn every_triangle_lies_in_its_plane() {
        let soup = Soup::room([6.0, 3.0, 5.0], 5).rotated(0.3);
        let (planes, scene) = (planes_of(&soup), scene(&soup));
        for triangle in 0..scene.mesh.triangles.len() {
            let plane = planes.plane(planes.of(triangle as u32).expect("walls are large"));
            assert!(scene.corners(triangle).iter().all(|corner| plane.height_m(corner).abs() < 1e-4));
        }
    }

    #[test]
    fn bumps_of_a_scan_do_not_break_a_wall() {
        let mut rng = Rng::new(3);
        let mut soup = Soup::room([6.0, 3.0, 5.0], 30);
        soup.shake(|| rng.range(-0.008, 0.008));
        let planes = planes_of(&soup);
        let in_six = planes.plane_of.iter().filter(|plane| **plane < 6).count();
        assert!(in_six * 10 > planes.plane_of.len() * 9, "{in_six} of {}", planes.plane_of.len());
        for plane in &planes.planes[..6] {
            let largest = plane.normal.abs().max();
            assert!(largest > 0.999_9, "{plane:?}");
        }
    }

    #[test]
    fn a_skirting_is_not_its_wall_and_crumbs_are_nothing() {
        let mut soup = Soup::room([6.0, 3.0, 5.0], 1);
        soup.quad([[0.0, 0.0, 0.012], [6.0, 0.0, 0.012], [6.0, 0.1, 0.012], [0.0, 0.1, 0.012]]);
        soup.quad([[2.0, 1.0, 1.0], [2.1, 1.0, 1.0], [2.1, 1.1, 1.3], [2.0, 1.1, 1.3]]);
        let planes = planes_of(&soup);
        assert_eq!(planes.planes.len(), 7);
        assert_eq!(planes.of(12), planes.of(13));
        assert!(
            (planes.plane(planes.of(12).expect("0.6 m2")).height_m(&[1.0, 1.0, 0.012].into())).abs() < 1e-5
        );
        assert_eq!(planes.of(14), None);
    }

    #[test]
    fn broken_triangles_lie_in_no_plane() {
        let mut soup = Soup::room([2.0, 2.0, 2.0], 1);
        soup.quad([[f32::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, f32::INFINITY]]);
        soup.quad([[1.0; 3]; 4]);
        let planes = planes_of(&soup);
        assert_eq!(planes.planes.len(), 6);
        assert!((12..16).all(|triangle| planes.of(triangle).is_none()));
    }
}
