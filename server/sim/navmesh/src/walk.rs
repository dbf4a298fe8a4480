//! Steps with sliding, as in `dtNavMeshQuery::moveAlongSurface`: the nearest reachable point to the target.

use crate::plane::{Spot, nearest_on_segment, turn};
use crate::polygons::Polygons;
use std::collections::VecDeque;

// Rounding moves ends by less than this, cells (5 micrometres).
const SAME_CELLS: f64 = 1e-4;
// Directions with a smaller cross product are parallel, cells squared.
const PARALLEL: f64 = 1e-9;

pub(crate) struct Step {
    pub(crate) start: Spot,
    pub(crate) polygon: u32,
    pub(crate) target: Spot,
    /// Portal search radius around the step centre, cells.
    pub(crate) reach_cells: f64,
    /// False ends the step at the first wall.
    pub(crate) slides: bool,
}

pub(crate) struct Walked {
    pub(crate) end: Spot,
    pub(crate) polygon: u32,
    pub(crate) blocked: bool,
}

/// Takes a step; `None` without a reachable end.
pub(crate) fn walk(polygons: &Polygons, step: &Step) -> Option<Walked> {
    let middle = step.start + (step.target - step.start) * 0.5;
    let mut seen = vec![step.polygon];
    let mut queue = VecDeque::from([step.polygon]);
    let mut best = None;
    let mut least = f64::INFINITY;
    while let Some(polygon) = queue.pop_front() {
        if holds(polygons, polygon, &step.target) {
            return Some(Walked { end: step.target, polygon, blocked: false });
        }
        // Outlines have the opposite direction in Detour; among equal points the first counts.
        for edge in polygons.edges(polygon).rev() {
            let (from, to) = (polygons.from(edge), polygons.to(edge));
            if let Some(neighbour) = polygons.neighbour(edge) {
                let gap = (nearest_on_segment(&middle, from, to) - middle).norm();
                let passes = step.slides || crossing(step, from, to).is_some();
                if gap <= step.reach_cells && passes && !seen.contains(&neighbour) {
                    seen.push(neighbour);
                    queue.push_back(neighbour);
                }
                continue;
            }
            let end = if step.slides {
                Some(nearest_on_segment(&step.target, from, to))
            } else {
                crossing(step, from, to)
            };
            if let Some(end) = end {
                let gap = (end - step.target).norm_squared();
                if best.is_none() || gap < least {
                    least = gap;
                    best = Some(Walked { end, polygon, blocked: gap > SAME_CELLS * SAME_CELLS });
                }
            }
        }
    }
    best
}

/// Returns the step's intersection with a segment.
fn crossing(step: &Step, from: &Spot, to: &Spot) -> Option<Spot> {
    let (along, way) = (to - from, step.target - step.start);
    let cross = along.perp(&way);
    if cross.abs() < PARALLEL {
        return None;
    }
    let offset = step.start - from;
    let (share, passed) = (offset.perp(&way) / cross, offset.perp(&along) / cross);
    let meets = (0.0..=1.0).contains(&share) && (0.0..=1.0).contains(&passed);
    meets.then(|| from + along * share)
}

fn holds(polygons: &Polygons, polygon: u32, spot: &Spot) -> bool {
    polygons.edges(polygon).all(|edge| turn(polygons.from(edge), polygons.to(edge), spot) >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::letter_l;
    use avln_geom::Vector2;

    fn step(from: (f64, f64, u32), by: (f64, f64), slides: bool) -> Option<Walked> {
        let (start, polygon) = (Spot::new(from.0, from.1), from.2);
        let offset = Vector2::new(by.0, by.1);
        let reach_cells = 0.5 * offset.norm() + 0.02;
        walk(&letter_l(), &Step { start, polygon, target: start + offset, reach_cells, slides })
    }

    fn assert_step(from: (f64, f64, u32), by: (f64, f64), to: (f64, f64, u32), blocked: bool) {
        let walked = step(from, by, true).expect("an end");
        let spot = walked.end;
        assert!((spot - Spot::new(to.0, to.1)).norm() < 1e-12, "{from:?} by {by:?} ends at {spot}");
        assert_eq!((walked.polygon, walked.blocked), (to.2, blocked), "{from:?} by {by:?}");
    }

    #[test]
    fn free_steps_cross_portals() {
        assert_step((5.0, 5.0, 0), (10.0, 2.0), (15.0, 7.0, 2), false);
        assert_step((5.0, 5.0, 3), (1.0, 2.0), (6.0, 7.0, 3), false);
    }

    #[test]
    fn walls_deflect_steps_sideways() {
        assert_step((5.0, 5.0, 0), (3.0, -9.0), (8.0, 0.0, 0), true);
        // Two walls in a row: the step ends in the room corner.
        assert_step((15.0, 5.0, 2), (9.0, -9.0), (20.0, 0.0, 2), true);
        // Past the end of a wall, the inner corner of the L.
        assert_step((18.0, 9.0, 2), (-12.0, 3.0), (6.0, 12.0, 1), false);
    }

    #[test]
    fn steps_from_a_wall_follow_or_leave_it() {
        assert_step((3.0, 0.0, 0), (15.0, 0.0), (18.0, 0.0, 2), false);
        assert_step((3.0, 0.0, 0), (0.0, 4.0), (3.0, 4.0, 0), false);
        assert_step((0.0, 0.0, 0), (-1.0, -1.0), (0.0, 0.0, 0), true);
        assert_step((3.0, 3.0, 0), (0.0, 0.0), (3.0, 3.0, 0), false);
    }

    #[test]
    fn steps_without_sliding_end_at_the_wall() {
        let at_wall = step((5.0, 5.0, 0), (4.0, -8.0), false).expect("an end");
        assert!((at_wall.end - Spot::new(7.5, 0.0)).norm() < 1e-12 && at_wall.blocked);
        let free = step((5.0, 5.0, 0), (10.0, 2.0), false).expect("an end");
        assert!(free.end == Spot::new(15.0, 7.0) && !free.blocked);
        // Out through a wall and in through another is not a path.
        let out = step((18.0, 9.0, 2), (-12.0, 5.0), false).expect("an end");
        assert!((out.end - Spot::new(15.6, 10.0)).norm() < 1e-12 && out.blocked);
    }

    #[test]
    fn steps_off_the_mesh_have_no_end() {
        let (start, target) = (Spot::new(5.0, -5.0), Spot::new(5.0, -6.0));
        let step = Step { start, polygon: 0, target, reach_cells: 1.0, slides: false };
        assert!(walk(&letter_l(), &step).is_none());
    }
}
