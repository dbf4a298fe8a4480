//! Distances by brute force (Dijkstra over a fine raster, and over all mutually visible corners), and sums over exits.

use crate::{hall, two_rooms};
use avln_geom::{Aabb, Point3, Rng};
use avln_houses::{HouseOptions, house};
use avln_navmesh::{Body, CornerWays, Exits, NavMesh, NavPoint, Places};
use std::collections::BTreeMap;

const SPACING_M: f32 = 0.1;
/// Largest ratio of eight-direction to straight path lengths.
const EIGHT_WAYS: f64 = 1.0824;

struct Raster<'a> {
    mesh: &'a NavMesh,
    points: Vec<NavPoint>,
    links: Vec<Vec<(usize, f64)>>,
}

impl<'a> Raster<'a> {
    fn new(mesh: &'a NavMesh, bounds: &Aabb) -> Self {
        let points = mesh.grid(bounds, SPACING_M);
        let key = |point: &NavPoint| {
            let index = |value: f32| (value / SPACING_M).round() as i32;
            (index(point.position().x), index(point.position().z))
        };
        let by_key: BTreeMap<_, _> = points.iter().enumerate().map(|(i, point)| (key(point), i)).collect();
        let around = [-1, 0, 1].into_iter().flat_map(|dx| [-1, 0, 1].map(|dz| (dx, dz)));
        let links = points.iter().map(|point| {
            let (x, z) = key(point);
            let near = around.clone().filter_map(|(dx, dz)| by_key.get(&(x + dx, z + dz)).copied());
            near.filter_map(|other| Some((other, walked(mesh, point, &points[other])?))).collect()
        });
        let links = links.collect();
        Self { mesh, points, links }
    }

    /// Costs from `start`, by relaxation to a fixed point.
    fn costs(&self, start: usize) -> Vec<f64> {
        let mut costs = vec![f64::INFINITY; self.points.len()];
        costs[start] = 0.0;
        let mut queue = std::collections::VecDeque::from([start]);
        while let Some(here) = queue.pop_front() {
            for &(other, length) in &self.links[here] {
                if costs[here] + length < costs[other] - 1e-12 {
                    costs[other] = costs[here] + length;
                    queue.push_back(other);
                }
            }
        }
        costs
    }

    fn check(&self, seed: u64) {
        let mut rng = Rng::new(seed);
        for _ in 0..4 {
            let start = rng.below(self.points.len());
            let field = self.mesh.field(&[(self.points[start], 0.0)]);
            for (point, cost) in self.points.iter().zip(self.costs(start)) {
                let exact = field.distance_m(self.mesh, point).unwrap_or(f64::INFINITY);
                assert!(exact <= cost + 1e-3, "{exact} > {cost} to {point:?}");
                // The raster may miss gaps narrower than the spacing, so this bound only applies inside its reach.
                assert!(
                    cost.is_infinite() || cost <= exact * EIGHT_WAYS + 0.3,
                    "{exact} << {cost} to {point:?}"
                );
            }
        }
    }
}

/// Length of the straight step between two points if it is on the mesh.
fn walked(mesh: &NavMesh, from: &NavPoint, to: &NavPoint) -> Option<f64> {
    let (from, to) = (from.position(), to.position());
    is_straight(mesh, &from, &to).then(|| f64::from((to - from).norm()))
}

/// Returns true if the straight line, sampled every centimetre, is on the mesh.
fn is_straight(mesh: &NavMesh, from: &Point3<f32>, to: &Point3<f32>) -> bool {
    let count = ((to - from).norm() / 0.01).ceil().max(1.0);
    (0..=count as u32).all(|i| mesh.snap(&(from + (to - from) * (i as f32 / count)), 1e-4).is_some())
}

#[test]
fn distances_are_at_most_raster_distances() {
    let bounds = Aabb::new(Point3::new(0.0, -0.5, 0.0), Point3::new(10.0, 0.5, 6.0));
    Raster::new(&two_rooms(), &bounds).check(31);
    let furnished = hall()
        .block([2.0, 0.0, 1.0], [3.2, 1.0, 4.0])
        .block([3.2, 0.0, 3.2], [6.0, 1.0, 4.0])
        .block([6.5, 0.0, 0.5], [7.0, 2.0, 5.0])
        .block([8.0, 0.0, 2.0], [8.3, 2.0, 6.0]);
    Raster::new(&furnished.build(), &bounds).check(32);
}

#[test]
fn slanted_post_rows_agree_with_a_raster() {
    let mut builder = hall();
    // Slanted rows of small posts.
    for row in 0..4 {
        for post in 0..5 {
            let (x, z) = (1.5 + 1.8 * row as f32 + 0.1 * post as f32, 0.7 + 1.1 * post as f32);
            builder = builder.block([x, 0.0, z], [x + 0.3, 2.0, z + 0.25]);
        }
    }
    let bounds = Aabb::new(Point3::new(0.0, -0.5, 0.0), Point3::new(10.0, 0.5, 6.0));
    Raster::new(&builder.build(), &bounds).check(33);
}

#[test]
fn distances_equal_the_full_corner_graph() {
    let furnished = hall().block([3.0, 0.0, 1.0], [3.8, 1.0, 4.5]).block([6.0, 0.0, 2.0], [7.5, 1.0, 6.0]);
    let mesh = furnished.build();
    let mut rng = Rng::new(34);
    let ends: Vec<_> = (0..10).map(|_| mesh.sample(&mut rng, mesh.largest_island())).collect();
    let mut places: Vec<_> = ends.iter().map(NavPoint::position).collect();
    let floor = mesh.polygons().into_iter().flatten().filter(|corner| corner.y < 0.1);
    let mut corners: Vec<_> = floor.collect();
    corners.sort_by(|a, b| (a.x, a.z).partial_cmp(&(b.x, b.z)).expect("finite"));
    corners.dedup();
    places.extend(corners);
    let count = places.len();
    let mut least = vec![vec![f64::INFINITY; count]; count];
    for i in 0..count {
        for j in 0..i {
            if is_straight(&mesh, &places[i], &places[j]) {
                let metres = f64::from((places[i] - places[j]).norm());
                (least[i][j], least[j][i]) = (metres, metres);
            }
        }
    }
    for k in 0..count {
        for i in 0..count {
            for j in 0..count {
                least[i][j] = least[i][j].min(least[i][k] + least[k][j]);
            }
        }
    }
    for (i, a) in ends.iter().enumerate() {
        for (j, b) in ends.iter().enumerate().filter(|&(j, _)| j != i) {
            let exact = mesh.distance_m(a, b).expect("one floor");
            assert!((exact - least[i][j]).abs() < 2e-3, "{exact} {} from {a:?} to {b:?}", least[i][j]);
        }
    }
}

struct Looked {
    mesh: NavMesh,
    points: Vec<NavPoint>,
    exits: Vec<Exits>,
    ways: Vec<CornerWays>,
}

fn look_around() -> Looked {
    let mesh = NavMesh::build(&house("exits", 5, &HouseOptions::default()), &Body::default())
        .expect("a house has a floor");
    let mut rng = Rng::new(9);
    let points: Vec<_> = (0..24).map(|_| mesh.sample(&mut rng, mesh.largest_island())).collect();
    let places = Places::new(&mesh, &points);
    let exits = points.iter().map(|point| mesh.exits(point, &places)).collect();
    let ways = (0..mesh.corner_count() as u32).map(|corner| mesh.corner_ways(corner)).collect();
    Looked { mesh, points, exits, ways }
}

impl Looked {
    fn distance_m(&self, a: usize, b: usize) -> f64 {
        let straight = self.exits[a].places.iter().find(|place| place.0 == b as u32).map(|place| place.1);
        let bent = self.exits[a].corners.iter().flat_map(|out| {
            let ways = &self.ways[out.corner as usize];
            self.exits[b]
                .corners
                .iter()
                .map(move |home| out.distance_m + ways.distance_m(home.corner) + home.distance_m)
        });
        bent.fold(straight.unwrap_or(f64::INFINITY), f64::min)
    }
}

#[test]
fn exits_and_corner_ways_sum_to_geodesic_distance() {
    let looked = look_around();
    for a in 0..looked.points.len() {
        for b in 0..looked.points.len() {
            let exact = looked.mesh.distance_m(&looked.points[a], &looked.points[b]).expect("one island");
            let sum = looked.distance_m(a, b);
            assert!((sum - exact).abs() < 1e-6, "{a} to {b}: {sum} for {exact}");
        }
    }
}

#[test]
fn corner_path_lengths_are_their_distances() {
    let looked = look_around();
    let home = &looked.ways[0];
    for corner in 0..looked.mesh.corner_count() as u32 {
        let path = home.path(&looked.mesh, corner);
        let walked: f32 = path.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
        if home.distance_m(corner).is_infinite() {
            assert!(path.is_empty());
            continue;
        }
        assert!((f64::from(walked) - home.distance_m(corner)).abs() < 1e-3, "{corner}");
        assert_eq!(path.last(), looked.ways[0].path(&looked.mesh, 0).first());
    }
}
