//! Signal generators for loops, whose samples beyond the end wrap to the start; spectral balance, peak limit and loudness.

use crate::SAMPLE_RATE_HZ;
use avln_geom::Rng;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex, num_complex::Complex32};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

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

/// Root mean square during peak limiting.
const LEVEL: f32 = 0.05;

/// Largest peak over root mean square: 13 dB.
const CREST: f32 = 4.467;

/// Edges between the low, middle and high parts, hertz.
const LOW_END_HZ: f32 = 1200.0;
const HIGH_START_HZ: f32 = 2000.0;

/// Smallest energy share for the low and the high part.
const MIN_SHARE: f32 = 0.3;

/// Lowest clip frequency, hertz.
const CUT_HZ: f32 = 80.0;

pub(super) struct Mastering {
    forward: Arc<dyn RealToComplex<f32>>,
    inverse: Arc<dyn ComplexToReal<f32>>,
}

impl Mastering {
    pub(super) fn new(length: usize) -> Self {
        let mut planner = RealFftPlanner::<f32>::new();
        Self { forward: planner.plan_fft_forward(length), inverse: planner.plan_fft_inverse(length) }
    }

    pub(super) fn apply(&self, sound: &mut [f32]) {
        const ROUNDS: usize = 4;
        self.balance(sound);
        set_level(sound);
        for _ in 0..ROUNDS {
            limit(sound);
            set_level(sound);
        }
        let audible = self.set_loudness(sound);
        debug_assert!(audible);
    }

    /// Scales a loop to the common loudness. Returns false, without a change, if it is almost silent.
    pub(super) fn set_loudness(&self, sound: &mut [f32]) -> bool {
        // -120 dB for a recording with full-scale samples.
        const SILENCE: f64 = 1e-6;
        let mut spectrum = self.forward.make_output_vec();
        let done = self.forward.process(&mut sound.to_vec(), &mut spectrum);
        debug_assert!(done.is_ok());
        let loudness = weighted_mean_square(&spectrum, sound.len()).sqrt();
        let audible = loudness > SILENCE && loudness.is_finite();
        let gain = if audible { (f64::from(LOUDNESS) / loudness) as f32 } else { 1.0 };
        sound.iter_mut().for_each(|sample| *sample *= gain);
        audible
    }

    /// Weighs the low and high parts, so that both are audible.
    fn balance(&self, sound: &mut [f32]) {
        let mut spectrum = self.forward.make_output_vec();
        let done = self.forward.process(sound, &mut spectrum);
        weigh(&mut spectrum, SAMPLE_RATE_HZ as f32 / sound.len() as f32);
        let done = done.and_then(|()| self.inverse.process(&mut spectrum, sound));
        debug_assert!(done.is_ok());
    }
}

fn weigh(spectrum: &mut [Complex32], bin_hz: f32) {
    let cut = (CUT_HZ / bin_hz) as usize;
    spectrum[..cut].fill(Complex32::default());
    let last = spectrum.len() - 1;
    spectrum[last] = Complex32::default();
    let energy = |from_hz: f32, to_hz: f32| -> f32 {
        let bins = &spectrum[(from_hz / bin_hz) as usize..(to_hz / bin_hz) as usize];
        bins.iter().map(Complex32::norm_sqr).sum::<f32>().max(f32::MIN_POSITIVE)
    };
    let top_hz = last as f32 * bin_hz;
    let parts = [energy(0.0, LOW_END_HZ), energy(LOW_END_HZ, HIGH_START_HZ), energy(HIGH_START_HZ, top_hz)];
    let total: f32 = parts.iter().sum();
    let [low, high] = [parts[0] / total, parts[2] / total].map(|share| share.max(MIN_SHARE));
    let middle = (parts[1] / total).min(1.0 - 2.0 * MIN_SHARE);
    let wanted = [low, middle, high].map(|share| share / (low + middle + high));
    let gains: [f32; 3] = std::array::from_fn(|part| (wanted[part] * total / parts[part]).sqrt());
    for (bin, value) in spectrum.iter_mut().enumerate() {
        *value *= gain_at(bin as f32 * bin_hz, &gains);
    }
}

/// Gain at a frequency, blended over a fifth of an octave around the edges.
fn gain_at(frequency_hz: f32, gains: &[f32; 3]) -> f32 {
    const HALF_WIDTH: f32 = 0.07;
    let passed =
        |border_hz: f32| ((frequency_hz / border_hz - 1.0) / (2.0 * HALF_WIDTH) + 0.5).clamp(0.0, 1.0);
    let lower = gains[0] + (gains[1] - gains[0]) * passed(LOW_END_HZ);
    lower + (gains[2] - lower) * passed(HIGH_START_HZ)
}

fn set_level(sound: &mut [f32]) {
    let mean_square = sound.iter().map(|sample| f64::from(sample * sample)).sum::<f64>() / sound.len() as f64;
    let gain = LEVEL / (mean_square.sqrt() as f32).max(f32::MIN_POSITIVE);
    sound.iter_mut().for_each(|sample| *sample *= gain);
}

/// Limits peaks: linear up to half the maximum, then saturating.
fn limit(sound: &mut [f32]) {
    const KNEE: f32 = 0.5;
    let ceiling = LEVEL * CREST;
    for sample in sound {
        let share = sample.abs() / ceiling;
        if share > KNEE {
            let bent = KNEE + (1.0 - KNEE) * libm::tanhf((share - KNEE) / (1.0 - KNEE));
            *sample = sample.signum() * bent * ceiling;
        }
    }
}

/// A-weighted root mean square for every clip; the unweighted mean over synthesised clips is then 0.05.
pub(super) const LOUDNESS: f32 = 0.0468;

/// A-weighted mean square for `length` samples, from the half spectrum.
pub(super) fn weighted_mean_square(spectrum: &[Complex32], length: usize) -> f64 {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / length as f64;
    let weighted =
        |(bin, value): (usize, &Complex32)| weight(bin as f64 * bin_hz) * f64::from(value.norm_sqr());
    // A bin also represents the mirror image; the weight at both ends is small.
    2.0 * spectrum.iter().enumerate().map(weighted).sum::<f64>() / (length as f64 * length as f64)
}

/// A-weighting as an energy factor, 1 at 1 kHz (IEC 61672-1, annex E).
fn weight(frequency_hz: f64) -> f64 {
    const CORNERS: [f64; 4] = [20.6 * 20.6, 107.7 * 107.7, 737.9 * 737.9, 12_194.0 * 12_194.0];
    const AT_1_KHZ: f64 = 0.630_978;
    let squared = frequency_hz * frequency_hz;
    let [a, b, c, d] = CORNERS.map(|corner| squared + corner);
    let rise = CORNERS[3] * squared * squared / (a * d);
    rise * rise / (b * c) / AT_1_KHZ
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_match_the_standard() {
        // IEC 61672-1, table 3, decibels.
        for (frequency_hz, level_db) in
            [(125.0, -16.1), (500.0, -3.2), (1000.0, 0.0), (4000.0, 1.0), (8000.0, -1.1)]
        {
            let found_db = 10.0 * weight(frequency_hz).log10();
            assert!((found_db - level_db).abs() < 0.1, "{frequency_hz} Hz: {found_db} dB");
        }
    }
}
