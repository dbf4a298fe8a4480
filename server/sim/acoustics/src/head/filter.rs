//! Head filters: design from a spectrum, aligned on the wave front.

use crate::SAMPLE_RATE_HZ;
use crate::transform::unit_phasor;
use realfft::num_complex::Complex64;
use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;

pub(crate) const HEAD_TAPS: usize = 64;

/// Samples before the wave front.
pub(crate) const HEAD_LEAD: usize = 16;

/// Distance for plane waves, metres.
pub(crate) const FAR_M: f32 = 1e6;

/// Discrete Fourier transform length for filter design.
pub(crate) const DESIGN_POINTS: usize = 256;
pub(crate) const DESIGN_BIN_HZ: f64 = SAMPLE_RATE_HZ as f64 / DESIGN_POINTS as f64;

// Above this frequency the response falls to zero at half the sample rate, which shortens the filters.
const ROLL_OFF_FROM_HZ: f64 = 6000.0;

pub(crate) type HeadFilter = [f32; HEAD_TAPS];

/// An ear's response to a wave.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EarResponse {
    /// Filter with the wave front at tap [`HEAD_LEAD`].
    pub(crate) filter: HeadFilter,
    /// Wave-front delay relative to the head centre, seconds; negative is earlier.
    pub(crate) delay_s: f64,
}

impl EarResponse {
    pub(super) fn free_field() -> Self {
        Self { filter: std::array::from_fn(|tap| if tap == HEAD_LEAD { 1.0 } else { 0.0 }), delay_s: 0.0 }
    }
}

/// Filter for a half spectrum, with the wave front at `onset_s` moved to tap [`HEAD_LEAD`].
pub(crate) fn design_from(spectrum: &[Complex64], onset_s: f64) -> HeadFilter {
    let aligned = |(bin, value): (usize, &Complex64)| {
        let frequency_hz = bin as f64 * DESIGN_BIN_HZ;
        let value = value * unit_phasor(TAU * frequency_hz * onset_s);
        // The two spectrum halves are conjugates: every bin except the first counts twice.
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

// Without a fade, the cut at both ends would be a step.
fn edge_fade(tap: usize) -> f64 {
    const FADE: usize = 8;
    let from_edge = tap.min(HEAD_TAPS - 1 - tap);
    if from_edge >= FADE { 1.0 } else { 0.5 - 0.5 * libm::cos(PI * (from_edge as f64 + 0.5) / FADE as f64) }
}
