//! Frames per second on one core, exact and at half a pixel: `cargo bench -p avln-render --bench frames`; with
//! `-- light` the cost of baking light in procedural houses, with `-- noise` the cost of sensor noise.
//!
//! `AVLN_BENCH_SCENE` selects a scene file, `AVLN_BENCH_TRIANGLES` the size of the scan-like scene.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

mod dense;

use avln_geom::{Point3, RayMesh, Rng, UnitQuaternion, angle};
use avln_houses::{HouseOptions, house};
use avln_render::{Camera, CameraImage, DepthNoise, Detail, Noise, Renderer, RgbNoise};
use avln_scene::{InstanceId, Scene};
use std::f32::consts::{FRAC_PI_2, PI};
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

const VIEWS: usize = 48;
const ROUNDS: usize = 9;
const SIZES: [u32; 4] = [64, 128, 256, 512];

fn main() {
    match std::env::args().find(|word| ["light", "noise"].contains(&word.as_str())).as_deref() {
        Some("light") => bake_lights(),
        Some(_) => add_noise(),
        None => render_frames(),
    }
}

fn render_frames() {
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
    let start = seconds();
    black_box(renderer.render_at(&Camera { width: 1, height: 1, ..cameras[0] }, Detail::HalfPixel));
    println!("  simplified in {:.0} ms", (seconds() - start) * 1e3);
    for size in SIZES {
        let [exact, half_pixel] = frames_per_second(&renderer, &cameras, size);
        println!(
            "  {size} x {size} RGB-D and instances: {exact:.0} frames per second, {half_pixel:.0} at half a pixel"
        );
    }
}

/// Medians over several rounds with all cameras: exact, and at half a pixel. Rounds alternate, so that other load
/// affects both alike.
fn frames_per_second(renderer: &Renderer, cameras: &[Camera], size: u32) -> [f64; 2] {
    // Processor time advances in steps of some milliseconds, so small images need several repetitions.
    let repetitions = 2 * SIZES[3] / size;
    let round = |detail: Detail| {
        let start = seconds();
        for camera in (0..repetitions).flat_map(|_| cameras) {
            black_box(renderer.render_at(&Camera { width: size, height: size, ..*camera }, detail));
        }
        (cameras.len() * repetitions as usize) as f64 / (seconds() - start)
    };
    let mut rounds: [Vec<f64>; 2] = [Vec::new(), Vec::new()];
    for _ in 0..ROUNDS {
        rounds[0].push(round(Detail::Exact));
        rounds[1].push(round(Detail::HalfPixel));
    }
    rounds.map(|mut rounds| {
        rounds.sort_by(f64::total_cmp);
        rounds[ROUNDS / 2]
    })
}

/// Processor time of this thread, or elapsed time without a report from the system.
fn seconds() -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(wall_seconds, |nanoseconds| nanoseconds * 1e-9)
}

fn wall_seconds() -> f64 {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Random headings in room centres.
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

const LIGHT_ROUNDS: usize = 5;

fn bake_lights() {
    for (name, options) in [("small", HouseOptions::small()), ("full-size", HouseOptions::default())] {
        for seed in 0..4 {
            first_picture(name, seed, &options);
        }
    }
}

/// Renders a pixel, which bakes the light; prints the best time.
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
    let milliseconds = (0..LIGHT_ROUNDS).map(round).fold(f64::INFINITY, f64::min);
    let (rooms, triangles) = (scene.regions.len(), scene.mesh.triangles.len());
    println!("{name} house {seed}: {rooms} rooms, {triangles} triangles, light in {milliseconds:.0} ms");
}

const NOISE_SIDE: u32 = 256;
const NOISE_ROUNDS: u64 = 200;

fn add_noise() {
    let none = Noise::default();
    let depth = Noise { depth: DepthNoise::Redwood, ..none };
    let rgb = Noise { rgb: RgbNoise::Gaussian, ..none };
    for (name, noise) in [("depth: redwood", depth), ("rgb: gaussian", rgb)] {
        let fastest_s =
            (0..NOISE_ROUNDS).map(|index| noise_seconds(&noise, index)).fold(f64::INFINITY, f64::min);
        println!(
            "{name}: {:.3} ms for {NOISE_SIDE} x {NOISE_SIDE}, fastest of {NOISE_ROUNDS}, wall time",
            fastest_s * 1e3
        );
    }
}

fn noise_seconds(noise: &Noise, index: u64) -> f64 {
    let pixels = (NOISE_SIDE * NOISE_SIDE) as usize;
    let depth = (0..pixels).map(|pixel| 1.0 + pixel as f32 / pixels as f32 * 5.0).collect();
    let instances = vec![InstanceId::NONE; pixels];
    let mut frame =
        CameraImage { width: NOISE_SIDE, height: NOISE_SIDE, rgb: vec![128; 3 * pixels], depth, instances };
    let start = Instant::now();
    noise.apply(black_box(&mut frame), index, 10.0);
    let taken_s = start.elapsed().as_secs_f64();
    black_box(&frame);
    taken_s
}
