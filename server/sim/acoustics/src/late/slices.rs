//! Time slices for late energy: 5 ms up to 80 ms, 10 ms up to 240 ms, 20 ms up to 560 ms, and so on.

use crate::bands::BANDS;
use crate::surfaces::SURFACE_BANDS;
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_geom::Vector3;

/// Counters per cell and time slice: energy per band, and the flux in x, y, z.
pub(super) const CHANNELS: usize = SURFACE_BANDS + 3;

/// Shortest slice, seconds.
const FIRST_S: f32 = 0.005;

/// Slices per width.
const OF_A_WIDTH: u32 = 16;

/// Returns the slice for path length `length_m` (0 to 1e6).
pub(super) fn slice_of(length_m: f32) -> usize {
    let slot = (length_m * (1.0 / (SPEED_OF_SOUND_M_S * FIRST_S))) as u32 + OF_A_WIDTH;
    let doubling = (slot / OF_A_WIDTH).ilog2();
    (doubling * OF_A_WIDTH + (slot >> doubling) - OF_A_WIDTH) as usize
}

/// Slice width at `length_m` relative to the first slice, as a power of two.
pub(super) fn doublings(length_m: f32) -> u32 {
    slice_of(length_m) as u32 / OF_A_WIDTH
}

pub(super) fn start_s(bin: usize) -> f32 {
    let (doubling, place) = (bin as u32 / OF_A_WIDTH, bin as u32 % OF_A_WIDTH);
    (((OF_A_WIDTH + place) << doubling) - OF_A_WIDTH) as f32 * FIRST_S
}

/// Number of slices that start before `duration_s`.
pub(super) fn count(duration_s: f32) -> usize {
    (0..).take_while(|bin| start_s(*bin) < duration_s).count()
}

/// Late energy in a time slice at a position. The direct wave at 1 m has energy 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Slice {
    pub(crate) energy: [f32; BANDS],
    /// Energy flow direction; 0 if isotropic, length 1 if unidirectional.
    pub(crate) flow: Vector3<f32>,
}

impl Slice {
    pub(crate) fn total(&self) -> f32 {
        self.energy.iter().sum()
    }
}

/// Samples with linearly interpolated gains.
pub(super) const BLOCK: usize = 16;

/// Energy per second by band; the direct wave at 1 m has energy 1.
pub(super) type Density = [f32; BANDS];

/// Energy over time, linear between slice centres, constant before the first and after the last.
pub(super) struct Envelope {
    pub(super) start: usize,
    blocks: usize,
    /// Centre per slice, seconds.
    middles_s: Vec<f32>,
    /// Start per block.
    places: Vec<SlicePosition>,
    /// Seconds under the two lines of a slice.
    weight_s: Vec<f32>,
}

impl Envelope {
    pub(super) fn new(slices: usize, start: usize, end: usize) -> Self {
        let blocks = end.saturating_sub(start) / BLOCK;
        let middles_s: Vec<f32> = (0..slices).map(middle_s).collect();
        let mut weight_s = vec![0.0; slices];
        for place in places(start + BLOCK / 2, blocks, &middles_s) {
            weight_s[place.slice] += (1.0 - place.share) * BLOCK as f32 / SAMPLE_RATE_HZ as f32;
            if let Some(next) = weight_s.get_mut(place.slice + 1) {
                *next += place.share * BLOCK as f32 / SAMPLE_RATE_HZ as f32;
            }
        }
        let places = places(start, blocks + 1, &middles_s).collect();
        Self { start, blocks, middles_s, places, weight_s }
    }

    // Cells have an extent, so energy can come before the first sound; the first audible slice takes it.
    pub(super) fn gathered(&self, slices: &[Slice]) -> Vec<Slice> {
        let mut early = [0.0; BANDS];
        let gather = |(slice, weight_s): (&Slice, &f32)| {
            let energy: [f32; BANDS] = std::array::from_fn(|band| slice.energy[band] + early[band]);
            let heard = *weight_s > 0.5 * BLOCK as f32 / SAMPLE_RATE_HZ as f32;
            early = if heard { [0.0; BANDS] } else { energy };
            Slice { energy: if heard { energy } else { [0.0; BANDS] }, flow: slice.flow }
        };
        slices.iter().zip(&self.weight_s).map(gather).collect()
    }

    /// Energy per second at the centre of slice `index`.
    pub(super) fn density(&self, index: usize, slice: &Slice) -> Density {
        slice.energy.map(|energy| if energy > 0.0 { energy / self.weight_s[index] } else { 0.0 })
    }

    /// Band gains at the start of a block, or at the last end.
    pub(super) fn gains(&self, densities: &[Density], block: usize) -> [f32; BANDS] {
        let SlicePosition { slice, share } = self.places[block];
        let next = &densities[(slice + 1).min(densities.len() - 1)];
        std::array::from_fn(|band| {
            let density = densities[slice][band] * (1.0 - share) + next[band] * share;
            (density * (1.0 / SAMPLE_RATE_HZ as f32)).sqrt()
        })
    }

    pub(super) fn blocks_until(&self, index: usize) -> usize {
        let sample = (start_s(index) * SAMPLE_RATE_HZ as f32) as usize;
        (sample.saturating_sub(self.start) / BLOCK + 1).min(self.blocks)
    }

    /// Sample range between the neighbouring slice centres, limited by start and end.
    pub(super) fn samples_of(&self, index: usize) -> std::ops::Range<usize> {
        let sample = |time_s: f32| (time_s * SAMPLE_RATE_HZ as f32) as usize;
        let from = if index == 0 { 0 } else { sample(self.middles_s[index - 1]) };
        let end = self.start + self.blocks * BLOCK;
        from.max(self.start)..sample(middle_s(index + 1)).min(end).max(self.start)
    }

    /// Share of slice `index` in the energy at `sample`, 0 to 1.
    pub(super) fn share(&self, index: usize, sample: usize) -> f32 {
        let time_s = sample as f32 / SAMPLE_RATE_HZ as f32;
        if time_s >= self.middles_s[index] {
            1.0 - share_of_next(index, time_s, &self.middles_s)
        } else {
            index.checked_sub(1).map_or(1.0, |before| share_of_next(before, time_s, &self.middles_s))
        }
    }
}

struct SlicePosition {
    slice: usize,
    /// Fraction towards the later slice, 0 to 1.
    share: f32,
}

pub(crate) fn middle_s(slice: usize) -> f32 {
    0.5 * (start_s(slice) + start_s(slice + 1))
}

/// Positions of every [`BLOCK`]th sample from `first`.
fn places(first: usize, count: usize, middles_s: &[f32]) -> impl Iterator<Item = SlicePosition> {
    let mut slice = 0;
    (0..count).map(move |block| {
        let time_s = (first + block * BLOCK) as f32 / SAMPLE_RATE_HZ as f32;
        while middles_s.get(slice + 1).is_some_and(|middle_s| *middle_s <= time_s) {
            slice += 1;
        }
        SlicePosition { slice, share: share_of_next(slice, time_s, middles_s) }
    })
}

/// Fraction from one slice centre to the next at `time_s`, 0 to 1.
fn share_of_next(slice: usize, time_s: f32, middles_s: &[f32]) -> f32 {
    let Some(next_s) = middles_s.get(slice + 1) else { return 0.0 };
    ((time_s - middles_s[slice]) / (next_s - middles_s[slice])).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn path_lengths_map_to_consecutive_slices() {
        assert_eq!((start_s(0), start_s(1)), (0.0, 0.005));
        assert!((start_s(16) - 0.08).abs() < 1e-6 && (start_s(32) - 0.24).abs() < 1e-6);
        for bin in 0..100 {
            let (start, end) = (start_s(bin), start_s(bin + 1));
            assert!(end > start);
            assert_eq!(slice_of((0.99 * start + 0.01 * end) * SPEED_OF_SOUND_M_S), bin);
            assert_eq!(slice_of((0.01 * start + 0.99 * end) * SPEED_OF_SOUND_M_S), bin);
        }
        for (time_s, times_wider) in [(0.0, 1), (0.079, 1), (0.081, 2), (0.239, 2), (0.241, 4), (0.57, 8)] {
            assert_eq!(1 << doublings(time_s * SPEED_OF_SOUND_M_S), times_wider, "{time_s} s");
        }
        assert_eq!(count(0.0), 0);
        assert_eq!(count(0.08), 16);
        assert_eq!(count(1.0), 59);
    }
}
