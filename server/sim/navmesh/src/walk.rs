use crate::plane::{Offset, nearest_on_segment};
use crate::polygons::Polygons;
use crate::sight::{Eye, polygons_around};

/// How often a step is turned along another wall before it ends.
const MAX_TURNS: usize = 8;
/// Directions are parallel to a wall when they leave it by less than this part of their length.
const PARALLEL: f64 = 1e-9;
/// A way this short is none, cells.
const STUCK_CELLS: f64 = 1e-6;

/// Where a step ends, and whether a wall took something of it.
pub(crate) struct Walked {
    pub(crate) end: Eye,
    pub(crate) blocked: bool,
}

/// Walks `offset` from `start` along the polygons; at a wall the rest of the way is projected on the wall.
pub(crate) fn walk(polygons: &Polygons, start: &Eye, offset: &Offset) -> Walked {
    let (mut end, mut rest, mut blocked) = (*start, *offset, false);
    for _ in 0..MAX_TURNS {
        let Some(wall) = straight(polygons, &mut end, &mut rest) else { break };
        blocked = true;
        let along = polygons.to(wall) - polygons.from(wall);
        rest = along * (rest.dot(&along) / along.norm_squared());
    }
    Walked { end, blocked }
}

/// Moves `at` by `rest` or up to the first wall, which is returned; `rest` is what could not be walked.
fn straight(polygons: &Polygons, at: &mut Eye, rest: &mut Offset) -> Option<u32> {
    // Every portal is crossed in the direction of the step, so none is crossed twice: this loop ends.
    for _ in 0..polygons.len().saturating_add(1) {
        let Some((edge, share)) = exit(polygons, at, rest) else {
            at.spot += *rest;
            return None;
        };
        if let Some(neighbour) = polygons.neighbour(edge) {
            advance(polygons, at, rest, edge, share);
            at.polygon = neighbour;
            continue;
        }
        let Some(around) = around_corner(polygons, at, rest, share) else {
            advance(polygons, at, rest, edge, share);
            return Some(edge);
        };
        at.polygon = around.polygon;
        if around.wall.is_some() {
            return around.wall;
        }
    }
    None
}

fn advance(polygons: &Polygons, at: &mut Eye, rest: &mut Offset, edge: u32, share: f64) {
    let crossing = at.spot + *rest * share;
    at.spot = nearest_on_segment(&crossing, polygons.from(edge), polygons.to(edge));
    *rest *= 1.0 - share;
}

/// Where to go on from a corner.
struct Around {
    polygon: u32,
    /// The wall to go along; `None` where the way is open.
    wall: Option<u32>,
}

/// Standing on a corner before a wall: of all polygons there the one that the way `rest` leads into, or else the one
/// whose wall takes least of it. `None` when the wall is farther than that.
fn around_corner(polygons: &Polygons, at: &Eye, rest: &Offset, share: f64) -> Option<Around> {
    let is_stuck = |share: f64| share * rest.norm() < STUCK_CELLS;
    if !is_stuck(share) {
        return None;
    }
    let mut best: Option<(f64, Around)> = None;
    for polygon in polygons_around(polygons, at) {
        let there = Eye { spot: at.spot, polygon };
        let Some((wall, _)) = exit(polygons, &there, rest).filter(|exit| is_stuck(exit.1)) else {
            return Some(Around { polygon, wall: None });
        };
        let along = (polygons.to(wall) - polygons.from(wall)).normalize();
        let kept = along.dot(rest).abs();
        if polygons.twin(wall).is_none() && best.as_ref().is_none_or(|(most, _)| kept > *most) {
            best = Some((kept, Around { polygon, wall: Some(wall) }));
        }
    }
    best.map(|(_, around)| around)
}

/// The edge through which the way `rest` leaves the polygon of `at`, and the share of `rest` walked until there.
fn exit(polygons: &Polygons, at: &Eye, rest: &Offset) -> Option<(u32, f64)> {
    let length = rest.norm();
    let mut best: Option<(f64, u32, f64)> = None;
    for edge in polygons.edges(at.polygon) {
        let (a, b) = (polygons.from(edge), polygons.to(edge));
        let along = b - a;
        // Positive when the way leads out, the floor being on the left of the edge.
        let outwards = rest.perp(&along);
        if outwards <= PARALLEL * length * along.norm() {
            continue;
        }
        let share = ((a - at.spot).perp(&along) / outwards).max(0.0);
        if share >= 1.0 {
            continue;
        }
        let crossing = at.spot + rest * share;
        let miss = (nearest_on_segment(&crossing, a, b) - crossing).norm();
        // Where edges lie on one line or meet in the crossing, the one that is really hit counts, portals first.
        let wall = if polygons.twin(edge).is_none() { PARALLEL } else { 0.0 };
        let cost = share * length + miss + wall;
        if best.is_none_or(|(least, ..)| cost < least) {
            best = Some((cost, edge, share));
        }
    }
    best.map(|(_, edge, share)| (edge, share))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane::Spot;
    use crate::polygons::tests::letter_l;

    fn assert_step(from: (f64, f64, u32), by: (f64, f64), to: (f64, f64, u32), blocked: bool) {
        let start = Eye { spot: Spot::new(from.0, from.1), polygon: from.2 };
        let walked = walk(&letter_l(), &start, &Offset::new(by.0, by.1));
        let spot = walked.end.spot;
        assert!((spot - Spot::new(to.0, to.1)).norm() < 1e-12, "{from:?} by {by:?} ends at {spot}");
        assert_eq!((walked.end.polygon, walked.blocked), (to.2, blocked), "{from:?} by {by:?}");
    }

    #[test]
    fn free_steps_cross_portals() {
        assert_step((5.0, 5.0, 0), (10.0, 2.0), (15.0, 7.0, 2), false);
        assert_step((5.0, 5.0, 3), (1.0, 2.0), (6.0, 7.0, 3), false);
    }

    #[test]
    fn walls_leave_the_part_along_them() {
        assert_step((5.0, 5.0, 0), (3.0, -9.0), (8.0, 0.0, 0), true);
        // From one wall into the next: the step ends in the room's corner.
        assert_step((15.0, 5.0, 2), (9.0, -9.0), (20.0, 0.0, 2), true);
        // Along a wall and past its end, the inner corner of the L.
        assert_step((18.0, 9.0, 2), (-12.0, 3.0), (6.0, 10.0, 0), true);
    }

    #[test]
    fn standing_on_a_wall_one_walks_along_it_and_away() {
        assert_step((3.0, 0.0, 0), (15.0, 0.0), (18.0, 0.0, 2), false);
        assert_step((3.0, 0.0, 0), (0.0, 4.0), (3.0, 4.0, 0), false);
        assert_step((0.0, 0.0, 0), (-1.0, -1.0), (0.0, 0.0, 0), true);
        assert_step((3.0, 3.0, 0), (0.0, 0.0), (3.0, 3.0, 0), false);
    }

    #[test]
    fn standing_on_a_corner_one_leaves_it_every_way_that_is_open() {
        for polygon in [0, 1, 2] {
            assert_step((10.0, 10.0, polygon), (8.0, -1.0), (18.0, 9.0, 2), false);
            assert_step((10.0, 10.0, polygon), (-1.0, 8.0), (9.0, 18.0, 1), false);
            assert_step((10.0, 10.0, polygon), (-3.0, -5.0), (7.0, 5.0, 0), false);
            assert_step((10.0, 10.0, polygon), (5.0, 0.0), (15.0, 10.0, 2), false);
        }
    }
}
