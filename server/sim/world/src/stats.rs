//! Walkability statistics, comparable with real buildings.
//!
//! Measures from the HM3D paper (Ramakrishnan et al. 2021): body radius 0.1 m, height 1.5 m.

use avln_geom::{Point3, RayMesh, Rng, Vector3};
use avln_navmesh::{Body, NavMesh, NavMeshError, NavPoint};
use avln_scene::Scene;

/// A building's walkability.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkStats {
    /// Largest island, square metres.
    pub navigable_m2: f64,
    /// Largest island's share among all floor islands, 0 to 1; islands on furniture do not count.
    pub largest_island: f64,
    /// Largest ratio between geodesic and straight distance, over 20 000 pairs on a floor at least 2 m apart.
    pub complexity: f64,
    /// Largest ratio over all pairs, as in the HM3D paper.
    pub complexity_of_all: f64,
    /// Mesh area within 0.5 m of the navigable floor, divided by the navigable area.
    pub clutter: f64,
    /// Total convex hull area over all floors, square metres.
    pub floor_m2: f64,
    /// Share of rooms reachable from the largest island for a body of radius 0.25 m, 0 to 1; 1 without known
    /// rooms.
    pub rooms_reached: f64,
}

/// Start positions, and goals per start.
const PAIRS: [usize; 2] = [200, 100];
/// Height difference between floors, metres.
const SAME_FLOOR_M: f32 = 0.5;
// Closer pairs only measure wall thickness, metres.
const APART_M: f64 = 2.0;

/// Measures `scene`; `seed` draws the sampled positions.
///
/// # Errors
/// If the scene is not walkable.
pub fn walk_stats(scene: &Scene, seed: u64) -> Result<WalkStats, NavMeshError> {
    let navmesh = NavMesh::build(scene, &Body::default())?;
    // As wide as a person: doors must be passable.
    let wide = NavMesh::build(scene, &Body { radius_m: 0.25, ..Body::default() })?;
    let rng = Rng::new(seed);
    let navigable_m2 = navmesh.island_area_m2(navmesh.largest_island());
    let [complexity_of_all, complexity] = complexity(&navmesh, &mut rng.fork("pairs"));
    Ok(WalkStats {
        navigable_m2,
        largest_island: largest_share(&navmesh, scene, &rng),
        complexity,
        complexity_of_all,
        clutter: clutter_m2(&navmesh, scene) / navigable_m2,
        floor_m2: floor_m2(&navmesh, &mut rng.fork("floors")),
        rooms_reached: rooms_reached(&wide, scene),
    })
}

/// Returns the largest island's share among all floor islands.
fn largest_share(navmesh: &NavMesh, scene: &Scene, rng: &Rng) -> f64 {
    // A floor island is at most 0.3 m above the lowest point of some room, or of the building without rooms.
    let floors: Vec<f32> = match scene.regions.as_slice() {
        [] => scene.bounds().iter().map(|bounds| bounds.min.y).collect(),
        regions => regions.iter().map(|region| region.bounds.min.y).collect(),
    };
    let largest = navmesh.largest_island();
    let on_floor = |island: &u32| {
        let y = navmesh.sample(&mut rng.fork("island"), *island).position().y;
        *island == largest || floors.iter().any(|floor| (y - floor).abs() < 0.3)
    };
    let islands = (0..navmesh.island_count()).filter(on_floor);
    navmesh.island_area_m2(largest) / islands.map(|island| navmesh.island_area_m2(island)).sum::<f64>()
}

/// Returns the largest distance ratio over all pairs, and over distant pairs.
fn complexity(navmesh: &NavMesh, rng: &mut Rng) -> [f64; 2] {
    let island = navmesh.largest_island();
    let mut most = [1.0_f64; 2];
    for _ in 0..PAIRS[0] {
        let start = navmesh.sample(rng, island);
        let field = navmesh.field(&[(start, 0.0)]);
        let mut left = PAIRS[1];
        // On floors with too few positions the draws would never end.
        for _ in 0..20 * PAIRS[1] {
            let goal = navmesh.sample(rng, island);
            let offset = goal.position() - start.position();
            if left == 0 || offset.y.abs() > SAME_FLOOR_M {
                continue;
            }
            left -= 1;
            let straight = f64::from(offset.norm());
            let ratio = field.distance_m(navmesh, &goal).map_or(1.0, |walk| walk / straight.max(1e-3));
            most[0] = most[0].max(ratio);
            most[1] = if straight >= APART_M { most[1].max(ratio) } else { most[1] };
        }
    }
    most
}

/// Returns the surface area within 0.5 m of the largest island.
fn clutter_m2(navmesh: &NavMesh, scene: &Scene) -> f64 {
    const NEAR_M: f32 = 0.5;
    const SMALL_M: f32 = 0.3;
    let near = |point: &Point3<f32>| {
        let found = navmesh.snap(point, NEAR_M);
        found.is_some_and(|found| navmesh.island_of(&found) == navmesh.largest_island())
    };
    let mut area_m2 = 0.0;
    // Triangles are subdivided until small and judged at their centres.
    for index in 0..scene.mesh.triangles.len() {
        let mut open = vec![scene.corners(index)];
        while let Some([a, b, c]) = open.pop() {
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            if longest > SMALL_M {
                open.extend(quarters([a, b, c]));
            } else if near(&Point3::from((a.coords + b.coords + c.coords) / 3.0)) {
                area_m2 += f64::from((b - a).cross(&(c - a)).norm()) / 2.0;
            }
        }
    }
    area_m2
}

/// Returns four triangles between the edge middles.
fn quarters([a, b, c]: [Point3<f32>; 3]) -> [[Point3<f32>; 3]; 4] {
    let middle = |p: Point3<f32>, q: Point3<f32>| Point3::from((p.coords + q.coords) / 2.0);
    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

/// Returns the total convex hull area over all floors.
fn floor_m2(navmesh: &NavMesh, rng: &mut Rng) -> f64 {
    const PLACES: usize = 4000;
    const BAND_M: f32 = 0.2;
    let island = navmesh.largest_island();
    let mut places: Vec<Point3<f32>> = (0..PLACES).map(|_| navmesh.sample(rng, island).position()).collect();
    places.sort_by(|a, b| a.y.total_cmp(&b.y));
    // Floors are height bands of 0.2 m with at least a twentieth of the positions; adjacent bands are merged.
    let band = |place: &Point3<f32>| (place.y / BAND_M + 0.5).floor() as i64;
    let mut floors: Vec<(i64, Vec<[f32; 2]>)> = Vec::new();
    for group in places.chunk_by(|a, b| band(a) == band(b)).filter(|group| group.len() >= PLACES / 20) {
        let flat = group.iter().map(|place| [place.x, place.z]);
        match floors.last_mut().filter(|(last, _)| band(&group[0]) - last <= 1) {
            Some((last, floor)) => {
                *last = band(&group[0]);
                floor.extend(flat);
            }
            None => floors.push((band(&group[0]), flat.collect())),
        }
    }
    floors.into_iter().map(|(_, floor)| hull_m2(floor)).sum()
}

/// Returns the convex hull area (monotone chain).
fn hull_m2(mut points: Vec<[f32; 2]>) -> f64 {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turn = |a: [f32; 2], b: [f32; 2], c: [f32; 2]| {
        let [ab, ac] = [b, c].map(|p| [f64::from(p[0] - a[0]), f64::from(p[1] - a[1])]);
        ab[0] * ac[1] - ab[1] * ac[0]
    };
    let chain = |points: &mut dyn Iterator<Item = [f32; 2]>| {
        let mut chain: Vec<[f32; 2]> = Vec::new();
        for point in points {
            while chain.len() >= 2 && turn(chain[chain.len() - 2], chain[chain.len() - 1], point) <= 0.0 {
                chain.pop();
            }
            chain.push(point);
        }
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    (1..hull.len()).map(|i| turn(hull[0], hull[i - 1], hull[i])).sum::<f64>() / 2.0
}

/// Returns the share of rooms with a position on the largest island.
fn rooms_reached(navmesh: &NavMesh, scene: &Scene) -> f64 {
    if scene.regions.is_empty() {
        return 1.0;
    }
    let largest = navmesh.largest_island();
    let entered = |region: &&avln_scene::Region| {
        let inside = |place: &NavPoint| navmesh.island_of(place) == largest;
        navmesh.grid(&region.bounds.grown(0.05), 0.1).iter().any(inside)
    };
    scene.regions.iter().filter(entered).count() as f64 / scene.regions.len() as f64
}

/// Returns the share of rays that meet a surface within 100 m, 0 to 1: 1 for closed buildings. Rays start in
/// room centres, 1.3 m above the floor.
pub fn closed_share(scene: &Scene) -> f64 {
    const RAYS: usize = 400;
    let mesh = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
    let direction = |index: usize| {
        // A Fibonacci sphere spreads directions evenly: https://arxiv.org/abs/0912.4540
        let y = 1.0 - (2 * index + 1) as f32 / RAYS as f32;
        let (sin, cos) = avln_geom::angle::sin_cos(2.399_963_2 * index as f32);
        let radius = (1.0 - y * y).sqrt();
        Vector3::new(radius * cos, y, radius * sin)
    };
    let mut met = 0;
    for region in &scene.regions {
        let mut eye = region.bounds.center();
        eye.y = region.bounds.min.y + 1.3;
        met += (0..RAYS).filter(|&index| mesh.cast(&eye, &direction(index), 100.0).is_some()).count();
    }
    met as f64 / (RAYS * scene.regions.len()).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hull_ignores_inner_points() {
        let square = vec![[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.0, 2.0], [0.5, 1.5], [1.0, 0.0]];
        assert!((hull_m2(square) - 4.0).abs() < 1e-9);
        assert_eq!(hull_m2(vec![[1.0, 1.0]; 3]), 0.0);
    }
}
