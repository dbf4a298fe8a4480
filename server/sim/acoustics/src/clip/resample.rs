//! Sample rate conversion of recordings.

use std::f64::consts::PI;

/// Zero crossings of the filter per side.
const CROSSINGS: f64 = 24.0;

/// Half-amplitude frequency of the filter, as a share of the lower Nyquist frequency.
const EDGE: f64 = 0.95;

/// Converts `samples` from `from_hz` to `to_hz` by a windowed sinc.
///
/// Filters are computed once per phase (Crochiere and Rabiner 1983, polyphase), with a Blackman window.
pub(super) fn resample(samples: &[f32], from_hz: u32, to_hz: u32) -> Vec<f32> {
    if from_hz == to_hz {
        return samples.to_vec();
    }
    let shared = common_divisor(from_hz, to_hz);
    let (step, phases) = ((from_hz / shared) as usize, (to_hz / shared) as usize);
    // Relative to the Nyquist frequency of the samples.
    let cutoff = EDGE * (f64::from(to_hz) / f64::from(from_hz)).min(1.0);
    let reach = (CROSSINGS / cutoff) as usize + 1;
    let filters: Vec<_> =
        (0..phases).map(|phase| filter(phase as f64 / phases as f64, cutoff, reach)).collect();
    let count = samples.len() * phases / step;
    (0..count).map(|n| filtered(samples, n * step / phases, reach, &filters[n * step % phases])).collect()
}

/// Weights of the `2 × reach` samples around a position `share` of a sample after the first middle sample;
/// their sum is 1.
fn filter(share: f64, cutoff: f64, reach: usize) -> Vec<f32> {
    let weight = |tap: usize| {
        let distance = tap as f64 - (reach as f64 - 1.0) - share;
        sinc(cutoff * distance) * blackman(distance / reach as f64)
    };
    let weights: Vec<f64> = (0..2 * reach).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| (weight / sum) as f32).collect()
}

/// Weighted sum of the samples around `place`; silence outside the recording.
fn filtered(samples: &[f32], place: usize, reach: usize, weights: &[f32]) -> f32 {
    let before = reach - 1;
    let skipped = before.saturating_sub(place);
    let start = (place + skipped) - before;
    samples[start..].iter().zip(&weights[skipped..]).map(|(sample, weight)| sample * weight).sum()
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { libm::sin(PI * x) / (PI * x) }
}

/// Blackman's window over -1 to 1; 0 beyond.
fn blackman(x: f64) -> f64 {
    if x.abs() >= 1.0 { 0.0 } else { 0.42 + 0.5 * libm::cos(PI * x) + 0.08 * libm::cos(2.0 * PI * x) }
}

fn common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(frequency_hz: f64, rate_hz: u32, count: usize) -> Vec<f32> {
        let turn = frequency_hz / f64::from(rate_hz);
        (0..count).map(|n| libm::sin(2.0 * PI * (turn * n as f64).fract()) as f32).collect()
    }

    #[test]
    fn tones_keep_their_phase_and_level() {
        for rate_hz in [8_000, 11_025, 44_100, 48_000, 96_000, 47_999] {
            for frequency_hz in [50.0, 440.0, 3000.0] {
                let resampled = resample(&tone(frequency_hz, rate_hz, rate_hz as usize), rate_hz, 16_000);
                assert_eq!(resampled.len(), 16_000);
                let wanted = tone(frequency_hz, 16_000, 16_000);
                // At both ends half of the filter covers silence.
                let errors = resampled.iter().zip(&wanted).skip(200).take(15_600).map(|(a, b)| (a - b).abs());
                let worst = errors.fold(0.0, f32::max);
                assert!(worst < 1e-3, "{rate_hz} Hz, tone of {frequency_hz} Hz: {worst}");
            }
        }
    }

    #[test]
    fn what_is_too_high_for_the_new_rate_is_gone() {
        for rate_hz in [22_050, 44_100, 192_000] {
            let resampled = resample(&tone(9500.0, rate_hz, rate_hz as usize), rate_hz, 16_000);
            let peak = resampled[200..15_800].iter().fold(0.0_f32, |peak, sample| peak.max(sample.abs()));
            assert!(peak < 1e-3, "{rate_hz}: {peak}");
        }
    }
}
