//! Every clip can be placed by ear, in each quarter of a second, in a room that rings.

use avln_acoustics::{Bank, SAMPLE_RATE_HZ};
use avln_geom::Rng;
use realfft::{RealFftPlanner, num_complex::Complex32};

/// A quarter of a second: a step of an episode.
const FRAME: usize = 4000;
/// How much later the sound reaches the right ear, samples: that of a source 45 degrees to the left.
const LAG: i32 = 8;
/// The longest lag of a head, samples.
const LONGEST_LAG: i32 = 12;
/// Two samples are some 15 degrees.
const TOLERANCE: i32 = 2;

/// Transforms of one length.
struct Fourier(RealFftPlanner<f32>);

impl Fourier {
    fn spectrum(&mut self, signal: &[f32], length: usize) -> Vec<Complex32> {
        let mut padded = signal.to_vec();
        padded.resize(length, 0.0);
        let forward = self.0.plan_fft_forward(length);
        let mut spectrum = forward.make_output_vec();
        forward.process(&mut padded, &mut spectrum).expect("lengths agree");
        spectrum
    }

    fn signal(&mut self, mut spectrum: Vec<Complex32>, length: usize) -> Vec<f32> {
        let last = spectrum.len() - 1;
        (spectrum[0].im, spectrum[last].im) = (0.0, 0.0);
        let inverse = self.0.plan_fft_inverse(length);
        let mut signal = inverse.make_output_vec();
        inverse.process(&mut spectrum, &mut signal).expect("lengths agree");
        signal
    }

    /// The loop `clip` through `response`.
    fn heard(&mut self, clip: &[f32], response: &[f32]) -> Vec<f32> {
        let through = self.spectrum(response, clip.len());
        let product = self.spectrum(clip, clip.len()).iter().zip(&through).map(|(a, b)| a * b).collect();
        self.signal(product, clip.len())
    }

    /// Samples by which the right ear hears later, by generalised cross-correlation with phase transform
    /// (Knapp and Carter 1976).
    fn lag(&mut self, left: &[f32], right: &[f32]) -> i32 {
        let length = 2 * FRAME;
        let (left, right) = (self.spectrum(left, length), self.spectrum(right, length));
        let phase = |(l, r): (&Complex32, &Complex32)| {
            let cross = r * l.conj();
            cross / cross.norm().max(1e-12)
        };
        let correlation = self.signal(left.iter().zip(&right).map(phase).collect(), length);
        let at = |lag: i32| correlation[lag.rem_euclid(length as i32) as usize];
        (-LONGEST_LAG..=LONGEST_LAG).max_by(|&a, &b| at(a).total_cmp(&at(b))).expect("a lag")
    }

    /// Share of the frames of a loop in which the lag is found.
    fn placed(&mut self, clip: &[f32]) -> f64 {
        let ears = [0, LAG].map(|lag| self.heard(clip, &response(lag)));
        let [left, right] = ears.each_ref().map(|ear| ear.chunks_exact(FRAME));
        let found = left.zip(right).map(|(left, right)| (self.lag(left, right) - LAG).abs() <= TOLERANCE);
        let found: Vec<bool> = found.collect();
        found.iter().filter(|&&found| found).count() as f64 / found.len() as f64
    }
}

/// A direct sound after `lag` samples, and four times its energy in a diffuse tail of the ear's own: 60 dB in 0.25 s.
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
    let mut fourier = Fourier(RealFftPlanner::new());
    for clip in Bank::default().clips() {
        let share = fourier.placed(&clip.samples);
        assert!(share >= 0.95, "{}: its lag is found in {share} of the steps", clip.name);
    }
}

#[test]
fn a_tone_cannot_be_placed() {
    let mut fourier = Fourier(RealFftPlanner::new());
    let turn = std::f32::consts::TAU * 3000.0 / SAMPLE_RATE_HZ as f32;
    let tone: Vec<f32> =
        (0..24 * FRAME).map(|n| 0.07 * libm::sinf((turn * n as f32) % std::f32::consts::TAU)).collect();
    let share = fourier.placed(&tone);
    assert!(share < 0.7, "{share}");
}
