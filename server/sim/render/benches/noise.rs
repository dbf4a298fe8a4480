//! Cost of sensor noise: `cargo bench -p avln-render --bench noise`.

#![expect(clippy::disallowed_methods, reason = "a bench reads the clock")]

use avln_render::{CameraImage, DepthNoise, Noise, RgbNoise};
use avln_scene::InstanceId;
use std::hint::black_box;
use std::time::Instant;

const SIDE: u32 = 256;
const ROUNDS: u64 = 200;

fn main() {
    let none = Noise::default();
    let depth = Noise { depth: DepthNoise::Redwood, ..none };
    let rgb = Noise { rgb: RgbNoise::Gaussian, ..none };
    for (name, noise) in [("depth: redwood", depth), ("rgb: gaussian", rgb)] {
        let fastest_s = (0..ROUNDS).map(|index| seconds(&noise, index)).fold(f64::INFINITY, f64::min);
        println!("{name}: {:.3} ms for {SIDE} x {SIDE}, fastest of {ROUNDS}, wall time", fastest_s * 1e3);
    }
}

fn seconds(noise: &Noise, index: u64) -> f64 {
    let pixels = (SIDE * SIDE) as usize;
    let depth = (0..pixels).map(|pixel| 1.0 + pixel as f32 / pixels as f32 * 5.0).collect();
    let instances = vec![InstanceId::NONE; pixels];
    let mut frame = CameraImage { width: SIDE, height: SIDE, rgb: vec![128; 3 * pixels], depth, instances };
    let start = Instant::now();
    noise.apply(black_box(&mut frame), index, 10.0);
    let taken_s = start.elapsed().as_secs_f64();
    black_box(&frame);
    taken_s
}
