//! Late energy in the whole building: all reflections without a discrete direction.

pub(crate) mod cells;
pub(crate) mod diffuse;
mod noise;
pub(crate) mod tail;
mod trace;

use crate::SPEED_OF_SOUND_M_S;
use crate::bands::{BANDS, air_loss};
use crate::building::{Building, Reader, Writer};
use crate::images::Images;
use crate::surfaces::SURFACE_BANDS;
use avln_geom::{Point3, Rng, Vector3};
use cells::{CHANNELS, NO_CELL, Slice, middle_s, slice_count};
use trace::{Tally, trace};

const SALT: u64 = 0x5d0_1a7e;

/// Energy by cell, time slice, band and direction.
pub(crate) struct LateField {
    /// Row in `values` per cell, [`NO_CELL`] without energy.
    row_of: Vec<u32>,
    /// `rows × slices × channels`: energy per cubic metre times metres, as upper float halves.
    values: Vec<u16>,
    /// Per slice and band: energy share after air absorption.
    air: Vec<[f32; BANDS]>,
    /// Energy share lost through holes, 0 to 1.
    pub(crate) lost_share: f32,
}

impl LateField {
    /// Traces rays from `outlet`, a finite position, without discrete waves: the direct wave and `images`.
    pub(crate) fn new(building: &Building, outlet: &Point3<f32>, images: &Images) -> Self {
        Self::with_key(building, outlet, images, key_of(outlet))
    }

    pub(super) fn with_key(building: &Building, outlet: &Point3<f32>, images: &Images, key: u64) -> Self {
        let count = slice_count(building.settings.response_s);
        let mut tally = trace(building, outlet, images, key);
        divide_by_volumes(building, &mut tally);
        Self {
            values: tally.sums.iter().map(|value| to_half(*value)).collect(),
            row_of: tally.row_of,
            air: air_shares(count),
            lost_share: tally.lost_share,
        }
    }

    pub(crate) fn write(&self, writer: &mut Writer) {
        writer.words(&[self.lost_share.to_bits()]);
        writer.words(&self.row_of);
        writer.halves(&self.values);
    }

    /// Reads the output of [`LateField::write`]; `None` if it does not fit the building.
    pub(crate) fn read(reader: &mut Reader, building: &Building) -> Option<Self> {
        let count = slice_count(building.settings.response_s);
        let (lost_share, row_of, values) = (reader.words()?, reader.words()?, reader.halves()?);
        let rows = values.len() / (count * CHANNELS).max(1);
        let is_known = |row: &u32| *row == NO_CELL || (*row as usize) < rows;
        let fits = row_of.len() == building.cells.len() && row_of.iter().all(is_known);
        let lost_share = f32::from_bits(*lost_share.first()?);
        fits.then(|| Self { row_of, values, air: air_shares(count), lost_share })
    }

    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.values.as_slice()) + size_of_val(self.row_of.as_slice())
    }

    pub(crate) fn at(&self, building: &Building, listener: &Point3<f32>) -> Vec<Slice> {
        let width = self.air.len() * CHANNELS;
        let mut sums = vec![0.0_f32; width];
        for (cell, weight) in building.cells.around(&building.air, listener) {
            if self.row_of[cell] != NO_CELL {
                let first = self.row_of[cell] as usize * width;
                let values = &self.values[first..first + width];
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * from_half(*value));
            }
        }
        sums.chunks_exact(CHANNELS).zip(&self.air).map(|(channels, air)| slice(channels, air)).collect()
    }
}

fn air_shares(count: usize) -> Vec<[f32; BANDS]> {
    let leaves = |bin| air_loss(middle_s(bin) * SPEED_OF_SOUND_M_S).map(|db| libm::exp10f(-db / 10.0));
    (0..count).map(leaves).collect()
}

fn slice(channels: &[f32], air: &[f32; BANDS]) -> Slice {
    // The surface table ends at 4 kHz; higher bands only add air absorption.
    let energy = std::array::from_fn(|band| channels[band.min(SURFACE_BANDS - 1)] * air[band]);
    let mean = channels[..SURFACE_BANDS].iter().sum::<f32>() / SURFACE_BANDS as f32;
    let flux = Vector3::from_column_slice(&channels[SURFACE_BANDS..]);
    Slice { energy, flow: if mean > 0.0 { flux / mean } else { Vector3::zeros() } }
}

/// Converts energy times length into density per cell.
fn divide_by_volumes(building: &Building, tally: &mut Tally) {
    let width = tally.bins * CHANNELS;
    for (cell, row) in tally.row_of.iter().enumerate().filter(|(_, row)| **row != NO_CELL) {
        let inverse = 1.0 / building.cells.volume_m3(&building.air, cell);
        let first = *row as usize * width;
        tally.sums[first..first + width].iter_mut().for_each(|value| *value *= inverse);
    }
}

// Random draws depend on the position only, so that results do not depend on earlier queries.
fn key_of(outlet: &Point3<f32>) -> u64 {
    outlet.iter().fold(SALT, |key, coordinate| Rng::word(key, u64::from(coordinate.to_bits())))
}

/// Upper half of a float, rounded: 0.4 % steps over the whole range.
fn to_half(value: f32) -> u16 {
    ((value.to_bits() + 0x8000) >> 16) as u16
}

fn from_half(half: u16) -> f32 {
    f32::from_bits(u32::from(half) << 16)
}

#[cfg(test)]
mod tests;
