//! Energy over time: straight lines between the middles of slices.

use super::bins;
use super::field::Slice;
use crate::SAMPLE_RATE_HZ;
use crate::bands::BANDS;

/// Samples over which gains go straight from one value to the next.
pub(super) const BLOCK: usize = 16;

/// Energy a second by band; the direct wave at 1 m has the energy 1.
pub(super) type Density = [f32; BANDS];

/// When late sound begins and ends, and how much time each slice stands for.
///
/// Before the first middle and after the last, energy is constant. All energy of a slice is in its two lines, also
/// where the sound begins in the midst of it.
pub(super) struct Envelope {
    /// Sample at which the sound begins.
    pub(super) start: usize,
    blocks: usize,
    /// Per slice: its middle, seconds.
    middles_s: Vec<f32>,
    /// Per block: where it starts.
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

    /// The slices with what comes before the sound begins moved to the first one after it: cells are larger than a
    /// point, and what is known of them may be early.
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

    /// Energy a second at the middle of slice `index`.
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

    /// Blocks until slice `index` begins, no more than there are.
    pub(super) fn blocks_until(&self, index: usize) -> usize {
        let sample = (bins::start_s(index) * SAMPLE_RATE_HZ as f32) as usize;
        (sample.saturating_sub(self.start) / BLOCK + 1).min(self.blocks)
    }

    /// Samples between the middles of the slices before and after slice `index`, as far as the sound has begun.
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

/// Between two middles.
struct Place {
    /// The slice of the earlier one.
    slice: usize,
    /// How far it is on the way to the later one, 0 to 1.
    share: f32,
}

fn middle_s(slice: usize) -> f32 {
    0.5 * (bins::start_s(slice) + bins::start_s(slice + 1))
}

/// The places of the samples `first`, `first` + [`BLOCK`] and so on.
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

/// How far `time_s` is on the way from the middle of a slice to the next middle, 0 to 1.
fn share_of_next(slice: usize, time_s: f32, middles_s: &[f32]) -> f32 {
    let Some(next_s) = middles_s.get(slice + 1) else { return 0.0 };
    ((time_s - middles_s[slice]) / (next_s - middles_s[slice])).clamp(0.0, 1.0)
}
