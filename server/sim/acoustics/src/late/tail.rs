//! Late energy as sound at two ears.

use super::bins;
use super::diffuse::noise_for;
use super::field::{Echo, Slice};
use super::noise::{Noise, PERIOD};
use crate::bands::BANDS;
use crate::impulse::ImpulseResponse;
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S, Settings};

/// Samples over which gains go straight from one value to the next.
const BLOCK: usize = 16;

/// What is quieter than this, relative to the direct wave at 1 m, is not heard: 140 dB down.
const SILENT: f32 = 1e-7;

/// Energy a second of every band over time: straight lines between the middles of slices.
///
/// Before the first middle and after the last it is constant. All energy of a slice is in its two lines, also where
/// the sound begins in the midst of it.
struct Envelope {
    /// Sample at which the sound begins.
    start: usize,
    blocks: usize,
    /// Per slice: energy a second at its middle.
    density: Vec<[f32; BANDS]>,
}

impl Envelope {
    fn new(slices: &[Slice], start: usize, end: usize) -> Self {
        let blocks = end.saturating_sub(start) / BLOCK;
        let mut weight_s = vec![0.0_f32; slices.len()];
        for edge in 0..blocks {
            let (slice, share) = place((start + edge * BLOCK + BLOCK / 2) as f32, slices.len());
            weight_s[slice] += (1.0 - share) * BLOCK as f32 / SAMPLE_RATE_HZ as f32;
            if let Some(next) = weight_s.get_mut(slice + 1) {
                *next += share * BLOCK as f32 / SAMPLE_RATE_HZ as f32;
            }
        }
        let mut density = vec![[0.0; BANDS]; slices.len()];
        let mut early = [0.0; BANDS];
        for ((slice, density), weight_s) in slices.iter().zip(&mut density).zip(weight_s) {
            let known: [f32; BANDS] = std::array::from_fn(|band| slice.energy[band] + early[band]);
            if weight_s > 0.5 * BLOCK as f32 / SAMPLE_RATE_HZ as f32 {
                *density = known.map(|energy| energy / weight_s);
                early = [0.0; BANDS];
            } else {
                // Cells are larger than a point: what is known of them may come before the sound gets here.
                early = known;
            }
        }
        Self { start, blocks, density }
    }

    /// Gain of each band at the start of block `edge`.
    fn gains(&self, edge: usize) -> [f32; BANDS] {
        if edge == 0 {
            return [0.0; BANDS];
        }
        let (slice, share) = place((self.start + edge * BLOCK) as f32, self.density.len());
        let next = &self.density[(slice + 1).min(self.density.len() - 1)];
        std::array::from_fn(|band| {
            let density = self.density[slice][band] * (1.0 - share) + next[band] * share;
            (density / SAMPLE_RATE_HZ as f32).sqrt()
        })
    }
}

/// The slice whose middle is before `sample`, and how far it is on the way to the next middle, 0 to 1.
fn place(sample: f32, slices: usize) -> (usize, f32) {
    let time_s = sample / SAMPLE_RATE_HZ as f32;
    let middle_s = |slice: usize| 0.5 * (bins::start_s(slice) + bins::start_s(slice + 1));
    let mut slice = bins::bin_of(time_s * SPEED_OF_SOUND_M_S).min(slices - 1);
    if middle_s(slice) > time_s {
        if slice == 0 {
            return (0, 0.0);
        }
        slice -= 1;
    }
    if slice + 1 == slices {
        return (slice, 0.0);
    }
    let share = (time_s - middle_s(slice)) / (middle_s(slice + 1) - middle_s(slice));
    (slice, share.clamp(0.0, 1.0))
}

/// Adds `echo` to both ears, from when sound has travelled `first_m` on.
pub(crate) fn add_tail(response: &mut ImpulseResponse, echo: &Echo, first_m: f32, settings: &Settings) {
    if echo.slices.is_empty() {
        return;
    }
    let noise = noise_for(&settings.head);
    let end = settings.response_samples();
    let start = ((first_m / SPEED_OF_SOUND_M_S * SAMPLE_RATE_HZ as f32) as usize).min(end);
    let envelope = Envelope::new(&echo.slices, start, end);
    let mut before = envelope.gains(0);
    for block in 0..envelope.blocks {
        let after = envelope.gains(block + 1);
        add_block(response, noise, start + block * BLOCK, &before, &after);
        before = after;
    }
}

/// Adds one block of noise whose gains go from `before` to `after`.
fn add_block(
    response: &mut ImpulseResponse,
    noise: &Noise,
    first: usize,
    before: &[f32; BANDS],
    after: &[f32; BANDS],
) {
    let mut sums = [[0.0_f32; BLOCK]; 2];
    for band in (0..BANDS).filter(|band| before[*band].max(after[*band]) > SILENT) {
        let slope = (after[band] - before[band]) / BLOCK as f32;
        let gains: [f32; BLOCK] = std::array::from_fn(|i| before[band] + slope * i as f32);
        for (sum, noise) in sums.iter_mut().zip([&noise.left[band], &noise.right[band]]) {
            add_noise(sum, &gains, noise, first);
        }
    }
    for (ear, sum) in [&mut response.left, &mut response.right].into_iter().zip(&sums) {
        if sum.iter().all(|sample| *sample == 0.0) {
            continue;
        }
        if ear.len() < first + BLOCK {
            ear.resize(first + BLOCK, 0.0);
        }
        ear[first..first + BLOCK].iter_mut().zip(sum).for_each(|(sample, sum)| *sample += sum);
    }
}

fn add_noise(sum: &mut [f32; BLOCK], gains: &[f32; BLOCK], noise: &[f32], first: usize) {
    let start = first % PERIOD;
    match noise.get(start..start + BLOCK) {
        Some(noise) => (0..BLOCK).for_each(|i| sum[i] += gains[i] * noise[i]),
        None => (0..BLOCK).for_each(|i| sum[i] += gains[i] * noise[(start + i) % PERIOD]),
    }
}
