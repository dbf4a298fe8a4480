//! Frames per second on one core, in a procedural house: `cargo bench -p avln-render`.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

use avln_geom::{Point3, RayMesh, Rng, angle};
use avln_render::{Camera, Renderer};
use avln_scene::Scene;
use avln_scene::procedural::{HouseOptions, house};
use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;
use std::time::Instant;

const VIEWS: usize = 48;
const ROUNDS: usize = 5;

fn main() {
    let scene = Arc::new(house("bench", 7, &HouseOptions::small()));
    let start = Instant::now();
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let renderer = Renderer::new(Arc::clone(&scene), rays);
    let prepare_ms = start.elapsed().as_secs_f64() * 1e3;
    println!(
        "{} triangles, {} textures, ready in {prepare_ms:.0} ms",
        scene.mesh.triangles.len(),
        scene.textures.len()
    );
    let cameras = cameras(&scene);
    for size in [128, 256, 512] {
        let fps = frames_per_second(&renderer, &cameras, size);
        println!("{size} x {size} RGB-D and instances: {fps:.0} frames per second");
    }
}

/// The best of some rounds over all cameras.
fn frames_per_second(renderer: &Renderer, cameras: &[Camera], size: u32) -> f64 {
    let round = |_| {
        let start = Instant::now();
        for camera in cameras {
            std::hint::black_box(renderer.render(&Camera { width: size, height: size, ..*camera }));
        }
        cameras.len() as f64 / start.elapsed().as_secs_f64()
    };
    (0..ROUNDS).map(round).fold(0.0, f64::max)
}

/// Random headings in the middles of the rooms.
fn cameras(scene: &Scene) -> Vec<Camera> {
    let mut rng = Rng::new(1);
    let camera = |index: usize| {
        let middle = scene.regions[index % scene.regions.len()].bounds.center();
        Camera {
            eye: Point3::new(middle.x, 1.0, middle.z),
            world_from_camera: angle::about_up(rng.range(-PI, PI)),
            width: 0,
            height: 0,
            hfov_rad: FRAC_PI_2,
            depth_max_m: 10.0,
        }
    };
    (0..VIEWS).map(camera).collect()
}
