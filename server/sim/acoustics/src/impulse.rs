//! Impulse response per ear from arriving waves.

use crate::bands::{BandLoss, LOSS_TAPS, loss_filter};
use crate::building::Settings;
use crate::head::filter::{HEAD_LEAD, HEAD_TAPS};
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_geom::{Point3, Vector3};
use std::f32::consts::PI;

/// Smallest effective path length, metres.
const MIN_DISTANCE_M: f32 = 0.1;

/// Half the taps in the fractional delay filter.
const DELAY_HALF_TAPS: usize = 16;

/// A head pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Listener {
    /// Head centre, world frame, metres.
    pub position: Point3<f32>,
    /// Rotation about +Y, radians; 0 faces -Z, left is positive.
    pub heading_rad: f32,
}

/// A wave at the listener.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Arrival {
    /// Unit vector from the listener towards the wave's origin, world frame.
    pub(crate) direction: Vector3<f32>,
    /// Path length, metres: determines delay, 1/r level and wave-front curvature.
    pub(crate) length_m: f32,
    /// Band losses in addition to 1/r.
    pub(crate) loss: BandLoss,
}

impl Arrival {
    fn heard_length_m(&self) -> f32 {
        self.length_m.max(MIN_DISTANCE_M)
    }

    /// Arrival time at the head centre, seconds after emission.
    pub(crate) fn delay_s(&self) -> f64 {
        f64::from(self.heard_length_m()) / f64::from(SPEED_OF_SOUND_M_S)
    }
}

/// A filter per ear from a source to a listener.
///
/// Index 0 is the emission; samples at [`SAMPLE_RATE_HZ`]. A source with unit pressure at 1 m has gain 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImpulseResponse {
    /// Left ear; lengths may differ.
    pub left: Vec<f32>,
    /// Right ear.
    pub right: Vec<f32>,
}

impl ImpulseResponse {
    pub(crate) fn new(listener: &Listener, arrivals: &[Arrival], settings: &Settings) -> Self {
        let mut response = Self::default();
        for arrival in arrivals {
            response.add(listener, arrival, settings);
        }
        response
    }

    /// Longer ear, samples.
    pub fn len(&self) -> usize {
        self.left.len().max(self.right.len())
    }

    /// Returns true if no wave arrives.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn add(&mut self, listener: &Listener, arrival: &Arrival, settings: &Settings) {
        let distance_m = arrival.heard_length_m();
        let loss = loss_filter(&arrival.loss).map(|tap| tap / distance_m);
        let responses = settings.head.ears(&arrival.direction, listener.heading_rad, distance_m);
        for (ear, response) in [&mut self.left, &mut self.right].into_iter().zip(responses) {
            let delay_s = arrival.delay_s() + response.delay_s;
            let taps: [f32; HEAD_TAPS + LOSS_TAPS - 1] = convolve(&response.filter, &loss);
            let start = delay_s * f64::from(SAMPLE_RATE_HZ) - HEAD_LEAD as f64;
            add_delayed(ear, &taps, start, settings.response_samples());
        }
    }
}

/// Convolution, cut to `N` taps.
pub(crate) fn convolve<const N: usize>(filter: &[f32; HEAD_TAPS], factors: &[f32]) -> [f32; N] {
    let mut taps = [0.0; N];
    for (offset, factor) in factors.iter().enumerate().filter(|(_, factor)| **factor != 0.0) {
        taps[offset..].iter_mut().zip(filter).for_each(|(sum, tap)| *sum += factor * tap);
    }
    taps
}

/// Adds `taps` to `ear` from sample `start`, which may be fractional or negative.
fn add_delayed(ear: &mut Vec<f32>, taps: &[f32], start: f64, max_samples: usize) {
    let whole = libm::floor(start);
    let kernel = delay_kernel((start - whole) as f32);
    let first = whole as i64 + 1 - DELAY_HALF_TAPS as i64;
    let end = first + (taps.len() + kernel.len()) as i64 - 1;
    add_convolved(ear, &kernel, taps, first, end.clamp(0, max_samples as i64) as usize);
}

/// Adds the convolution of `factors` and `taps` to `ear` from sample `first`, after extending `ear` to `end`
/// samples. Samples outside are dropped.
pub(crate) fn add_convolved(ear: &mut Vec<f32>, factors: &[f32], taps: &[f32], first: i64, end: usize) {
    if ear.len() < end {
        ear.resize(end, 0.0);
    }
    for (offset, factor) in factors.iter().enumerate() {
        let from = first + offset as i64;
        let skipped = (-from).max(0) as usize;
        let target = ear.get_mut(from.max(0) as usize..).unwrap_or_default();
        target.iter_mut().zip(taps.iter().skip(skipped)).for_each(|(sum, tap)| *sum += factor * tap);
    }
}

/// A windowed sinc that delays by [`DELAY_HALF_TAPS`] - 1 samples plus `fraction` (0 to 1).
fn delay_kernel(fraction: f32) -> [f32; 2 * DELAY_HALF_TAPS] {
    let sin_fraction = libm::sinf(PI * fraction);
    std::array::from_fn(|tap| {
        let whole = tap as i32 + 1 - DELAY_HALF_TAPS as i32;
        let time = whole as f32 - fraction;
        let window = 0.5 + 0.5 * libm::cosf(PI * time / DELAY_HALF_TAPS as f32);
        // sin(pi (n - f)) is sin(pi f) with the parity sign of n inverted.
        let sine = if whole % 2 == 0 { -sin_fraction } else { sin_fraction };
        let sinc = if time.abs() < 1e-6 { 1.0 } else { sine / (PI * time) };
        sinc * window
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractional_delays_are_accurate_to_a_microsecond() {
        for fraction in [0.0, 0.1, 0.37, 0.5, 0.93] {
            let mut ear = Vec::new();
            add_delayed(&mut ear, &[1.0], 40.0 + fraction, 1000);
            for frequency_hz in [200.0, 1000.0, 4000.0, 6000.0] {
                let turn = std::f64::consts::TAU * frequency_hz / f64::from(SAMPLE_RATE_HZ);
                let (re, im) = ear.iter().enumerate().fold((0.0, 0.0), |(re, im), (n, tap)| {
                    let phase = turn * (n as f64 - 40.0 - fraction);
                    (re + f64::from(*tap) * libm::cos(phase), im - f64::from(*tap) * libm::sin(phase))
                });
                let error_s = -libm::atan2(im, re) / (turn * f64::from(SAMPLE_RATE_HZ));
                assert!(error_s.abs() < 1e-6, "{fraction} at {frequency_hz} Hz: off by {error_s} s");
                assert!((re - 1.0).abs() < 0.02, "{fraction} at {frequency_hz} Hz: gain {re}");
            }
        }
    }

    #[test]
    fn taps_outside_of_the_response_are_dropped() {
        let mut ear = Vec::new();
        add_delayed(&mut ear, &[1.0; 4], -3.0, 1000);
        assert!((ear[0] - 1.0).abs() < 1e-6 && ear.len() < 40);
        add_delayed(&mut ear, &[1.0; 4], 1100.0, 1000);
        assert_eq!(ear.len(), 1000);
    }
}
