//! Polygon triangulation, by the crate `earcut`.

use avln_geom::{Point3, Vector3};
use earcut::Earcut;

/// Largest relative difference between outline area and total triangle area; a larger one means that the outline
/// crosses itself.
const MAX_AREA_DIFFERENCE: f64 = 1e-3;

/// Cuts the polygon `corners` (indices into `positions`) into triangles with the same winding, and appends them to `triangles`.
///
/// Triangles with a repeated corner are left out.
///
/// # Panics
/// If a corner is not an index into `positions`.
pub fn triangulate(positions: &[Point3<f32>], corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    let points = corners.iter().map(|&corner| positions[corner as usize].cast::<f64>());
    let found = match corners.len() {
        0..3 => Vec::new(),
        3 => vec![[0, 1, 2]],
        _ => triangulate_outline(&projected(points)),
    };
    let named = found.into_iter().map(|triangle| triangle.map(|index| corners[index as usize]));
    triangles.extend(named.filter(|[a, b, c]| a != b && b != c && c != a));
}

/// Cuts a flat outline into triangles with the same winding: indices into `outline`.
///
/// A convex outline becomes a fan around the first corner.
pub fn triangulate_outline(outline: &[[f64; 2]]) -> Vec<[u32; 3]> {
    // Nearly all scan faces are convex. A fan makes triangle order, and with it the scene's digest, independent
    // from the library version.
    if is_convex(outline) {
        return (2..outline.len() as u32).map(|last| [0, last - 1, last]).collect();
    }
    let mut indices: Vec<u32> = Vec::new();
    Earcut::new().earcut(outline.iter().copied(), &[], &mut indices);
    // The library turns all triangles the same way, whichever way the outline turns.
    let winding = signed_area(outline);
    let mut triangles = indices.as_chunks::<3>().0.to_vec();
    for triangle in &mut triangles {
        if signed_area(&triangle.map(|corner| outline[corner as usize])) * winding < 0.0 {
            triangle.swap(1, 2);
        }
    }
    triangles
}

/// Returns whether `triangles` fill `outline`; they do not if it crosses itself.
pub fn fills_outline(outline: &[[f64; 2]], triangles: &[[u32; 3]]) -> bool {
    let area = signed_area(outline).abs();
    let corners = |triangle: &[u32; 3]| triangle.map(|corner| outline[corner as usize]);
    let filled: f64 = triangles.iter().map(|triangle| signed_area(&corners(triangle)).abs()).sum();
    area > 0.0 && (filled - area).abs() <= MAX_AREA_DIFFERENCE * area
}

/// Signed area, positive if it turns from the first axis to the second.
pub fn signed_area(outline: &[[f64; 2]]) -> f64 {
    let edges = outline.iter().zip(outline.iter().cycle().skip(1));
    edges.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
}

/// Coordinates without the normal's main axis, by Newell's formula (M. E. Newell in Sutherland, Sproull and
/// Schumacker 1974).
fn projected(points: impl Iterator<Item = Point3<f64>> + Clone) -> Vec<[f64; 2]> {
    let next = points.clone().cycle().skip(1);
    let normal =
        points.clone().zip(next).fold(Vector3::zeros(), |sum, (a, b)| sum + a.coords.cross(&b.coords));
    let main = normal.abs().imax();
    let [first, second] = [(main + 1) % 3, (main + 2) % 3];
    points.map(|point| [point[first], point[second]]).collect()
}

/// Returns whether all corners turn the same way, in a single turn.
fn is_convex(outline: &[[f64; 2]]) -> bool {
    let count = outline.len();
    let edge = |at: usize| {
        let [a, b] = [outline[at % count], outline[(at + 1) % count]];
        [b[0] - a[0], b[1] - a[1]]
    };
    let winding = signed_area(outline);
    let turns = (0..count).all(|at| {
        let [before, after] = [edge(at), edge(at + 1)];
        (before[0] * after[1] - before[1] * after[0]) * winding > 0.0
    });
    // A five-pointed star turns the same way everywhere, but changes direction in x more than twice.
    let goes_right: Vec<bool> = (0..count).map(|at| edge(at)[0] > 0.0).collect();
    let changes = (0..count).filter(|&at| goes_right[at] != goes_right[(at + 1) % count]).count();
    turns && changes <= 2
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
        assert!(triangles.iter().all(|&triangle| area(triangle) > 0.0));
        (triangles, total)
    }

    #[test]
    fn convex_quad_is_cut_from_its_first_corner() {
        let (triangles, area) = cut(&[[0.0, 0.0], [0.0, 2.0], [3.0, 2.0], [3.0, 0.0]]);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(area, 6.0);
    }

    #[test]
    fn concave_quad_is_cut_inside() {
        // The corner (1, 1) points inwards: only the diagonal through it stays inside.
        let (triangles, area) = cut(&[[0.0, 0.0], [1.0, 1.0], [0.0, 4.0], [4.0, 0.0]]);
        assert_eq!(triangles.len(), 2);
        assert!((area - 6.0).abs() < 1e-6, "{area}");
        assert!(triangles.iter().all(|triangle| triangle.contains(&1)));
    }

    #[test]
    fn l_shape_preserves_its_area() {
        let (triangles, area) =
            cut(&[[0.0, 0.0], [0.0, 4.0], [1.0, 4.0], [1.0, 1.0], [3.0, 1.0], [3.0, 0.0]]);
        assert_eq!((triangles.len(), area), (4, 6.0));
    }

    #[test]
    fn large_concave_polygon_preserves_its_area() {
        let corner = |index: usize| {
            let (sin, cos) = avln_geom::angle::sin_cos(index as f32 / 100.0 * std::f32::consts::TAU);
            let radius = if index.is_multiple_of(2) { 4.0 } else { 3.0 };
            [radius * sin, radius * cos]
        };
        let points: Vec<[f32; 2]> = (0..100).map(corner).collect();
        let exact = signed_area(&points.iter().map(|point| point.map(f64::from)).collect::<Vec<_>>());
        assert!((f64::from(cut(&points).1) - exact.abs()).abs() < 1e-3);
    }

    #[test]
    fn repeated_corners_make_no_triangle() {
        let positions = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)];
        let mut triangles = Vec::new();
        triangulate(&positions, &[0, 1, 1], &mut triangles);
        triangulate(&positions, &[0, 1], &mut triangles);
        assert!(triangles.is_empty());
        triangulate(&positions, &[0, 1, 2, 2], &mut triangles);
        assert_eq!(triangles.len(), 1);
    }

    #[test]
    fn outlines_that_cross_themselves_are_not_filled() {
        let star = [[0.0, 3.0], [2.0, -2.0], [-3.0, 1.0], [3.0, 1.0], [-2.0, -2.0]];
        let bow_tie = [[0.0, 0.0], [3.0, 2.0], [3.0, 0.0], [0.0, 2.0]];
        for outline in [&star[..], &bow_tie, &[]] {
            assert!(!fills_outline(outline, &triangulate_outline(outline)), "{outline:?}");
        }
    }
}
