//! Cost of a navmesh: `cargo bench -p avln-navmesh --bench ways`.
//!
//! The houses are procedural; `AVLN_BENCH_SCENE` adds the scene at that path.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

use avln_geom::{Rng, Vector3};
use avln_houses::{HouseOptions, house};
use avln_navmesh::{Body, NavMesh, NavMeshSettings, NavPoint};
use avln_scene::Scene;
use std::{
    hint::black_box,
    path::Path,
    time::{Duration, Instant},
};

const POINTS: usize = 200;
/// Minimum duration of a measurement.
const LEAST: Duration = Duration::from_millis(200);

/// Mean time per call of `work`, which receives the call index.
fn each(mut work: impl FnMut(usize)) -> Duration {
    let begin = Instant::now();
    for call in 0.. {
        work(call);
        if begin.elapsed() >= LEAST {
            return begin.elapsed() / (call as u32 + 1);
        }
    }
    LEAST
}

fn measure(scene: &Scene) {
    let body = Body::default();
    let own = each(|_| {
        drop(black_box(NavMesh::build(scene, &body)));
    });
    let habitats = each(|_| {
        drop(black_box(NavMesh::build_with(scene, &NavMeshSettings::default())));
    });
    println!("{}: {} triangles", scene.name, scene.mesh.triangles.len());
    println!("  build, the arena's settings   {own:>12.2?}");
    println!("  build, Habitat's settings     {habitats:>12.2?}");
    let Ok(mesh) = NavMesh::build(scene, &body) else { return };
    println!("  {} polygons, {:.1} square metres", mesh.polygons().len(), mesh.area_m2());

    let mut rng = Rng::new(1);
    let points: Vec<NavPoint> = (0..POINTS).map(|_| mesh.sample(&mut rng, mesh.largest_island())).collect();
    let pair = |call: usize| (&points[call % POINTS], &points[(7 * call + 3) % POINTS]);
    let path = each(|call| {
        black_box(mesh.path(pair(call).0, pair(call).1));
    });
    let field = each(|call| {
        black_box(mesh.field(&[(points[call % POINTS], 0.0)]));
    });
    let one = mesh.field(&[(points[0], 0.0)]);
    let ask = each(|call| {
        black_box(one.distance_m(&mesh, &points[call % POINTS]));
    });
    let outlooks: Vec<_> = points.iter().map(|point| mesh.outlook(point)).collect();
    let ask_again = each(|call| {
        black_box(one.distance_from_m(&mesh, &outlooks[call % POINTS]));
    });
    let table = each(|_| {
        black_box(mesh.distances_m(&points, &points));
    });
    let step = Vector3::new(0.15, 0.0, -0.2);
    let slide = each(|call| {
        black_box(mesh.slide(&points[call % POINTS], &step));
    });
    println!("  path                          {path:>12.2?}");
    println!("  field                         {field:>12.2?}");
    println!("  distance from a field         {ask:>12.2?}");
    println!("  the same with an outlook      {ask_again:>12.2?}");
    println!("  table of {POINTS} x {POINTS} distances  {table:>12.2?}");
    println!("  slide                         {slide:>12.2?}");
}

fn main() {
    for seed in 0..2 {
        measure(&house(&format!("house-{seed}"), seed, &HouseOptions::default()));
    }
    if let Ok(path) = std::env::var("AVLN_BENCH_SCENE") {
        match avln_formats::open::open(Path::new(&path)) {
            Ok(scene) => measure(&scene),
            Err(error) => println!("{error}"),
        }
    }
}
