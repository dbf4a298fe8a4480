//! Outlines of rooms: their triangles, and what lies inside.

use avln_geom::Point2;

/// Corners of an outline.
pub(super) const MAX_CORNERS: usize = 256;
/// Twice the area of a triangle that counts as flat, square metres.
const FLAT_M2: f32 = 1e-6;

/// Triangles that fill a simple outline, by cutting off ears; all turn the way the outline does. `None` where that fails
/// (the outline crosses itself).
pub(super) fn triangles(outline: &[Point2<f32>]) -> Option<Vec<[u32; 3]>> {
    if crosses_itself(outline) {
        return None;
    }
    let turn = signed_area_m2(outline).signum();
    let mut left: Vec<usize> = (0..outline.len()).collect();
    let mut found = Vec::new();
    while left.len() > 3 {
        let ear = (0..left.len()).find(|&at| is_ear(outline, &left, at, turn))?;
        let [before, tip, after] = around(&left, ear);
        if turned(outline, [before, tip, after]).abs() > FLAT_M2 {
            found.push([before as u32, tip as u32, after as u32]);
        }
        left.remove(ear);
    }
    found.push([*left.first()? as u32, *left.get(1)? as u32, *left.get(2)? as u32]);
    Some(found)
}

/// Whether two sides cross, other than by ending on each other.
fn crosses_itself(outline: &[Point2<f32>]) -> bool {
    let count = outline.len();
    let are_apart = |line: [usize; 2], a: usize, b: usize| {
        let [first, second] = [a, b].map(|point| turned(outline, [line[0], line[1], point]));
        first * second < 0.0
    };
    let side = |at: usize| [at, (at + 1) % count];
    let pairs = (0..count).flat_map(|one| (one + 1..count).map(move |other| (one, other)));
    pairs.into_iter().any(|(one, other)| {
        let (one, other) = (side(one), side(other));
        are_apart(one, other[0], other[1]) && are_apart(other, one[0], one[1])
    })
}

fn around(left: &[usize], at: usize) -> [usize; 3] {
    let count = left.len();
    [left[(at + count - 1) % count], left[at], left[(at + 1) % count]]
}

/// Twice the signed area of a triangle.
fn turned(outline: &[Point2<f32>], [a, b, c]: [usize; 3]) -> f32 {
    let (first, second) = (outline[b] - outline[a], outline[c] - outline[b]);
    first.x * second.y - first.y * second.x
}

/// Whether the corner can be cut off: it is convex, or flat, and no other corner lies in its triangle.
fn is_ear(outline: &[Point2<f32>], left: &[usize], at: usize, turn: f32) -> bool {
    let corners = around(left, at);
    let area = turned(outline, corners) * turn;
    if area.abs() <= FLAT_M2 {
        return true;
    }
    let inside = |point: usize| {
        let [a, b, c] = corners;
        [[a, b], [b, c], [c, a]].iter().all(|&[from, to]| turned(outline, [from, to, point]) * turn > 0.0)
    };
    area > 0.0 && !left.iter().any(|&point| !corners.contains(&point) && inside(point))
}

/// Positive where the outline turns from the first axis to the second.
pub(super) fn signed_area_m2(outline: &[Point2<f32>]) -> f32 {
    let edges = (0..outline.len()).map(|at| (outline[at], outline[(at + 1) % outline.len()]));
    edges.map(|(a, b)| a.x * b.y - a.y * b.x).sum::<f32>() / 2.0
}

/// Whether a point lies inside (even-odd rule).
pub(super) fn holds(outline: &[Point2<f32>], point: &Point2<f32>) -> bool {
    let edges = (0..outline.len()).map(|at| (outline[at], outline[(at + 1) % outline.len()]));
    let crossed = edges.filter(|(a, b)| {
        (a.y > point.y) != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossed.count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(outline: &[Point2<f32>], triangles: &[[u32; 3]]) -> f32 {
        triangles.iter().map(|triangle| turned(outline, triangle.map(|corner| corner as usize)) / 2.0).sum()
    }

    #[test]
    fn an_l_shape_is_filled_whichever_way_it_turns() {
        // 4 x 4 less the 2 x 2 corner, with a corner in the middle of an edge.
        let mut outline: Vec<Point2<f32>> =
            [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 4.0], [0.0, 4.0]]
                .map(Point2::from)
                .to_vec();
        for sign in [1.0, -1.0] {
            let found = triangles(&outline).unwrap();
            assert_eq!(area(&outline, &found), sign * 12.0);
            assert_eq!(signed_area_m2(&outline), sign * 12.0);
            assert!(holds(&outline, &Point2::new(1.0, 3.0)) && !holds(&outline, &Point2::new(3.0, 3.0)));
            outline.reverse();
        }
    }

    #[test]
    fn what_is_no_outline_has_no_triangles() {
        assert_eq!(triangles(&[]), None);
        assert_eq!(triangles(&[Point2::origin(); 2]), None);
        let bow_tie = [[0.0, 0.0], [3.0, 2.0], [3.0, 0.0], [0.0, 2.0]].map(Point2::from);
        assert_eq!(triangles(&bow_tie), None);
    }
}
