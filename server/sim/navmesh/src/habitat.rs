//! Habitat-compatible projection, steps and path lengths, as in habitat-sim's `PathFinder`. Sources:
//! habitat-sim `src/esp/nav/PathFinder.cpp`, Detour `findNearestPoly`, `findPath` (the best polygon chain by portal middles)
//! and `findStraightPath` (the string pulled tight through it).

use crate::field::{QueueEntry, steps_to};
use crate::mesh::{NavMesh, NavPoint, Slide, Step};
use crate::plane::{Lattice, LatticePoint, Spot, nearest_height_m, share_of_segment, turn};
use crate::polygons::{NONE, Polygons, extent};
use crate::sight::Eye;
use crate::surface::Surface;
use avln_geom::Point3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Half extents of the polygon search box: horizontal and vertical, metres.
const BOX_M: (f64, f64) = (2.0, 4.0);
/// Relative distance of equal end points.
const SAME: f32 = 1e-5;
// On a crack between two islands the next projection could select the other island; this shift into the
// polygon prevents that, metres.
const NUDGE_M: f32 = 1e-4;

impl NavMesh {
    /// Projects `point` to the mesh like Habitat; `None` if the surrounding box of 4 x 8 x 4 m is empty.
    ///
    /// A polygon above or below within the body's climb has priority over nearer lateral polygons.
    pub fn project(&self, point: &Point3<f32>) -> Option<NavPoint> {
        let (spot, height_m) = (self.lattice.spot(point), f64::from(point.y));
        let reach_cells = self.lattice.cells(BOX_M.0);
        let mut best: Option<(f64, u32, Spot)> = None;
        self.bins.around(&spot, reach_cells, |polygon| {
            if self.is_in_box(polygon, &spot, height_m) {
                let nearest = self.polygons.nearest(polygon, &spot);
                let cost = self.nearness(polygon, &spot, &nearest, height_m);
                if best.is_none_or(|(least, first, _)| cost < least || cost == least && polygon < first) {
                    best = Some((cost, polygon, nearest));
                }
            }
            reach_cells
        });
        best.map(|(_, polygon, nearest)| self.point(&nearest, polygon))
    }

    /// Returns the end of a step, like Habitat's `try_step` or, without `slides`, `try_step_no_sliding`:
    /// `start` if either point is off the mesh or `end` is nearest to a different island.
    pub fn try_step(&self, start: &Point3<f32>, end: &Point3<f32>, slides: bool) -> Point3<f32> {
        self.stepped(start, end, slides).unwrap_or(*start)
    }

    fn stepped(&self, start: &Point3<f32>, end: &Point3<f32>, slides: bool) -> Option<Point3<f32>> {
        let from = self.project(start)?;
        let towards = self.project(end)?;
        if self.island_of(&from) != self.island_of(&towards) {
            return None;
        }
        let (start, target) = (self.lattice.spot(&from.position), self.lattice.spot(end));
        let reach_cells = self.step_reach(f64::from((end - from.position).norm()));
        let step = Step { start, polygon: from.polygon, target, reach_cells, slides };
        let Slide { end: reached, blocked } = self.step(&step)?;
        // Habitat's own meshes must reproduce Habitat's bits; with scene heights the result is only a position.
        let exact = matches!(self.surface, Surface::Detail(_)) && blocked && slides;
        let stopped = exact.then(|| stop(self, reached.polygon, end)).flatten();
        let place = stopped.unwrap_or(reached.position);
        let again = self.project(&place)?;
        if self.island_of(&again) == self.island_of(&from) {
            return Some(place);
        }
        let inwards = self.middle(reached.polygon) - place;
        Some(place + inwards * (NUDGE_M / inwards.norm().max(NUDGE_M)))
    }

    /// Returns Habitat's path length, metres; `None` without a path. Both points are projected but retain
    /// their heights; the path is tightened in the best polygon chain, which is not always shortest.
    pub fn geodesic_m(&self, a: &Point3<f32>, b: &Point3<f32>) -> Option<f64> {
        let (on_a, on_b) = (self.project(a)?, self.project(b)?);
        if self.island_of(&on_a) != self.island_of(&on_b) {
            return None;
        }
        if are_same(&on_a, &on_b) {
            return Some(0.0);
        }
        let ends = [&on_a, &on_b].map(|on| Eye { place: self.place(on), polygon: on.polygon });
        let drawn = [self.place(&self.end_of_path(a, &on_a)), self.place(&self.end_of_path(b, &on_b))];
        corridor_m(&self.polygons, &self.lattice, ends, drawn)
    }

    /// Returns the shortest path length between the points of [`NavMesh::geodesic_m`]; never longer.
    pub fn shortest_m(&self, a: &Point3<f32>, b: &Point3<f32>) -> Option<f64> {
        let (on_a, on_b) = (self.project(a)?, self.project(b)?);
        if are_same(&on_a, &on_b) {
            return Some(0.0);
        }
        self.distance_m(&self.end_of_path(a, &on_a), &self.end_of_path(b, &on_b))
    }

    fn place(&self, point: &NavPoint) -> LatticePoint {
        let position = point.position;
        LatticePoint { spot: self.lattice.spot(&position), height_m: f64::from(position.y) }
    }

    /// Returns `point` itself above its polygon, otherwise the nearest rim point at rim height.
    fn end_of_path(&self, point: &Point3<f32>, on: &NavPoint) -> NavPoint {
        let spot = self.lattice.spot(point);
        let nearest = self.polygons.nearest(on.polygon, &spot);
        let height_m = if nearest == spot { point.y } else { self.rim_m(on.polygon, &nearest) as f32 };
        NavPoint { position: self.lattice.point(&nearest, height_m), polygon: on.polygon }
    }

    fn rim_m(&self, polygon: u32, spot: &Spot) -> f64 {
        let side = |edge| [edge, self.polygons.next(edge)].map(|edge| self.polygons.corner(edge));
        nearest_height_m(spot, self.polygons.edges(polygon).map(side))
    }

    fn is_in_box(&self, polygon: u32, spot: &Spot, height_m: f64) -> bool {
        let corners = self.polygons.corners(polygon);
        let (low, high) = extent(corners);
        let reach = self.lattice.cells(BOX_M.0);
        let beside = low.x <= spot.x + reach
            && high.x >= spot.x - reach
            && low.y <= spot.y + reach
            && high.y >= spot.y - reach;
        let (bottom_m, top_m) = match &self.surface {
            Surface::Detail(detail) => detail.reach_m(polygon),
            Surface::Scene(_) => {
                let heights = corners.iter().map(|corner| corner.height_m);
                heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(y), h.max(y)))
            }
        };
        beside && bottom_m <= height_m + BOX_M.1 && top_m >= height_m - BOX_M.1
    }

    /// Habitat's polygon ranking, square metres: the rise beyond a climb above or below a polygon, otherwise
    /// the distance in space.
    fn nearness(&self, polygon: u32, spot: &Spot, nearest: &Spot, height_m: f64) -> f64 {
        let rise_m = f64::from(self.surface.height_m(polygon, nearest)) - height_m;
        if nearest == spot {
            (rise_m.abs() - f64::from(self.climb_m)).max(0.0).powi(2)
        } else {
            let flat_m = (nearest - spot).norm() * f64::from(self.lattice.cell_m);
            flat_m * flat_m + rise_m * rise_m
        }
    }

    fn middle(&self, polygon: u32) -> Point3<f32> {
        let corners = self.polygons.corners(polygon);
        let count = corners.len() as f64;
        let sum = corners.iter().fold(Spot::origin(), |sum, corner| sum + corner.spot.coords);
        let height_m = corners.iter().map(|corner| corner.height_m).sum::<f64>() / count;
        self.lattice.point(&(sum / count), height_m as f32)
    }
}

/// Returns true if Habitat treats two mesh points as equal.
fn are_same(a: &NavPoint, b: &NavPoint) -> bool {
    let least = a.position.coords.norm_squared().min(b.position.coords.norm_squared());
    (a.position - b.position).norm_squared() <= SAME * SAME * least
}

/// A wall in Detour's direction.
#[derive(Clone, Copy)]
struct Wall {
    begin: Point3<f32>,
    end: Point3<f32>,
}

impl Wall {
    /// Returns the parameter (0 to 1) of the wall point nearest to `target` in the plane, and the squared
    /// distance.
    fn nearest(&self, target: &Point3<f32>) -> (f32, f32) {
        let (along, to) = (self.end - self.begin, target - self.begin);
        let length_squared = along.x * along.x + along.z * along.z;
        let mut share = along.x * to.x + along.z * to.z;
        if length_squared > 0.0 {
            share /= length_squared;
        }
        let share = share.clamp(0.0, 1.0);
        let (x, z) = (self.begin.x + share * along.x - target.x, self.begin.z + share * along.z - target.z);
        (share, x * x + z * z)
    }

    /// Returns true if a ray in x crosses the wall.
    fn crosses(&self, place: &Point3<f32>) -> bool {
        let (a, b) = (&self.end, &self.begin);
        (a.z > place.z) != (b.z > place.z) && place.x < (b.x - a.x) * (place.z - a.z) / (b.z - a.z) + a.x
    }
}

/// Returns the end of a step to `target` against a wall of `polygon`; `None` without walls.
fn stop(mesh: &NavMesh, polygon: u32, target: &Point3<f32>) -> Option<Point3<f32>> {
    let polygons = &mesh.polygons;
    let wall = |edge: u32| {
        let place = |edge: u32| {
            let LatticePoint { spot, height_m } = polygons.corner(edge);
            mesh.lattice.corner(&spot, height_m as f32)
        };
        Wall { begin: place(polygons.next(edge)), end: place(edge) }
    };
    let mut best: Option<(f32, f32, Wall)> = None;
    for edge in polygons.edges(polygon).rev().filter(|&edge| polygons.twin(edge).is_none()) {
        let (share, gap) = wall(edge).nearest(target);
        if best.is_none_or(|(least, ..)| gap < least) {
            best = Some((gap, share, wall(edge)));
        }
    }
    let (_, share, Wall { begin, end }) = best?;
    // f32 rounding puts the point inside or outside the polygon. Detour then takes the detail mesh height or
    // the straight rim (`moveAlongSurface`, `getPolyHeight`).
    let mut place = begin + (end - begin) * share;
    let crossed = polygons.edges(polygon).filter(|&edge| wall(edge).crosses(&place)).count();
    if crossed % 2 == 1 {
        place.y = mesh.surface.height_m(polygon, &mesh.lattice.spot(&place));
    }
    Some(place)
}

// Detour scales the straight distance so that the estimate stays a lower bound.
const HEURISTIC: f64 = 0.999;
// Detour skips a first portal this close to the start, metres.
const AT_PORTAL_M: f64 = 0.001;
// Detour merges positions within this distance, metres.
const SAME_M: f64 = 1.0 / 16384.0;

/// Returns the length in metres of Detour's path between mesh points, drawn between `start` and `end` above
/// or below them. `None` without a path.
fn corridor_m(
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
