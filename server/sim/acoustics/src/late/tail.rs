//! Rendering of late energy at two ears.

use super::cells::{BLOCK, Density, Envelope, Slice};
use super::diffuse::HeardField;
use super::noise::PERIOD;
use crate::bands::BANDS;
use crate::building::Settings;
use crate::head::filter::{EarResponse, FAR_M, HEAD_LEAD, HEAD_TAPS};
use crate::impulse::{ImpulseResponse, Listener, add_convolved, convolve};
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_geom::Vector3;

/// Inaudible energy relative to the direct wave at 1 m: -140 dB.
const SILENT: f32 = 1e-7;

/// Slices with directional rendering, the first 80 ms. Later directions only change the level difference.
pub(crate) const DIRECTED: usize = 16;

/// Later slices with a common direction.
pub(crate) const GROUP: usize = 16;

/// Smallest energy share for a slice with a direction.
const MIN_SHARE: f32 = 1e-3;

/// Taps for the fractional filter shift.
const MOVE_TAPS: usize = 4;

/// Late energy at a listener.
struct Tail<'a> {
    listener: &'a Listener,
    settings: &'a Settings,
    heard: &'a HeardField,
    envelope: Envelope,
    slices: Vec<Slice>,
    densities: Vec<Density>,
}

/// Adds `echo` to both ears, starting after a path length of `first_m`.
pub(crate) fn add_tail(
    response: &mut ImpulseResponse,
    listener: &Listener,
    echo: &[Slice],
    first_m: f32,
    settings: &Settings,
) {
    if echo.is_empty() {
        return;
    }
    let end = settings.response_samples();
    let start = ((first_m / SPEED_OF_SOUND_M_S * SAMPLE_RATE_HZ as f32) as usize).min(end);
    let envelope = Envelope::new(echo.len(), start, end);
    let slices = envelope.gathered(echo);
    let densities = slices.iter().enumerate().map(|(i, slice)| envelope.density(i, slice)).collect();
    let heard = settings.head.heard_field();
    let tail = Tail { listener, settings, heard, envelope, slices, densities };
    let [left, right] = tail.diffuse_gains();
    tail.add_diffuse(&mut response.left, &left, &heard.noise.left);
    tail.add_diffuse(&mut response.right, &right, &heard.noise.right);
    tail.add_directed(response);
}

/// Directional share in a slice, 0 to 1.
pub(crate) fn directed_share(flow: &Vector3<f32>) -> f32 {
    // Sound with a smooth asymmetry (`1 + 3 f cos`) has a flow of `f`; only a larger flow needs a direction.
    const BROAD: f32 = 0.22;
    ((flow.norm().min(1.0) - BROAD) / (1.0 - BROAD)).max(0.0)
}

impl Tail<'_> {
    /// Diffuse gains per slice at the left and right ear, by band.
    fn diffuse_gains(&self) -> [Vec<Density>; 2] {
        let mut gains = [const { Vec::new() }; 2];
        for slice in self.slices.iter().take(DIRECTED) {
            gains.iter_mut().for_each(|ear| ear.push([1.0 - directed_share(&slice.flow); BANDS]));
        }
        for group in self.slices.get(DIRECTED..).unwrap_or_default().chunks(GROUP) {
            for (ear, tilt) in gains.iter_mut().zip(self.group_tilt(group)) {
                ear.resize(ear.len() + group.len(), tilt);
            }
        }
        gains
    }

    /// Gain per ear for asymmetric sound.
    fn group_tilt(&self, group: &[Slice]) -> [Density; 2] {
        let total: f32 = group.iter().map(Slice::total).sum();
        let sum: Vector3<f32> = group.iter().map(|slice| slice.flow * slice.total()).sum();
        let flow = if total > 0.0 { sum / total } else { Vector3::zeros() };
        let share = directed_share(&flow);
        if share == 0.0 {
            return [[1.0; BANDS]; 2];
        }
        let ears = self.settings.head.ears(&-flow.normalize(), self.listener.heading_rad, FAR_M);
        ears.map(|ear| self.heard.tilt(&ear).map(|tilt| 1.0 - share + share * tilt))
    }

    fn add_diffuse(&self, ear: &mut Vec<f32>, gains: &[Density], noise: &[Vec<f32>; BANDS]) {
        let weighted = |(density, gain): (&Density, &Density)| -> Density {
            std::array::from_fn(|band| density[band] * gain[band])
        };
        let densities: Vec<Density> = self.densities.iter().zip(gains).map(weighted).collect();
        let is_audible = |density: &Density| density.iter().any(|value| *value > 0.0);
        let Some(last) = densities.iter().rposition(is_audible) else { return };
        let start = self.envelope.start;
        let length = start + self.envelope.blocks_until(last + 2) * BLOCK;
        ear.resize(ear.len().max(length), 0.0);
        let mut before = [0.0; BANDS];
        for (block, samples) in ear[start..length].chunks_exact_mut(BLOCK).enumerate() {
            let after = self.envelope.gains(&densities, block + 1);
            add_block(samples, noise, start + block * BLOCK, [&before, &after]);
            before = after;
        }
    }

    /// Adds the directional part of every slice as noise through the ear filters.
    fn add_directed(&self, response: &mut ImpulseResponse) {
        let least = MIN_SHARE * self.slices.iter().map(Slice::total).sum::<f32>();
        for (index, slice) in self.slices.iter().enumerate().take(DIRECTED) {
            let share = directed_share(&slice.flow);
            if share == 0.0 || share * slice.total() <= least {
                continue;
            }
            let sound = self.slice_sound(index, &self.densities[index].map(|density| density * share));
            let first = self.envelope.samples_of(index).start;
            let ears = self.settings.head.ears(&-slice.flow.normalize(), self.listener.heading_rad, FAR_M);
            for (ear, filter) in [&mut response.left, &mut response.right].into_iter().zip(&ears) {
                add_filtered(ear, &sound, first, filter, self.settings.response_samples());
            }
        }
    }

    /// Noise that rises from the previous slice centre and falls to the next.
    fn slice_sound(&self, index: usize, density: &Density) -> Vec<f32> {
        let samples = self.envelope.samples_of(index);
        // Neighbouring slices overlap and use independent noise, so that their energies add.
        let first = samples.start + (index % 2) * PERIOD / 2;
        let mut sound = vec![0.0_f32; samples.len()];
        for band in (0..BANDS).filter(|band| density[*band] > 0.0) {
            let gain = (density[band] / SAMPLE_RATE_HZ as f32).sqrt();
            let noise = &self.heard.noise.point[band];
            for (offset, sum) in sound.iter_mut().enumerate() {
                *sum += gain * noise[(first + offset) % PERIOD];
            }
        }
        for (sample, value) in samples.zip(&mut sound) {
            *value *= self.envelope.share(index, sample).sqrt();
        }
        sound
    }
}

/// Adds a noise block with gains from `before` to `after`.
fn add_block(
    samples: &mut [f32],
    noise: &[Vec<f32>; BANDS],
    first: usize,
    [before, after]: [&[f32; BANDS]; 2],
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
    convolve(filter, &weights)
}
