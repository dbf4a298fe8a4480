//! Lengths of shortest tours by plain distance fields: slower than what missions are drawn with, and shares nothing with it.

use avln_world::{DistanceField, NavMesh, NavPoint};

/// Shortest tours from a start through one point of each region.
pub(super) struct Tours<'a> {
    navmesh: &'a NavMesh,
    regions: &'a [Vec<NavPoint>],
}

impl<'a> Tours<'a> {
    pub(super) fn new(navmesh: &'a NavMesh, regions: &'a [Vec<NavPoint>]) -> Self {
        Self { navmesh, regions }
    }

    /// Length of the tour in the order of the regions, metres; infinite when one is out of reach.
    pub(super) fn ordered_m(&self, start: NavPoint) -> f64 {
        let mut field = self.navmesh.field(&[(start, 0.0)]);
        let mut length_m = f64::INFINITY;
        for region in 0..self.regions.len() {
            (field, length_m) = self.visit(&field, region);
        }
        length_m
    }

    /// The same for the best of all orders: every order is tried.
    pub(super) fn unordered_m(&self, start: NavPoint) -> f64 {
        let mut best_m = f64::INFINITY;
        let left: Vec<usize> = (0..self.regions.len()).collect();
        self.try_all(&self.navmesh.field(&[(start, 0.0)]), &left, &mut best_m);
        best_m
    }

    fn try_all(&self, field: &DistanceField, left: &[usize], best_m: &mut f64) {
        for &region in left {
            let (onward, length_m) = self.visit(field, region);
            if length_m >= *best_m {
                continue;
            }
            let rest: Vec<usize> = left.iter().copied().filter(|&other| other != region).collect();
            if rest.is_empty() {
                *best_m = length_m;
            } else {
                self.try_all(&onward, &rest, best_m);
            }
        }
    }

    /// Goes on to every point of a region: the distances from there, and the least of them, metres.
    fn visit(&self, field: &DistanceField, region: usize) -> (DistanceField, f64) {
        let points = self.regions[region].iter();
        let seeds: Vec<_> =
            points.filter_map(|point| Some((*point, field.distance_m(self.navmesh, point)?))).collect();
        let least_m = seeds.iter().map(|seed| seed.1).fold(f64::INFINITY, f64::min);
        (self.navmesh.field(&seeds), least_m)
    }
}
