//! Cost of baking light in procedural houses: `cargo bench -p avln-render --bench light`.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

use avln_geom::{Point3, RayMesh, UnitQuaternion};
use avln_houses::{HouseOptions, house};
use avln_render::{Camera, Renderer};
use std::sync::Arc;
use std::time::Instant;

const ROUNDS: usize = 5;

fn main() {
    for (name, options) in [("small", HouseOptions::small()), ("full-size", HouseOptions::default())] {
        for seed in 0..4 {
            first_picture(name, seed, &options);
        }
    }
}

/// Renders a pixel, which bakes the light; prints the best of several rounds.
fn first_picture(name: &str, seed: u64, options: &HouseOptions) {
    let scene = Arc::new(house("bench", seed, options));
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let camera = Camera {
        eye: Point3::new(0.0, 1.0, 0.0),
        world_from_camera: UnitQuaternion::identity(),
        width: 1,
        height: 1,
        hfov_rad: 1.0,
        depth_max_m: 10.0,
    };
    let round = |_| {
        let renderer = Renderer::new(Arc::clone(&scene), Arc::clone(&rays));
        let start = Instant::now();
        std::hint::black_box(renderer.render(&camera));
        start.elapsed().as_secs_f64() * 1e3
    };
    let milliseconds = (0..ROUNDS).map(round).fold(f64::INFINITY, f64::min);
    let (rooms, triangles) = (scene.regions.len(), scene.mesh.triangles.len());
    println!("{name} house {seed}: {rooms} rooms, {triangles} triangles, light in {milliseconds:.0} ms");
}
