//! Size and speed of image encodings in a procedural house: `cargo bench -p avln-lab --bench codecs`.

use avln_geom::{Point3, RayMesh, Rng, angle};
use avln_houses::{HouseOptions, house};
use avln_proto::wire::{Encoding, SensorKind, Size, depth, offered, rgb};
use avln_render::{Camera, CameraImage, Renderer};
use std::f32::consts::{FRAC_PI_2, PI};
use std::hint::black_box;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

const SIDE: u32 = 256;
const VIEWS: usize = 32;
/// Rounds per mean.
const ROUNDS: usize = 25;
const SIZE: Size = Size { width: SIDE, height: SIDE };
const LAYOUT: depth::Layout = depth::Layout { size: SIZE, unit_m: 1.0 };

fn main() {
    let frames = frames();
    println!(
        "{:>8} {:>28} {:>8} {:>8} {:>10} {:>10}",
        "sensor", "encoding", "bytes", "share", "encode us", "decode us"
    );
    for &encoding in offered(SensorKind::Rgb) {
        let encode = |frame: &CameraImage| rgb::encode(encoding, SIZE, &frame.rgb).unwrap();
        report(
            "colour",
            encoding,
            3,
            &measure(&frames, encode, |bytes| {
                black_box(rgb::decode(encoding, SIZE, bytes.clone()).unwrap());
            }),
        );
    }
    for &encoding in offered(SensorKind::Depth) {
        let encode = |frame: &CameraImage| depth::encode(encoding, LAYOUT, &frame.depth).unwrap();
        report(
            "depth",
            encoding,
            4,
            &measure(&frames, encode, |bytes| {
                black_box(depth::decode(encoding, LAYOUT, bytes).unwrap());
            }),
        );
    }
}

/// Bytes per frame, and processor time to encode and decode, seconds.
struct Cost {
    bytes: usize,
    encode_s: f64,
    decode_s: f64,
}

fn measure<T>(frames: &[CameraImage], encode: impl Fn(&CameraImage) -> T, decode: impl Fn(&T)) -> Cost
where
    T: AsRef<[u8]>,
{
    let (mut encode_s, mut decode_s, mut bytes) = (0.0, 0.0, 0);
    for _ in 0..ROUNDS {
        let begun = seconds();
        let packed: Vec<T> = frames.iter().map(&encode).collect();
        encode_s += (seconds() - begun) / (ROUNDS * frames.len()) as f64;
        let begun = seconds();
        packed.iter().for_each(&decode);
        decode_s += (seconds() - begun) / (ROUNDS * frames.len()) as f64;
        bytes = packed.iter().map(|packed| packed.as_ref().len()).sum::<usize>() / frames.len();
    }
    Cost { bytes, encode_s, decode_s }
}

fn report(sensor: &str, encoding: Encoding, bytes_a_pixel: usize, cost: &Cost) {
    let share = cost.bytes as f64 / (bytes_a_pixel * SIZE.pixels()) as f64;
    let [encode_us, decode_us] = [cost.encode_s, cost.decode_s].map(|seconds| seconds * 1e6);
    let name = encoding.as_str_name();
    println!("{sensor:>8} {name:>28} {:>8} {share:>8.2} {encode_us:>10.0} {decode_us:>10.0}", cost.bytes);
}

/// Returns the thread's processor time on Linux, otherwise the wall time.
fn seconds() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.get_or_init(Instant::now).elapsed().as_secs_f64(), |time| time * 1e-9)
}

/// Renders views from the rooms' middles.
fn frames() -> Vec<CameraImage> {
    let scene = Arc::new(house("bench", 7, &HouseOptions::default()));
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let renderer = Renderer::new(Arc::clone(&scene), rays);
    let mut rng = Rng::new(1);
    let view = |index: usize| {
        let middle = scene.regions[index % scene.regions.len()].bounds.center();
        renderer.render(&Camera {
            eye: Point3::new(middle.x, middle.y, middle.z),
            world_from_camera: angle::about_up(rng.range(-PI, PI)),
            width: SIDE,
            height: SIDE,
            hfov_rad: FRAC_PI_2,
            depth_max_m: 10.0,
        })
    };
    (0..VIEWS).map(view).collect()
}
