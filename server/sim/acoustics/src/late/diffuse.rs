//! Head responses to diffuse sound.

use super::noise::{DiffuseResponse, Noise};
use crate::SAMPLE_RATE_HZ;
use crate::bands::{BAND_HZ, BANDS};
use crate::head::filter::{EarResponse, HEAD_LEAD, HEAD_TAPS, HeadFilter};
use crate::transform::unit_phasor;
use avln_geom::{Vector3, angle};
use realfft::num_complex::Complex64;
use std::f64::consts::TAU;
use std::sync::OnceLock;

const DIRECTIONS: usize = 256;

/// Frequencies: multiples of 125 Hz up to half the sample rate.
const FREQUENCIES: usize = 65;

/// Filter roll-off, hertz.
const MAX_PROBED_HZ: f64 = 6000.0;

/// A head's response to late energy.
pub(crate) struct HeardField {
    pub(super) noise: Noise,
    /// Energy at an ear relative to the free field, by band.
    pub(crate) energy: [f32; BANDS],
}

impl HeardField {
    /// Averages `ears`, the responses to a wave by direction, over all directions.
    pub(crate) fn new(ears: impl Fn(&Vector3<f32>) -> [EarResponse; 2]) -> Self {
        let known = diffuse_field(&ears);
        let noise = Noise::new(|frequency_hz| between(&known, frequency_hz));
        let mut energy = [0.0; BANDS];
        for index in 0..DIRECTIONS {
            for ear in ears(&angle::spread_direction(index, DIRECTIONS)) {
                let heard = band_energies(&ear.filter);
                energy.iter_mut().zip(heard).for_each(|(sum, heard)| *sum += 0.5 * heard / DIRECTIONS as f32);
            }
        }
        Self { noise, energy }
    }

    /// Energy by band, relative to diffuse sound.
    pub(super) fn tilt(&self, response: &EarResponse) -> [f32; BANDS] {
        let heard = band_energies(&response.filter);
        std::array::from_fn(
            |band| if self.energy[band] > 0.0 { heard[band] / self.energy[band] } else { 1.0 },
        )
    }
}

/// Probe frequencies per band, octaves from the centre.
const PROBES_OCTAVES: [f64; 3] = [-0.33, 0.0, 0.33];

/// Energy of a head filter by band, relative to a unit pulse.
pub(crate) fn band_energies(filter: &HeadFilter) -> [f32; BANDS] {
    static WAVES: OnceLock<Vec<[[f32; 2]; HEAD_TAPS]>> = OnceLock::new();
    let waves = WAVES.get_or_init(probe_waves);
    let energy = |wave: &[[f32; 2]; HEAD_TAPS]| {
        let (mut re, mut im) = (0.0, 0.0);
        for (tap, [cos, sin]) in filter.iter().zip(wave) {
            re += tap * cos;
            im += tap * sin;
        }
        re * re + im * im
    };
    std::array::from_fn(|band| {
        let probes = &waves[band * PROBES_OCTAVES.len()..][..PROBES_OCTAVES.len()];
        probes.iter().map(energy).sum::<f32>() / PROBES_OCTAVES.len() as f32
    })
}

/// Cosine and sine per probe and tap.
fn probe_waves() -> Vec<[[f32; 2]; HEAD_TAPS]> {
    let frequencies = BAND_HZ.iter().flat_map(|center| {
        PROBES_OCTAVES.map(|octaves| (f64::from(*center) * libm::exp2(octaves)).min(MAX_PROBED_HZ))
    });
    let wave = |frequency_hz: f64| {
        let turn = TAU * frequency_hz / f64::from(SAMPLE_RATE_HZ);
        std::array::from_fn(|n| [libm::cos(turn * n as f64) as f32, libm::sin(turn * n as f64) as f32])
    };
    frequencies.map(wave).collect()
}

/// Response of both ears to plane waves from all directions, by frequency.
fn diffuse_field(ears: &impl Fn(&Vector3<f32>) -> [EarResponse; 2]) -> Vec<DiffuseResponse> {
    let (mut energy, mut likeness) = ([0.0; FREQUENCIES], [0.0; FREQUENCIES]);
    for index in 0..DIRECTIONS {
        let [left, right] = ears(&angle::spread_direction(index, DIRECTIONS)).map(|ear| spectrum(&ear));
        for (k, (left, right)) in left.iter().zip(&right).enumerate() {
            energy[k] += 0.5 * (left.norm_sqr() + right.norm_sqr());
            likeness[k] += (left * right.conj()).re;
        }
    }
    let mean = |(energy, likeness): (f64, f64)| DiffuseResponse {
        energy: energy / DIRECTIONS as f64,
        coherence: if energy > 0.0 { (likeness / energy).clamp(-1.0, 1.0) } else { 1.0 },
    };
    energy.into_iter().zip(likeness).map(mean).collect()
}

fn spectrum(ear: &EarResponse) -> [Complex64; FREQUENCIES] {
    const TURN: usize = 2 * (FREQUENCIES - 1);
    let step_hz = f64::from(SAMPLE_RATE_HZ) / TURN as f64;
    let phasor = |turns: f64| unit_phasor(TAU * turns).conj();
    let turns: [Complex64; TURN] = std::array::from_fn(|k| phasor(k as f64 / TURN as f64));
    std::array::from_fn(|k| {
        let tap = |n: usize| turns[k * (n + TURN - HEAD_LEAD) % TURN] * f64::from(ear.filter[n]);
        (0..HEAD_TAPS).map(tap).sum::<Complex64>() * phasor(k as f64 * step_hz * ear.delay_s)
    })
}

fn between(known: &[DiffuseResponse], frequency_hz: f64) -> DiffuseResponse {
    let place = frequency_hz * (2 * (FREQUENCIES - 1)) as f64 / f64::from(SAMPLE_RATE_HZ);
    let low = (place as usize).min(FREQUENCIES - 2);
    let share = (place - low as f64).clamp(0.0, 1.0);
    let mix = |of: fn(&DiffuseResponse) -> f64| of(&known[low]) * (1.0 - share) + of(&known[low + 1]) * share;
    DiffuseResponse { energy: mix(|diffuse| diffuse.energy), coherence: mix(|diffuse| diffuse.coherence) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::head::Head;
    use crate::head::filter::FAR_M;

    #[test]
    fn left_waves_are_louder_at_the_left_ear() {
        let field = Head::Sphere.heard_field();
        let ears = Head::Sphere.ears(&Vector3::new(-1.0, 0.0, 0.0), 0.0, FAR_M);
        let [left, right] = ears.map(|ear| field.tilt(&ear));
        for band in 2..BANDS {
            let (near, far) = (left[band], right[band]);
            assert!(near > 1.4 * far && near > 1.0, "band {band}: {near} and {far}");
        }
        assert!((left[0] - 1.0).abs() < 0.2 && (right[0] - 1.0).abs() < 0.2);
    }

    #[test]
    fn sphere_ears_are_coherent_only_at_low_frequencies() {
        let known = diffuse_field(&|direction: &Vector3<f32>| Head::Sphere.ears(direction, 0.0, FAR_M));
        let at = |frequency_hz| between(&known, frequency_hz);
        assert!(at(125.0).coherence > 0.9, "{:?}", at(125.0));
        for frequency_hz in [1500.0, 2000.0, 4000.0, 6000.0] {
            assert!(at(frequency_hz).coherence.abs() < 0.3, "{:?} at {frequency_hz} Hz", at(frequency_hz));
        }
        // Long waves pass the head unchanged; short waves hit half the surface at twice the pressure.
        assert!((at(125.0).energy - 1.0).abs() < 0.1, "{:?}", at(125.0));
        assert!((1.0..2.5).contains(&at(4000.0).energy), "{:?}", at(4000.0));
    }
}
