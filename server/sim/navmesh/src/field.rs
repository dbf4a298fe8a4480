//! Shortest paths between two points, by best-first search over corners (Hart, Nilsson and Raphael 1968); distance fields:
//! walking distance from anywhere to weighted seeds.

use crate::mesh::{NavMesh, NavPoint};
use crate::plane::LatticePoint;
use crate::polygons::NONE;
use crate::sight::{Corners, Eye, Link, VisiblePart, look};
use avln_geom::Point3;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

impl NavMesh {
    /// Returns the shortest path length, metres; `None` across islands. The path is exact in the ground
    /// plane; legs are measured in space. Bit-identical in both directions.
    pub fn distance_m(&self, a: &NavPoint, b: &NavPoint) -> Option<f64> {
        // Sums depend on the order of their terms, so both directions are searched from the same end.
        let (a, b) = if order(a) <= order(b) { (a, b) } else { (b, a) };
        route(self, a, b).map(|route| route.metres)
    }

    /// Returns the shortest path: `a`, bends, `b`; `None` across islands.
    pub fn path(&self, a: &NavPoint, b: &NavPoint) -> Option<Vec<Point3<f32>>> {
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
    if mesh.island_of(a) != mesh.island_of(b) {
        return None;
    }
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

impl NavMesh {
    /// Returns distances to the nearest of weighted `seeds`; the weight, metres, is added. Non-finite weights
    /// are ignored.
    pub fn field(&self, seeds: &[(NavPoint, f64)]) -> DistanceField {
        let mut seeds: Vec<_> = seeds
            .iter()
            .filter(|(_, weight_m)| weight_m.is_finite())
            .map(|&(point, weight_m)| Seed { eye: self.eye(&point), position: point.position(), weight_m })
            .collect();
        seeds.sort_by_key(|seed| seed.eye.polygon);
        let mut corners = vec![Way::NONE; self.corners.len()];
        for (seed, index) in seeds.iter().zip(0..) {
            look(&self.polygons, &seed.eye, |polygon, view| {
                self.corners.in_view(self.polygons.edges(polygon), view, &seed.eye.place, |link| {
                    corners[link.to as usize].improve(seed.weight_m + link.metres, Next::Seed(index));
                });
            });
        }
        spread(&self.corners, &mut corners);
        DistanceField { seeds, corners }
    }

    /// Returns the visibility of `point`, reusable with many fields.
    pub fn outlook(&self, point: &NavPoint) -> Outlook {
        let eye = self.eye(point);
        let (mut views, mut links) = (Vec::new(), Vec::new());
        look(&self.polygons, &eye, |polygon, view| {
            views.push((polygon, *view));
            self.corners.in_view(self.polygons.edges(polygon), view, &eye.place, |link| links.push(link));
        });
        Outlook { eye, views, links }
    }

    /// Returns distances from `from` (outer) to `to` (inner), metres; `None` across islands. Cheaper than
    /// single queries.
    pub fn distances_m(&self, from: &[NavPoint], to: &[NavPoint]) -> Vec<Vec<Option<f64>>> {
        let outlooks: Vec<_> = from.iter().map(|point| self.outlook(point)).collect();
        let mut distances = vec![Vec::with_capacity(to.len()); from.len()];
        for target in to {
            let field = self.field(&[(*target, 0.0)]);
            for (row, outlook) in distances.iter_mut().zip(&outlooks) {
                row.push(field.distance_from_m(self, outlook));
            }
        }
        distances
    }
}

/// Distances over a [`NavMesh`]: the minimum over seeds of weight plus geodesic distance.
///
/// With a different mesh, methods panic or return wrong results.
pub struct DistanceField {
    seeds: Vec<Seed>,
    /// By mesh corner.
    corners: Vec<Way>,
}

struct Seed {
    eye: Eye,
    position: Point3<f32>,
    weight_m: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum Next {
    Nowhere,
    Corner(u32),
    Seed(u32),
}

#[derive(Clone, Copy)]
struct Way {
    metres: f64,
    next: Next,
}

impl Way {
    const NONE: Self = Self { metres: f64::INFINITY, next: Next::Nowhere };

    fn improve(&mut self, metres: f64, next: Next) {
        if metres < self.metres {
            *self = Self { metres, next };
        }
    }

    fn metres(&self) -> Option<f64> {
        self.metres.is_finite().then_some(self.metres)
    }
}

impl DistanceField {
    /// Returns distance plus weight for the best seed, metres; `None` without a seed on the island.
    pub fn distance_m(&self, mesh: &NavMesh, point: &NavPoint) -> Option<f64> {
        self.way(mesh, point).metres()
    }

    /// Returns [`DistanceField::distance_m`] for the point of `outlook`, several times faster.
    pub fn distance_from_m(&self, mesh: &NavMesh, outlook: &Outlook) -> Option<f64> {
        let mut way = Way::NONE;
        for (polygon, view) in &outlook.views {
            self.to_seeds(mesh, *polygon, view, &outlook.eye.place, &mut way);
        }
        for link in &outlook.links {
            way.improve(self.corners[link.to as usize].metres + link.metres, Next::Corner(link.to));
        }
        way.metres()
    }

    /// Returns the shortest path: `point`, bends, best seed; `None` without a seed on the island.
    pub fn path(&self, mesh: &NavMesh, point: &NavPoint) -> Option<Vec<Point3<f32>>> {
        let mut next = self.way(mesh, point).next;
        let mut path = vec![point.position()];
        loop {
            match next {
                Next::Nowhere => return None,
                Next::Seed(seed) => {
                    path.push(self.seeds[seed as usize].position);
                    return Some(path);
                }
                Next::Corner(corner) => {
                    path.push(mesh.corner_position(corner));
                    next = self.corners[corner as usize].next;
                }
            }
        }
    }

    fn way(&self, mesh: &NavMesh, point: &NavPoint) -> Way {
        let eye = mesh.eye(point);
        let mut way = Way::NONE;
        look(&mesh.polygons, &eye, |polygon, view| {
            self.to_seeds(mesh, polygon, view, &eye.place, &mut way);
            mesh.corners.in_view(mesh.polygons.edges(polygon), view, &eye.place, |Link { to, metres }| {
                way.improve(self.corners[to as usize].metres + metres, Next::Corner(to));
            });
        });
        way
    }

    /// Improves `way` by visible seeds on `polygon`.
    fn to_seeds(
        &self,
        mesh: &NavMesh,
        polygon: u32,
        view: &VisiblePart,
        place: &LatticePoint,
        way: &mut Way,
    ) {
        let first = self.seeds.partition_point(|seed| seed.eye.polygon < polygon);
        let here = self.seeds[first..].iter().zip(first as u32..);
        for (seed, index) in here.take_while(|(seed, _)| seed.eye.polygon == polygon) {
            if view.holds(&seed.eye.place.spot) {
                let metres = seed.weight_m + mesh.lattice.apart_m(&seed.eye.place, place);
                way.improve(metres, Next::Seed(index));
            }
        }
    }
}

/// Spreads the seeded ways over all links (Dijkstra 1959).
fn spread(corners: &Corners, ways: &mut [Way]) {
    let seeded = ways.iter().zip(0..).filter(|(way, _)| way.metres.is_finite());
    let mut waiting: BinaryHeap<_> =
        seeded.map(|(way, corner)| Reverse(QueueEntry { metres: way.metres, number: corner })).collect();
    while let Some(Reverse(QueueEntry { metres, number: corner })) = waiting.pop() {
        if metres > ways[corner as usize].metres {
            continue;
        }
        for link in corners.links(corner) {
            let through = metres + link.metres;
            if through < ways[link.to as usize].metres {
                ways[link.to as usize] = Way { metres: through, next: Next::Corner(corner) };
                waiting.push(Reverse(QueueEntry { metres: through, number: link.to }));
            }
        }
    }
}

/// A point's visibility, for [`DistanceField::distance_from_m`].
pub struct Outlook {
    eye: Eye,
    views: Vec<(u32, VisiblePart)>,
    links: Vec<Link>,
}

/// Indexed mesh points for repeated distance queries.
pub struct Places {
    places: Vec<IndexedPlace>,
}

struct IndexedPlace {
    eye: Eye,
    index: u32,
}

/// First corners on shortest paths from a point, and the points in straight reach.
///
/// With [`CornerWays`], a distance between points with known exits is a sum: the straight distance, or the
/// minimum over exit, corner path and exit.
#[derive(Clone, Debug, Default)]
pub struct Exits {
    /// Useful visible corners, ascending, without duplicates.
    pub corners: Vec<Exit>,
    /// Index and distance in metres of visible points, ascending.
    pub places: Vec<(u32, f64)>,
}

/// A corner in straight reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exit {
    /// Corner index, below [`NavMesh::corner_count`].
    pub corner: u32,
    /// Distance, metres.
    pub distance_m: f64,
}

/// Shortest paths from all corners to a target corner. Methods panic for an unknown corner.
pub struct CornerWays {
    home: u32,
    corners: Vec<Way>,
}

impl Places {
    /// Indexes `points` of `mesh`.
    pub fn new(mesh: &NavMesh, points: &[NavPoint]) -> Self {
        let indexed = points.iter().zip(0..);
        let mut places: Vec<_> =
            indexed.map(|(point, index)| IndexedPlace { eye: mesh.eye(point), index }).collect();
        places.sort_unstable_by_key(|place| (place.eye.polygon, place.index));
        Self { places }
    }

    fn on(&self, polygon: u32) -> impl Iterator<Item = &IndexedPlace> {
        let first = self.places.partition_point(|place| place.eye.polygon < polygon);
        self.places[first..].iter().take_while(move |place| place.eye.polygon == polygon)
    }
}

impl NavMesh {
    /// Returns the corner count.
    pub fn corner_count(&self) -> usize {
        self.corners.len()
    }

    /// Returns the exits of `point`, and the visible `places`.
    pub fn exits(&self, point: &NavPoint, places: &Places) -> Exits {
        let outlook = self.outlook(point);
        let exit = |link: &Link| Exit { corner: link.to, distance_m: link.metres };
        let mut exits = Exits { corners: outlook.links.iter().map(exit).collect(), places: Vec::new() };
        for (polygon, view) in &outlook.views {
            for IndexedPlace { eye, index } in
                places.on(*polygon).filter(|place| view.holds(&place.eye.place.spot))
            {
                exits.places.push((*index, self.lattice.apart_m(&eye.place, &outlook.eye.place)));
            }
        }
        exits.places.sort_unstable_by_key(|place| place.0);
        exits.places.dedup_by_key(|place| place.0);
        exits.corners.sort_unstable_by_key(|exit| exit.corner);
        exits.corners.dedup_by_key(|exit| exit.corner);
        exits
    }

    /// Returns the shortest paths from all corners to `corner`.
    pub fn corner_ways(&self, corner: u32) -> CornerWays {
        let mut corners = vec![Way::NONE; self.corners.len()];
        corners[corner as usize].metres = 0.0;
        spread(&self.corners, &mut corners);
        CornerWays { home: corner, corners }
    }
}

impl CornerWays {
    /// Returns the path length from `corner`, metres; infinite without a path.
    pub fn distance_m(&self, corner: u32) -> f64 {
        self.corners[corner as usize].metres
    }

    /// Returns the bends from `corner` to the target corner, both included; empty without a path.
    pub fn path(&self, mesh: &NavMesh, corner: u32) -> Vec<Point3<f32>> {
        if self.corners[corner as usize].metres.is_infinite() {
            return Vec::new();
        }
        let mut path = vec![mesh.corner_position(corner)];
        let mut at = corner;
        while at != self.home
            && let Next::Corner(next) = self.corners[at as usize].next
        {
            path.push(mesh.corner_position(next));
            at = next;
        }
        path
    }
}
