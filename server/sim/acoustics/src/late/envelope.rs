//! Energy over time, interpolated linearly between slice centres.

use super::bins;
use super::field::Slice;
use crate::SAMPLE_RATE_HZ;
use crate::bands::BANDS;

/// Samples with linearly interpolated gains.
pub(super) const BLOCK: usize = 16;

/// Energy per second by band; the direct wave at 1 m has energy 1.
pub(super) type Density = [f32; BANDS];

/// Start, end and slice weights of late sound.
///
/// Energy is constant before the first centre and after the last. Both lines of a slice contain its whole
/// energy, also if the sound starts inside the slice.
pub(super) struct Envelope {
    /// First sample of the sound.
    pub(super) start: usize,
    blocks: usize,
    /// Per slice: its centre, seconds.
    middles_s: Vec<f32>,
    /// Per block: its start.
    places: Vec<Place>,
    /// Per slice: seconds under its two lines.
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

    /// Moves energy before the start of the sound into the first slice after it: cells have an extent, so
    /// their energy can be early.
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

    /// Gain of each band at the start of a block, or at the end of the last one.
    pub(super) fn gains(&self, densities: &[Density], block: usize) -> [f32; BANDS] {
        let Place { slice, share } = self.places[block];
        let next = &densities[(slice + 1).min(densities.len() - 1)];
        std::array::from_fn(|band| {
            let density = densities[slice][band] * (1.0 - share) + next[band] * share;
            (density * (1.0 / SAMPLE_RATE_HZ as f32)).sqrt()
        })
    }

    /// Number of blocks before slice `index`, limited to the total.
    pub(super) fn blocks_until(&self, index: usize) -> usize {
        let sample = (bins::start_s(index) * SAMPLE_RATE_HZ as f32) as usize;
        (sample.saturating_sub(self.start) / BLOCK + 1).min(self.blocks)
    }

    /// Sample range between the centres of the slices before and after `index`, limited by the start of the
    /// sound.
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

/// A position between two centres.
struct Place {
    /// The earlier slice.
    slice: usize,
    /// Fraction towards the later slice, 0 to 1.
    share: f32,
}

fn middle_s(slice: usize) -> f32 {
    0.5 * (bins::start_s(slice) + bins::start_s(slice + 1))
}

/// Positions of the samples `first`, `first` + [`BLOCK`] and so on.
fn places(first: usize, count: usize, middles_s: &[f32]) -> impl Iterator<Item = Place> {
    let mut slice = 0;
    (0..count).map(move |block| {
        let time_s = (first + block * BLOCK) as f32 / SAMPLE_RATE_HZ as f32;
        while middles_s.get(slice + 1).is_some_and(|middle_s| *middle_s <= time_s) {
            slice += 1;
        }
        Place { slice, share: share_of_next(slice, time_s, middles_s) }
    })
}

/// Fraction of `time_s` between the centre of a slice and the next, 0 to 1.
fn share_of_next(slice: usize, time_s: f32, middles_s: &[f32]) -> f32 {
    let Some(next_s) = middles_s.get(slice + 1) else { return 0.0 };
    ((time_s - middles_s[slice]) / (next_s - middles_s[slice])).clamp(0.0, 1.0)
}
