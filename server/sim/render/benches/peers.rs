//! The renderer compared with rays through our tree and parry3d's, on the same mesh and poses, single thread:
//! `cargo bench -p avln-render --bench peers [-- --scene FILE] [--dump FOLDER]`.
//!
//! Without a file the scene is a procedural house subdivided to half a million triangles. `--dump` writes
//! mesh, textures, cameras and frames for `benches/embree.py` and `benches/llvmpipe.py`.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

#[path = "peers/dump.rs"]
mod dump;
#[path = "peers/places.rs"]
mod places;
#[path = "peers/tessellate.rs"]
mod tessellate;

use avln_formats::open;
use avln_geom::convert::{GlamVec3, glam_from_point, glam_from_vector};
use avln_geom::{Point3, RayMesh, Vector3};
use avln_houses::{HouseOptions, house};
use avln_render::{Camera, CameraImage, Renderer};
use avln_scene::{Lighting, Scene};
use parry3d::query::{Ray, RayCast};
use parry3d::shape::TriMesh;
use std::hint::black_box;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

const SIDE: u32 = 256;
const VIEWS: usize = 16;
const ROUNDS: usize = 5;
const TRIANGLES: usize = 500_000;
const REACH_M: f32 = 1e4;

fn main() {
    let scene = Arc::new(scene());
    println!("{}: {} triangles, {} textures", scene.name, scene.mesh.triangles.len(), scene.textures.len());
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let start = Instant::now();
    let renderer = Renderer::new(Arc::clone(&scene), Arc::clone(&rays));
    renderer.model();
    println!(
        "renderer ready in {:.0} ms, {:.1} MB resident",
        start.elapsed().as_secs_f64() * 1e3,
        renderer.resident_bytes() as f64 / 1e6
    );
    let cameras = places::cameras(&scene, &rays, VIEWS, SIDE);
    let (ours_s, ours) = timed(&cameras, |camera| renderer.render(camera));
    report("ours, RGB, depth and ids", ours_s, ours_s);
    let (rays_s, seen) =
        timed(&cameras, |camera| depths(camera, |from, to| Some(rays.cast(from, to, REACH_M)?.distance)));
    report("rays through RayMesh, depth", rays_s, ours_s);
    agreement(&ours, &seen);
    let mesh = parry(&scene);
    let (parry_s, seen) = timed(&cameras, |camera| depths(camera, |from, to| cast(&mesh, from, to)));
    report("rays through parry3d's TriMesh, depth", parry_s, ours_s);
    agreement(&ours, &seen);
    print_bandwidth(ours_s);
    if let Some(folder) = argument("--dump") {
        dump::write(&PathBuf::from(&folder), &scene, &cameras, &ours, 1.0 / ours_s)
            .expect("the folder can be written");
        println!("written to {folder}");
    }
}

/// Argument after `name` on the command line.
fn argument(name: &str) -> Option<String> {
    std::env::args().skip_while(|word| word != name).nth(1)
}

/// The scene with its own colours as light, so that all renderers draw the same mesh.
fn scene() -> Scene {
    let scene = match argument("--scene") {
        Some(path) => open::open(path.as_ref()).expect("a scene"),
        None => tessellate::refined(house("house-7", 7, &HouseOptions::default()), TRIANGLES),
    };
    Scene { lighting: Lighting::Painted, ..scene }
}

/// Mean seconds per image over the fastest of several rounds per camera, and the results.
fn timed<T>(cameras: &[Camera], mut take: impl FnMut(&Camera) -> T) -> (f64, Vec<T>) {
    let mut fastest_s = vec![f64::INFINITY; cameras.len()];
    let mut seen = Vec::new();
    for _ in 0..ROUNDS {
        seen.clear();
        for (camera, fastest_s) in cameras.iter().zip(&mut fastest_s) {
            let start = Instant::now();
            seen.push(black_box(take(black_box(camera))));
            *fastest_s = fastest_s.min(start.elapsed().as_secs_f64());
        }
    }
    (fastest_s.iter().sum::<f64>() / cameras.len() as f64, seen)
}

fn report(what: &str, seconds: f64, ours_s: f64) {
    let rays_m = f64::from(SIDE * SIDE) / seconds / 1e6;
    println!(
        "{what}: {:.1} frames/s at {SIDE} x {SIDE} ({rays_m:.2} M pixels/s); ours is {:.1} times as fast",
        1.0 / seconds,
        seconds / ours_s
    );
}

/// Prints the pixel count with a difference above a thousandth.
fn agreement(ours: &[CameraImage], theirs: &[Vec<f32>]) {
    let pairs = ours.iter().zip(theirs).flat_map(|(ours, theirs)| ours.depth.iter().zip(theirs));
    let differ = pairs.filter(|(a, b)| (**a - **b).abs() > 1e-3 * b.max(0.1)).count();
    let all = ours.len() * (SIDE * SIDE) as usize;
    println!("    {differ} of {all} pixels differ by more than 0.1 %");
}

/// Depth of every pixel by rays, row-major; 0 for a miss.
fn depths(camera: &Camera, cast: impl Fn(&Point3<f32>, &Vector3<f32>) -> Option<f32>) -> Vec<f32> {
    let [right, up, ahead] = places::axes(camera);
    let half = 0.5 * camera.width as f32;
    let slope = (0.5 * camera.hfov_rad).tan() / half;
    let pixels = (0..camera.width * camera.height).map(|pixel| {
        let (x, y) = ((pixel % camera.width) as f32 + 0.5 - half, (pixel / camera.width) as f32 + 0.5 - half);
        cast(&camera.eye, &(ahead + (right * x - up * y) * slope)).unwrap_or(0.0)
    });
    pixels.collect()
}

fn parry(scene: &Scene) -> TriMesh {
    let vertices: Vec<GlamVec3> = scene.mesh.positions.iter().map(glam_from_point).collect();
    TriMesh::new(vertices, scene.mesh.triangles.clone()).expect("a mesh with triangles")
}

fn cast(mesh: &TriMesh, from: &Point3<f32>, to: &Vector3<f32>) -> Option<f32> {
    mesh.cast_local_ray(&Ray::new(glam_from_point(from), glam_from_vector(to)), REACH_M, false)
}

/// Prints the limit set by memory bandwidth.
fn print_bandwidth(ours_s: f64) {
    const BYTES: usize = 256 << 20;
    let (mut from, mut to) = (vec![1_u8; BYTES], vec![2_u8; BYTES]);
    let best = |mut work: Box<dyn FnMut() + '_>| {
        let time = |_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        };
        BYTES as f64 / (0..ROUNDS).map(time).fold(f64::INFINITY, f64::min) / 1e9
    };
    let set = best(Box::new(|| black_box(&mut from).fill(3)));
    let copied = best(Box::new(|| black_box(&mut to).copy_from_slice(black_box(&from))));
    let frame = (SIDE * SIDE) as usize * (3 + 4 + 4);
    println!("memory: set at {set:.1} GB/s, copied at {copied:.1} GB/s");
    println!(
        "a frame writes {frame} bytes at least: {:.0} frames/s if that were all; ours uses {:.1} % of it",
        set * 1e9 / frame as f64,
        100.0 * frame as f64 / ours_s / (set * 1e9)
    );
}
