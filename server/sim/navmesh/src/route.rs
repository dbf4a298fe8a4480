//! Shortest paths between two points: best-first search over corners (Hart, Nilsson and Raphael 1968).

use crate::mesh::{NavMesh, NavPoint};
use crate::polygons::NONE;
use crate::sight::{Eye, look};
use avln_geom::Point3;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

impl NavMesh {
    /// Returns the shortest path length, metres; `None` across islands. The path is exact in the ground
    /// plane; legs are measured in space. Bit-identical in both directions.
    pub fn distance_m(&self, a: &NavPoint, b: &NavPoint) -> Option<f64> {
        if self.island_of(a) != self.island_of(b) {
            return None;
        }
        // Sums depend on the order of their terms, so both directions are searched from the same end.
        let (a, b) = if order(a) <= order(b) { (a, b) } else { (b, a) };
        route(self, a, b).map(|route| route.metres)
    }

    /// Returns the shortest path: `a`, bends, `b`; `None` across islands.
    pub fn path(&self, a: &NavPoint, b: &NavPoint) -> Option<Vec<Point3<f32>>> {
        if self.island_of(a) != self.island_of(b) {
            return None;
        }
        let bends = route(self, a, b)?.bends;
        let between = bends.into_iter().map(|corner| self.corner_position(corner));
        Some(std::iter::once(a.position).chain(between).chain([b.position]).collect())
    }
}

struct Route {
    metres: f64,
    bends: Vec<u32>,
}

#[derive(Clone, Copy)]
struct Reached {
    metres: f64,
    from: u32,
}

fn route(mesh: &NavMesh, a: &NavPoint, b: &NavPoint) -> Option<Route> {
    let (a, b) = (mesh.eye(a), mesh.eye(b));
    let mut search = RouteSearch::new(mesh, &b);
    if let Some(metres) = search.start(&a) {
        return Some(Route { metres, bends: Vec::new() });
    }
    search.run()
}

struct RouteSearch<'a> {
    mesh: &'a NavMesh,
    goal: &'a Eye,
    /// Straight distance to the goal by corner; infinite if hidden.
    last_m: Vec<f64>,
    reached: Vec<Reached>,
    waiting: BinaryHeap<Reverse<QueueEntry>>,
}

impl<'a> RouteSearch<'a> {
    fn new(mesh: &'a NavMesh, goal: &'a Eye) -> Self {
        let mut last_m = vec![f64::INFINITY; mesh.corners.len()];
        look(&mesh.polygons, goal, |polygon, view| {
            mesh.corners.in_view(mesh.polygons.edges(polygon), view, &goal.place, |link| {
                last_m[link.to as usize] = link.metres;
            });
        });
        let reached = vec![Reached { metres: f64::INFINITY, from: NONE }; mesh.corners.len()];
        Self { mesh, goal, last_m, reached, waiting: BinaryHeap::new() }
    }

    /// Opens the corners visible from `start`; returns the distance if the goal is visible.
    fn start(&mut self, start: &Eye) -> Option<f64> {
        let (mesh, goal) = (self.mesh, self.goal);
        let mut straight = None;
        look(&mesh.polygons, start, |polygon, view| {
            if polygon == goal.polygon && view.holds(&goal.place.spot) {
                straight = Some(mesh.lattice.apart_m(&start.place, &goal.place));
            }
            let edges = mesh.polygons.edges(polygon);
            mesh.corners.in_view(edges, view, &start.place, |link| self.open(link.to, link.metres, NONE));
        });
        straight
    }

    fn open(&mut self, corner: u32, metres: f64, from: u32) {
        let known = &mut self.reached[corner as usize];
        if metres < known.metres {
            *known = Reached { metres, from };
            let at_least = metres + self.mesh.corners.metres_to(corner, &self.goal.place);
            self.waiting.push(Reverse(QueueEntry { metres: at_least, number: corner }));
        }
    }

    fn run(mut self) -> Option<Route> {
        let mut best = (f64::INFINITY, NONE);
        while let Some(Reverse(QueueEntry { metres: at_least, number: corner })) = self.waiting.pop() {
            if at_least >= best.0 {
                break;
            }
            let metres = self.reached[corner as usize].metres;
            if at_least > metres + self.mesh.corners.metres_to(corner, &self.goal.place) {
                continue;
            }
            let whole = metres + self.last_m[corner as usize];
            if whole < best.0 {
                best = (whole, corner);
            }
            for link in self.mesh.corners.links(corner) {
                self.open(link.to, metres + link.metres, corner);
            }
        }
        (best.1 != NONE).then(|| {
            let bends = steps_to(best.1, |corner| self.reached[corner as usize].from);
            Route { metres: best.0, bends }
        })
    }
}

/// Returns the steps to `last`, first step first; `before` returns the previous step or [`NONE`].
pub(crate) fn steps_to(last: u32, before: impl Fn(u32) -> u32) -> Vec<u32> {
    let known = |step: u32| Some(step).filter(|&step| step != NONE);
    let mut steps: Vec<_> = std::iter::successors(known(last), |&step| known(before(step))).collect();
    steps.reverse();
    steps
}

/// A search queue entry, ordered by cost, then by index.
#[derive(PartialEq)]
pub(crate) struct QueueEntry {
    pub(crate) metres: f64,
    pub(crate) number: u32,
}

impl Eq for QueueEntry {}

impl PartialOrd for QueueEntry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for QueueEntry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.metres.total_cmp(&other.metres).then(self.number.cmp(&other.number))
    }
}

fn order(point: &NavPoint) -> (u32, [u32; 3]) {
    (point.polygon, [point.position.x, point.position.y, point.position.z].map(f32::to_bits))
}
