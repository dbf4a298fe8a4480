//! Polygons as triangles.

use avln_geom::{Point3, Vector3};

/// Polygons with more corners are cut as a fan.
const MAX_EARS: usize = 64;

/// Cuts the polygon `corners` (indices into `positions`, which must exist) into triangles of the same winding, by clipping ears;
/// triangles that use a corner twice are left out.
pub fn triangulate(positions: &[Point3<f32>], corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let add = |[a, b, c]: [u32; 3]| {
        if a != b && b != c && c != a {
            triangles.push([a, b, c]);
        }
    };
    if corners.len() <= 3 || corners.len() > MAX_EARS {
        (2..corners.len()).map(|last| [corners[0], corners[last - 1], corners[last]]).for_each(add);
    } else {
        clip_ears(positions, corners.to_vec(), add);
    }
}

/// Cuts a polygon of at least three corners into triangles, however many there are, in the plane that Newell's formula gives
/// (M. E. Newell in Sutherland, Sproull and Schumacker 1974).
pub fn clip_ears(positions: &[Point3<f32>], mut rest: Vec<u32>, mut add: impl FnMut([u32; 3])) {
    let at = |corner: u32| positions[corner as usize];
    let normal = newell(rest.iter().map(|&corner| at(corner)));
    while rest.len() > 3 {
        let count = rest.len();
        // The last corner but one first: a convex polygon becomes the fan around its first corner.
        let ear = (1..=count).find(|&ear| is_ear(&rest, ear % count, &at, &normal)).unwrap_or(1) % count;
        add(around(&rest, ear));
        rest.remove(ear);
    }
    add([rest[0], rest[1], rest[2]]);
}

/// The corner `middle` between its neighbours.
fn around(ring: &[u32], middle: usize) -> [u32; 3] {
    let count = ring.len();
    [ring[(middle + count - 1) % count], ring[middle], ring[(middle + 1) % count]]
}

fn newell(ring: impl Iterator<Item = Point3<f32>> + Clone) -> Vector3<f32> {
    let next = ring.clone().cycle().skip(1);
    ring.zip(next).fold(Vector3::zeros(), |sum, (a, b)| sum + a.coords.cross(&b.coords))
}

/// Whether cutting off `middle` leaves a polygon: the corner points outwards and no other lies in the triangle.
fn is_ear(ring: &[u32], middle: usize, at: &impl Fn(u32) -> Point3<f32>, normal: &Vector3<f32>) -> bool {
    let triangle = around(ring, middle);
    let [a, b, c] = triangle.map(at);
    let side = |from: Point3<f32>, to: Point3<f32>, point: Point3<f32>| {
        (to - from).cross(&(point - from)).dot(normal)
    };
    if side(a, b, c) <= 0.0 {
        return false;
    }
    let inside =
        |point: Point3<f32>| side(a, b, point) >= 0.0 && side(b, c, point) >= 0.0 && side(c, a, point) >= 0.0;
    let others = ring.iter().filter(|corner| !triangle.contains(corner));
    others.map(|&corner| at(corner)).all(|point| !inside(point))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(points: &[[f32; 2]]) -> (Vec<[u32; 3]>, f32) {
        let positions: Vec<Point3<f32>> = points.iter().map(|&[x, z]| Point3::new(x, 1.0, z)).collect();
        let corners: Vec<u32> = (0..points.len() as u32).collect();
        let mut triangles = Vec::new();
        triangulate(&positions, &corners, &mut triangles);
        let area = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|corner| positions[corner as usize]);
            (b - a).cross(&(c - a)).y / 2.0
        };
        let total = triangles.iter().map(|&triangle| area(triangle)).sum();
        assert!(triangles.iter().all(|&triangle| area(triangle) > 0.0) || points.len() > MAX_EARS);
        (triangles, total)
    }

    #[test]
    fn a_quad_is_cut_along_the_diagonal_from_its_first_corner() {
        let (triangles, area) = cut(&[[0.0, 0.0], [0.0, 2.0], [3.0, 2.0], [3.0, 0.0]]);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(area, 6.0);
    }

    #[test]
    fn a_quad_with_an_inward_corner_is_cut_inside() {
        // The corner (1, 1) points inwards: only the diagonal through it stays inside.
        let (triangles, area) = cut(&[[0.0, 0.0], [1.0, 1.0], [0.0, 4.0], [4.0, 0.0]]);
        assert_eq!(triangles.len(), 2);
        assert!((area - 6.0).abs() < 1e-6, "{area}");
        assert!(triangles.iter().all(|triangle| triangle.contains(&1)));
    }

    #[test]
    fn an_l_keeps_its_area() {
        let (triangles, area) =
            cut(&[[0.0, 0.0], [0.0, 4.0], [1.0, 4.0], [1.0, 1.0], [3.0, 1.0], [3.0, 0.0]]);
        assert_eq!((triangles.len(), area), (4, 6.0));
    }

    #[test]
    fn corners_used_twice_make_no_triangle() {
        let positions = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)];
        let mut triangles = Vec::new();
        triangulate(&positions, &[0, 1, 1], &mut triangles);
        triangulate(&positions, &[0, 1], &mut triangles);
        assert!(triangles.is_empty());
        triangulate(&positions, &[0, 1, 2, 2], &mut triangles);
        assert_eq!(triangles, [[0, 1, 2]]);
    }
}
