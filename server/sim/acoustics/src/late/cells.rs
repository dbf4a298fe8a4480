//! Air cells that collect late energy. No cell crosses a wall.

use super::slices::{self, CHANNELS};
use crate::air::Air;
use avln_geom::{Point3, Vector3};

pub(super) const NO_CELL: u32 = u32::MAX;

/// Smallest and largest block edge, voxels.
const BLOCK: usize = 3;
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
        let most = MAX_BYTES / (slices::count(response_s).max(1) * CHANNELS * size_of::<u16>());
        let whole = whole_voxels(air);
        let mut edge = BLOCK;
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
