//! Golden images. `AVLN_BLESS=1 cargo test -p avln-render --test all` rewrites them.
//!
//! Filters may change slightly: grey levels may differ by [`MEAN`] on average, and by more than [`MOST`] in
//! one channel per hundred.

use crate::scenes::{camera, procedural, shoot, textured};
use avln_geom::{Point3, angle};
use avln_render::{Camera, CameraImage};
use std::fs::{self, File};
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};

/// Mean channel difference, grey levels.
const MEAN: f64 = 2.0;
/// Difference exceeded by at most 1 % of the channels, grey levels.
const MOST: u8 = 24;

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(format!("{name}.png"))
}

fn write(path: &Path, frame: &CameraImage) {
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    let out = BufWriter::new(File::create(path).expect("a file that can be written"));
    let mut encoder = png::Encoder::new(out, frame.width, frame.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().and_then(|mut out| out.write_image_data(&frame.rgb)).expect("a picture");
}

fn read(path: &Path) -> (u32, u32, Vec<u8>) {
    let file = File::open(path)
        .unwrap_or_else(|error| panic!("{}: {error}; write it with AVLN_BLESS=1", path.display()));
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().expect("a picture");
    let mut rgb = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut rgb).expect("a picture");
    (info.width, info.height, rgb)
}

fn compare(name: &str, frame: &CameraImage) {
    let path = path(name);
    if std::env::var_os("AVLN_BLESS").is_some() {
        write(&path, frame);
    }
    let (width, height, golden) = read(&path);
    assert_eq!((width, height), (frame.width, frame.height), "{name}");
    let differences: Vec<u8> = golden.iter().zip(&frame.rgb).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = differences.iter().map(|&by| f64::from(by)).sum::<f64>() / differences.len() as f64;
    let far = differences.iter().filter(|by| **by > MOST).count();
    let largest = differences.iter().max().copied().unwrap_or_default();
    assert!(
        mean <= MEAN && far * 100 <= differences.len(),
        "{name}: the image differs by {mean:.2} grey levels on average and {largest} at most; {far} of {} channels \
         differ by more than {MOST}. Check the image, then rewrite it with AVLN_BLESS=1",
        differences.len()
    );
}

/// A view from a room centre, 1.2 m above the floor.
fn in_room(seed: u64, room: usize, [heading_rad, pitch_rad]: [f32; 2]) -> CameraImage {
    let scene = procedural(seed);
    let bounds = scene.regions[room].bounds;
    let eye = Point3::new(bounds.center().x, bounds.min.y + 1.2, bounds.center().z);
    let held = angle::about_up(heading_rad) * angle::about_right(pitch_rad);
    shoot(scene, &Camera { width: 96, height: 72, ..camera(eye, held) })
}

#[test]
fn procedural_house_matches_golden_images() {
    compare("house-21-room-0", &in_room(21, 0, [0.6, -0.2]));
    compare("house-9-room-2", &in_room(9, 2, [2.4, -0.35]));
}

#[test]
fn textures_bars_and_tints_match_golden_images() {
    let held = angle::about_up(0.25) * angle::about_right(-0.15);
    let camera = Camera { width: 96, height: 72, ..camera(Point3::new(0.2, 1.5, 1.6), held) };
    compare("textured", &shoot(textured(), &camera));
}

#[test]
fn changed_images_are_detected() {
    if std::env::var_os("AVLN_BLESS").is_some() {
        return;
    }
    let held = angle::about_up(0.3) * angle::about_right(-0.15);
    let turned = Camera { width: 96, height: 72, ..camera(Point3::new(0.2, 1.5, 1.6), held) };
    let frame = shoot(textured(), &turned);
    assert!(std::panic::catch_unwind(|| compare("textured", &frame)).is_err());
}
