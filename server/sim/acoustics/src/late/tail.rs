//! Rendering of late energy at two ears.

use super::diffuse::{FAR_M, HeardField};
use super::directed;
use super::envelope::{BLOCK, Density, Envelope};
use super::field::{Echo, Slice};
use super::noise::{Noise, PERIOD};
use crate::bands::BANDS;
use crate::impulse::ImpulseResponse;
use crate::{Listener, SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S, Settings};
use avln_geom::Vector3;

/// Inaudible energy relative to the direct wave at 1 m: -140 dB.
const SILENT: f32 = 1e-7;

/// Number of first slices (80 ms) with directional rendering including interaural delay. Later directions
/// only change the level difference.
pub(super) const DIRECTED: usize = 16;

/// Slices per group with a common direction in later sound.
const GROUP: usize = 16;

/// Adds `echo` to both ears of `listener`, starting after a path length of `first_m`.
pub(crate) fn add_tail(
    response: &mut ImpulseResponse,
    listener: &Listener,
    echo: &Echo,
    first_m: f32,
    settings: &Settings,
) {
    if echo.slices.is_empty() {
        return;
    }
    let heard = HeardField::of(&settings.head);
    let end = settings.response_samples();
    let start = ((first_m / SPEED_OF_SOUND_M_S * SAMPLE_RATE_HZ as f32) as usize).min(end);
    let envelope = Envelope::new(echo.slices.len(), start, end);
    let slices = envelope.gathered(&echo.slices);
    let densities: Vec<Density> =
        slices.iter().enumerate().map(|(i, slice)| envelope.density(i, slice)).collect();
    let [left, right] = shares(&slices, listener, settings, heard);
    add_diffuse(response, &envelope, &densities, [&left, &right], &heard.noise);
    directed::add(response, &envelope, &slices, &densities, listener, settings, &heard.noise);
}

/// Directional share of the sound in a slice, 0 to 1.
///
/// Sound with a smooth asymmetry (`1 + 3 f cos`) has a flow of `f`; only a larger flow needs a direction.
pub(super) fn directed_share(slice: &Slice) -> f32 {
    const BROAD: f32 = 0.22;
    ((slice.flow.norm().min(1.0) - BROAD) / (1.0 - BROAD)).max(0.0)
}

/// Gains of diffuse sound per slice at the left and right ear, by band.
fn shares(
    slices: &[Slice],
    listener: &Listener,
    settings: &Settings,
    heard: &HeardField,
) -> [Vec<Density>; 2] {
    let mut shares = [const { Vec::new() }; 2];
    for slice in slices.iter().take(DIRECTED) {
        shares.iter_mut().for_each(|ear| ear.push([1.0 - directed_share(slice); BANDS]));
    }
    for group in slices.get(DIRECTED..).unwrap_or_default().chunks(GROUP) {
        let tilts = group_tilt(group, listener, settings, heard);
        for (ear, tilt) in shares.iter_mut().zip(tilts) {
            ear.resize(ear.len() + group.len(), tilt);
        }
    }
    shares
}

/// Gain of each ear for asymmetric sound.
fn group_tilt(group: &[Slice], listener: &Listener, settings: &Settings, heard: &HeardField) -> [Density; 2] {
    let weight = |slice: &Slice| slice.energy.iter().sum::<f32>();
    let total: f32 = group.iter().map(weight).sum();
    let sum: Vector3<f32> = group.iter().map(|slice| slice.flow * weight(slice)).sum();
    let mean = Slice { flow: if total > 0.0 { sum / total } else { Vector3::zeros() }, ..Slice::default() };
    let share = directed_share(&mean);
    if share == 0.0 {
        return [[1.0; BANDS]; 2];
    }
    let ears = settings.head.ears(&-mean.flow.normalize(), listener.heading_rad, FAR_M);
    ears.map(|ear| heard.tilt(&ear).map(|tilt| 1.0 - share + share * tilt))
}

/// Adds the diffuse part.
fn add_diffuse(
    response: &mut ImpulseResponse,
    envelope: &Envelope,
    densities: &[Density],
    shares: [&[Density]; 2],
    noise: &Noise,
) {
    let ears = [(&mut response.left, shares[0], &noise.left), (&mut response.right, shares[1], &noise.right)];
    for (ear, shares, noise) in ears {
        let densities: Vec<Density> = densities
            .iter()
            .zip(shares)
            .map(|(density, share)| std::array::from_fn(|band| density[band] * share[band]))
            .collect();
        let Some(last) = densities.iter().rposition(|density| density.iter().any(|value| *value > 0.0))
        else {
            continue;
        };
        let blocks = envelope.blocks_until(last + 2);
        let length = envelope.start + blocks * BLOCK;
        ear.resize(ear.len().max(length), 0.0);
        let mut before = [0.0; BANDS];
        for (block, samples) in ear[envelope.start..length].chunks_exact_mut(BLOCK).enumerate() {
            let after = envelope.gains(&densities, block + 1);
            add_block(samples, noise, envelope.start + block * BLOCK, &before, &after);
            before = after;
        }
    }
}

/// Adds a block of noise with gains from `before` to `after`.
fn add_block(
    samples: &mut [f32],
    noise: &[Vec<f32>; BANDS],
    first: usize,
    before: &[f32; BANDS],
    after: &[f32; BANDS],
) {
    let mut sums = [0.0_f32; BLOCK];
    // Blocks start anywhere; the stored noise continues for a block after its period.
    let start = first % PERIOD;
    for band in 0..BANDS {
        if before[band].max(after[band]) > SILENT {
            let slope = (after[band] - before[band]) / BLOCK as f32;
            let noise = &noise[band][start..start + BLOCK];
            for i in 0..BLOCK {
                sums[i] += (before[band] + slope * i as f32) * noise[i];
            }
        }
    }
    samples.iter_mut().zip(sums).for_each(|(sample, sum)| *sample += sum);
}
