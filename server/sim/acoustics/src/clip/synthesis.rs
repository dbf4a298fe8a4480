//! Signal generators for loops: samples beyond the end wrap to the start.

use crate::SAMPLE_RATE_HZ;
use avln_geom::Rng;
use std::f32::consts::{PI, TAU};

/// Clip length, samples: six seconds.
pub(super) const CLIP_SAMPLES: usize = 6 * SAMPLE_RATE_HZ as usize;

pub(super) fn silence() -> Vec<f32> {
    vec![0.0; CLIP_SAMPLES]
}

/// White noise, -1 to 1.
pub(super) fn white(rng: &mut Rng) -> Vec<f32> {
    (0..CLIP_SAMPLES).map(|_| rng.range(-1.0, 1.0)).collect()
}

/// Pink noise, -3 dB per octave: three leaky sums over white noise, one per two octaves.
pub(super) fn pink(rng: &mut Rng) -> Vec<f32> {
    let white = white(rng);
    let mut pink: Vec<f32> = white.iter().map(|sample| 0.2 * sample).collect();
    for (keep, gain) in [(0.995, 0.1), (0.96, 0.3), (0.6, 1.0)] {
        let mut leaky = white.clone();
        recur(&mut leaky, keep, 0.0);
        add(&mut pink, &leaky, 0, gain);
    }
    pink
}

pub(super) fn samples(seconds: f32) -> usize {
    (seconds * SAMPLE_RATE_HZ as f32) as usize
}

/// Adds `event` times `gain` to the loop from sample `start`, wrapping at the end.
pub(super) fn add(target: &mut [f32], event: &[f32], start: usize, gain: f32) {
    let mut place = start % target.len();
    for part in event.chunks(target.len()) {
        let (before_end, after_end) = part.split_at(part.len().min(target.len() - place));
        for (from, samples) in [(place, before_end), (0, after_end)] {
            target[from..].iter_mut().zip(samples).for_each(|(sum, sample)| *sum += gain * sample);
        }
        place = (place + part.len()) % target.len();
    }
}

/// Filters in place: `y[n] = x[n] + a y[n-1] + b y[n-2]`.
pub(super) fn recur(signal: &mut [f32], a: f32, b: f32) {
    let input = signal.to_vec();
    // The second round starts in the steady state that the loop settles into.
    let (mut last, mut before) = (0.0, 0.0);
    for _ in 0..2 {
        for (sample, input) in signal.iter_mut().zip(&input) {
            *sample = input + a * last + b * before;
            (before, last) = (last, *sample);
        }
    }
}

/// First-order low pass with a moving edge; `edge_hz` maps the elapsed loop share to hertz.
pub(super) fn low_pass(signal: &[f32], edge_hz: impl Fn(f32) -> f32) -> Vec<f32> {
    /// Samples with a constant edge.
    const BLOCK: usize = 64;
    let follow = |block: usize| {
        let angle = TAU * edge_hz((block * BLOCK) as f32 / signal.len() as f32) / SAMPLE_RATE_HZ as f32;
        angle / (1.0 + angle)
    };
    let follows: Vec<f32> = (0..signal.len().div_ceil(BLOCK)).map(follow).collect();
    let mut passed = signal.to_vec();
    let mut level = 0.0;
    for _ in 0..2 {
        for (n, (out, input)) in passed.iter_mut().zip(signal).enumerate() {
            level += follows[n / BLOCK] * (input - level);
            *out = level;
        }
    }
    passed
}

/// Resonance at `frequency_hz`, `bandwidth_hz` wide, with a peak gain near 1.
pub(super) fn resonate(signal: &[f32], frequency_hz: f32, bandwidth_hz: f32) -> Vec<f32> {
    let rate = SAMPLE_RATE_HZ as f32;
    let radius = libm::expf(-PI * bandwidth_hz / rate);
    let gain = (1.0 - radius) * 2.0 * libm::sinf(PI * frequency_hz.min(rate / 4.0) / rate).max(0.05);
    let mut resonant: Vec<f32> = signal.iter().map(|sample| gain * sample).collect();
    recur(&mut resonant, 2.0 * radius * libm::cosf(TAU * frequency_hz / rate), -radius * radius);
    resonant
}

/// A hump with `count` samples: rises over the first `attack` share, falls over the rest, both half cosines.
pub(super) fn hump(count: usize, attack: f32) -> Vec<f32> {
    let peak = (attack * count as f32).max(1.0);
    let fall = (count as f32 - peak).max(1.0);
    let height = |n: usize| {
        let n = n as f32 + 0.5;
        let share = if n < peak { n / peak } else { 1.0 - (n - peak) / fall };
        0.5 - 0.5 * libm::cosf(PI * share)
    };
    (0..count).map(height).collect()
}

/// A sweep, even in octaves, with `count` samples.
pub(super) fn sweep(from_hz: f32, to_hz: f32, count: usize) -> Vec<f32> {
    let step = libm::expf(libm::logf(to_hz / from_hz) / count as f32);
    let (mut frequency_hz, mut phase) = (from_hz, 0.0_f32);
    let next = |_| {
        phase = (phase + TAU * frequency_hz / SAMPLE_RATE_HZ as f32) % TAU;
        frequency_hz *= step;
        libm::sinf(phase)
    };
    (0..count).map(next).collect()
}

/// Event starts on the loop, samples: about `rate_hz` per second, moved randomly by up to `jitter` spacings.
pub(super) fn beats(rng: &mut Rng, rate_hz: f32, jitter: f32) -> Vec<usize> {
    let count = (rate_hz * CLIP_SAMPLES as f32 / SAMPLE_RATE_HZ as f32).round().max(1.0) as usize;
    let share = CLIP_SAMPLES as f32 / count as f32;
    let place = |beat: usize| (beat as f32 + 0.5 + rng.range(-0.5, 0.5) * jitter) * share;
    (0..count).map(place).map(|start| start as usize).collect()
}

/// Scales to root mean square 1; silence stays silent.
pub(super) fn normalized(signal: &[f32]) -> Vec<f32> {
    let mean_square = signal.iter().map(|sample| sample * sample).sum::<f32>() / signal.len().max(1) as f32;
    let gain = if mean_square > 0.0 { 1.0 / mean_square.sqrt() } else { 1.0 };
    signal.iter().map(|sample| gain * sample).collect()
}

pub(super) fn shaped(signal: &[f32], envelope: &[f32]) -> Vec<f32> {
    signal.iter().zip(envelope).map(|(sample, gain)| sample * gain).collect()
}

pub(super) fn buzz(pitch_hz: f32, count: usize) -> Vec<f32> {
    let turn = turn_of(pitch_hz);
    // A high power of a raised cosine is a narrow hump per period.
    let pulse = |n: usize| {
        let cosine = 0.5 + 0.5 * libm::cosf((turn * n as f32) % TAU);
        let squared = cosine * cosine;
        let fourth = squared * squared;
        fourth * fourth * fourth - 0.15
    };
    (0..count).map(pulse).collect()
}

/// All harmonics below 7 kHz with falling amplitude.
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

/// `cos(x) + cos(2 x) + … + cos(count x)`: the Dirichlet kernel.
fn cosines(x: f32, count: f32) -> f32 {
    let half = libm::sinf(0.5 * x);
    if half.abs() < 1e-4 { count } else { 0.5 * (libm::sinf((count + 0.5) * x) / half - 1.0) }
}

/// A tone with phase modulation at `ratio` times the pitch, decaying from `depth` radians.
pub(super) fn bell(pitch_hz: f32, ratio: f32, depth: f32, count: usize) -> Vec<f32> {
    let (carrier, modulator) = (turn_of(pitch_hz), turn_of(pitch_hz * ratio));
    let next = |n: usize| {
        let left = 1.0 - n as f32 / count as f32;
        let swing = depth * left * libm::sinf((modulator * n as f32) % TAU);
        libm::sinf((carrier * n as f32) % TAU + swing)
    };
    (0..count).map(next).collect()
}

/// Radians per sample.
fn turn_of(frequency_hz: f32) -> f32 {
    TAU * frequency_hz / SAMPLE_RATE_HZ as f32
}
