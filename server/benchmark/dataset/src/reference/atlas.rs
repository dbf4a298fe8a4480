//! Distance tables of the success regions of a house, computed once for all missions.

use avln_geom::Point3;
use avln_navmesh::{CornerWays, Exits, NavMesh, NavPoint, Places};
use std::cell::OnceCell;

/// Precomputed visibility and distances between success regions and wall corners. Tours become sums over these tables.
pub(crate) struct Atlas<'a> {
    navmesh: &'a NavMesh,
    regions: Vec<Region>,
    /// Sample points in all regions, region by region.
    places: Places,
    /// Shortest paths to each corner, computed on first use.
    ways: Vec<OnceCell<CornerWays>>,
    /// Points in line of sight per region pair, at `smaller * regions + larger`.
    straight: Vec<Vec<Straight>>,
    /// Shortest distance per region pair, metres.
    apart_m: Vec<f64>,
}

/// Start point with the visible points and corners.
pub(crate) struct Departure {
    position: Point3<f32>,
    exits: Exits,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    pub(crate) distance_m: f64,
    /// First and last corner; `None` for a straight path.
    corners: Option<(u32, u32)>,
}

const NO_WAY: Way = Way { distance_m: f64::INFINITY, corners: None };

impl Way {
    fn improve(&mut self, distance_m: f64, corners: Option<(u32, u32)>) {
        if distance_m < self.distance_m {
            *self = Self { distance_m, corners };
        }
    }
}

impl<'a> Atlas<'a> {
    /// Computes the tables. Region pairs closer than `least_apart_m` get no tours.
    pub(crate) fn new(navmesh: &'a NavMesh, regions: &[Vec<NavPoint>], least_apart_m: f64) -> Self {
        let all: Vec<NavPoint> = regions.iter().flatten().copied().collect();
        let pairs = regions.len() * regions.len();
        let mut atlas = Self {
            navmesh,
            regions: Vec::with_capacity(regions.len()),
            places: Places::new(navmesh, &all),
            // A path tree per corner, but most corners lie on no tour: trees are computed on first use.
            ways: (0..navmesh.corner_count()).map(|_| OnceCell::new()).collect(),
            straight: std::iter::repeat_with(Vec::new).take(pairs).collect(),
            apart_m: vec![f64::INFINITY; pairs],
        };
        atlas.look_around(regions, least_apart_m);
        atlas.measure();
        atlas
    }

    fn look_around(&mut self, regions: &[Vec<NavPoint>], least_apart_m: f64) {
        let stands = |(region, points): (usize, &Vec<NavPoint>)| {
            (0..points.len() as u32).map(move |stand| (region, stand))
        };
        let place_of: Vec<(usize, u32)> = regions.iter().enumerate().flat_map(stands).collect();
        let mut first = 0;
        for (here, points) in regions.iter().enumerate() {
            let exits: Vec<_> = points.iter().map(|point| self.navmesh.exits(point, &self.places)).collect();
            for (from, exits) in exits.iter().enumerate() {
                for &(place, distance_m) in &exits.places {
                    let (there, to) = place_of[place as usize];
                    if there > here {
                        let pair = Straight { from: from as u32, to, distance_m };
                        self.note(here * regions.len() + there, pair, least_apart_m);
                    }
                }
            }
            self.regions.push(Region::new(first, points, &exits));
            first += points.len();
        }
    }

    fn note(&mut self, pair: usize, straight: Straight, least_apart_m: f64) {
        self.apart_m[pair] = self.apart_m[pair].min(straight.distance_m);
        // Regions this close are never in the same mission, and their lists of visible pairs would be the longest.
        if self.apart_m[pair] < least_apart_m {
            self.straight[pair] = Vec::new();
        } else {
            self.straight[pair].push(straight);
        }
    }

    /// Lowers pair distances by paths around corners.
    fn measure(&mut self) {
        let count = self.len();
        for (a, b) in (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))) {
            let (here, there) = (&self.regions[a], &self.regions[b]);
            let mut least_m = self.apart_m[a * count + b];
            for (&home, near_m) in there.gates.iter().zip(&there.near_m) {
                let ways = self.ways_to(home);
                for (&out, left_m) in here.gates.iter().zip(&here.near_m) {
                    least_m = least_m.min(left_m + ways.distance_m(out) + near_m);
                }
            }
            self.apart_m[a * count + b] = least_m;
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.regions.len()
    }

    /// Returns the shortest distance between two regions, metres; infinite if disconnected.
    pub(crate) fn apart_m(&self, a: usize, b: usize) -> f64 {
        self.apart_m[a.min(b) * self.len() + a.max(b)]
    }

    pub(crate) fn departure(&self, start: &NavPoint) -> Departure {
        Departure { position: start.position(), exits: self.navmesh.exits(start, &self.places) }
    }

    /// Returns the shortest distance from the start to a region, metres; infinite if disconnected.
    pub(crate) fn start_m(&self, start: &Departure, to: usize) -> f64 {
        let region = &self.regions[to];
        let gates = region.gates.iter().zip(&region.near_m);
        let bent = gates.map(|(&gate, near_m)| self.gate_m(start, gate) + near_m);
        let straight = region.seen_from(start).map(|(_, distance_m)| distance_m);
        bent.chain(straight).fold(f64::INFINITY, f64::min)
    }

    /// Shortest distance from the start to a corner, metres.
    fn gate_m(&self, start: &Departure, gate: u32) -> f64 {
        let ways = self.ways_to(gate);
        let exits = start.exits.corners.iter();
        exits.map(|exit| exit.distance_m + ways.distance_m(exit.corner)).fold(f64::INFINITY, f64::min)
    }

    /// Returns shortest distances from the start to every point in a region, metres.
    pub(crate) fn depart(&self, start: &Departure, to: usize) -> Vec<f64> {
        let region = &self.regions[to];
        let gates: Vec<f64> = region.gates.iter().map(|&gate| self.gate_m(start, gate)).collect();
        let mut costs = region.spread(&gates);
        for (stand, distance_m) in region.seen_from(start) {
            costs[stand] = costs[stand].min(distance_m);
        }
        costs
    }

    /// Returns the costs at the points in `to`, given `costs` at the points in `from`, metres.
    pub(crate) fn onward(&self, from: usize, costs: &[f64], to: usize) -> Vec<f64> {
        let (here, there) = (&self.regions[from], &self.regions[to]);
        let left = here.gather(costs);
        let to_gate = |&gate: &u32| {
            let ways = self.ways_to(gate);
            let by = here.gates.iter().zip(&left);
            by.map(|(&corner, cost)| cost + ways.distance_m(corner)).fold(f64::INFINITY, f64::min)
        };
        let mut reached = there.spread(&there.gates.iter().map(to_gate).collect::<Vec<_>>());
        for (a, b, distance_m) in self.straight(from, to) {
            reached[b] = reached[b].min(costs[a] + distance_m);
        }
        reached
    }

    /// Returns paths from every point in `from` to a point.
    pub(crate) fn back(&self, to: (usize, usize), from: usize) -> Vec<Way> {
        let (here, there) = (&self.regions[from], &self.regions[to.0]);
        let exits: Vec<_> =
            there.stands[to.1].exits.iter().map(|(gate, m)| (there.gates[*gate as usize], *m)).collect();
        let by_gate: Vec<Way> = here.gates.iter().map(|&gate| self.way_out(gate, &exits)).collect();
        let bent = |stand: &Stand| {
            let mut way = NO_WAY;
            for (gate, distance_m) in &stand.exits {
                let onward = by_gate[*gate as usize];
                way.improve(distance_m + onward.distance_m, onward.corners);
            }
            way
        };
        let mut ways: Vec<Way> = here.stands.iter().map(bent).collect();
        for (a, b, distance_m) in self.straight(from, to.0) {
            if b == to.1 {
                ways[a].improve(distance_m, None);
            }
        }
        ways
    }

    /// Returns the corners on a path between two points, including both ends.
    pub(crate) fn leg(&self, from: (usize, usize), to: (usize, usize), way: &Way) -> Vec<Point3<f32>> {
        let end = |(region, stand): (usize, usize)| self.regions[region].stands[stand].position;
        self.between(end(from), way, end(to))
    }

    /// Returns the corners on the path from the start to a point, including both ends.
    pub(crate) fn first_leg(&self, start: &Departure, to: (usize, usize)) -> Vec<Point3<f32>> {
        let region = &self.regions[to.0];
        let stand = &region.stands[to.1];
        let exits: Vec<_> = stand.exits.iter().map(|(gate, m)| (region.gates[*gate as usize], *m)).collect();
        let mut way = NO_WAY;
        for exit in &start.exits.corners {
            let onward = self.way_out(exit.corner, &exits);
            way.improve(exit.distance_m + onward.distance_m, onward.corners);
        }
        for (_, distance_m) in region.seen_from(start).filter(|seen| seen.0 == to.1) {
            way.improve(distance_m, None);
        }
        self.between(start.position, &way, stand.position)
    }

    fn between(&self, from: Point3<f32>, way: &Way, to: Point3<f32>) -> Vec<Point3<f32>> {
        let mut leg = vec![from];
        if let Some((out, home)) = way.corners {
            leg.extend(self.ways_to(home).path(self.navmesh, out));
        }
        leg.push(to);
        leg
    }

    /// Best path from a corner by `exits`.
    fn way_out(&self, corner: u32, exits: &[(u32, f64)]) -> Way {
        let mut way = NO_WAY;
        for &(home, distance_m) in exits {
            way.improve(self.ways_to(home).distance_m(corner) + distance_m, Some((corner, home)));
        }
        way
    }

    fn ways_to(&self, corner: u32) -> &CornerWays {
        self.ways[corner as usize].get_or_init(|| self.navmesh.corner_ways(corner))
    }

    /// Pairs of points in line of sight between two regions.
    fn straight(&self, from: usize, to: usize) -> impl Iterator<Item = (usize, usize, f64)> {
        let turned = from > to;
        self.straight[from.min(to) * self.len() + from.max(to)].iter().map(move |pair| {
            let (a, b) = (pair.from as usize, pair.to as usize);
            if turned { (b, a, pair.distance_m) } else { (a, b, pair.distance_m) }
        })
    }
}

struct Region {
    /// First point's index among all points.
    first: usize,
    stands: Vec<Stand>,
    /// Exit corners, ascending.
    gates: Vec<u32>,
    /// Per exit corner: distance to the nearest point, metres.
    near_m: Vec<f64>,
}

struct Stand {
    position: Point3<f32>,
    /// Visible exit corners: index in the region, and distance in metres.
    exits: Vec<(u32, f64)>,
}

struct Straight {
    from: u32,
    to: u32,
    distance_m: f64,
}

impl Region {
    fn new(first: usize, points: &[NavPoint], exits: &[Exits]) -> Self {
        let mut gates: Vec<u32> =
            exits.iter().flat_map(|seen| &seen.corners).map(|exit| exit.corner).collect();
        gates.sort_unstable();
        gates.dedup();
        let mut near_m = vec![f64::INFINITY; gates.len()];
        let mut stands = Vec::with_capacity(points.len());
        for (point, seen) in points.iter().zip(exits) {
            let exits = seen.corners.iter().map(|exit| {
                let gate = gates.partition_point(|&gate| gate < exit.corner);
                near_m[gate] = near_m[gate].min(exit.distance_m);
                (gate as u32, exit.distance_m)
            });
            stands.push(Stand { position: point.position(), exits: exits.collect() });
        }
        Self { first, stands, gates, near_m }
    }

    /// Costs at exit corners from costs at points.
    fn gather(&self, costs: &[f64]) -> Vec<f64> {
        let mut gates = vec![f64::INFINITY; self.gates.len()];
        for (stand, cost) in self.stands.iter().zip(costs) {
            for &(gate, distance_m) in &stand.exits {
                let gate = &mut gates[gate as usize];
                *gate = gate.min(cost + distance_m);
            }
        }
        gates
    }

    /// Costs at points from costs at exit corners.
    fn spread(&self, gates: &[f64]) -> Vec<f64> {
        let least = |stand: &Stand| {
            let ways = stand.exits.iter().map(|&(gate, distance_m)| gates[gate as usize] + distance_m);
            ways.fold(f64::INFINITY, f64::min)
        };
        self.stands.iter().map(least).collect()
    }

    /// Sample points visible from a start, with distances in metres.
    fn seen_from(&self, start: &Departure) -> impl Iterator<Item = (usize, f64)> {
        let places = &start.exits.places;
        let from = places.partition_point(|place| (place.0 as usize) < self.first);
        let end = self.first + self.stands.len();
        places[from..]
            .iter()
            .take_while(move |place| (place.0 as usize) < end)
            .map(|place| (place.0 as usize - self.first, place.1))
    }
}
