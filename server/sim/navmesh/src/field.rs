use crate::corners::{Corners, Link};
use crate::mesh::{NavMesh, NavPoint};
use crate::outlook::Outlook;
use crate::plane::Spot;
use crate::sight::{Eye, VisiblePart, look};
use crate::waiting::QueueEntry;
use avln_geom::Point3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

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
