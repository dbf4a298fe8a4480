use crate::plane::{Spot, share_of_segment, turn};
use crate::polygons::{PolygonCorner, RawPolygon};

/// Tolerance outside a triangle for its height, relative to its area.
const RIM: f64 = 1e-6;

/// Triangles that give the polygons their heights: the detail mesh of Recast.
pub(crate) struct Detail {
    first: Vec<u32>,
    triangles: Vec<[PolygonCorner; 3]>,
}

impl Detail {
    /// Bytes that the lists take.
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.first.as_slice()) + size_of_val(self.triangles.as_slice())
    }

    pub(crate) fn new(polygons: &[RawPolygon]) -> Self {
        let mut detail = Self { first: vec![0], triangles: Vec::new() };
        for polygon in polygons {
            detail.triangles.extend(&polygon.detail);
            detail.first.push(detail.triangles.len() as u32);
        }
        detail
    }

    /// Height at `spot` on `polygon`: from the covering triangle, otherwise from the nearest triangle side.
    pub(crate) fn height_m(&self, polygon: u32, spot: &Spot) -> f64 {
        let triangles = self.of(polygon);
        triangles.iter().find_map(|triangle| height_inside(triangle, spot)).unwrap_or_else(|| {
            let sides = triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
            let mut best = (f64::INFINITY, 0.0);
            for (a, b) in sides {
                let share = share_of_segment(spot, &a.spot, &b.spot);
                let distance = (a.spot + (b.spot - a.spot) * share - spot).norm_squared();
                if distance < best.0 {
                    best = (distance, a.height_m + (b.height_m - a.height_m) * share);
                }
            }
            best.1
        })
    }

    /// Lowest and highest corner of `polygon`'s triangles, metres.
    pub(crate) fn reach_m(&self, polygon: u32) -> (f64, f64) {
        let heights = self.of(polygon).iter().flatten().map(|corner| corner.height_m);
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)))
    }

    fn of(&self, polygon: u32) -> &[[PolygonCorner; 3]] {
        let range = |index: usize| self.first[index] as usize;
        &self.triangles[range(polygon as usize)..range(polygon as usize + 1)]
    }
}

/// Height at `spot` in the plane of a covering triangle.
fn height_inside([a, b, c]: &[PolygonCorner; 3], spot: &Spot) -> Option<f64> {
    let area = turn(&a.spot, &b.spot, &c.spot);
    if area == 0.0 {
        return None;
    }
    let beta = turn(&a.spot, spot, &c.spot) / area;
    let gamma = turn(&a.spot, &b.spot, spot) / area;
    let inside = beta >= -RIM && gamma >= -RIM && beta + gamma <= 1.0 + RIM;
    let height_m = a.height_m + (b.height_m - a.height_m) * beta + (c.height_m - a.height_m) * gamma;
    inside.then_some(height_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_follow_the_triangle_and_hold_on_outside() {
        let corner = |x, z, height_m| PolygonCorner { spot: Spot::new(x, z), height_m };
        let ramp = [corner(0.0, 0.0, 1.0), corner(10.0, 0.0, 2.0), corner(0.0, 10.0, 1.0)];
        let detail = Detail::new(&[RawPolygon { detail: vec![ramp], ..Default::default() }]);
        assert_eq!(detail.height_m(0, &Spot::new(5.0, 2.0)), 1.5);
        assert_eq!(detail.height_m(0, &Spot::new(5.0, -3.0)), 1.5);
        assert_eq!(detail.height_m(0, &Spot::new(12.0, 0.0)), 2.0);
        assert_eq!(detail.reach_m(0), (1.0, 2.0));
    }
}
