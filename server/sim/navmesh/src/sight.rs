//! Straight visibility, and the bends of shortest paths with their straight connections. The view is clipped at every portal
//! (triangular expansion, Bungiu and others 2014), so it follows the floor and never mixes storeys.

use crate::plane::{Lattice, LatticePoint, Spot, nearest_on_segment, turn};
use crate::polygons::{NONE, Polygons};
use std::ops::Range;

// A spot this close to a portal is on both sides, cells (5 nm).
const ON_EDGE_CELLS: f64 = 1e-7;
// Tolerance in cells squared: the end of a wall seen lengthwise stays visible despite rounding. Between
// lattice corners all values are integers and the test is exact.
const SLACK: f64 = 1e-7;
// Narrower views are rounding remainders, cells squared.
const NARROWEST: f64 = 1e-9;

/// A position on the mesh to look from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Eye {
    pub(crate) place: LatticePoint,
    pub(crate) polygon: u32,
}

/// The visible part: the whole polygon, or the part between two rays.
#[derive(Clone, Copy)]
pub(crate) enum VisiblePart {
    Whole,
    Between { eye: Spot, right: Spot, left: Spot },
}

impl VisiblePart {
    pub(crate) fn holds(&self, spot: &Spot) -> bool {
        match self {
            Self::Whole => true,
            Self::Between { eye, right, left } => {
                turn(eye, right, spot) >= -SLACK && turn(eye, left, spot) <= SLACK
            }
        }
    }
}
struct Beam {
    /// Portal, as an edge of the entered polygon.
    entry: u32,
    right: Spot,
    left: Spot,
}

/// Calls `see` for every visible polygon, once per portal path.
pub(crate) fn look(polygons: &Polygons, eye: &Eye, mut see: impl FnMut(u32, &VisiblePart)) {
    let around = polygons_around(polygons, eye);
    let spot = &eye.place.spot;
    let mut beams = Vec::new();
    for &polygon in &around {
        see(polygon, &VisiblePart::Whole);
        for edge in polygons.edges(polygon) {
            let (right, left) = (*polygons.from(edge), *polygons.to(edge));
            if let Some(entry) = polygons.twin(edge)
                && !around.contains(&polygons.owner(entry))
                && turn(spot, &right, &left) > NARROWEST
            {
                beams.push(Beam { entry, right, left });
            }
        }
    }
    while let Some(Beam { entry, right, left }) = beams.pop() {
        see(polygons.owner(entry), &VisiblePart::Between { eye: *spot, right, left });
        spread(polygons, spot, &Beam { entry, right, left }, &mut beams);
    }
}

fn spread(polygons: &Polygons, eye: &Spot, beam: &Beam, beams: &mut Vec<Beam>) {
    let mut edge = polygons.next(beam.entry);
    while edge != beam.entry {
        let following = polygons.next(edge);
        if let Some(entry) = polygons.twin(edge) {
            let (from, to) = (polygons.from(edge), polygons.from(following));
            let right = if turn(eye, &beam.right, from) > 0.0 { *from } else { beam.right };
            let left = if turn(eye, &beam.left, to) < 0.0 { *to } else { beam.left };
            if turn(eye, &right, &left) > NARROWEST {
                beams.push(Beam { entry, right, left });
            }
        }
        edge = following;
    }
}

/// Returns the polygon of `eye`, then the others that touch it at a portal or corner.
fn polygons_around(polygons: &Polygons, eye: &Eye) -> Vec<u32> {
    let mut around = vec![eye.polygon];
    let mut next = 0;
    while let Some(&polygon) = around.get(next) {
        next += 1;
        for edge in polygons.edges(polygon) {
            let Some(neighbour) = polygons.neighbour(edge) else { continue };
            let spot = &eye.place.spot;
            let gap = nearest_on_segment(spot, polygons.from(edge), polygons.to(edge)) - spot;
            if gap.norm_squared() <= ON_EDGE_CELLS * ON_EDGE_CELLS && !around.contains(&neighbour) {
                around.push(neighbour);
            }
        }
    }
    around
}

// Largest turn of an exact tangent by rounding, cells squared.
const TANGENT_SLACK: f64 = 1e-7;

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
        !(before > TANGENT_SLACK && after < -TANGENT_SLACK
            || before < -TANGENT_SLACK && after > TANGENT_SLACK)
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

    fn sees(eye: (f64, f64, u32), target: (f64, f64, u32)) -> bool {
        let place = LatticePoint { spot: Spot::new(eye.0, eye.1), height_m: 0.0 };
        let eye = Eye { place, polygon: eye.2 };
        let mut seen = false;
        look(&letter_l(), &eye, |polygon, view| {
            seen |= polygon == target.2 && view.holds(&Spot::new(target.0, target.1));
        });
        seen
    }

    #[test]
    fn inner_corner_of_an_l_hides_floor() {
        // The corner is at (10, 10): visible from (5, 15), and nothing beyond it on the diagonal.
        assert!(sees((5.0, 15.0, 1), (10.0, 10.0, 2)));
        assert!(sees((5.0, 15.0, 1), (14.0, 6.0, 2)));
        assert!(!sees((5.0, 15.0, 1), (14.1, 6.0, 2)));
        assert!(sees((14.0, 6.0, 2), (5.0, 15.0, 1)));
        assert!(!sees((14.1, 6.0, 2), (5.0, 15.0, 1)));
    }

    #[test]
    fn walls_are_visible_lengthwise_and_storeys_hidden() {
        assert!(sees((0.0, 0.0, 0), (20.0, 0.0, 2)));
        assert!(sees((10.0, 5.0, 0), (20.0, 10.0, 2)));
        assert!(sees((10.0, 10.0, 1), (20.0, 10.0, 2)));
        assert!(!sees((5.0, 5.0, 0), (5.0, 5.0, 3)));
        assert!(sees((5.0, 5.0, 3), (1.0, 1.0, 3)));
    }

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
