//! Bends of shortest paths, and their straight connections.

use crate::plane::{Lattice, LatticePoint, Spot, turn};
use crate::polygons::{NONE, Polygons};
use crate::sight::{Eye, VisiblePart, look};
use std::ops::Range;

// Largest turn of an exact tangent by rounding, cells squared.
const SLACK: f64 = 1e-7;

/// The bends on shortest paths, and their straight connections.
///
/// A shortest path bends only at convex wall corners (Lozano-Pérez and Wesley 1979).
pub(crate) struct Corners {
    lattice: Lattice,
    corners: Vec<WallCorner>,
    /// Corner by edge start; `NONE` for other corners.
    at_edge: Vec<u32>,
    first_link: Vec<u32>,
    links: Vec<Link>,
}

#[derive(Clone, Copy)]
pub(crate) struct WallCorner {
    pub(crate) eye: Eye,
    /// Wall ends before and after the corner; the floor is on the left.
    before: Spot,
    after: Spot,
}

/// A straight path to a corner.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Link {
    pub(crate) to: u32,
    pub(crate) metres: f64,
}

impl WallCorner {
    /// Returns true if a path from `spot` can bend here: both walls on one side.
    fn is_tangent(&self, spot: &Spot) -> bool {
        let before = turn(spot, &self.eye.place.spot, &self.before);
        let after = turn(spot, &self.eye.place.spot, &self.after);
        !(before > SLACK && after < -SLACK || before < -SLACK && after > SLACK)
    }
}

impl Corners {
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.corners.as_slice())
            + size_of_val(self.at_edge.as_slice())
            + size_of_val(self.first_link.as_slice())
            + size_of_val(self.links.as_slice())
    }

    /// Finds the corners; `height_m` maps an edge to the ground height at the start.
    pub(crate) fn new(polygons: &Polygons, lattice: Lattice, height_m: impl Fn(u32) -> f64) -> Self {
        let (corners, at_edge) = find(polygons, height_m);
        let mut found = Self { lattice, corners, at_edge, first_link: vec![0], links: Vec::new() };
        for id in 0..found.corners.len() as u32 {
            let links = found.links_of(polygons, id);
            found.links.extend(links);
            found.first_link.push(found.links.len() as u32);
        }
        found
    }

    pub(crate) fn len(&self) -> usize {
        self.corners.len()
    }

    pub(crate) fn get(&self, corner: u32) -> &WallCorner {
        &self.corners[corner as usize]
    }

    pub(crate) fn links(&self, corner: u32) -> &[Link] {
        let range = |index: usize| self.first_link[index] as usize;
        &self.links[range(corner as usize)..range(corner as usize + 1)]
    }

    pub(crate) fn metres_to(&self, corner: u32, place: &LatticePoint) -> f64 {
        self.lattice.apart_m(&self.get(corner).eye.place, place)
    }

    /// Calls `found` for visible, useful corners among the `edges` of a polygon.
    pub(crate) fn in_view(
        &self,
        edges: Range<u32>,
        view: &VisiblePart,
        place: &LatticePoint,
        mut found: impl FnMut(Link),
    ) {
        for &to in &self.at_edge[edges.start as usize..edges.end as usize] {
            if to == NONE {
                continue;
            }
            let corner = &self.corners[to as usize];
            if view.holds(&corner.eye.place.spot) && corner.is_tangent(&place.spot) {
                found(Link { to, metres: self.metres_to(to, place) });
            }
        }
    }

    fn links_of(&self, polygons: &Polygons, id: u32) -> Vec<Link> {
        let corner = self.corners[id as usize];
        let mut links = Vec::new();
        look(polygons, &corner.eye, |polygon, view| {
            self.in_view(polygons.edges(polygon), view, &corner.eye.place, |link| {
                let other = self.corners[link.to as usize].eye.place.spot;
                if other != corner.eye.place.spot && corner.is_tangent(&other) {
                    links.push(link);
                }
            });
        });
        links.sort_unstable_by_key(|link| link.to);
        links.dedup();
        links
    }
}

/// Returns the wall ends with a right turn into the next wall.
fn find(polygons: &Polygons, height_m: impl Fn(u32) -> f64) -> (Vec<WallCorner>, Vec<u32>) {
    let edges = 0..polygons.edges(polygons.len() - 1).end;
    let mut at_edge = vec![NONE; edges.len()];
    let mut corners = Vec::new();
    for wall in edges.filter(|&edge| polygons.twin(edge).is_none()) {
        let fan = fan(polygons, wall);
        let leaving = fan[fan.len() - 1];
        let spot = *polygons.to(wall);
        let (before, after) = (*polygons.from(wall), *polygons.to(leaving));
        let side = turn(&before, &spot, &after);
        // A path bends around the end of a wall without thickness too.
        let is_dead_end = side == 0.0 && (after - spot).dot(&(spot - before)) < 0.0;
        if side < 0.0 || is_dead_end {
            fan.iter().for_each(|&edge| at_edge[edge as usize] = corners.len() as u32);
            let place = LatticePoint { spot, height_m: height_m(leaving) };
            let eye = Eye { place, polygon: polygons.owner(leaving) };
            corners.push(WallCorner { eye, before, after });
        }
    }
    (corners, at_edge)
}

/// Returns the edges that leave the end of `wall`, up to the next wall.
fn fan(polygons: &Polygons, wall: u32) -> Vec<u32> {
    let mut fan = vec![polygons.next(wall)];
    while let Some(twin) = polygons.twin(fan[fan.len() - 1]) {
        fan.push(polygons.next(twin));
    }
    fan
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::letter_l;
    use avln_geom::Point3;

    #[test]
    fn l_shape_has_one_bend() {
        let polygons = letter_l();
        let lattice = Lattice { origin: Point3::origin(), cell_m: 0.5, level_m: 0.2 };
        let corners = Corners::new(&polygons, lattice, |_| 3.0);
        assert_eq!(corners.len(), 1);
        let place = LatticePoint { spot: Spot::new(2.0, 10.0), height_m: 0.0 };
        assert_eq!(corners.metres_to(0, &place), 5.0);
        assert_eq!(corners.get(0).eye.place.spot, Spot::new(10.0, 10.0));
        assert!(corners.links(0).is_empty());
        // From (2, 18) a path may continue behind the corner; from (5, 5) it would run into the wall.
        assert!(corners.get(0).is_tangent(&Spot::new(2.0, 18.0)));
        assert!(!corners.get(0).is_tangent(&Spot::new(5.0, 5.0)));
    }
}
