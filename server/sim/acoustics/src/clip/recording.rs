//! Clips from recordings.

use super::Clip;
use super::synthesis::Mastering;
use crate::SAMPLE_RATE_HZ;
use std::f32::consts::FRAC_PI_2;
use std::f64::consts::PI;
use std::ops::RangeInclusive;

const RATES_HZ: RangeInclusive<u32> = 8_000..=192_000;
const LENGTHS_S: RangeInclusive<f64> = 1.0..=60.0;

// Most files reach 1; larger values are damage.
const LARGEST: f32 = 1e6;

/// Cross-fade from end to start, samples: 50 ms.
const SEAM_SAMPLES: usize = SAMPLE_RATE_HZ as usize / 20;

/// Recording errors.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RecordingError {
    /// Sample rate out of range, hertz.
    #[error("its sample rate is {0} Hz; 8000 to 192000 Hz are supported")]
    Rate(u32),
    /// Length out of range, seconds.
    #[error("it is {0:.2} s long; 1 to 60 s are supported")]
    Length(f64),
    /// A sample that is not finite or too large.
    #[error("its sample {index} is {value}; save it again with samples from -1 to 1")]
    Sample {
        /// Sample index, from 0.
        index: usize,
        /// Sample value.
        value: f32,
    },
    /// A silent recording.
    #[error("it is silent; remove it or record it again")]
    Silent,
}

impl Clip {
    /// Returns a clip with the common loudness from a mono recording at `rate_hz`. The last 50 ms fade into
    /// the first, so that the loop is seamless and 50 ms shorter.
    ///
    /// # Errors
    /// If the rate is outside 8000 to 192000 Hz, the length is outside 1 to 60 s, the recording is silent, or
    /// a sample is not finite or above a million.
    pub fn recorded(name: &str, samples: &[f32], rate_hz: u32) -> Result<Self, RecordingError> {
        check(samples, rate_hz)?;
        let mut sound = without_seam(&resample(samples, rate_hz, SAMPLE_RATE_HZ));
        if !Mastering::new(sound.len()).set_loudness(&mut sound) {
            return Err(RecordingError::Silent);
        }
        Ok(Self { name: name.to_owned(), samples: sound.into() })
    }
}

fn check(samples: &[f32], rate_hz: u32) -> Result<(), RecordingError> {
    if !RATES_HZ.contains(&rate_hz) {
        return Err(RecordingError::Rate(rate_hz));
    }
    let length_s = samples.len() as f64 / f64::from(rate_hz);
    if !LENGTHS_S.contains(&length_s) {
        return Err(RecordingError::Length(length_s));
    }
    match samples.iter().position(|sample| sample.is_nan() || sample.abs() > LARGEST) {
        Some(index) => Err(RecordingError::Sample { index, value: samples[index] }),
        None => Ok(()),
    }
}

/// Cross-fades the end into the start at constant power.
fn without_seam(sound: &[f32]) -> Vec<f32> {
    let (kept, end) = sound.split_at(sound.len().saturating_sub(SEAM_SAMPLES));
    let mut looped = kept.to_vec();
    for (index, (start, end)) in looped.iter_mut().zip(end).enumerate() {
        let angle = FRAC_PI_2 * (index as f32 + 0.5) / SEAM_SAMPLES as f32;
        *start = *start * libm::sinf(angle) + end * libm::cosf(angle);
    }
    looped
}

/// Zero crossings per filter side.
const CROSSINGS: f64 = 24.0;

/// Half-amplitude frequency relative to the lower Nyquist frequency.
const EDGE: f64 = 0.95;

pub(super) fn resample(samples: &[f32], from_hz: u32, to_hz: u32) -> Vec<f32> {
    if from_hz == to_hz {
        return samples.to_vec();
    }
    let shared = common_divisor(from_hz, to_hz);
    let (step, phases) = ((from_hz / shared) as usize, (to_hz / shared) as usize);
    // Relative to the input's Nyquist frequency.
    let cutoff = EDGE * (f64::from(to_hz) / f64::from(from_hz)).min(1.0);
    let reach = (CROSSINGS / cutoff) as usize + 1;
    let filters: Vec<_> =
        (0..phases).map(|phase| filter(phase as f64 / phases as f64, cutoff, reach)).collect();
    let count = samples.len() * phases / step;
    (0..count).map(|n| filtered(samples, n * step / phases, reach, &filters[n * step % phases])).collect()
}

/// Weights with sum 1 for `2 × reach` samples around `share` samples after the first middle sample.
fn filter(share: f64, cutoff: f64, reach: usize) -> Vec<f32> {
    let weight = |tap: usize| {
        let distance = tap as f64 - (reach as f64 - 1.0) - share;
        sinc(cutoff * distance) * blackman(distance / reach as f64)
    };
    let weights: Vec<f64> = (0..2 * reach).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| (weight / sum) as f32).collect()
}

/// Weighted sum around sample `place`; silence outside the recording.
fn filtered(samples: &[f32], place: usize, reach: usize, weights: &[f32]) -> f32 {
    let before = reach - 1;
    let skipped = before.saturating_sub(place);
    let start = (place + skipped) - before;
    samples[start..].iter().zip(&weights[skipped..]).map(|(sample, weight)| sample * weight).sum()
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { libm::sin(PI * x) / (PI * x) }
}

/// Blackman window over -1 to 1; 0 beyond.
fn blackman(x: f64) -> f64 {
    if x.abs() >= 1.0 { 0.0 } else { 0.42 + 0.5 * libm::cos(PI * x) + 0.08 * libm::cos(2.0 * PI * x) }
}

fn common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::TAU;

    fn tone(frequency_hz: f32, rate_hz: u32, seconds: f32) -> Vec<f32> {
        let turn = f64::from(frequency_hz) / f64::from(rate_hz);
        let sample = |n: usize| 0.2 * libm::sinf(TAU * (turn * n as f64).fract() as f32);
        (0..(seconds * rate_hz as f32) as usize).map(sample).collect()
    }

    fn root_mean_square(samples: &[f32]) -> f32 {
        (samples.iter().map(|sample| sample * sample).sum::<f32>() / samples.len() as f32).sqrt()
    }

    #[test]
    fn sample_rate_does_not_change_a_clip() {
        // A 1 kHz tone has weight 1, so mean square and loudness are equal.
        for rate_hz in [8_000, 11_025, 16_000, 22_050, 44_100, 48_000, 96_000, 192_000] {
            let clip = Clip::recorded("tone", &tone(1000.0, rate_hz, 2.0), rate_hz).expect("a clip");
            assert_eq!(clip.samples.len(), 2 * 16_000 - 800, "{rate_hz}");
            let level = root_mean_square(&clip.samples);
            assert!((level / crate::clip::synthesis::LOUDNESS - 1.0).abs() < 0.002, "{rate_hz}: {level}");
        }
    }

    #[test]
    fn recording_level_does_not_change_a_clip() {
        let tones = [tone(700.0, 16_000, 1.5), tone(2500.0, 16_000, 1.5)];
        let sound: Vec<f32> = tones[0].iter().zip(&tones[1]).map(|(a, b)| a + b).collect();
        let soft: Vec<f32> = sound.iter().map(|sample| 0.001 * sample).collect();
        let [loud, soft] = [sound, soft].map(|sound| Clip::recorded("", &sound, 16_000).expect("a clip"));
        assert!(loud.samples.iter().zip(soft.samples.iter()).all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn recordings_loop_without_a_step() {
        let clip = Clip::recorded("", &tone(333.3, 16_000, 1.37), 16_000).expect("a clip");
        let steps = clip.samples.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let largest = steps.fold(0.0, f32::max);
        let seam = (clip.samples[0] - clip.samples[clip.samples.len() - 1]).abs();
        assert!(seam <= 1.05 * largest, "{seam} after steps of up to {largest}");
    }

    #[test]
    fn unusable_recordings_fail_with_a_reason() {
        let refused = |samples: &[f32], rate_hz| Clip::recorded("", samples, rate_hz).expect_err("no clip");
        assert_eq!(refused(&[0.1; 8000], 7999), RecordingError::Rate(7999));
        assert_eq!(refused(&[], 16_000), RecordingError::Length(0.0));
        assert!(refused(&[0.1; 15_999], 16_000).to_string().contains("1 to 60 s"));
        assert!(matches!(refused(&vec![0.1; 61 * 8000], 8000), RecordingError::Length(_)));
        for silence in [0.0, 1e-9] {
            assert_eq!(refused(&[silence; 16_000], 16_000), RecordingError::Silent);
        }
        let mut broken = tone(500.0, 16_000, 1.0);
        for wrong in [f32::NAN, f32::NEG_INFINITY, f32::MAX] {
            broken[77] = wrong;
            assert!(refused(&broken, 16_000).to_string().starts_with("its sample 77 is "));
        }
        broken[77] = LARGEST;
        let clip = Clip::recorded("", &broken, 16_000).expect("a click");
        assert!(clip.samples.iter().all(|sample| sample.is_finite()));
    }

    fn unit_tone(frequency_hz: f64, rate_hz: u32, count: usize) -> Vec<f32> {
        let turn = frequency_hz / f64::from(rate_hz);
        (0..count).map(|n| libm::sin(2.0 * PI * (turn * n as f64).fract()) as f32).collect()
    }

    #[test]
    fn resampled_tones_keep_phase_and_level() {
        for rate_hz in [8_000, 11_025, 44_100, 48_000, 96_000, 47_999] {
            for frequency_hz in [50.0, 440.0, 3000.0] {
                let resampled =
                    resample(&unit_tone(frequency_hz, rate_hz, rate_hz as usize), rate_hz, 16_000);
                assert_eq!(resampled.len(), 16_000);
                let wanted = unit_tone(frequency_hz, 16_000, 16_000);
                // At both ends half the filter covers silence.
                let errors = resampled.iter().zip(&wanted).skip(200).take(15_600).map(|(a, b)| (a - b).abs());
                let worst = errors.fold(0.0, f32::max);
                assert!(worst < 1e-3, "{rate_hz} Hz, tone of {frequency_hz} Hz: {worst}");
            }
        }
    }

    #[test]
    fn resampling_removes_frequencies_above_the_new_limit() {
        for rate_hz in [22_050, 44_100, 192_000] {
            let resampled = resample(&unit_tone(9500.0, rate_hz, rate_hz as usize), rate_hz, 16_000);
            let peak = resampled[200..15_800].iter().fold(0.0_f32, |peak, sample| peak.max(sample.abs()));
            assert!(peak < 1e-3, "{rate_hz}: {peak}");
        }
    }
}
