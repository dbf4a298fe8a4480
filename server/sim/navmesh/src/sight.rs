//! Straight visibility: the view is clipped at every portal (triangular expansion, Bungiu and others 2014),
//! so it follows the floor and never mixes storeys.

use crate::plane::{LatticePoint, Spot, nearest_on_segment, turn};
use crate::polygons::Polygons;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::letter_l;

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
}
