//! The directional part of early late energy, for example through a door.

use super::diffuse::FAR_M;
use super::envelope::{Density, Envelope};
use super::field::Slice;
use super::noise::{Noise, PERIOD};
use super::tail::{DIRECTED, directed_share};
use crate::bands::BANDS;
use crate::head::{EarResponse, HEAD_LEAD, HEAD_TAPS};
use crate::impulse::ImpulseResponse;
use crate::{Listener, SAMPLE_RATE_HZ, Settings};

/// Smallest energy share of a slice with a direction.
const LEAST_SHARE: f32 = 1e-3;

/// Taps of the fractional shift of a filter.
const MOVE_TAPS: usize = 4;

/// Adds the directional part of every slice as noise through the filters of both ears.
pub(super) fn add(
    response: &mut ImpulseResponse,
    envelope: &Envelope,
    slices: &[Slice],
    densities: &[Density],
    listener: &Listener,
    settings: &Settings,
    noise: &Noise,
) {
    let energy = |slice: &Slice| slice.energy.iter().sum::<f32>();
    let least = LEAST_SHARE * slices.iter().map(energy).sum::<f32>();
    for (index, slice) in slices.iter().enumerate().take(DIRECTED) {
        let share = directed_share(slice);
        if share == 0.0 || share * energy(slice) <= least {
            continue;
        }
        let samples = envelope.samples_of(index);
        let sound = slice_sound(envelope, index, &densities[index].map(|density| density * share), noise);
        let ears = settings.head.ears(&-slice.flow.normalize(), listener.heading_rad, FAR_M);
        for (ear, filter) in [&mut response.left, &mut response.right].into_iter().zip(&ears) {
            add_filtered(ear, &sound, samples.start, filter, settings.response_samples());
        }
    }
}

/// Noise of a slice, rising from the centre of the previous slice and falling to the centre of the next.
fn slice_sound(envelope: &Envelope, index: usize, density: &Density, noise: &Noise) -> Vec<f32> {
    let samples = envelope.samples_of(index);
    // Neighbouring slices overlap and use independent noise, so that their energies add.
    let first = samples.start + (index % 2) * PERIOD / 2;
    let mut sound = vec![0.0_f32; samples.len()];
    for band in (0..BANDS).filter(|band| density[*band] > 0.0) {
        let gain = (density[band] / SAMPLE_RATE_HZ as f32).sqrt();
        let noise = (0..samples.len()).map(|offset| noise.point[band][(first + offset) % PERIOD]);
        sound.iter_mut().zip(noise).for_each(|(sum, noise)| *sum += gain * noise);
    }
    for (sample, value) in samples.zip(&mut sound) {
        *value *= envelope.share(index, sample).sqrt();
    }
    sound
}

/// Adds `sound`, which passes the head centre from sample `first`, as heard by the ear.
fn add_filtered(ear: &mut Vec<f32>, sound: &[f32], first: usize, filter: &EarResponse, most_samples: usize) {
    let delay = filter.delay_s * f64::from(SAMPLE_RATE_HZ);
    let whole = libm::floor(delay);
    let taps = moved(&filter.filter, (delay - whole) as f32);
    let start = first as i64 + whole as i64 - HEAD_LEAD as i64 - 1;
    let end = (start + (sound.len() + taps.len()) as i64).clamp(0, most_samples as i64) as usize;
    if ear.len() < end {
        ear.resize(end, 0.0);
    }
    for (offset, value) in sound.iter().enumerate() {
        let from = start + offset as i64;
        let skipped = (-from).max(0) as usize;
        let target = ear.get_mut(from.max(0) as usize..).unwrap_or_default();
        target.iter_mut().zip(taps.iter().skip(skipped)).for_each(|(sum, tap)| *sum += value * tap);
    }
}

/// The filter delayed by one sample and `fraction` (0 to 1): Lagrange interpolation with four taps.
fn moved(filter: &[f32; HEAD_TAPS], fraction: f32) -> [f32; HEAD_TAPS + MOVE_TAPS] {
    let d = 1.0 + fraction;
    let weights = [
        -(d - 1.0) * (d - 2.0) * (d - 3.0) / 6.0,
        d * (d - 2.0) * (d - 3.0) / 2.0,
        -d * (d - 1.0) * (d - 3.0) / 2.0,
        d * (d - 1.0) * (d - 2.0) / 6.0,
    ];
    let mut taps = [0.0; HEAD_TAPS + MOVE_TAPS];
    for (shift, weight) in weights.iter().enumerate() {
        taps[shift..].iter_mut().zip(filter).for_each(|(sum, tap)| *sum += weight * tap);
    }
    taps
}
