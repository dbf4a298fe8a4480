use crate::build::Builder;
use avln_geom::{Aabb, Point3, Rng, Vector3};
use avln_navmesh::{NavMesh, NavPoint};

const RISE_M: f32 = 0.18;
const STEPS: usize = 15;
const UPPER_M: f32 = RISE_M * STEPS as f32;

/// A ground floor of 12 x 4 m with an upper floor. A flight of steps, 0.18 m high and 0.28 m long, rises in
/// an opening at z = 3 to 4 m from x = 4 m to x = 8.2 m.
fn house() -> NavMesh {
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

fn at(mesh: &NavMesh, x: f32, y: f32, z: f32) -> NavPoint {
    mesh.snap(&Point3::new(x, y, z), 0.3).expect("on a floor")
}

#[test]
fn stairs_join_two_storeys_and_points_above_each_other_stay_apart() {
    let mesh = house();
    let (below, above) = (at(&mesh, 10.0, 0.0, 1.0), at(&mesh, 10.0, UPPER_M, 1.0));
    assert!((below.position().y, above.position().y) == (0.0, UPPER_M), "{below:?} {above:?}");
    assert_eq!(mesh.island_of(&below), mesh.island_of(&above));
    let distance = mesh.distance_m(&below, &above).unwrap();
    // The side of the flight separates it from the adjacent floor from the second step, (4.28, 3.0). The path
    // goes there, 0.1 m off, around it, up to the end of the opening at (8.2, 3.0), 0.1 m off, and on:
    // sqrt(5.72^2 + 1.9^2) + 0.1 * pi + sqrt(3.92^2 + 2.5^2) + 0.1 + sqrt(1.7^2 + 2.1^2) = 13.79, with a rise
    // of 2.5 m: 2.7 m minus one or two steps.
    assert!((distance - 13.79).abs() < 0.3, "{distance}");
    let path = mesh.path(&below, &above).unwrap();
    assert!(path.iter().any(|corner| corner.x < 4.5), "{path:?}");
}

#[test]
fn walking_the_flight_follows_its_steps() {
    let mesh = house();
    let mut here = at(&mesh, 3.5, 0.0, 3.5);
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
fn a_step_on_one_storey_stays_on_it() {
    let mesh = house();
    let mut rng = Rng::new(21);
    for start in [at(&mesh, 10.0, 0.0, 1.0), at(&mesh, 10.0, UPPER_M, 1.0)] {
        for _ in 0..2000 {
            let asked = Vector3::new(rng.range(-1.0, 1.0), 0.0, rng.range(-0.8, 0.8));
            let end = mesh.slide(&start, &asked).end;
            assert!((end.position().y - start.position().y).abs() < 0.03, "{start:?} {end:?}");
        }
    }
}

#[test]
fn a_grid_has_a_point_on_every_storey() {
    let mesh = house();
    let column = Aabb::new(Point3::new(9.9, -1.0, 0.9), Point3::new(10.1, 5.0, 1.1));
    let heights: Vec<_> = mesh.grid(&column, 1.0).iter().map(|point| point.position().y).collect();
    assert_eq!(heights, [0.0, UPPER_M]);
    let upper = Aabb::new(Point3::new(9.9, 1.0, 0.9), column.max);
    assert_eq!(mesh.grid(&upper, 1.0).len(), 1);
}

#[test]
fn steps_that_are_too_high_do_not_join() {
    let ledge = |rise: f32| {
        Builder::default().floor([0.0; 3], [6.0, 0.0, 3.0]).block([3.0, 0.0, 0.0], [6.0, rise, 3.0]).build()
    };
    let joined = |mesh: &NavMesh, rise: f32| {
        mesh.distance_m(&at(mesh, 1.0, 0.0, 1.5), &at(mesh, 5.0, rise, 1.5)).is_some()
    };
    assert!(joined(&ledge(0.15), 0.15) && joined(&ledge(0.2), 0.2));
    assert!(!joined(&ledge(0.26), 0.26) && !joined(&ledge(0.5), 0.5));
}
