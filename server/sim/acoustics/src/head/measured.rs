//! Measured heads.

use super::filter::{DESIGN_BIN_HZ, DESIGN_POINTS, EarResponse, HEAD_TAPS, design_from};
use super::sofa::{EarMeasurement, HeadError, Measurements, unit_vector};
use super::sphere::{ear_axes, onset_delay_s};
use crate::SAMPLE_RATE_HZ;
use crate::late::diffuse::HeardField;
use crate::transform::unit_phasor;
use avln_geom::{Vector3, angle};
use realfft::{RealFftPlanner, num_complex::Complex64};
use std::cmp::Ordering;
use std::f64::consts::TAU;
use std::fmt;
use std::sync::OnceLock;

/// Angle between table directions, degrees.
const STEP_DEG: f32 = 5.0;

/// Table directions: a full circle, and from straight down to straight up.
const AROUND: usize = 72;
const UP: usize = 37;

/// Measured directions interpolated into a table direction.
const NEIGHBOURS: usize = 4;

/// Response window around the highest peak, seconds.
const BEFORE_PEAK_S: f64 = 0.002;
const AFTER_PEAK_S: f64 = 0.008;

/// Oversampling factor in the wave-front search.
const FINER: usize = 8;

// The head is no obstacle from 188 to 1000 Hz, so these bins have the free-field level.
const LOW_BINS: std::ops::RangeInclusive<usize> = 3..=16;

/// A head measured from many directions, at [`SAMPLE_RATE_HZ`].
pub struct MeasuredHead {
    /// `UP x AROUND`, row by row: elevation from -90 degrees up, azimuth from ahead to the left.
    table: Vec<[EarResponse; 2]>,
    pub(super) heard_field: OnceLock<HeardField>,
}

impl MeasuredHead {
    /// Reads free-field responses from a SOFA file.
    ///
    /// Responses are separated into delay and shape, and both are interpolated between the four nearest
    /// directions. The mean level from 188 to 1000 Hz is normalised to the free field, the mean delay to a
    /// sphere.
    ///
    /// # Errors
    /// If the format differs or the file is damaged; see [`HeadError`].
    pub fn from_sofa(bytes: &[u8]) -> Result<Self, HeadError> {
        // The HDF5 reader can panic on damaged files.
        let read = std::panic::catch_unwind(|| Measurements::read(bytes));
        let measured = read.unwrap_or(Err(HeadError::NoSofa))?;
        let mut analysis = Analysis::new(measured.rate_hz);
        let ears = measured.ears.iter().map(|ears| ears.each_ref().map(|ear| analysis.ear(ear)));
        let mut ears: Vec<[EarResponse; 2]> = ears.collect();
        let power: f64 = analysis.low_power / (2 * ears.len()) as f64;
        if power.is_nan() || power <= 0.0 {
            return Err(HeadError::Silent);
        }
        let gain = 1.0 / power.sqrt();
        let lag_s = mean_lag_s(&measured.directions, &ears);
        for ear in ears.iter_mut().flatten() {
            ear.filter.iter_mut().for_each(|tap| *tap = (f64::from(*tap) * gain) as f32);
            ear.delay_s -= lag_s;
        }
        let nodes = (0..UP).flat_map(|up| (0..AROUND).map(move |around| node_direction(up, around)));
        let table = nodes.map(|node| interpolated(&node, &measured.directions, &ears)).collect();
        Ok(Self { table, heard_field: OnceLock::new() })
    }

    /// Returns the left and right ear responses to a wave from `direction` (unit vector, world frame).
    pub(super) fn ears(&self, direction: &Vector3<f32>, heading_rad: f32) -> [EarResponse; 2] {
        let (sin, cos) = angle::sin_cos(heading_rad);
        let ahead = -direction.x * sin - direction.z * cos;
        let left = direction.z * sin - direction.x * cos;
        let azimuth_deg = angle::atan2(left, ahead).to_degrees().rem_euclid(360.0);
        let elevation_deg = libm::asinf(direction.y.clamp(-1.0, 1.0)).to_degrees();
        let (around, around_share) = cell(azimuth_deg / STEP_DEG, AROUND);
        let (up, up_share) = cell((elevation_deg + 90.0) / STEP_DEG, UP - 1);
        let next = (around + 1) % AROUND;
        let corners = [
            (up * AROUND + around, (1.0 - up_share) * (1.0 - around_share)),
            (up * AROUND + next, (1.0 - up_share) * around_share),
            ((up + 1) * AROUND + around, up_share * (1.0 - around_share)),
            ((up + 1) * AROUND + next, up_share * around_share),
        ];
        [0, 1].map(|ear| {
            weighted_sum(corners.iter().map(|(node, share)| (&self.table[*node][ear], f64::from(*share))))
        })
    }
}

impl PartialEq for MeasuredHead {
    fn eq(&self, other: &Self) -> bool {
        self.table == other.table
    }
}

impl fmt::Debug for MeasuredHead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MeasuredHead").finish_non_exhaustive()
    }
}

/// Index below `count` at `position`, and the fraction beyond it.
fn cell(position: f32, count: usize) -> (usize, f32) {
    let whole = (position.max(0.0) as usize).min(count - 1);
    (whole, (position - whole as f32).clamp(0.0, 1.0))
}

/// Table direction: x ahead, y left, z up.
fn node_direction(up: usize, around: usize) -> Vector3<f64> {
    let elevation = (f64::from(STEP_DEG) * up as f64 - 90.0).to_radians();
    let azimuth = (f64::from(STEP_DEG) * around as f64).to_radians();
    unit_vector(azimuth, elevation)
}

/// Interpolates between the measurements nearest to `direction`.
fn interpolated(
    direction: &Vector3<f64>,
    known: &[Vector3<f64>],
    ears: &[[EarResponse; 2]],
) -> [EarResponse; 2] {
    // Half the squared chord, almost half the squared angle. Smaller values count as zero distance.
    const SAME: f64 = 1e-6;
    let mut nearest: Vec<(f64, usize)> =
        known.iter().enumerate().map(|(index, other)| (1.0 - direction.dot(other), index)).collect();
    let by_distance = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    let used = NEIGHBOURS.min(nearest.len());
    nearest.select_nth_unstable_by(used - 1, by_distance);
    nearest.truncate(used);
    nearest.sort_by(by_distance);
    let weight = |distance: f64| 1.0 / (distance.max(0.0) + SAME);
    let total: f64 = nearest.iter().map(|(distance, _)| weight(*distance)).sum();
    [0, 1].map(|ear| {
        weighted_sum(nearest.iter().map(|(distance, index)| (&ears[*index][ear], weight(*distance) / total)))
    })
}

fn weighted_sum<'a>(parts: impl Iterator<Item = (&'a EarResponse, f64)>) -> EarResponse {
    let mut sum = EarResponse { filter: [0.0; HEAD_TAPS], delay_s: 0.0 };
    for (ear, share) in parts {
        sum.filter.iter_mut().zip(&ear.filter).for_each(|(sum, tap)| *sum += share as f32 * tap);
        sum.delay_s += share * ear.delay_s;
    }
    sum
}

/// Mean wave-front delay relative to a sphere, seconds.
fn mean_lag_s(directions: &[Vector3<f64>], ears: &[[EarResponse; 2]]) -> f64 {
    let lags = directions.iter().zip(ears).flat_map(|(direction, ears)| {
        // At heading 0, ahead is -Z and left is -X.
        let world = Vector3::new(-direction.y as f32, direction.z as f32, -direction.x as f32);
        let sphere_s = ear_axes(0.0).map(|axis| onset_delay_s(f64::from(axis.dot(&world)), f64::INFINITY));
        [ears[0].delay_s - sphere_s[0], ears[1].delay_s - sphere_s[1]]
    });
    lags.sum::<f64>() / (2 * ears.len()) as f64
}

/// Separation into delay and shape.
struct Analysis {
    rate_hz: f64,
    /// `exp(-j w)` per bin for one file sample.
    turns: Vec<Complex64>,
    planner: RealFftPlanner<f64>,
    /// Sum over all responses: mean power in [`LOW_BINS`].
    low_power: f64,
}

impl Analysis {
    fn new(rate_hz: f64) -> Self {
        let turn = |bin: usize| unit_phasor(-TAU * DESIGN_BIN_HZ * bin as f64 / rate_hz);
        let turns = (0..=DESIGN_POINTS / 2).map(turn).collect();
        Self { rate_hz, turns, planner: RealFftPlanner::new(), low_power: 0.0 }
    }

    fn ear(&mut self, measured: &EarMeasurement) -> EarResponse {
        let (first, taps) = around_peak(&measured.taps, self.rate_hz);
        let spectrum: Vec<Complex64> = self.turns.iter().map(|turn| fourier_sum(taps, *turn)).collect();
        let power = spectrum[LOW_BINS].iter().map(Complex64::norm_sqr).sum::<f64>();
        self.low_power += power / LOW_BINS.count() as f64;
        let onset_s = self.onset_s(&spectrum);
        EarResponse {
            filter: design_from(&spectrum, onset_s),
            delay_s: onset_s + first as f64 / self.rate_hz + measured.delay_s,
        }
    }

    /// Wave-front time, seconds after the first tap: the best match with the minimum-phase version (Nam, Abel
    /// and Smith 2008, AES Convention 125, paper 7612).
    fn onset_s(&mut self, spectrum: &[Complex64]) -> f64 {
        let minimum = self.minimum_phase(spectrum);
        let points = FINER * DESIGN_POINTS;
        let inverse = self.planner.plan_fft_inverse(points);
        let mut common = inverse.make_input_vec();
        // The mean and the last bin contain no delay information.
        for bin in 1..spectrum.len() - 1 {
            common[bin] = spectrum[bin] * minimum[bin].conj();
        }
        let mut alike = inverse.make_output_vec();
        let done = inverse.process(&mut common, &mut alike);
        debug_assert!(done.is_ok());
        let best = (0..points).max_by(|a, b| alike[*a].total_cmp(&alike[*b]).then(b.cmp(a))).unwrap_or(0);
        let at = |offset: usize| alike[(best + offset) % points];
        let (before, peak, after) = (at(points - 1), at(0), at(1));
        let bend = before - 2.0 * peak + after;
        let shift = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
        // Wrapped positions are before the first tap.
        let whole = if best > points * 3 / 4 { best as f64 - points as f64 } else { best as f64 };
        (whole + shift) / (FINER as f64 * f64::from(SAMPLE_RATE_HZ))
    }

    /// Minimum-phase spectrum with equal magnitude (Oppenheim and Schafer, "Discrete-Time Signal Processing",
    /// chapter 13).
    fn minimum_phase(&mut self, spectrum: &[Complex64]) -> Vec<Complex64> {
        let forward = self.planner.plan_fft_forward(DESIGN_POINTS);
        let inverse = self.planner.plan_fft_inverse(DESIGN_POINTS);
        let largest = spectrum.iter().map(|value| value.norm_sqr().sqrt()).fold(0.0, f64::max);
        let floor = (largest * 1e-4).max(f64::MIN_POSITIVE);
        let mut logarithm: Vec<Complex64> = spectrum
            .iter()
            .map(|value| Complex64::new(libm::log(value.norm_sqr().sqrt().max(floor)), 0.0))
            .collect();
        let mut cepstrum = inverse.make_output_vec();
        let done = inverse.process(&mut logarithm, &mut cepstrum);
        debug_assert!(done.is_ok());
        let scale = 1.0 / DESIGN_POINTS as f64;
        for (n, value) in cepstrum.iter_mut().enumerate() {
            let fold = match n.cmp(&(DESIGN_POINTS / 2)) {
                Ordering::Less if n > 0 => 2.0,
                Ordering::Greater => 0.0,
                _ => 1.0,
            };
            *value *= fold * scale;
        }
        let mut folded = forward.make_output_vec();
        let done = forward.process(&mut cepstrum, &mut folded);
        debug_assert!(done.is_ok());
        folded.into_iter().map(|value| unit_phasor(value.im) * libm::exp(value.re)).collect()
    }
}

/// Taps around the highest tap, and the first index.
fn around_peak(taps: &[f32], rate_hz: f64) -> (usize, &[f32]) {
    let higher = |a: &usize, b: &usize| taps[*a].abs().total_cmp(&taps[*b].abs()).then(b.cmp(a));
    let peak = (0..taps.len()).max_by(higher).unwrap_or(0);
    let first = peak.saturating_sub((BEFORE_PEAK_S * rate_hz) as usize);
    let end = (peak + (AFTER_PEAK_S * rate_hz) as usize).min(taps.len());
    (first, &taps[first..end])
}

/// Fourier sum over `taps` at `turn` per tap.
fn fourier_sum(taps: &[f32], turn: Complex64) -> Complex64 {
    taps.iter().rev().fold(Complex64::default(), |sum, tap| sum * turn + f64::from(*tap))
}
