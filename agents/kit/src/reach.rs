//! Walking distances from the body over the known floor.

use crate::geometry::FloorPoint;
use crate::map::occupancy::{Cell, Occupancy};
use crate::path::{Nodes, OpenCells, SIDES, STRIDE, step_cost_m};

/// Costs of the cheapest paths from one place to all reachable cells: one search instead of a path per destination.
pub struct ReachField {
    nodes: Nodes,
}

impl ReachField {
    /// Computes the costs from `from` over known floor; with `through_unknown` also through unseen cells within `most_m`.
    pub fn new(map: &Occupancy, from: FloorPoint, most_m: f32, through_unknown: bool) -> Self {
        let start = Cell::at(from);
        let mut nodes = Nodes::new();
        nodes.improve(start, f32::MIN_POSITIVE, 0);
        let mut open = OpenCells::new(0.0, start);
        while let Some(cell) = open.pop() {
            let Some(cost_m) = nodes.close(cell) else { continue };
            if cost_m > most_m {
                break;
            }
            for (side, (dc, dr)) in SIDES.into_iter().enumerate() {
                let next = cell.moved(dc * STRIDE, dr * STRIDE);
                if !through_unknown && map.is_unknown(next) {
                    continue;
                }
                let Some(step_m) = step_cost_m(map, cell, next, from) else { continue };
                let total_m = cost_m + step_m;
                if nodes.improve(next, total_m, side) {
                    open.push(total_m, next);
                }
            }
        }
        Self { nodes }
    }

    /// Returns the cost to a point, metres on open floor; `None` for an unreachable point.
    pub fn cost_m(&self, place: FloorPoint) -> Option<f32> {
        Some(self.nodes.cost_m(Cell::at(place))).filter(|cost_m| *cost_m > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::find_path;

    const FAR_M: f32 = 100.0;

    fn room() -> Occupancy {
        Occupancy::default()
            .with_floor(FloorPoint::new(-3.0, -3.0), FloorPoint::new(3.0, 3.0))
            .with_wall(FloorPoint::new(0.0, -2.0), FloorPoint::new(0.1, 9.0))
    }

    #[test]
    fn costs_equal_those_of_paths() {
        let (map, from) = (room(), FloorPoint::new(-1.0, 1.0));
        let field = ReachField::new(&map, from, FAR_M, false);
        for goal in [FloorPoint::new(1.0, 1.0), FloorPoint::new(-2.0, -2.0), FloorPoint::new(2.0, -1.0)] {
            let path = find_path(&map, from, goal, 0.1);
            let cost_m = field.cost_m(goal).unwrap();
            assert!((cost_m - path.cost_m).abs() < 0.25, "{cost_m} {}", path.cost_m);
        }
    }

    #[test]
    fn closed_rooms_are_unreachable() {
        let map = room().with_wall(FloorPoint::new(0.0, -4.0), FloorPoint::new(0.1, -2.0));
        let beyond = FloorPoint::new(1.0, 1.0);
        let from = FloorPoint::new(-1.0, 1.0);
        assert_eq!(ReachField::new(&map, from, FAR_M, false).cost_m(beyond), None);
        assert!(ReachField::new(&map, from, FAR_M, true).cost_m(beyond).is_some(), "around the outside");
        assert_eq!(ReachField::new(&map, from, FAR_M, false).cost_m(FloorPoint::new(-5.0, 0.0)), None);
    }
}
