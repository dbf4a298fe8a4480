//! Steps, distances and grids on a single floor and on two storeys.

use crate::{Builder, hall, two_rooms};
use avln_geom::{Aabb, Point3, Rng, Vector3};
use avln_navmesh::{NavMesh, NavPoint};

/// A lattice cell: the error of a path around a wall due to rasterisation.
const CELL_M: f64 = 0.05;

fn at(mesh: &NavMesh, x: f32, z: f32) -> NavPoint {
    mesh.snap(&Point3::new(x, 0.0, z), 0.1).expect("on the floor")
}

fn flat_distance(a: &NavPoint, b: &NavPoint) -> f64 {
    f64::from((a.position() - b.position()).xz().norm())
}

#[test]
fn area_excludes_a_rim_of_body_radius() {
    let mesh = hall().build();
    let expected = 9.8 * 5.8;
    let island = mesh.largest_island();
    assert!((mesh.island_area_m2(island) - expected).abs() < 1.0, "{}", mesh.island_area_m2(island));
    assert!(mesh.area_m2() >= mesh.island_area_m2(island));
}

#[test]
fn area_excludes_furniture() {
    let mesh = hall().block([3.0, 0.0, 2.0], [5.0, 1.0, 4.0]).block([7.0, 0.0, 3.0], [8.0, 3.0, 4.0]).build();
    // The hall without the rim, 9.8 x 5.8 m, minus two blocks with rims, 2.2 x 2.2 m and 1.2 x 1.2 m.
    let area_m2 = mesh.island_area_m2(mesh.largest_island());
    assert!((area_m2 - (56.84 - 4.84 - 1.44)).abs() < 1.5, "{area_m2}");
    assert_eq!(mesh.snap(&Point3::new(7.5, 0.0, 3.5), 0.5), None);
    let (left, right) = (at(&mesh, 2.5, 3.0), at(&mesh, 5.5, 3.0));
    // Around two corners of the first block, (3, 2) and (5, 2), 0.1 m off: 2 * sqrt(0.4^2 + 1.1^2) + 2.2 = 4.541.
    let distance = mesh.distance_m(&left, &right).unwrap();
    assert!((distance - 4.541).abs() < 2.0 * CELL_M, "{distance}");
}

#[test]
fn distances_around_a_wall_match_hand_computed_values() {
    let mesh = two_rooms();
    // Straight through the doorway.
    let (a, b) = (at(&mesh, 2.0, 3.0), at(&mesh, 8.0, 3.0));
    assert!((mesh.distance_m(&a, &b).unwrap() - 6.0).abs() < 1e-5);
    // Around both ends of the lower wall at the body's radius, (4.95, 2.6) and (5.05, 2.6):
    // 2 * sqrt(2.95^2 + 1.6^2) + 0.1 = 6.812.
    let (a, b) = (at(&mesh, 2.0, 1.0), at(&mesh, 8.0, 1.0));
    let distance = mesh.distance_m(&a, &b).unwrap();
    assert!((distance - 6.812).abs() < CELL_M, "{distance}");
    // Diagonally: below the upper end on the left, above the lower end on the right; the straight line is free.
    let (a, b) = (at(&mesh, 4.0, 2.4), at(&mesh, 6.0, 3.6));
    let distance = mesh.distance_m(&a, &b).unwrap();
    assert!((distance - 4_f64.mul_add(1.0, 1.44).sqrt()).abs() < 1e-5, "{distance}");
}

#[test]
fn path_length_is_the_distance() {
    let mesh = two_rooms();
    let mut rng = Rng::new(11);
    for _ in 0..200 {
        let (a, b) = (mesh.sample(&mut rng, 0), mesh.sample(&mut rng, 0));
        let path = mesh.path(&a, &b).unwrap();
        assert_eq!((path[0], path[path.len() - 1]), (a.position(), b.position()));
        let length: f64 = path.windows(2).map(|leg| f64::from((leg[1] - leg[0]).xz().norm())).sum();
        let distance = mesh.distance_m(&a, &b).unwrap();
        assert!((length - distance).abs() < 1e-4, "{length} {distance}");
    }
}

#[test]
fn distance_is_a_metric() {
    let mesh = two_rooms();
    let mut rng = Rng::new(12);
    for _ in 0..300 {
        let [a, b, c] = [(); 3].map(|()| mesh.sample(&mut rng, 0));
        let distance = |p: &NavPoint, q: &NavPoint| mesh.distance_m(p, q).unwrap();
        assert_eq!(distance(&a, &b).to_bits(), distance(&b, &a).to_bits());
        assert!(distance(&a, &c) <= distance(&a, &b) + distance(&b, &c) + 1e-9);
        assert!(distance(&a, &b) >= flat_distance(&a, &b) - 1e-5);
        assert!(distance(&a, &a) < 1e-9);
    }
}

#[test]
fn rooms_without_an_opening_are_two_islands() {
    let mesh = hall().block([4.95, 0.0, 0.0], [5.05, 2.5, 6.0]).build();
    let (a, b) = (at(&mesh, 2.0, 3.0), at(&mesh, 8.0, 3.0));
    assert_ne!(mesh.island_of(&a), mesh.island_of(&b));
    assert_eq!((mesh.distance_m(&a, &b), mesh.path(&a, &b)), (None, None));
    let field = mesh.field(&[(a, 0.0)]);
    assert_eq!((field.distance_m(&mesh, &b), field.path(&mesh, &b)), (None, None));
    assert_eq!(mesh.field(&[]).distance_m(&mesh, &b), None);
}

#[test]
fn sliding_preserves_the_part_parallel_to_the_wall() {
    let mesh = two_rooms();
    let free = mesh.slide(&at(&mesh, 2.0, 2.0), &Vector3::new(0.15, 0.0, -0.2));
    assert!(!free.blocked);
    assert!((free.end.position() - Point3::new(2.15, 0.0, 1.8)).norm() < 1e-5);
    // The wall at z = 0 limits the body centre to z = 0.1; 0.15 m of 0.25 m are parallel to it.
    let start = at(&mesh, 2.0, 0.12);
    let along = mesh.slide(&start, &Vector3::new(0.15, 0.0, -0.2));
    assert!(along.blocked);
    assert!((along.end.position().x - 2.15).abs() < 1e-5, "{:?}", along.end);
    assert!((f64::from(along.end.position().z) - 0.1).abs() < CELL_M);
    let against = mesh.slide(&along.end, &Vector3::new(0.0, 0.0, -0.25));
    assert!(against.blocked);
    assert!((against.end.position() - along.end.position()).norm() < 1e-5);
    assert_eq!(mesh.slide(&start, &Vector3::new(f32::NAN, 0.0, 0.0)).end, start);
}

#[test]
fn random_walk_stays_on_its_island() {
    let mesh = two_rooms();
    let mut rng = Rng::new(13);
    let mut here = mesh.sample(&mut rng, 0);
    for _ in 0..20_000 {
        let asked = Vector3::new(rng.range(-0.5, 0.5), 0.0, rng.range(-0.5, 0.5));
        let slide = mesh.slide(&here, &asked);
        // The first wall on the way is a place to end at, so the end is no farther from the aim than the start was.
        let (moved, length) = (flat_distance(&here, &slide.end), f64::from(asked.norm()));
        let missed = f64::from((here.position() + asked - slide.end.position()).xz().norm());
        assert!(missed <= length + 1e-5, "{missed} of {asked}");
        assert!(slide.blocked == (missed > 1e-5) && (slide.blocked || moved > length - 1e-5), "{slide:?}");
        let snapped = mesh.snap(&slide.end.position(), 1e-3).expect("still on the mesh");
        assert_eq!(mesh.island_of(&slide.end), mesh.island_of(&snapped));
        here = slide.end;
    }
}

#[test]
fn field_is_the_minimum_over_seeds() {
    let mesh = two_rooms();
    let mut rng = Rng::new(14);
    let seeds: Vec<_> = (0..7).map(|_| (mesh.sample(&mut rng, 0), rng.unit() * 3.0)).collect();
    let field = mesh.field(&seeds);
    for _ in 0..200 {
        let point = mesh.sample(&mut rng, 0);
        let ways = seeds.iter().map(|(seed, weight)| weight + mesh.distance_m(&point, seed).unwrap());
        let expected = ways.fold(f64::INFINITY, f64::min);
        let distance = field.distance_m(&mesh, &point).unwrap();
        assert!((distance - expected).abs() < 1e-9, "{distance} {expected}");
        let path = field.path(&mesh, &point).unwrap();
        assert!(seeds.iter().any(|(seed, _)| seed.position() == path[path.len() - 1]));
    }
}

#[test]
fn grids_and_samples_repeat_and_cover() {
    let mesh = two_rooms();
    let bounds = Aabb::new(Point3::new(1.0, -0.5, 1.0), Point3::new(3.0, 0.5, 2.0));
    let grid = mesh.grid(&bounds, 0.5);
    let places: Vec<_> = grid.iter().map(|point| (point.position().x, point.position().z)).collect();
    let expected: Vec<_> =
        (2..=6).flat_map(|x| (2..=4).map(move |z| (x as f32 * 0.5, z as f32 * 0.5))).collect();
    assert_eq!(places.len(), expected.len());
    for (place, expected) in places.iter().zip(&expected) {
        assert!((place.0 - expected.0).abs() + (place.1 - expected.1).abs() < 1e-5, "{place:?} {expected:?}");
    }
    assert!(mesh.grid(&bounds, 0.0).is_empty() && mesh.grid(&bounds, f32::NAN).is_empty());

    let again = two_rooms();
    assert_eq!(mesh.polygons(), again.polygons());
    assert_eq!(grid, again.grid(&bounds, 0.5));
    let draw = |mesh: &NavMesh| {
        let mut rng = Rng::new(15);
        (0..4000).map(|_| mesh.sample(&mut rng, 0)).collect::<Vec<_>>()
    };
    let samples = draw(&mesh);
    assert_eq!(samples, draw(&again));
    // The rooms are equal, so half of the samples fall into each.
    let left = samples.iter().filter(|point| point.position().x < 5.0).count();
    assert!((1850..2150).contains(&left), "{left}");
}

#[test]
fn snapping_finds_the_nearest_floor_within_reach() {
    let mesh = two_rooms();
    let over_the_wall = Point3::new(5.0, 0.0, 1.0);
    assert_eq!(mesh.snap(&over_the_wall, 0.1), None);
    let beside = mesh.snap(&over_the_wall, 0.3).expect("15 cm away");
    assert!((f64::from((beside.position().x - 5.0).abs()) - 0.15).abs() < CELL_M, "{beside:?}");
    let far = mesh.snap(&Point3::new(-30.0, 0.0, 3.0), 100.0).expect("30 m away");
    assert!((far.position() - Point3::new(0.1, 0.0, 3.0)).norm() < 0.06, "{far:?}");
    assert_eq!(mesh.snap(&Point3::new(-30.0, 0.0, 3.0), 1.0), None);
    assert_eq!(mesh.snap(&Point3::new(f32::NAN, 0.0, 3.0), 1.0), None);
    assert_eq!(mesh.snap(&Point3::new(2.0, 0.05, 3.0), 0.1).unwrap().position().y, 0.0);
}

#[test]
fn main_island_is_neither_roof_nor_table() {
    let table = hall().block([2.0, 0.7, 2.0], [4.0, 0.75, 4.0]);
    let mesh = table.block([-0.2, 2.5, -0.2], [10.2, 2.7, 6.2]).build();
    let floor = at(&mesh, 8.0, 3.0);
    assert_eq!(mesh.island_of(&floor), mesh.largest_island());
    let roof = mesh.snap(&Point3::new(5.0, 2.7, 3.0), 0.1).expect("a flat roof");
    assert!(mesh.island_area_m2(mesh.island_of(&roof)) > mesh.island_area_m2(mesh.largest_island()));
    let top = mesh.snap(&Point3::new(3.0, 0.75, 3.0), 0.1).expect("a table top with headroom");
    assert_eq!(mesh.distance_m(&floor, &top), None);
    assert_eq!(mesh.island_count(), 3);
}

#[test]
fn body_stays_a_radius_off_walls() {
    let scene =
        Builder::default().floor([0.0; 3], [10.0, 0.0, 6.0]).walls_around([0.0, 0.0], [10.0, 6.0]).scene();
    let wide = avln_navmesh::Body { radius_m: 0.5, ..Default::default() };
    let mesh = NavMesh::build(&scene, &wide).unwrap();
    let corner = mesh.snap(&Point3::origin(), 2.0).unwrap();
    assert!((corner.position() - Point3::new(0.5, 0.0, 0.5)).norm() < 0.1, "{corner:?}");
}

#[test]
fn distance_table_equals_single_distances() {
    let mesh = two_rooms();
    let mut rng = Rng::new(16);
    let [from, to] = [12, 9].map(|count| (0..count).map(|_| mesh.sample(&mut rng, 0)).collect::<Vec<_>>());
    let table = mesh.distances_m(&from, &to);
    assert_eq!((table.len(), table[0].len()), (12, 9));
    for (row, a) in table.iter().zip(&from) {
        for (entry, b) in row.iter().zip(&to) {
            let (one, field) =
                (mesh.distance_m(a, b).unwrap(), mesh.field(&[(*b, 0.0)]).distance_m(&mesh, a));
            assert!((entry.unwrap() - one).abs() < 1e-9 && *entry == field, "{entry:?} {one}");
        }
    }
}

const RISE_M: f32 = 0.18;
const STEPS: usize = 15;
const UPPER_M: f32 = RISE_M * STEPS as f32;

/// A ground floor of 12 x 4 m with an upper floor. A flight of steps, 0.18 m high and 0.28 m long, rises in
/// an opening at z = 3 to 4 m from x = 4 m to x = 8.2 m.
fn two_storeys() -> NavMesh {
    let mut builder = Builder::default().floor([0.0; 3], [12.0, 0.0, 4.0]);
    for step in 0..STEPS {
        let (x, y) = (4.0 + 0.28 * step as f32, RISE_M * (step + 1) as f32);
        builder = builder.block([x, y - RISE_M, 3.0], [x + 0.28, y, 4.0]);
    }
    builder
        .block([8.2, UPPER_M - 0.1, 0.0], [12.0, UPPER_M, 4.0])
        .block([0.0, UPPER_M - 0.1, 0.0], [8.2, UPPER_M, 2.9])
        .build()
}

fn at_height(mesh: &NavMesh, x: f32, y: f32, z: f32) -> NavPoint {
    mesh.snap(&Point3::new(x, y, z), 0.3).expect("on a floor")
}

#[test]
fn stairs_join_two_storeys() {
    let mesh = two_storeys();
    let (below, above) = (at_height(&mesh, 10.0, 0.0, 1.0), at_height(&mesh, 10.0, UPPER_M, 1.0));
    assert!((below.position().y, above.position().y) == (0.0, UPPER_M), "{below:?} {above:?}");
    assert_eq!(mesh.island_of(&below), mesh.island_of(&above));
    let distance = mesh.distance_m(&below, &above).unwrap();
    // The side of the flight separates it from the adjacent floor from the second step, (4.28, 3.0). The path
    // passes it at 0.1 m, continues up to the end of the opening at (8.2, 3.0), 0.1 m off, and on:
    // sqrt(5.72^2 + 1.9^2) + 0.1 * pi + sqrt(3.92^2 + 2.5^2) + 0.1 + sqrt(1.7^2 + 2.1^2) = 13.79, with a rise
    // of 2.5 m: 2.7 m minus one or two steps.
    assert!((distance - 13.79).abs() < 0.3, "{distance}");
    let path = mesh.path(&below, &above).unwrap();
    assert!(path.iter().any(|corner| corner.x < 4.5), "{path:?}");
}

#[test]
fn walking_on_stairs_follows_the_steps() {
    let mesh = two_storeys();
    let mut here = at_height(&mesh, 3.5, 0.0, 3.5);
    for _ in 0..24 {
        let slide = mesh.slide(&here, &Vector3::new(0.25, 0.0, 0.0));
        assert!(!slide.blocked);
        let position = slide.end.position();
        let step = ((position.x - 4.0) / 0.28).floor().clamp(-1.0, STEPS as f32 - 1.0);
        assert!((position.y - (step + 1.0) * RISE_M).abs() < RISE_M + 0.01, "{position}");
        here = slide.end;
    }
    assert!((here.position() - Point3::new(9.5, UPPER_M, 3.5)).norm() < 1e-3, "{here:?}");
}

#[test]
fn steps_stay_on_their_storey() {
    let mesh = two_storeys();
    let mut rng = Rng::new(21);
    for start in [at_height(&mesh, 10.0, 0.0, 1.0), at_height(&mesh, 10.0, UPPER_M, 1.0)] {
        for _ in 0..2000 {
            let asked = Vector3::new(rng.range(-1.0, 1.0), 0.0, rng.range(-0.8, 0.8));
            let end = mesh.slide(&start, &asked).end;
            assert!((end.position().y - start.position().y).abs() < 0.03, "{start:?} {end:?}");
        }
    }
}

#[test]
fn a_grid_has_a_point_on_every_storey() {
    let mesh = two_storeys();
    let column = Aabb::new(Point3::new(9.9, -1.0, 0.9), Point3::new(10.1, 5.0, 1.1));
    let heights: Vec<_> = mesh.grid(&column, 1.0).iter().map(|point| point.position().y).collect();
    assert_eq!(heights, [0.0, UPPER_M]);
    let upper = Aabb::new(Point3::new(9.9, 1.0, 0.9), column.max);
    assert_eq!(mesh.grid(&upper, 1.0).len(), 1);
}

#[test]
fn high_steps_do_not_join_floors() {
    let ledge = |rise: f32| {
        Builder::default().floor([0.0; 3], [6.0, 0.0, 3.0]).block([3.0, 0.0, 0.0], [6.0, rise, 3.0]).build()
    };
    let joined = |mesh: &NavMesh, rise: f32| {
        mesh.distance_m(&at_height(mesh, 1.0, 0.0, 1.5), &at_height(mesh, 5.0, rise, 1.5)).is_some()
    };
    assert!(joined(&ledge(0.15), 0.15) && joined(&ledge(0.2), 0.2));
    assert!(!joined(&ledge(0.26), 0.26) && !joined(&ledge(0.5), 0.5));
}
