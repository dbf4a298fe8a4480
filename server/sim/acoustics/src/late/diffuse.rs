//! How heads hear sound that comes from everywhere.

use super::noise::{Diffuse, Noise};
use crate::head::{EarResponse, HEAD_LEAD, HEAD_TAPS};
use crate::{Head, SAMPLE_RATE_HZ};
use avln_geom::{Vector3, angle};
use realfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Directions over which is averaged.
const DIRECTIONS: usize = 256;

/// Frequencies at which is measured: multiples of 125 Hz up to half the sample rate.
const FREQUENCIES: usize = 65;

/// From farther than this, waves are flat, metres.
const FAR_M: f32 = 1e6;

/// The noise that `head` hears late energy as.
pub(super) fn noise_for(head: &Head) -> &'static Noise {
    static SPHERE: OnceLock<Noise> = OnceLock::new();
    static OMNI: OnceLock<Noise> = OnceLock::new();
    let place = match head {
        Head::Sphere => &SPHERE,
        Head::Omni => &OMNI,
    };
    place.get_or_init(|| {
        let known = diffuse_field(|direction| head.ears(direction, 0.0, FAR_M));
        Noise::new(|frequency_hz| between(&known, frequency_hz))
    })
}

/// What both ears make of plane waves from all directions, by frequency.
fn diffuse_field(ears: impl Fn(&Vector3<f32>) -> [EarResponse; 2]) -> Vec<Diffuse> {
    let (mut energy, mut likeness) = ([0.0; FREQUENCIES], [0.0; FREQUENCIES]);
    for index in 0..DIRECTIONS {
        let [left, right] = ears(&angle::spread_direction(index, DIRECTIONS)).map(|ear| spectrum(&ear));
        for (k, (left, right)) in left.iter().zip(&right).enumerate() {
            energy[k] += 0.5 * (left.norm_sqr() + right.norm_sqr());
            likeness[k] += (left * right.conj()).re;
        }
    }
    let mean = |(energy, likeness): (f64, f64)| Diffuse {
        energy: energy / DIRECTIONS as f64,
        coherence: if energy > 0.0 { (likeness / energy).clamp(-1.0, 1.0) } else { 1.0 },
    };
    energy.into_iter().zip(likeness).map(mean).collect()
}

/// An ear's response at the frequencies, delay included.
fn spectrum(ear: &EarResponse) -> [Complex64; FREQUENCIES] {
    const TURN: usize = 2 * (FREQUENCIES - 1);
    let step_hz = f64::from(SAMPLE_RATE_HZ) / TURN as f64;
    let phasor = |turns: f64| Complex64::new(libm::cos(TAU * turns), -libm::sin(TAU * turns));
    let turns: [Complex64; TURN] = std::array::from_fn(|k| phasor(k as f64 / TURN as f64));
    std::array::from_fn(|k| {
        let tap = |n: usize| turns[k * (n + TURN - HEAD_LEAD) % TURN] * f64::from(ear.filter[n]);
        (0..HEAD_TAPS).map(tap).sum::<Complex64>() * phasor(k as f64 * step_hz * ear.delay_s)
    })
}

fn between(known: &[Diffuse], frequency_hz: f64) -> Diffuse {
    let place = frequency_hz * (2 * (FREQUENCIES - 1)) as f64 / f64::from(SAMPLE_RATE_HZ);
    let low = (place as usize).min(FREQUENCIES - 2);
    let share = (place - low as f64).clamp(0.0, 1.0);
    let mix = |of: fn(&Diffuse) -> f64| of(&known[low]) * (1.0 - share) + of(&known[low + 1]) * share;
    Diffuse { energy: mix(|diffuse| diffuse.energy), coherence: mix(|diffuse| diffuse.coherence) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_hears_lows_alike_and_highs_apart() {
        let known = diffuse_field(|direction| Head::Sphere.ears(direction, 0.0, FAR_M));
        let at = |frequency_hz| between(&known, frequency_hz);
        assert!(at(125.0).coherence > 0.9, "{:?}", at(125.0));
        for frequency_hz in [1500.0, 2000.0, 4000.0, 6000.0] {
            assert!(at(frequency_hz).coherence.abs() < 0.3, "{:?} at {frequency_hz} Hz", at(frequency_hz));
        }
        // Long waves pass the head as if it were not there; short ones meet half of the surface, at twice the pressure.
        assert!((at(125.0).energy - 1.0).abs() < 0.1, "{:?}", at(125.0));
        assert!((1.0..2.5).contains(&at(4000.0).energy), "{:?}", at(4000.0));
    }
}
