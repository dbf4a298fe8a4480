//! The path that Detour finds: the best chain of polygons by the middles of their portals (`dtNavMeshQuery::findPath`),
//! and the string pulled tight through it (`findStraightPath`).

use crate::plane::{Lattice, share_of_segment, turn};
use crate::polygons::{NONE, PolygonCorner, Polygons};
use crate::route::QueueEntry;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Detour's factor on the remaining straight distance, so that the estimate is a lower bound.
const HEURISTIC: f64 = 0.999;
/// A first portal this close to the start is passed, metres.
const AT_PORTAL_M: f64 = 0.001;
/// Positions within this distance are equal, metres.
const SAME_M: f64 = 1.0 / 16384.0;

/// An end of a path and its polygon.
#[derive(Clone, Copy)]
pub(crate) struct CorridorEnd {
    pub(crate) place: PolygonCorner,
    pub(crate) polygon: u32,
}

/// Length of Detour's path, metres: from `from` to `to` on the mesh, drawn between `start` and `end`, which
/// may be above or below. `None` without a path.
pub(crate) fn corridor_m(
    polygons: &Polygons,
    lattice: &Lattice,
    [from, to]: [CorridorEnd; 2],
    [start, end]: [PolygonCorner; 2],
) -> Option<f64> {
    let chain = CorridorSearch::new(polygons, lattice, to).run(from)?;
    let points = Pull { polygons, lattice, portals: &chain, end }.points(start);
    let length = |leg: &[PolygonCorner]| apart_m(lattice, &leg[0], &leg[1]);
    Some(points.windows(2).map(length).sum())
}

fn apart_m(lattice: &Lattice, a: &PolygonCorner, b: &PolygonCorner) -> f64 {
    lattice.apart_m((&a.spot, a.height_m), (&b.spot, b.height_m))
}

/// Search state of a polygon: entry point and best path.
#[derive(Clone, Copy)]
struct Node {
    place: PolygonCorner,
    cost_m: f64,
    total_m: f64,
    /// The portal that it is entered by, as the polygon before it names it.
    portal: u32,
}

struct CorridorSearch<'a> {
    polygons: &'a Polygons,
    lattice: &'a Lattice,
    goal: CorridorEnd,
    nodes: Vec<Option<Node>>,
    waiting: BinaryHeap<Reverse<QueueEntry>>,
}

impl<'a> CorridorSearch<'a> {
    fn new(polygons: &'a Polygons, lattice: &'a Lattice, goal: CorridorEnd) -> Self {
        let nodes = vec![None; polygons.len() as usize];
        Self { polygons, lattice, goal, nodes, waiting: BinaryHeap::new() }
    }

    /// The portals from the polygon of `from` to the goal's.
    fn run(mut self, from: CorridorEnd) -> Option<Vec<u32>> {
        let total_m = HEURISTIC * apart_m(self.lattice, &from.place, &self.goal.place);
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
        // The last edge comes last: outlines have the opposite direction in Detour.
        for edge in (edges.start..edges.end - 1).rev().chain([edges.end - 1]) {
            let Some(neighbour) = self.polygons.neighbour(edge).filter(|&next| Some(next) != before) else {
                continue;
            };
            let known = self.nodes[neighbour as usize];
            let place = known.map_or_else(|| self.middle(edge), |known| known.place);
            let mut cost_m = node.cost_m + apart_m(self.lattice, &node.place, &place);
            let left_m = apart_m(self.lattice, &place, &self.goal.place);
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

    fn middle(&self, edge: u32) -> PolygonCorner {
        let (a, b) = (begin(self.polygons, edge), begin(self.polygons, self.polygons.next(edge)));
        PolygonCorner { spot: a.spot + (b.spot - a.spot) * 0.5, height_m: 0.5 * (a.height_m + b.height_m) }
    }

    fn portals(&self, last: u32) -> Vec<u32> {
        let entered = |polygon: u32| self.nodes[polygon as usize].map_or(NONE, |node| node.portal);
        let before = |&portal: &u32| Some(entered(self.polygons.owner(portal))).filter(|&next| next != NONE);
        let first = Some(entered(last)).filter(|&portal| portal != NONE);
        let mut portals: Vec<_> = std::iter::successors(first, before).collect();
        portals.reverse();
        portals
    }
}

fn begin(polygons: &Polygons, edge: u32) -> PolygonCorner {
    PolygonCorner { spot: *polygons.from(edge), height_m: polygons.height_m(edge) }
}

/// A side of the funnel: tip and portal.
#[derive(Clone, Copy)]
struct Side {
    tip: PolygonCorner,
    portal: usize,
}

/// The string through a chain of portals (Mononen 2010, simple stupid funnel).
struct Pull<'a> {
    polygons: &'a Polygons,
    lattice: &'a Lattice,
    portals: &'a [u32],
    end: PolygonCorner,
}

impl Pull<'_> {
    fn points(&self, start: PolygonCorner) -> Vec<PolygonCorner> {
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

    /// Right and left end of a portal; the end of the path follows the last portal.
    fn portal(&self, at: usize) -> (PolygonCorner, PolygonCorner) {
        match self.portals.get(at) {
            Some(&edge) => (begin(self.polygons, edge), begin(self.polygons, self.polygons.next(edge))),
            None => (self.end, self.end),
        }
    }

    fn stands_at(&self, start: &PolygonCorner, right: &PolygonCorner, left: &PolygonCorner) -> bool {
        let share = share_of_segment(&start.spot, &left.spot, &right.spot);
        let nearest = left.spot + (right.spot - left.spot) * share;
        (nearest - start.spot).norm() * f64::from(self.lattice.cell_m) < AT_PORTAL_M
    }

    /// Moves `side` to `next` if that narrows the funnel; returns the tip of `other` if `next` is beyond it.
    /// `sign` is 1 for the right side and -1 for the left.
    fn narrow(
        &self,
        apex: &PolygonCorner,
        side: &mut Side,
        other: &Side,
        next: PolygonCorner,
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

    fn same(&self, a: &PolygonCorner, b: &PolygonCorner) -> bool {
        apart_m(self.lattice, a, b) < SAME_M
    }

    fn append(&self, points: &mut Vec<PolygonCorner>, point: PolygonCorner) {
        if points.last().is_none_or(|last| !self.same(last, &point)) {
            points.push(point);
        }
    }
}
