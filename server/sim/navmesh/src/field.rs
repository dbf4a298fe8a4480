use crate::corners::{Corners, Link};
use crate::mesh::{NavMesh, NavPoint};
use crate::plane::Spot;
use crate::route::QueueEntry;
use crate::sight::{Eye, VisiblePart, look};
use avln_geom::Point3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

impl NavMesh {
    /// Distances to the nearest of `seeds`, with a weight in metres added per seed.
    ///
    /// Seeds with a non-finite weight are ignored.
    pub fn field(&self, seeds: &[(NavPoint, f64)]) -> DistanceField {
        DistanceField::new(self, seeds)
    }

    /// Visibility of `point`, for many fields.
    pub fn outlook(&self, point: &NavPoint) -> Outlook {
        Outlook::new(self, point)
    }

    /// Distances from `from` (outer) to `to` (inner), metres; `None` across islands. Much cheaper than single
    /// queries: visibility is computed once per point.
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

/// Distances over a [`NavMesh`] to the nearest of weighted seeds.
///
/// The distance of a point is the minimum over the seeds of weight plus geodesic distance.
pub struct DistanceField {
    /// Seeds, ordered by polygon.
    seeds: Vec<Seed>,
    /// Per mesh corner: lowest cost in metres and next stop.
    corners: Vec<(f64, Next)>,
}

struct Seed {
    eye: Eye,
    position: Point3<f32>,
    weight_m: f64,
}

impl Seed {
    fn place(&self) -> (&Spot, f64) {
        (&self.eye.spot, f64::from(self.position.y))
    }
}

/// The next stop on the way to the best seed.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Next {
    Nowhere,
    Corner(u32),
    Seed(u32),
}

/// The best path from a point: cost in metres and first stop.
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
    pub(crate) fn new(mesh: &NavMesh, seeds: &[(NavPoint, f64)]) -> Self {
        let mut seeds: Vec<_> = seeds
            .iter()
            .filter(|(_, weight_m)| weight_m.is_finite())
            .map(|&(point, weight_m)| Seed { eye: mesh.eye(&point), position: point.position(), weight_m })
            .collect();
        seeds.sort_by_key(|seed| seed.eye.polygon);
        let mut corners = vec![(f64::INFINITY, Next::Nowhere); mesh.corners.len()];
        for (seed, index) in seeds.iter().zip(0..) {
            look(&mesh.polygons, &seed.eye, |polygon, view| {
                mesh.corners.in_view(mesh.polygons.edges(polygon), view, seed.place(), |link| {
                    let corner = &mut corners[link.to as usize];
                    let metres = seed.weight_m + link.metres;
                    if metres < corner.0 {
                        *corner = (metres, Next::Seed(index));
                    }
                });
            });
        }
        spread(&mesh.corners, &mut corners);
        Self { seeds, corners }
    }

    /// Distance from `point` to the best seed, metres, including its weight; `None` without a seed on the
    /// island.
    ///
    /// # Panics
    /// If `mesh` is a different, smaller mesh.
    pub fn distance_m(&self, mesh: &NavMesh, point: &NavPoint) -> Option<f64> {
        self.way(mesh, point).metres()
    }

    /// Like [`DistanceField::distance_m`] for the point of `outlook`: several times faster for a point in
    /// many fields.
    ///
    /// # Panics
    /// If `mesh` is a different, smaller mesh.
    pub fn distance_from_m(&self, mesh: &NavMesh, outlook: &Outlook) -> Option<f64> {
        let mut way = Way::NONE;
        for (polygon, view) in outlook.views() {
            self.to_seeds(mesh, *polygon, view, outlook.place(), &mut way);
        }
        for link in outlook.links() {
            way.improve(self.corners[link.to as usize].0 + link.metres, Next::Corner(link.to));
        }
        way.metres()
    }

    /// The shortest path from `point` to the best seed: `point`, the bends, the seed.
    ///
    /// `None` without a seed on the island of `point`.
    ///
    /// # Panics
    /// If `mesh` is a different, smaller mesh.
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
                    next = self.corners[corner as usize].1;
                }
            }
        }
    }

    fn way(&self, mesh: &NavMesh, point: &NavPoint) -> Way {
        let (eye, height_m) = (mesh.eye(point), f64::from(point.position().y));
        let place = (&eye.spot, height_m);
        let mut way = Way::NONE;
        look(&mesh.polygons, &eye, |polygon, view| {
            self.to_seeds(mesh, polygon, view, place, &mut way);
            mesh.corners.in_view(mesh.polygons.edges(polygon), view, place, |Link { to, metres }| {
                way.improve(self.corners[to as usize].0 + metres, Next::Corner(to));
            });
        });
        way
    }

    /// Improves `way` by the seeds on `polygon` that are in `view`.
    fn to_seeds(&self, mesh: &NavMesh, polygon: u32, view: &VisiblePart, place: (&Spot, f64), way: &mut Way) {
        let first = self.seeds.partition_point(|seed| seed.eye.polygon < polygon);
        let here = self.seeds[first..].iter().zip(first as u32..);
        for (seed, index) in here.take_while(|(seed, _)| seed.eye.polygon == polygon) {
            if view.holds(&seed.eye.spot) {
                let metres = seed.weight_m + mesh.lattice().apart_m(seed.place(), place);
                way.improve(metres, Next::Seed(index));
            }
        }
    }
}

/// Relaxes the costs of all corners over their links (Dijkstra 1959).
pub(crate) fn spread(corners: &Corners, costs: &mut [(f64, Next)]) {
    let seeded = costs.iter().zip(0..).filter(|(cost, _)| cost.0.is_finite());
    let mut waiting: BinaryHeap<_> =
        seeded.map(|(cost, corner)| Reverse(QueueEntry { metres: cost.0, number: corner })).collect();
    while let Some(Reverse(QueueEntry { metres, number: corner })) = waiting.pop() {
        if metres > costs[corner as usize].0 {
            continue;
        }
        for link in corners.links(corner) {
            let through = metres + link.metres;
            if through < costs[link.to as usize].0 {
                costs[link.to as usize] = (through, Next::Corner(corner));
                waiting.push(Reverse(QueueEntry { metres: through, number: link.to }));
            }
        }
    }
}

/// Visibility of a point on its mesh, reusable for many fields
/// ([`DistanceField::distance_from_m`](crate::DistanceField::distance_from_m)).
pub struct Outlook {
    eye: Eye,
    height_m: f64,
    views: Vec<(u32, VisiblePart)>,
    links: Vec<Link>,
}

impl Outlook {
    pub(crate) fn new(mesh: &NavMesh, point: &NavPoint) -> Self {
        let (eye, height_m) = (mesh.eye(point), f64::from(point.position().y));
        let (mut views, mut links) = (Vec::new(), Vec::new());
        look(&mesh.polygons, &eye, |polygon, view| {
            views.push((polygon, *view));
            mesh.corners.in_view(mesh.polygons.edges(polygon), view, (&eye.spot, height_m), |link| {
                links.push(link);
            });
        });
        Self { eye, height_m, views, links }
    }

    pub(crate) fn place(&self) -> (&Spot, f64) {
        (&self.eye.spot, self.height_m)
    }

    pub(crate) fn views(&self) -> &[(u32, VisiblePart)] {
        &self.views
    }

    pub(crate) fn links(&self) -> &[Link] {
        &self.links
    }
}

/// Points of a mesh for repeated distance queries, identified by index.
pub struct Places {
    /// Polygon, index, spot and height, ordered by polygon.
    places: Vec<(u32, u32, Spot, f64)>,
}

/// Exits of a mesh point: the first corners of shortest paths, and the points in straight reach.
///
/// With the [`CornerWays`] of the mesh, distances between points with known exits are sums: the straight
/// distance, or the minimum over exit, path between corners, and exit.
#[derive(Clone, Debug, Default)]
pub struct Exits {
    /// Corners in view that a shortest way can bend around, ascending by corner, each once.
    pub corners: Vec<Exit>,
    /// Points in straight reach with distances in metres, ascending by index.
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

/// Shortest paths from all corners of a mesh to a corner.
pub struct CornerWays {
    home: u32,
    corners: Vec<(f64, Next)>,
}

impl Places {
    /// Stores `points` of `mesh` for visibility queries.
    pub fn new(mesh: &NavMesh, points: &[NavPoint]) -> Self {
        let place = |(point, index): (&NavPoint, u32)| {
            let eye = mesh.eye(point);
            (eye.polygon, index, eye.spot, f64::from(point.position().y))
        };
        let mut places: Vec<_> = points.iter().zip(0..).map(place).collect();
        places.sort_unstable_by_key(|place| (place.0, place.1));
        Self { places }
    }

    fn on(&self, polygon: u32) -> impl Iterator<Item = &(u32, u32, Spot, f64)> {
        let first = self.places.partition_point(|place| place.0 < polygon);
        self.places[first..].iter().take_while(move |place| place.0 == polygon)
    }
}

impl NavMesh {
    /// Corner count.
    pub fn corner_count(&self) -> usize {
        self.corners.len()
    }

    /// Exits of `point`: corners, and the visible `places`.
    pub fn exits(&self, point: &NavPoint, places: &Places) -> Exits {
        let outlook = self.outlook(point);
        let exit = |link: &Link| Exit { corner: link.to, distance_m: link.metres };
        let mut exits = Exits { corners: outlook.links().iter().map(exit).collect(), places: Vec::new() };
        for (polygon, view) in outlook.views() {
            let here = places.on(*polygon).filter(|(_, _, spot, _)| view.holds(spot));
            let apart_m = |spot, height_m| self.lattice().apart_m((spot, height_m), outlook.place());
            exits.places.extend(here.map(|(_, index, spot, height_m)| (*index, apart_m(spot, *height_m))));
        }
        exits.places.sort_unstable_by_key(|place| place.0);
        exits.places.dedup_by_key(|place| place.0);
        exits.corners.sort_unstable_by_key(|exit| exit.corner);
        exits.corners.dedup_by_key(|exit| exit.corner);
        exits
    }

    /// Shortest paths from all corners to `corner`.
    ///
    /// # Panics
    /// If `corner` is out of range.
    pub fn corner_ways(&self, corner: u32) -> CornerWays {
        let mut corners = vec![(f64::INFINITY, Next::Nowhere); self.corners.len()];
        corners[corner as usize] = (0.0, Next::Nowhere);
        spread(&self.corners, &mut corners);
        CornerWays { home: corner, corners }
    }
}

impl CornerWays {
    /// Path length from `corner`, metres; infinite without a path.
    ///
    /// # Panics
    /// If `corner` is out of range.
    pub fn distance_m(&self, corner: u32) -> f64 {
        self.corners[corner as usize].0
    }

    /// Bends of the path from `corner`: `corner` first, the target corner last; empty without a path.
    ///
    /// # Panics
    /// If `corner` is out of range, or `mesh` is a different, smaller mesh.
    pub fn path(&self, mesh: &NavMesh, corner: u32) -> Vec<Point3<f32>> {
        if self.corners[corner as usize].0.is_infinite() {
            return Vec::new();
        }
        let mut path = vec![mesh.corner_position(corner)];
        let mut at = corner;
        while at != self.home
            && let Next::Corner(next) = self.corners[at as usize].1
        {
            path.push(mesh.corner_position(next));
            at = next;
        }
        path
    }
}
