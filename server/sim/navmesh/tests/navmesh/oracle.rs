//! Brute force: Dijkstra over a fine raster whose steps are walked with `slide`.

use crate::build::{hall, two_rooms};
use avln_geom::{Aabb, Point3, Rng};
use avln_navmesh::{NavMesh, NavPoint};
use std::collections::BTreeMap;

const SPACING_M: f32 = 0.1;
/// What going in eight directions may cost over going straight.
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

    /// Costs from `start`, by relaxing until nothing changes.
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
                assert!(exact <= cost + 1e-4, "{exact} > {cost} to {point:?}");
                // The raster may miss gaps narrower than its spacing, so this bound holds for its reach only.
                assert!(
                    cost.is_infinite() || cost <= exact * EIGHT_WAYS + 0.3,
                    "{exact} << {cost} to {point:?}"
                );
            }
        }
    }
}

fn walked(mesh: &NavMesh, from: &NavPoint, to: &NavPoint) -> Option<f64> {
    let offset = to.position() - from.position();
    let slide = mesh.slide(from, &offset);
    let there = !slide.blocked && (slide.end.position() - to.position()).norm() < 1e-3;
    there.then(|| f64::from(offset.xz().norm()))
}

#[test]
fn exact_distances_are_never_beaten_by_a_raster() {
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
fn round_obstacles_are_no_exception() {
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
