//! Head models: the response of each ear to a wave by direction and range.

use crate::SAMPLE_RATE_HZ;
use crate::late::HeardField;
use crate::sphere::{SphereResponse, onset_delay_s};
use avln_geom::{Vector3, angle};
use realfft::num_complex::Complex64;
use std::f64::consts::{PI, TAU};
use std::sync::{Arc, OnceLock};

mod measured;
mod sofa;

pub use measured::{HeadError, MeasuredHead};

/// A head model.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Head {
    /// A rigid sphere with a radius of 8.75 cm and ears at 100 degrees.
    #[default]
    Sphere,
    /// No head: both ears receive the pressure at the head centre.
    Omni,
    /// A measured head, without distance dependence.
    Measured(Arc<MeasuredHead>),
}

/// Azimuth of the ears of the sphere, degrees from straight ahead.
const EAR_AZIMUTH_DEG: f32 = 100.0;

/// Taps of a head filter.
pub(crate) const HEAD_TAPS: usize = 64;

/// Samples of a head filter before the arrival of the wave front.
pub(crate) const HEAD_LEAD: usize = 16;

/// Inverse ranges of the table, per metre: 0.25, 0.5, 1, 2, 4 metres and a plane wave.
const INVERSE_RANGES: [f32; 6] = [4.0, 2.0, 1.0, 0.5, 0.25, 0.0];

/// Angles of incidence of the table: 0 to 180 degrees, one degree apart.
const ANGLES: usize = 181;

/// Points of the discrete Fourier transform that designs the filters.
const DESIGN_POINTS: usize = 256;

/// Roll-off frequency: above it the response falls to zero at half the sample rate, to shorten filters.
const ROLL_OFF_FROM_HZ: f64 = 6000.0;

type Filter = [f32; HEAD_TAPS];

/// Filters of an ear on a rigid sphere for every incidence and range, aligned on the wave front.
pub(crate) struct HeadTable {
    /// `INVERSE_RANGES × ANGLES`, row by row.
    filters: Vec<Filter>,
}

/// Response of an ear to a wave.
pub(crate) struct EarResponse {
    /// Filter with the wave front at tap [`HEAD_LEAD`].
    pub(crate) filter: Filter,
    /// Delay of the wave front at this ear relative to the head centre, seconds; negative is earlier.
    pub(crate) delay_s: f64,
}

impl EarResponse {
    /// Response without a head.
    fn free_field() -> Self {
        Self { filter: std::array::from_fn(|tap| if tap == HEAD_LEAD { 1.0 } else { 0.0 }), delay_s: 0.0 }
    }
}

impl Head {
    /// Computes the response to diffuse sound in advance (about 0.1 s), which otherwise delays the first late
    /// energy.
    pub fn prepare(&self) {
        HeardField::of(self);
    }

    /// Responses of the left and right ear to a wave from `direction` (unit vector, world frame) with an
    /// origin `range_m` (at least 0.1) away.
    pub(crate) fn ears(&self, direction: &Vector3<f32>, heading_rad: f32, range_m: f32) -> [EarResponse; 2] {
        match self {
            Self::Sphere => ear_axes(heading_rad).map(|axis| head().ear(axis.dot(direction), range_m)),
            Self::Omni => [EarResponse::free_field(), EarResponse::free_field()],
            Self::Measured(measured) => measured.ears(direction, heading_rad),
        }
    }
}

/// Unit vectors out of the left and the right ear of the sphere, world frame.
fn ear_axes(heading_rad: f32) -> [Vector3<f32>; 2] {
    let (sin, cos) = angle::sin_cos(heading_rad);
    let (forward, left) = (Vector3::new(-sin, 0.0, -cos), Vector3::new(-cos, 0.0, sin));
    let (ear_sin, ear_cos) = angle::sin_cos(EAR_AZIMUTH_DEG.to_radians());
    [forward * ear_cos + left * ear_sin, forward * ear_cos - left * ear_sin]
}

/// The table, computed on first use.
pub(crate) fn head() -> &'static HeadTable {
    static HEAD: OnceLock<HeadTable> = OnceLock::new();
    HEAD.get_or_init(HeadTable::new)
}

impl HeadTable {
    fn new() -> Self {
        let filters = INVERSE_RANGES.iter().flat_map(|inverse| design_range(1.0 / f64::from(*inverse)));
        Self { filters: filters.collect() }
    }

    /// Response to a source at `range_m` (at least 0.1) at the given cosine to the ear axis. Relative to the
    /// free field at the head centre.
    pub(crate) fn ear(&self, cos_incidence: f32, range_m: f32) -> EarResponse {
        let cos_incidence = cos_incidence.clamp(-1.0, 1.0);
        let (row, row_weight) = range_position(range_m);
        let degrees = libm::acosf(cos_incidence).to_degrees().clamp(0.0, 180.0);
        let column = (degrees as usize).min(ANGLES - 2);
        let column_weight = degrees - column as f32;
        let corners = [
            (row, column, (1.0 - row_weight) * (1.0 - column_weight)),
            (row, column + 1, (1.0 - row_weight) * column_weight),
            (row + 1, column, row_weight * (1.0 - column_weight)),
            (row + 1, column + 1, row_weight * column_weight),
        ];
        let mut filter = [0.0; HEAD_TAPS];
        for (row, column, weight) in corners {
            let known = &self.filters[row * ANGLES + column];
            filter.iter_mut().zip(known).for_each(|(sum, tap)| *sum += weight * tap);
        }
        EarResponse { filter, delay_s: onset_delay_s(f64::from(cos_incidence), f64::from(range_m)) }
    }
}

/// The table row just beyond `range_m` on the near side, and the weight of the next row.
fn range_position(range_m: f32) -> (usize, f32) {
    let inverse = (1.0 / range_m).clamp(0.0, INVERSE_RANGES[0]);
    let row = (0..INVERSE_RANGES.len() - 2).find(|row| inverse >= INVERSE_RANGES[row + 1]);
    let row = row.unwrap_or(INVERSE_RANGES.len() - 2);
    (row, (INVERSE_RANGES[row] - inverse) / (INVERSE_RANGES[row] - INVERSE_RANGES[row + 1]))
}

/// The filters of all angles at one range.
fn design_range(range_m: f64) -> Vec<Filter> {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / DESIGN_POINTS as f64;
    let responses: Vec<_> = (0..=DESIGN_POINTS / 2)
        .map(|bin| SphereResponse::new((bin as f64 * bin_hz).max(20.0), range_m))
        .collect();
    let at_angle = |degrees: usize| {
        let cos_incidence = libm::cos((degrees as f64).to_radians());
        let spectrum: Vec<_> = responses.iter().map(|response| response.pressure(cos_incidence)).collect();
        design_from(&spectrum, onset_delay_s(cos_incidence, range_m))
    };
    (0..ANGLES).map(at_angle).collect()
}

/// Filter of a spectrum (bins from 0 to half the sample rate, [`DESIGN_POINTS`] per period), with the wave
/// front at `onset_s` moved to tap [`HEAD_LEAD`].
fn design_from(spectrum: &[Complex64], onset_s: f64) -> Filter {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / DESIGN_POINTS as f64;
    let aligned = |(bin, value): (usize, &Complex64)| {
        let frequency_hz = bin as f64 * bin_hz;
        let value = value * unit_phasor(TAU * frequency_hz * onset_s);
        // The two halves of the spectrum are conjugates: every bin except the first counts twice.
        if bin == 0 { Complex64::new(value.norm(), 0.0) } else { value * 2.0 * roll_off(frequency_hz) }
    };
    let spectrum: Vec<_> = spectrum.iter().enumerate().map(aligned).collect();
    let turns = turns();
    std::array::from_fn(|tap| {
        let sample = (tap + DESIGN_POINTS - HEAD_LEAD) % DESIGN_POINTS;
        let terms = spectrum.iter().enumerate();
        let sum: f64 = terms.map(|(bin, value)| (value * turns[bin * sample % DESIGN_POINTS]).re).sum();
        (sum / DESIGN_POINTS as f64 * edge_fade(tap)) as f32
    })
}

/// Unit circle in [`DESIGN_POINTS`] steps.
fn turns() -> &'static [Complex64; DESIGN_POINTS] {
    static TURNS: OnceLock<[Complex64; DESIGN_POINTS]> = OnceLock::new();
    TURNS.get_or_init(|| std::array::from_fn(|step| unit_phasor(TAU * step as f64 / DESIGN_POINTS as f64)))
}

/// 1 below [`ROLL_OFF_FROM_HZ`], a raised cosine down to 0 at half the sample rate.
fn roll_off(frequency_hz: f64) -> f64 {
    let nyquist_hz = f64::from(SAMPLE_RATE_HZ) / 2.0;
    let position = ((frequency_hz - ROLL_OFF_FROM_HZ) / (nyquist_hz - ROLL_OFF_FROM_HZ)).clamp(0.0, 1.0);
    0.5 + 0.5 * libm::cos(PI * position)
}

/// Fades the first and last taps, to avoid a step at the cut.
fn edge_fade(tap: usize) -> f64 {
    const FADE: usize = 8;
    let from_edge = tap.min(HEAD_TAPS - 1 - tap);
    if from_edge >= FADE { 1.0 } else { 0.5 - 0.5 * libm::cos(PI * (from_edge as f64 + 0.5) / FADE as f64) }
}

fn unit_phasor(angle_rad: f64) -> Complex64 {
    Complex64::new(libm::cos(angle_rad), libm::sin(angle_rad))
}
