//! Segmentation time on one thread: fastest and median run out of a hundred.

use avln_perception::{CameraModel, Depth, Perception, Picture, VisionNetwork};
use std::hint::black_box;
use std::time::Instant;

fn main() {
    let mut network = VisionNetwork::new().expect("the weights of the crate");
    for side in [192, 256] {
        let rgb: Vec<u8> = (0..3 * side * side).map(|i| (i * 31 % 251) as u8).collect();
        let metres: Vec<f32> = (0..side * side).map(|i| 1.0 + (i % side) as f32 / 64.0).collect();
        let picture = Picture { width: side, height: side, rgb: &rgb };
        let camera = CameraModel { hfov_rad: 1.57, height_m: 1.0, pitch_rad: 0.0 };
        let mut times_ms: Vec<f64> = (0..100)
            .map(|_| {
                let start = Instant::now();
                black_box(network.see(&picture, Some((&Depth { metres: &metres }, &camera))))
                    .expect("a picture");
                start.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        times_ms.sort_by(f64::total_cmp);
        println!("{side} x {side}: {:.1} ms, median {:.1} ms", times_ms[0], times_ms[50]);
    }
}
