//! Tones with many harmonics.

use crate::SAMPLE_RATE_HZ;
use std::f32::consts::TAU;

/// A train of smooth pulses at `pitch_hz`.
pub(super) fn buzz(pitch_hz: f32, count: usize) -> Vec<f32> {
    let turn = turn_of(pitch_hz);
    // A power of a raised cosine: a narrow hump per period.
    let pulse = |n: usize| {
        let cosine = 0.5 + 0.5 * libm::cosf((turn * n as f32) % TAU);
        let squared = cosine * cosine;
        let fourth = squared * squared;
        fourth * fourth * fourth - 0.15
    };
    (0..count).map(pulse).collect()
}

/// All harmonics of `pitch_hz` below 7 kHz, with falling amplitude.
///
/// The sum of cosines is the Dirichlet kernel; a leaky integrator tilts it by up to 6 dB per octave.
pub(super) fn note(pitch_hz: f32, count: usize) -> Vec<f32> {
    const TOP_HZ: f32 = 7000.0;
    const KEPT: f32 = 0.7;
    let turn = turn_of(pitch_hz);
    let harmonics = (TOP_HZ / pitch_hz).max(1.0) as u32 as f32;
    let mut sum = 0.0;
    let next = |n: usize| {
        sum = KEPT * sum + (1.0 - KEPT) * cosines((turn * n as f32) % TAU, harmonics) / harmonics;
        sum
    };
    (0..count).map(next).collect()
}

/// `cos(x) + cos(2 x) + … + cos(count x)`.
fn cosines(x: f32, count: f32) -> f32 {
    let half = libm::sinf(0.5 * x);
    if half.abs() < 1e-4 { count } else { 0.5 * (libm::sinf((count + 0.5) * x) / half - 1.0) }
}

/// A tone at `pitch_hz` with phase modulation at `ratio` times the pitch, starting at `depth` radians and
/// decaying.
pub(super) fn bell(pitch_hz: f32, ratio: f32, depth: f32, count: usize) -> Vec<f32> {
    let (carrier, modulator) = (turn_of(pitch_hz), turn_of(pitch_hz * ratio));
    let next = |n: usize| {
        let left = 1.0 - n as f32 / count as f32;
        let swing = depth * left * libm::sinf((modulator * n as f32) % TAU);
        libm::sinf((carrier * n as f32) % TAU + swing)
    };
    (0..count).map(next).collect()
}

/// Radians a sample at `frequency_hz`.
fn turn_of(frequency_hz: f32) -> f32 {
    TAU * frequency_hz / SAMPLE_RATE_HZ as f32
}
