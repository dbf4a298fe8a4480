//! The renderer compared with rays through our tree and parry3d's, on the same mesh and poses, single thread:
//! `cargo bench -p avln-render --bench peers [-- --scene FILE] [--dump FOLDER]`.
//!
//! Without a file the scene is a procedural house subdivided to half a million triangles. `--dump` writes
//! mesh, textures, cameras and frames for `benches/embree.py` and `benches/llvmpipe.py`.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

use avln_formats::open;
use avln_geom::convert::{GlamVec3, glam_from_point, glam_from_vector};
use avln_geom::{Aabb, Point3, RayMesh, Rng, Vector3, angle};
use avln_houses::{HouseOptions, house};
use avln_render::{Camera, CameraImage, Renderer};
use avln_scene::{Lighting, Mesh, Scene};
use parry3d::query::{Ray, RayCast};
use parry3d::shape::TriMesh;
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::fs;
use std::hint::black_box;
use std::io::Result;
use std::path::{Path, PathBuf};
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
    let cameras = cameras(&scene, &rays, VIEWS, SIDE);
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
        write_dump(&PathBuf::from(&folder), &scene, &cameras, &ours, 1.0 / ours_s)
            .expect("the folder can be written");
        println!("written to {folder}");
    }
}

/// Argument after `name` on the command line.
fn argument(name: &str) -> Option<String> {
    std::env::args().skip_while(|word| word != name).nth(1)
}

/// A scene lit by surface colours: all renderers draw the same mesh.
fn scene() -> Scene {
    let scene = match argument("--scene") {
        Some(path) => open::open(path.as_ref()).expect("a scene"),
        None => refined(house("house-7", 7, &HouseOptions::default()), TRIANGLES),
    };
    Scene { lighting: Lighting::Painted, ..scene }
}

/// Mean seconds per image, with the fastest round per camera, and the results.
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

/// Depth by pixel, from rays, row-major; 0 for a miss.
fn depths(camera: &Camera, cast: impl Fn(&Point3<f32>, &Vector3<f32>) -> Option<f32>) -> Vec<f32> {
    let [right, up, ahead] = axes(camera);
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

/// Prints the memory bandwidth limit.
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

/// The scene with edges halved until it has at least `least` triangles. Shared edges are halved in both
/// triangles, so the surface stays closed.
fn refined(scene: Scene, least: usize) -> Scene {
    let mut longest_m = 1.0;
    loop {
        let mesh = halved(&scene.mesh, longest_m);
        if mesh.triangles.len() >= least {
            return Scene { mesh, ..scene };
        }
        longest_m *= 0.95;
    }
}

/// The mesh without edges longer than `longest_m`, by repeated halving.
fn halved(mesh: &Mesh, longest_m: f32) -> Mesh {
    let mut fine = Mesh { triangles: vec![], material_of: vec![], instance_of: vec![], ..mesh.clone() };
    let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let mut waiting = vec![*triangle];
        while let Some(triangle) = waiting.pop() {
            let length = |i: usize| {
                let at = |corner: u32| fine.positions[corner as usize];
                (at(triangle[i]) - at(triangle[(i + 1) % 3])).norm()
            };
            let edge = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
            if length(edge) <= longest_m {
                fine.triangles.push(triangle);
                fine.material_of.push(mesh.material_of[index]);
                fine.instance_of.push(mesh.instance_of[index]);
                continue;
            }
            let [a, b, c] = [0, 1, 2].map(|i| triangle[(edge + i) % 3]);
            let key = [a.min(b), a.max(b)];
            let middle = *middles.entry(key).or_insert_with(|| add_middle(&mut fine, key));
            waiting.extend([[a, middle, c], [middle, b, c]]);
        }
    }
    fine
}

fn add_middle(mesh: &mut Mesh, [a, b]: [u32; 2]) -> u32 {
    let (a, b) = (a as usize, b as usize);
    let half = |p: u8, q: u8| ((u16::from(p) + u16::from(q)) / 2) as u8;
    let position = Point3::from((mesh.positions[a].coords + mesh.positions[b].coords) * 0.5);
    let uv = mesh.uvs[a] + (mesh.uvs[b] - mesh.uvs[a]) * 0.5;
    let color = std::array::from_fn(|i| half(mesh.colors[a][i], mesh.colors[b][i]));
    mesh.positions.push(position);
    mesh.uvs.push(uv);
    mesh.colors.push(color);
    mesh.positions.len() as u32 - 1
}

const EYE_M: f32 = 1.0;
const ELBOW_ROOM_M: f32 = 0.3;
const TRIES: usize = 100_000;

/// Level cameras 1 m above floors with free surroundings, over the rooms or, without rooms, over the whole
/// scene.
fn cameras(scene: &Scene, rays: &RayMesh, count: usize, side: u32) -> Vec<Camera> {
    let mut rng = Rng::new(1);
    let rooms: Vec<Aabb> = match scene.bounds() {
        Some(bounds) if scene.regions.is_empty() => vec![bounds],
        _ => scene.regions.iter().map(|region| region.bounds).collect(),
    };
    let draw = |attempt: usize| {
        let room = rooms[attempt % rooms.len()];
        let (x, z) = (rng.range(room.min.x, room.max.x), rng.range(room.min.z, room.max.z));
        let above = Point3::new(x, room.min.y + 0.5 * room.size().y, z);
        let floor_m = rays.cast(&above, &-Vector3::y(), 3.0)?.distance;
        let eye = above + Vector3::y() * (EYE_M - floor_m);
        let camera = Camera {
            eye,
            world_from_camera: angle::about_up(rng.range(-PI, PI)),
            width: side,
            height: side,
            hfov_rad: FRAC_PI_2,
            depth_max_m: f32::MAX,
        };
        let near = |i: usize| {
            let (sin, cos) = angle::sin_cos(TAU * i as f32 / 8.0);
            rays.cast(&eye, &Vector3::new(sin, 0.0, cos), ELBOW_ROOM_M).is_some()
        };
        (!(0..8).any(near)).then_some(camera)
    };
    let cameras: Vec<Camera> = (0..TRIES).filter_map(draw).take(count).collect();
    assert!(!cameras.is_empty(), "this scene has no free floor");
    cameras
}

/// Camera directions right, up and ahead, world frame.
fn axes(camera: &Camera) -> [Vector3<f32>; 3] {
    [Vector3::x(), Vector3::y(), -Vector3::z()].map(|axis| camera.world_from_camera * axis)
}

/// Writes raw little-endian arrays and `scene.json`, which lists them with our own frame rate.
fn write_dump(
    folder: &Path,
    scene: &Scene,
    cameras: &[Camera],
    ours: &[CameraImage],
    fps: f64,
) -> Result<()> {
    fs::create_dir_all(folder)?;
    let mesh = &scene.mesh;
    let put = |name: &str, bytes: Vec<u8>| fs::write(folder.join(name), bytes);
    put("positions.f32", floats(mesh.positions.iter().flat_map(|p| [p.x, p.y, p.z])))?;
    put("uvs.f32", floats(mesh.uvs.iter().flat_map(|uv| [uv.x, uv.y])))?;
    put("colors.u8", mesh.colors.concat())?;
    put("triangles.u32", words(mesh.triangles.iter().flatten().copied()))?;
    put("materials.u32", words(mesh.material_of.iter().map(|&material| u32::from(material))))?;
    put("instances.u32", words(mesh.instance_of.iter().map(|id| id.0)))?;
    put("cameras.f32", floats(cameras.iter().flat_map(numbers)))?;
    put("depth.f32", floats(ours.iter().flat_map(|frame| frame.depth.iter().copied())))?;
    put("rgb.u8", ours.iter().flat_map(|frame| frame.rgb.iter().copied()).collect())?;
    put("ids.u32", words(ours.iter().flat_map(|frame| frame.instances.iter().map(|id| id.0))))?;
    for (index, texture) in scene.textures.iter().enumerate() {
        put(&format!("texture-{index}.rgba"), texture.pixels.clone())?;
    }
    put("scene.json", listing(scene, cameras, fps).into_bytes())
}

/// Eye, right, up, ahead, and the tangent of half the angle of view.
fn numbers(camera: &Camera) -> Vec<f32> {
    let [right, up, ahead] = axes(camera);
    let eye = camera.eye.coords;
    let axes = [eye, right, up, ahead].into_iter().flat_map(<[f32; 3]>::from);
    axes.chain([(0.5 * camera.hfov_rad).tan()]).collect()
}

fn listing(scene: &Scene, cameras: &[Camera], fps: f64) -> String {
    let textures = scene.textures.iter().map(|texture| format!("[{}, {}]", texture.width, texture.height));
    let materials = scene.materials.iter().map(|material| {
        let texture = material.texture.map_or("null".to_owned(), |index| index.to_string());
        let cutoff = material.alpha_cutoff.map_or("null".to_owned(), |cutoff| cutoff.to_string());
        format!(r#"{{"color": {:?}, "texture": {texture}, "cutoff": {cutoff}}}"#, material.base_color)
    });
    format!(
        r#"{{"side": {}, "cameras": {}, "ours_fps": {fps}, "textures": [{}], "materials": [{}]}}"#,
        cameras[0].width,
        cameras.len(),
        textures.collect::<Vec<_>>().join(", "),
        materials.collect::<Vec<_>>().join(", ")
    )
}

fn floats(values: impl Iterator<Item = f32>) -> Vec<u8> {
    values.flat_map(f32::to_le_bytes).collect()
}

fn words(values: impl Iterator<Item = u32>) -> Vec<u8> {
    values.flat_map(u32::to_le_bytes).collect()
}
