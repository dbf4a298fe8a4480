//! Tightening of paths around edges.

use avln_geom::{Point3, RayMesh};

/// Shortens `way` in place until it touches the edges, to 1 or 2 cm; both ends stay.
///
/// Redundant corners are dropped; the others move towards the line between their neighbours until they touch
/// an obstacle, and on towards the next corner. A corner around two edges (the jambs of a thick wall) is
/// split.
pub(crate) fn tighten(rays: &RayMesh, way: &mut Vec<Point3<f32>>) {
    sweep(rays, way);
    let mut corner = 1;
    while corner + 1 < way.len() {
        let pair = cut(rays, [way[corner - 1], way[corner], way[corner + 1]]);
        way.splice(corner..=corner, pair);
        corner += 2;
    }
    sweep(rays, way);
    sweep(rays, way);
}

fn sweep(rays: &RayMesh, way: &mut Vec<Point3<f32>>) {
    let mut corner = 1;
    while corner + 1 < way.len() {
        if rays.is_clear(&way[corner - 1], &way[corner + 1]) {
            way.remove(corner);
        } else {
            pull(rays, way, corner);
            slide(rays, way, corner);
            corner += 1;
        }
    }
}

/// Moves a corner towards the next, as far as it is visible from the previous corner: the path then leaves
/// the previous corner exactly past the hiding edge.
fn slide(rays: &RayMesh, way: &mut [Point3<f32>], corner: usize) {
    let (before, from) = (way[corner - 1], way[corner]);
    let leg = way[corner + 1] - from;
    way[corner] = from + leg * largest_share(|share| rays.is_clear(&before, &(from + leg * share)));
}

/// Moves a corner towards the line between its neighbours, first vertically, then freely.
fn pull(rays: &RayMesh, way: &mut [Point3<f32>], corner: usize) {
    let (before, after) = (way[corner - 1], way[corner + 1]);
    let leg = after - before;
    for level_only in [true, false] {
        let from = way[corner];
        let along = (from - before).dot(&leg) / leg.norm_squared().max(f32::MIN_POSITIVE);
        let mut offset = before + leg * along.clamp(0.0, 1.0) - from;
        if level_only {
            (offset.x, offset.z) = (0.0, 0.0);
        }
        let fits = |share: f32| {
            let point = from + offset * share;
            rays.is_clear(&before, &point) && rays.is_clear(&point, &after)
        };
        way[corner] = from + offset * largest_share(fits);
    }
}

/// Two mutually visible points on the legs before and after a corner, as far from it as possible.
fn cut(rays: &RayMesh, [before, corner, after]: [Point3<f32>; 3]) -> [Point3<f32>; 2] {
    let shorter_m = (before - corner).norm().min((after - corner).norm());
    let towards = |end: &Point3<f32>, share: f32| {
        let leg = end - corner;
        corner + leg * (0.9 * share * shorter_m / leg.norm().max(f32::MIN_POSITIVE))
    };
    let ends = |share: f32| [towards(&before, share), towards(&after, share)];
    let share = largest_share(|share| {
        let [one, other] = ends(share);
        rays.is_clear(&one, &other)
    });
    ends(share)
}

/// The largest share, to one part in 64, accepted by `fits`; 0 is assumed to fit.
fn largest_share(fits: impl Fn(f32) -> bool) -> f32 {
    if fits(1.0) {
        return 1.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..6 {
        let middle = 0.5 * (low + high);
        if fits(middle) { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall from y = 0 up, 10 m high and wide, `thick_m` deep behind x = 0, that ends at z = 0.
    fn wall(thick_m: f32) -> RayMesh {
        let sheet = |x: f32| [(x, 0.0, 0.0), (x, 10.0, 0.0), (x, 10.0, 10.0), (x, 0.0, 10.0)];
        let end = [(0.0, 0.0, 0.0), (thick_m, 0.0, 0.0), (thick_m, 10.0, 0.0), (0.0, 10.0, 0.0)];
        let corners: Vec<_> = [sheet(0.0), sheet(thick_m), end].concat();
        let corners: Vec<_> = corners.into_iter().map(|(x, y, z)| Point3::new(x, y, z)).collect();
        let triangles: Vec<_> =
            [0, 4, 8].iter().flat_map(|i| [[*i, i + 1, i + 2], [*i, i + 2, i + 3]]).collect();
        RayMesh::new(&corners, &triangles)
    }

    fn length_m(way: &[Point3<f32>]) -> f32 {
        way.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum()
    }

    #[test]
    fn a_slack_way_comes_to_lie_against_one_edge_or_two() {
        let (from, to) = (Point3::new(-2.0, 4.0, 1.5), Point3::new(2.5, 4.0, 2.0));
        // Around the edge at x = 0, and with a second one at x = 0.5.
        for (thick_m, taut_m) in [(0.001, 2.5 + 3.2016), (0.5, 2.5 + 0.5 + 2.8284)] {
            let mut way = vec![from, Point3::new(0.1, 4.3, -0.3), to];
            tighten(&wall(thick_m), &mut way);
            assert!(
                (-0.002..0.03).contains(&(length_m(&way) - taut_m)),
                "{} m of {taut_m} m",
                length_m(&way)
            );
        }
    }

    #[test]
    fn a_bend_around_nothing_is_straightened() {
        let mut way =
            vec![Point3::new(-2.0, 1.0, -1.0), Point3::new(0.0, 3.0, -4.0), Point3::new(2.0, 1.0, -1.0)];
        tighten(&wall(0.2), &mut way);
        assert_eq!(way.len(), 2);
    }
}
