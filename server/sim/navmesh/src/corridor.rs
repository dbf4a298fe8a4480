//! Detour's path: the best polygon chain by portal middles (`dtNavMeshQuery::findPath`), and the string
//! pulled tight through it (`findStraightPath`).

use crate::plane::{Lattice, LatticePoint, share_of_segment, turn};
use crate::polygons::{NONE, Polygons};
use crate::route::{QueueEntry, steps_to};
use crate::sight::Eye;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

// Detour scales the straight distance so that the estimate stays a lower bound.
const HEURISTIC: f64 = 0.999;
// Detour skips a first portal this close to the start, metres.
const AT_PORTAL_M: f64 = 0.001;
// Detour merges positions within this distance, metres.
const SAME_M: f64 = 1.0 / 16384.0;

/// Returns the length in metres of Detour's path between mesh points, drawn between `start` and `end` above
/// or below them. `None` without a path.
pub(crate) fn corridor_m(
    polygons: &Polygons,
    lattice: &Lattice,
    [from, to]: [Eye; 2],
    [start, end]: [LatticePoint; 2],
) -> Option<f64> {
    let chain = CorridorSearch::new(polygons, lattice, to).run(from)?;
    let points = Pull { polygons, lattice, portals: &chain, end }.points(start);
    Some(points.windows(2).map(|leg| lattice.apart_m(&leg[0], &leg[1])).sum())
}

#[derive(Clone, Copy)]
struct Node {
    place: LatticePoint,
    cost_m: f64,
    total_m: f64,
    /// Entry portal, as an edge of the previous polygon.
    portal: u32,
}

struct CorridorSearch<'a> {
    polygons: &'a Polygons,
    lattice: &'a Lattice,
    goal: Eye,
    nodes: Vec<Option<Node>>,
    waiting: BinaryHeap<Reverse<QueueEntry>>,
}

impl<'a> CorridorSearch<'a> {
    fn new(polygons: &'a Polygons, lattice: &'a Lattice, goal: Eye) -> Self {
        let nodes = vec![None; polygons.len() as usize];
        Self { polygons, lattice, goal, nodes, waiting: BinaryHeap::new() }
    }

    fn run(mut self, from: Eye) -> Option<Vec<u32>> {
        let total_m = HEURISTIC * self.lattice.apart_m(&from.place, &self.goal.place);
        self.nodes[from.polygon as usize] =
            Some(Node { place: from.place, cost_m: 0.0, total_m, portal: NONE });
        self.waiting.push(Reverse(QueueEntry { metres: total_m, number: from.polygon }));
        while let Some(Reverse(QueueEntry { metres: total_m, number: polygon })) = self.waiting.pop() {
            let node = self.nodes[polygon as usize]?;
            if total_m > node.total_m {
                continue;
            }
            if polygon == self.goal.polygon {
                return Some(self.portals(polygon));
            }
            self.expand(polygon, &node);
        }
        None
    }

    fn expand(&mut self, polygon: u32, node: &Node) {
        let edges = self.polygons.edges(polygon);
        let before = (node.portal != NONE).then(|| self.polygons.owner(node.portal));
        // Outlines have the opposite direction in Detour, which starts with the last edge. Among equal costs
        // the first edge wins, so the order decides the path.
        for edge in (edges.start..edges.end - 1).rev().chain([edges.end - 1]) {
            let Some(neighbour) = self.polygons.neighbour(edge).filter(|&next| Some(next) != before) else {
                continue;
            };
            let known = self.nodes[neighbour as usize];
            let place = known.map_or_else(|| self.middle(edge), |known| known.place);
            let mut cost_m = node.cost_m + self.lattice.apart_m(&node.place, &place);
            let left_m = self.lattice.apart_m(&place, &self.goal.place);
            let total_m = if neighbour == self.goal.polygon {
                cost_m += left_m;
                cost_m
            } else {
                cost_m + HEURISTIC * left_m
            };
            if known.is_none_or(|known| total_m < known.total_m) {
                self.nodes[neighbour as usize] = Some(Node { place, cost_m, total_m, portal: edge });
                self.waiting.push(Reverse(QueueEntry { metres: total_m, number: neighbour }));
            }
        }
    }

    fn middle(&self, edge: u32) -> LatticePoint {
        let (a, b) = (self.polygons.corner(edge), self.polygons.corner(self.polygons.next(edge)));
        LatticePoint { spot: a.spot + (b.spot - a.spot) * 0.5, height_m: 0.5 * (a.height_m + b.height_m) }
    }

    fn portals(&self, last: u32) -> Vec<u32> {
        let entered = |polygon: u32| self.nodes[polygon as usize].map_or(NONE, |node| node.portal);
        steps_to(entered(last), |portal| entered(self.polygons.owner(portal)))
    }
}
#[derive(Clone, Copy)]
struct Side {
    tip: LatticePoint,
    portal: usize,
}

/// The string through a portal chain (Mononen 2010, simple stupid funnel).
struct Pull<'a> {
    polygons: &'a Polygons,
    lattice: &'a Lattice,
    portals: &'a [u32],
    end: LatticePoint,
}

impl Pull<'_> {
    fn points(&self, start: LatticePoint) -> Vec<LatticePoint> {
        let mut points = vec![start];
        let (mut apex, mut right, mut left) =
            (start, Side { tip: start, portal: 0 }, Side { tip: start, portal: 0 });
        let mut at = 0;
        while at <= self.portals.len() {
            let (next_right, next_left) = self.portal(at);
            if at == 0 && !self.portals.is_empty() && self.stands_at(&start, &next_right, &next_left) {
                at += 1;
                continue;
            }
            let corner = match self.narrow(&apex, &mut right, &left, next_right, at, 1.0) {
                Some(corner) => Some(corner),
                None => self.narrow(&apex, &mut left, &right, next_left, at, -1.0),
            };
            if let Some(corner) = corner {
                apex = corner.tip;
                self.append(&mut points, apex);
                (right, left, at) = (corner, corner, corner.portal);
            }
            at += 1;
        }
        self.append(&mut points, self.end);
        points
    }

    /// Right and left end; the path's end follows the last portal.
    fn portal(&self, at: usize) -> (LatticePoint, LatticePoint) {
        match self.portals.get(at) {
            Some(&edge) => (self.polygons.corner(edge), self.polygons.corner(self.polygons.next(edge))),
            None => (self.end, self.end),
        }
    }

    fn stands_at(&self, start: &LatticePoint, right: &LatticePoint, left: &LatticePoint) -> bool {
        let share = share_of_segment(&start.spot, &left.spot, &right.spot);
        let nearest = left.spot + (right.spot - left.spot) * share;
        (nearest - start.spot).norm() * f64::from(self.lattice.cell_m) < AT_PORTAL_M
    }

    /// Moves `side` to `next` if that narrows the funnel; returns `other` if `next` is beyond it. `sign` is 1
    /// for the right side, -1 for the left.
    fn narrow(
        &self,
        apex: &LatticePoint,
        side: &mut Side,
        other: &Side,
        next: LatticePoint,
        at: usize,
        sign: f64,
    ) -> Option<Side> {
        if sign * turn(&apex.spot, &side.tip.spot, &next.spot) < 0.0 {
            return None;
        }
        let beyond = sign * turn(&apex.spot, &other.tip.spot, &next.spot) >= 0.0;
        if beyond && !self.same(apex, &side.tip) {
            return Some(*other);
        }
        *side = Side { tip: next, portal: at };
        None
    }

    fn same(&self, a: &LatticePoint, b: &LatticePoint) -> bool {
        self.lattice.apart_m(a, b) < SAME_M
    }

    fn append(&self, points: &mut Vec<LatticePoint>, point: LatticePoint) {
        if points.last().is_none_or(|last| !self.same(last, &point)) {
            points.push(point);
        }
    }
}
