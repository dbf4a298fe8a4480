//! Bins of late energy: time slices, and air cells, of which none crosses a wall. Slices take 5 ms up to 80 ms, 10 ms up to 240 ms,
//! 20 ms up to 560 ms, and so on.

use crate::air::Air;
use crate::bands::BANDS;
use crate::surfaces::SURFACE_BANDS;
use crate::{SAMPLE_RATE_HZ, SPEED_OF_SOUND_M_S};
use avln_geom::{Point3, Vector3};

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

/// Start of slice `bin`, seconds.
pub(super) fn start_s(bin: usize) -> f32 {
    let (doubling, place) = (bin as u32 / OF_A_WIDTH, bin as u32 % OF_A_WIDTH);
    (((OF_A_WIDTH + place) << doubling) - OF_A_WIDTH) as f32 * FIRST_S
}

/// Number of slices that start before `duration_s`.
pub(super) fn slice_count(duration_s: f32) -> usize {
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

/// Centre of slice `slice`, seconds.
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

/// Voxel outside of all cells.
pub(super) const NO_CELL: u32 = u32::MAX;

/// Smallest and largest block edge, voxels.
const MIN_BLOCK: usize = 3;
const MAX_BLOCK: usize = 24;

/// Memory limit per source, bytes.
const MAX_BYTES: usize = 6 << 20;

/// Air blocks, divided at blocked voxel steps; twice as high as wide.
pub(crate) struct Cells {
    /// Cell per air voxel, [`NO_CELL`] near surfaces.
    pub(super) cell_of: Vec<u32>,
    cells: Vec<Cell>,
    /// Voxels per block in x, y, z.
    block: [usize; 3],
    blocks: [usize; 3],
    /// First cell per block, with a final sentinel.
    first_of: Vec<u32>,
}

/// A connected part of a block.
struct Cell {
    /// Voxel nearest to the centre.
    middle: u32,
    voxels: u32,
}

impl Cells {
    /// Divides the air into cells. Energy for responses with `response_s` seconds then fits [`MAX_BYTES`].
    pub(crate) fn new(air: &Air, response_s: f32) -> Self {
        let most = MAX_BYTES / (slice_count(response_s).max(1) * CHANNELS * size_of::<u16>());
        let whole = whole_voxels(air);
        let mut edge = MIN_BLOCK;
        loop {
            let cells = Self::with_blocks(air, &whole, [edge, 2 * edge, edge]);
            if cells.len() <= most || edge >= MAX_BLOCK {
                return cells;
            }
            edge += 1;
        }
    }

    /// Divides the air into cells with eight times the volume.
    pub(crate) fn larger(&self, air: &Air) -> Self {
        Self::with_blocks(air, &whole_voxels(air), self.block.map(|voxels| 2 * voxels))
    }

    fn with_blocks(air: &Air, whole: &[bool], block: [usize; 3]) -> Self {
        let size = air.grid.size;
        let blocks = [0, 1, 2].map(|axis| size[axis].div_ceil(block[axis]));
        let mut cells =
            Self { cell_of: vec![NO_CELL; whole.len()], cells: Vec::new(), block, blocks, first_of: vec![0] };
        for index in 0..blocks.iter().product() {
            cells.add_block(air, whole, index);
            cells.first_of.push(cells.cells.len() as u32);
        }
        cells
    }

    fn add_block(&mut self, air: &Air, whole: &[bool], index: usize) {
        for voxel in self.voxels(air, index) {
            if whole[voxel] && self.cell_of[voxel] == NO_CELL {
                let members = self.flood(air, whole, index, voxel);
                let middle = nearest_to_mean(air, &members) as u32;
                self.cells.push(Cell { middle, voxels: members.len() as u32 });
            }
        }
    }

    /// Returns the block's voxels connected to `seed`; they become the next cell.
    fn flood(&mut self, air: &Air, whole: &[bool], index: usize, seed: usize) -> Vec<usize> {
        let cell = self.cells.len() as u32;
        self.cell_of[seed] = cell;
        let mut members = vec![seed];
        let mut next = 0;
        while let Some(&voxel) = members.get(next) {
            next += 1;
            for neighbour in air.neighbours(voxel) {
                let inside = whole[neighbour] && self.block_of(air.grid.cell(neighbour)) == index;
                if inside && self.cell_of[neighbour] == NO_CELL {
                    self.cell_of[neighbour] = cell;
                    members.push(neighbour);
                }
            }
        }
        members
    }

    fn voxels(&self, air: &Air, index: usize) -> Vec<usize> {
        let [across, up, _] = self.blocks;
        let place = [index % across, index / across % up, index / (across * up)];
        let range = |axis: usize| {
            let first = place[axis] * self.block[axis];
            first..(first + self.block[axis]).min(air.grid.size[axis])
        };
        let rows = range(2).flat_map(|z| range(1).map(move |y| (y, z)));
        rows.flat_map(|(y, z)| range(0).map(move |x| air.grid.index([x, y, z]))).collect()
    }

    fn block_of(&self, voxel: [usize; 3]) -> usize {
        let [x, y, z] = [0, 1, 2].map(|axis| voxel[axis] / self.block[axis]);
        (z * self.blocks[1] + y) * self.blocks[0] + x
    }

    pub(crate) fn len(&self) -> usize {
        self.cells.len()
    }

    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.cell_of.as_slice())
            + size_of_val(self.cells.as_slice())
            + size_of_val(self.first_of.as_slice())
    }

    pub(super) fn volume_m3(&self, air: &Air, cell: usize) -> f32 {
        let edge_m = air.grid.cell_m;
        self.cells[cell].voxels as f32 * (edge_m * edge_m * edge_m)
    }

    /// Returns cells around `point` with weights that add up to 1: the visible cells in the eight adjacent
    /// blocks, otherwise the cell at the nearest visible voxel; empty without air nearby.
    pub(super) fn around(&self, air: &Air, point: &Point3<f32>) -> Vec<(usize, f32)> {
        let mut around = self.in_sight(air, point);
        if around.is_empty() {
            around.extend(self.nearest(air, point).map(|cell| (cell, 1.0)));
        }
        let total: f32 = around.iter().map(|(_, weight)| weight).sum();
        around.iter_mut().for_each(|(_, weight)| *weight /= total);
        around
    }

    fn in_sight(&self, air: &Air, point: &Point3<f32>) -> Vec<(usize, f32)> {
        let mut found = Vec::with_capacity(8);
        for (block, weight) in self.blocks_around(air, point) {
            for cell in self.first_of[block]..self.first_of[block + 1] {
                let Cell { middle, voxels } = self.cells[cell as usize];
                let weight = weight * voxels as f32;
                if weight > 0.0 && air.rays.is_clear(point, &air.grid.center(middle as usize)) {
                    found.push((cell as usize, weight));
                }
            }
        }
        found
    }

    /// The eight blocks around `point`, with trilinear weights.
    fn blocks_around(&self, air: &Air, point: &Point3<f32>) -> Vec<(usize, f32)> {
        let grid = &air.grid;
        let corner = grid.first_center - Vector3::from_element(0.5 * grid.cell_m);
        let place = [0, 1, 2]
            .map(|axis| (point[axis] - corner[axis]) / (grid.cell_m * self.block[axis] as f32) - 0.5);
        let mut found = Vec::with_capacity(8);
        for corner in 0..8 {
            let (mut weight, mut block) = (1.0, [0; 3]);
            for axis in 0..3 {
                let (low, step) = (place[axis].floor(), (corner >> axis) & 1);
                let share = place[axis] - low;
                weight *= if step == 1 { share } else { 1.0 - share };
                let index = low + step as f32;
                let last = self.blocks[axis] as f32 - 1.0;
                weight *= f32::from(u8::from((0.0..=last).contains(&index)));
                block[axis] = index.max(0.0) as usize;
            }
            if weight > 0.0 {
                found.push(((block[2] * self.blocks[1] + block[1]) * self.blocks[0] + block[0], weight));
            }
        }
        found
    }

    /// The nearest cell, behind as few surfaces as possible.
    fn nearest(&self, air: &Air, point: &Point3<f32>) -> Option<usize> {
        const FAR_M: f32 = 2.0;
        let start = air.visible_cells(point).first().copied().or_else(|| air.nearest_cell(point))?;
        if (air.grid.center(start) - point).norm() > FAR_M {
            return None;
        }
        let mut seen = vec![start];
        let mut next = 0;
        // Breadth first: the air near surfaces is one or two voxels thick.
        const ENOUGH: usize = 4096;
        while let Some(&voxel) = seen.get(next).filter(|_| next < ENOUGH) {
            next += 1;
            if self.cell_of[voxel] != NO_CELL {
                return Some(self.cell_of[voxel] as usize);
            }
            for neighbour in air.neighbours(voxel) {
                if !seen.contains(&neighbour) {
                    seen.push(neighbour);
                }
            }
        }
        None
    }
}

fn whole_voxels(air: &Air) -> Vec<bool> {
    (0..air.grid.len()).map(|voxel| is_whole(air, voxel)).collect()
}

/// Returns true if no surface cuts the axes of a room voxel.
fn is_whole(air: &Air, voxel: usize) -> bool {
    // Other voxels belong to no cell: cell volumes are exact, and no energy counts behind a wall.
    if !air.in_room[voxel] {
        return false;
    }
    if air.neighbours(voxel).count() == 6 {
        return true;
    }
    let (center, half_m) = (air.grid.center(voxel), 0.5 * air.grid.cell_m);
    [Vector3::x(), Vector3::y(), Vector3::z()]
        .iter()
        .all(|axis| air.rays.is_clear(&(center - axis * half_m), &(center + axis * half_m)))
}

fn nearest_to_mean(air: &Air, members: &[usize]) -> usize {
    let sum: Vector3<f32> = members.iter().map(|voxel| air.grid.center(*voxel).coords).sum();
    let mean = Point3::from(sum / members.len() as f32);
    let distance = |voxel: usize| (air.grid.center(voxel) - mean).norm_squared();
    members.iter().copied().min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(members[0])
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
        assert_eq!(slice_count(0.0), 0);
        assert_eq!(slice_count(0.08), 16);
        assert_eq!(slice_count(1.0), 59);
    }
}
