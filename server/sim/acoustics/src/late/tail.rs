//! Rendering of late energy at two ears.

use super::decorrelation::PERIOD;
use super::diffuse::HeardField;
use super::noise::Noise;
use super::slices::{BLOCK, Density, Echo, Envelope, Slice};
use crate::bands::BANDS;
use crate::building::Settings;
use crate::head::filter::{EarResponse, FAR_M, HEAD_LEAD, HEAD_TAPS};
use crate::impulse::{ImpulseResponse, Listener, add_convolved};
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_geom::Vector3;

/// Inaudible energy relative to the direct wave at 1 m: -140 dB.
const SILENT: f32 = 1e-7;

/// Slices with directional rendering, the first 80 ms. Later directions only change the level difference.
pub(super) const DIRECTED: usize = 16;

/// Later slices with a common direction.
const GROUP: usize = 16;

/// Adds `echo` to both ears, starting after a path length of `first_m`.
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
    let heard = settings.head.heard_field();
    let end = settings.response_samples();
    let start = ((first_m / SPEED_OF_SOUND_M_S * SAMPLE_RATE_HZ as f32) as usize).min(end);
    let envelope = Envelope::new(echo.slices.len(), start, end);
    let slices = envelope.gathered(&echo.slices);
    let densities: Vec<Density> =
        slices.iter().enumerate().map(|(i, slice)| envelope.density(i, slice)).collect();
    let [left, right] = shares(&slices, listener, settings, heard);
    add_diffuse(response, &envelope, &densities, [&left, &right], &heard.noise);
    add_directed(response, &envelope, &slices, &densities, listener, settings, &heard.noise);
}

/// Directional share in a slice, 0 to 1.
pub(super) fn directed_share(slice: &Slice) -> f32 {
    const BROAD: f32 = 0.22;
    ((slice.flow.norm().min(1.0) - BROAD) / (1.0 - BROAD)).max(0.0)
}

/// Diffuse gains per slice at the left and right ear, by band.
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

/// Gain per ear for asymmetric sound.
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

/// Adds a noise block with gains from `before` to `after`.
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

/// Smallest energy share for a slice with a direction.
const MIN_SHARE: f32 = 1e-3;

/// Taps for the fractional filter shift.
const MOVE_TAPS: usize = 4;

/// Adds the directional part of every slice as noise through the ear filters.
fn add_directed(
    response: &mut ImpulseResponse,
    envelope: &Envelope,
    slices: &[Slice],
    densities: &[Density],
    listener: &Listener,
    settings: &Settings,
    noise: &Noise,
) {
    let energy = |slice: &Slice| slice.energy.iter().sum::<f32>();
    let least = MIN_SHARE * slices.iter().map(energy).sum::<f32>();
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

/// Noise that rises from the previous slice centre and falls to the next.
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

/// Adds `sound`, at the head centre from sample `first`, through an ear filter.
fn add_filtered(ear: &mut Vec<f32>, sound: &[f32], first: usize, filter: &EarResponse, max_samples: usize) {
    let delay = filter.delay_s * f64::from(SAMPLE_RATE_HZ);
    let whole = libm::floor(delay);
    let taps = moved(&filter.filter, (delay - whole) as f32);
    let start = first as i64 + whole as i64 - HEAD_LEAD as i64 - 1;
    let end = start + (sound.len() + taps.len()) as i64;
    add_convolved(ear, sound, &taps, start, end.clamp(0, max_samples as i64) as usize);
}

/// Delays the filter by one sample plus `fraction` (0 to 1): Lagrange interpolation with four taps.
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
