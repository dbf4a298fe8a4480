//! Frames per second of processor time on a core: `cargo bench -p avln-render --bench frames`.
//!
//! `AVLN_BENCH_SCENE` selects a scene file, `AVLN_BENCH_TRIANGLES` the size of the scan-like scene.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

mod dense;

use avln_geom::{Point3, RayMesh, Rng, angle};
use avln_houses::{HouseOptions, house};
use avln_render::{Camera, Renderer};
use avln_scene::Scene;
use std::f32::consts::{FRAC_PI_2, PI};
use std::sync::Arc;
use std::time::Instant;

const VIEWS: usize = 48;
const ROUNDS: usize = 9;

fn main() {
    if let Some(path) = std::env::var_os("AVLN_BENCH_SCENE") {
        return report(avln_formats::open::open(path.as_ref()).expect("a scene"));
    }
    report(house("bench", 7, &HouseOptions::default()));
    let asked = std::env::var("AVLN_BENCH_TRIANGLES").ok().map(|count| count.parse().expect("a number"));
    for triangles in asked.map_or(vec![100_000, 500_000, 2_000_000], |count| vec![count]) {
        report(dense::scan(triangles));
    }
}

fn report(scene: Scene) {
    let scene = Arc::new(scene);
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let start = seconds();
    let renderer = Renderer::new(Arc::clone(&scene), rays);
    let model = renderer.model();
    let prepare_ms = (seconds() - start) * 1e3;
    println!(
        "{} triangles at {:.1} bytes, textures {:.0} MB, prepared in {prepare_ms:.0} ms",
        model.triangle_count(),
        model.geometry_bytes() as f64 / model.triangle_count() as f64,
        model.texture_bytes() as f64 / 1e6,
    );
    let cameras = cameras(&scene);
    for size in [128, 256, 512] {
        let fps = frames_per_second(&renderer, &cameras, size);
        println!("  {size} x {size} RGB-D and instances: {fps:.0} frames per second");
    }
}

/// The median of some rounds over all cameras.
fn frames_per_second(renderer: &Renderer, cameras: &[Camera], size: u32) -> f64 {
    let round = |_| {
        let start = seconds();
        for camera in cameras {
            std::hint::black_box(renderer.render(&Camera { width: size, height: size, ..*camera }));
        }
        cameras.len() as f64 / (seconds() - start)
    };
    let mut rounds: Vec<f64> = (0..ROUNDS).map(round).collect();
    rounds.sort_by(f64::total_cmp);
    rounds[ROUNDS / 2]
}

/// Processor time of this thread if the system reports it, otherwise elapsed time.
fn seconds() -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(wall_seconds, |nanoseconds| nanoseconds * 1e-9)
}

fn wall_seconds() -> f64 {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Random headings in the middles of the rooms.
fn cameras(scene: &Scene) -> Vec<Camera> {
    let mut rng = Rng::new(1);
    let camera = |index: usize| {
        let middle = match scene.regions.len() {
            0 => scene.bounds().expect("a scene has bounds").center(),
            count => scene.regions[index % count].bounds.center(),
        };
        Camera {
            eye: Point3::new(middle.x, middle.y, middle.z),
            world_from_camera: angle::about_up(rng.range(-PI, PI)),
            width: 0,
            height: 0,
            hfov_rad: FRAC_PI_2,
            depth_max_m: 10.0,
        }
    };
    (0..VIEWS).map(camera).collect()
}
