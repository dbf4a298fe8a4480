//! Looking around in the success regions of a house, once for all missions.

use super::atlas::Departure;
use avln_geom::Point3;
use avln_navmesh::{Exits, NavMesh, NavPoint, Places};

/// A success region.
pub(super) struct Region {
    /// Number of its first place among the places of all regions.
    first: usize,
    pub(super) stands: Vec<Stand>,
    /// Corners by which one can leave it, ascending.
    pub(super) gates: Vec<u32>,
    /// For each gate: how far the nearest stand is, metres.
    pub(super) near_m: Vec<f64>,
}

/// A sampled place of a region.
pub(super) struct Stand {
    pub(super) position: Point3<f32>,
    /// Gates in straight reach, by their index in the region, and how far they are, metres.
    pub(super) exits: Vec<(u32, f64)>,
}

/// Two stands in straight reach of each other.
pub(super) struct Straight {
    pub(super) from: u32,
    pub(super) to: u32,
    pub(super) distance_m: f64,
}

/// What there is to see. Pairs of regions are numbered `smaller * regions + larger`.
pub(super) struct Found {
    pub(super) regions: Vec<Region>,
    /// All stands of all regions, one region after the other.
    pub(super) places: Places,
    /// For each pair of regions: stands in straight reach of each other.
    pub(super) straight: Vec<Vec<Straight>>,
    /// For each pair: the least of their distances, metres.
    pub(super) straight_m: Vec<f64>,
}

/// Looks around from every point; pairs of regions that turn out to be nearer than `least_apart_m` are not kept.
pub(super) fn around(navmesh: &NavMesh, regions: &[Vec<NavPoint>], least_apart_m: f64) -> Found {
    let all: Vec<NavPoint> = regions.iter().flatten().copied().collect();
    let place_of: Vec<(usize, u32)> = regions
        .iter()
        .enumerate()
        .flat_map(|(region, points)| (0..points.len() as u32).map(move |stand| (region, stand)))
        .collect();
    let count = regions.len();
    let mut found = Found {
        regions: Vec::with_capacity(count),
        places: Places::new(navmesh, &all),
        straight: std::iter::repeat_with(Vec::new).take(count * count).collect(),
        straight_m: vec![f64::INFINITY; count * count],
    };
    let mut first = 0;
    for (here, points) in regions.iter().enumerate() {
        let exits: Vec<_> = points.iter().map(|point| navmesh.exits(point, &found.places)).collect();
        for (from, exits) in exits.iter().enumerate() {
            for &(place, distance_m) in &exits.places {
                let (there, to) = place_of[place as usize];
                if there > here {
                    let pair = Straight { from: from as u32, to, distance_m };
                    found.note(here * count + there, pair, least_apart_m);
                }
            }
        }
        found.regions.push(Region::new(first, points, &exits));
        first += points.len();
    }
    found
}

impl Found {
    fn note(&mut self, pair: usize, straight: Straight, least_apart_m: f64) {
        self.straight_m[pair] = self.straight_m[pair].min(straight.distance_m);
        if self.straight_m[pair] < least_apart_m {
            self.straight[pair] = Vec::new();
        } else {
            self.straight[pair].push(straight);
        }
    }
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

    /// Costs at the gates from costs at the stands.
    pub(super) fn gather(&self, costs: &[f64]) -> Vec<f64> {
        let mut gates = vec![f64::INFINITY; self.gates.len()];
        for (stand, cost) in self.stands.iter().zip(costs) {
            for &(gate, distance_m) in &stand.exits {
                let gate = &mut gates[gate as usize];
                *gate = gate.min(cost + distance_m);
            }
        }
        gates
    }

    /// Costs at the stands from costs at the gates.
    pub(super) fn spread(&self, gates: &[f64]) -> Vec<f64> {
        let least = |stand: &Stand| {
            let ways = stand.exits.iter().map(|&(gate, distance_m)| gates[gate as usize] + distance_m);
            ways.fold(f64::INFINITY, f64::min)
        };
        self.stands.iter().map(least).collect()
    }

    /// The stands in straight reach of a start, and how far they are, metres.
    pub(super) fn seen_from(&self, start: &Departure) -> impl Iterator<Item = (usize, f64)> {
        let places = &start.exits.places;
        let from = places.partition_point(|place| (place.0 as usize) < self.first);
        let end = self.first + self.stands.len();
        places[from..]
            .iter()
            .take_while(move |place| (place.0 as usize) < end)
            .map(|place| (place.0 as usize - self.first, place.1))
    }
}
