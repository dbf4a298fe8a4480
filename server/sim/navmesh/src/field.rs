use crate::corners::{Corners, Link};
use crate::mesh::{NavMesh, NavPoint};
use crate::plane::CELL_M;
use crate::sight::{Eye, look};
use avln_geom::Point3;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Distances over one [`NavMesh`] to the nearest of some weighted seeds.
///
/// The distance of a point is the minimum over the seeds of the seed's weight plus the geodesic distance to it.
pub struct DistanceField {
    /// Seeds, ordered by polygon.
    seeds: Vec<Seed>,
    /// For each corner of the mesh: the least cost, in cells, and where it leads.
    corners: Vec<(f64, Next)>,
}

struct Seed {
    eye: Eye,
    position: Point3<f32>,
    cells: f64,
}

/// The next stop on the way to the best seed.
#[derive(Clone, Copy, PartialEq)]
enum Next {
    Nowhere,
    Corner(u32),
    Seed(u32),
}

/// The best way from a point: its cost in cells and its first stop.
struct Way {
    cells: f64,
    next: Next,
}

impl Way {
    fn improve(&mut self, cells: f64, next: Next) {
        if cells < self.cells {
            *self = Self { cells, next };
        }
    }
}

impl DistanceField {
    pub(crate) fn new(mesh: &NavMesh, seeds: &[(NavPoint, f64)]) -> Self {
        let mut seeds: Vec<_> = seeds
            .iter()
            .filter(|(_, weight_m)| weight_m.is_finite())
            .map(|(point, weight_m)| Seed {
                eye: mesh.eye(point),
                position: point.position(),
                cells: weight_m / f64::from(CELL_M),
            })
            .collect();
        seeds.sort_by_key(|seed| seed.eye.polygon);
        let mut corners = vec![(f64::INFINITY, Next::Nowhere); mesh.corners.len()];
        for (seed, index) in seeds.iter().zip(0..) {
            look(&mesh.polygons, &seed.eye, |polygon, view| {
                mesh.corners.in_view(mesh.polygons.edges(polygon), view, &seed.eye.spot, |link| {
                    let corner = &mut corners[link.to as usize];
                    let cells = seed.cells + link.cells;
                    if cells < corner.0 {
                        *corner = (cells, Next::Seed(index));
                    }
                });
            });
        }
        spread(&mesh.corners, &mut corners);
        Self { seeds, corners }
    }

    /// Distance from `point` to its best seed, metres, the seed's weight included; `None` when no seed is on its island.
    ///
    /// # Panics
    /// When `mesh` is not the mesh of this field and smaller.
    pub fn distance_m(&self, mesh: &NavMesh, point: &NavPoint) -> Option<f64> {
        let cells = self.way(mesh, &mesh.eye(point)).cells;
        cells.is_finite().then(|| cells * f64::from(CELL_M))
    }

    /// The shortest path from `point` to its best seed: `point`, the corners where the path bends, the seed.
    ///
    /// `None` when no seed is on the island of `point`.
    ///
    /// # Panics
    /// When `mesh` is not the mesh of this field and smaller.
    pub fn path(&self, mesh: &NavMesh, point: &NavPoint) -> Option<Vec<Point3<f32>>> {
        let mut next = self.way(mesh, &mesh.eye(point)).next;
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

    fn way(&self, mesh: &NavMesh, eye: &Eye) -> Way {
        let mut way = Way { cells: f64::INFINITY, next: Next::Nowhere };
        look(&mesh.polygons, eye, |polygon, view| {
            let first = self.seeds.partition_point(|seed| seed.eye.polygon < polygon);
            let here = self.seeds[first..].iter().zip(first as u32..);
            for (seed, index) in here.take_while(|(seed, _)| seed.eye.polygon == polygon) {
                if view.holds(&seed.eye.spot) {
                    let cells = seed.cells + (seed.eye.spot - eye.spot).norm();
                    way.improve(cells, Next::Seed(index));
                }
            }
            mesh.corners.in_view(mesh.polygons.edges(polygon), view, &eye.spot, |Link { to, cells }| {
                way.improve(self.corners[to as usize].0 + cells, Next::Corner(to));
            });
        });
        way
    }
}

/// A corner that waits for its turn, ordered by cost, then by number.
#[derive(PartialEq)]
struct Waiting {
    cells: f64,
    corner: u32,
}

impl Eq for Waiting {}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        self.cells.total_cmp(&other.cells).then(self.corner.cmp(&other.corner))
    }
}

/// Lowers the costs of all corners to what their links allow (Dijkstra 1959).
fn spread(corners: &Corners, costs: &mut [(f64, Next)]) {
    let seeded = costs.iter().zip(0..).filter(|(cost, _)| cost.0.is_finite());
    let mut waiting: BinaryHeap<_> =
        seeded.map(|(cost, corner)| Reverse(Waiting { cells: cost.0, corner })).collect();
    while let Some(Reverse(Waiting { cells, corner })) = waiting.pop() {
        if cells > costs[corner as usize].0 {
            continue;
        }
        for link in corners.links(corner) {
            let through = cells + link.cells;
            if through < costs[link.to as usize].0 {
                costs[link.to as usize] = (through, Next::Corner(corner));
                waiting.push(Reverse(Waiting { cells: through, corner: link.to }));
            }
        }
    }
}
