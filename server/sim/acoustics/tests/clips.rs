//! Every clip can be placed by ear, in each quarter of a second, in a room that rings.

mod common;

use avln_acoustics::{Bank, SAMPLE_RATE_HZ};
use avln_geom::Rng;
use common::lag::{FRAME, Fourier};

/// Delay at the right ear, samples: a source 45 degrees to the left.
const LAG: i32 = 8;
/// Two samples are some 15 degrees.
const TOLERANCE: f32 = 2.0;

/// Share of the frames of a loop in which the lag is found.
fn placed(fourier: &mut Fourier, clip: &[f32]) -> f64 {
    let ears = [0, LAG].map(|lag| heard(fourier, clip, &response(lag)));
    let [left, right] = ears.each_ref().map(|ear| ear.chunks_exact(FRAME));
    let found =
        left.zip(right).map(|(left, right)| (fourier.lag(left, right) - LAG as f32).abs() <= TOLERANCE);
    let found: Vec<bool> = found.collect();
    found.iter().filter(|&&found| found).count() as f64 / found.len() as f64
}

/// The loop `clip` through `response`.
fn heard(fourier: &mut Fourier, clip: &[f32], response: &[f32]) -> Vec<f32> {
    let through = fourier.spectrum(response, clip.len());
    let product = fourier.spectrum(clip, clip.len()).iter().zip(&through).map(|(a, b)| a * b).collect();
    fourier.signal(product, clip.len())
}

/// A direct sound after `lag` samples, and four times its energy in an independent diffuse tail: 60 dB in
/// 0.25 s.
fn response(lag: i32) -> Vec<f32> {
    let mut rng = Rng::new(31 + lag as u64);
    let decay = |n: usize| libm::expf(-6.9 * n as f32 / FRAME as f32);
    let tail: Vec<f32> = (0..FRAME).map(|n| decay(n) * rng.range(-1.0, 1.0)).collect();
    let energy: f32 = tail.iter().map(|sample| sample * sample).sum();
    let mut response = vec![0.0; FRAME + 64];
    response[lag as usize] = 1.0;
    response[40..].iter_mut().zip(&tail).for_each(|(sum, sample)| *sum += 2.0 * sample / energy.sqrt());
    response
}

#[test]
fn every_clip_can_be_placed_by_ear_in_nearly_every_step() {
    let mut fourier = Fourier::default();
    for clip in Bank::default().clips() {
        let share = placed(&mut fourier, &clip.samples);
        assert!(share >= 0.95, "{}: its lag is found in {share} of the steps", clip.name);
    }
}

#[test]
fn a_tone_cannot_be_placed() {
    let mut fourier = Fourier::default();
    let turn = std::f32::consts::TAU * 3000.0 / SAMPLE_RATE_HZ as f32;
    let tone: Vec<f32> =
        (0..24 * FRAME).map(|n| 0.07 * libm::sinf((turn * n as f32) % std::f32::consts::TAU)).collect();
    let share = placed(&mut fourier, &tone);
    assert!(share < 0.7, "{share}");
}
