//! Floor regions without holes, as required for outlines in `rerecast`.
//!
//! Sweep over cell rows: a run of connected cells continues the previous row's region if both touch only each
//! other; otherwise it opens a new region. A region therefore has a single run per row and straight borders.

use rerecast::{CompactHeightfield, RegionId};

// Region numbers start at 1; the upper half has another meaning in `rerecast`.
const MAX_REGIONS: usize = 0x7fff;
const LOWER_X: u8 = 0;
const LOWER_Z: u8 = 3;
const NONE: u32 = u32::MAX;

/// Assigns regions to floor cells, except in connected parts below `min_cells`.
///
/// # Errors
/// The region count, if above 32,767.
pub(crate) fn divide(field: &mut CompactHeightfield, min_cells: u32) -> Result<(), usize> {
    let links = Links::new(field);
    let large = in_large_parts(&links, min_cells);
    let (region_of, count) = sweep(field, &links, &large);
    if count > MAX_REGIONS {
        return Err(count);
    }
    for (span, region) in field.spans.iter_mut().zip(region_of) {
        span.region = RegionId::from(if region == NONE { 0 } else { region as u16 + 1 });
    }
    field.max_region = RegionId::from(count as u16);
    Ok(())
}

/// Connected floor cells towards lower x and z, or `NONE`.
struct Links {
    walkable: Vec<bool>,
    lower_x: Vec<u32>,
    lower_z: Vec<u32>,
}

impl Links {
    fn new(field: &CompactHeightfield) -> Self {
        let walkable: Vec<_> = field.areas.iter().map(|area| area.is_walkable()).collect();
        let (mut lower_x, mut lower_z) = (vec![NONE; walkable.len()], vec![NONE; walkable.len()]);
        let width = usize::from(field.width);
        for (column, cell) in field.cells.iter().enumerate() {
            for span in cell.index_range().filter(|&span| walkable[span]) {
                let link = |direction: u8, step: usize| {
                    let layer = field.spans[span].con(direction)?;
                    let other = field.cells[column - step].index() + u32::from(layer);
                    walkable[other as usize].then_some(other)
                };
                lower_x[span] = link(LOWER_X, 1).unwrap_or(NONE);
                lower_z[span] = link(LOWER_Z, width).unwrap_or(NONE);
            }
        }
        Self { walkable, lower_x, lower_z }
    }
}
fn in_large_parts(links: &Links, min_cells: u32) -> Vec<bool> {
    let count = links.walkable.len() as u32;
    let mut parent: Vec<u32> = (0..count).collect();
    for span in 0..count {
        let neighbours = [links.lower_x[span as usize], links.lower_z[span as usize]];
        for neighbour in neighbours.into_iter().filter(|&neighbour| neighbour != NONE) {
            let (a, b) = (root(&mut parent, span), root(&mut parent, neighbour));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let roots: Vec<_> = (0..count).map(|span| root(&mut parent, span)).collect();
    let mut cells = vec![0; roots.len()];
    roots.iter().for_each(|&root| cells[root as usize] += 1);
    let is_large = roots.iter().map(|&root| cells[root as usize] >= min_cells);
    is_large.zip(&links.walkable).map(|(large, &walkable)| large && walkable).collect()
}

fn root(parent: &mut [u32], mut span: u32) -> u32 {
    while parent[span as usize] != span {
        parent[span as usize] = parent[parent[span as usize] as usize];
        span = parent[span as usize];
    }
    span
}

/// A run's contact with the previous row: first region with cell count, and a flag for further regions.
struct Below {
    region: u32,
    cells: u32,
    others: bool,
}

impl Below {
    fn add(&mut self, region: u32) {
        if self.region == NONE {
            self.region = region;
        }
        self.others |= self.region != region;
        self.cells += 1;
    }

    /// Returns the continued region: the only one touched, if it touches no other run.
    fn continued(&self, touched: &[u32]) -> Option<u32> {
        let alone = self.region != NONE && !self.others && touched[self.region as usize] == self.cells;
        alone.then_some(self.region)
    }
}
fn sweep(field: &CompactHeightfield, links: &Links, chosen: &[bool]) -> (Vec<u32>, usize) {
    let (mut region_of, mut run_of) = (vec![NONE; chosen.len()], vec![0; chosen.len()]);
    let mut count = 0;
    for row in field.cells.chunks(usize::from(field.width).max(1)) {
        let spans: Vec<_> = row.iter().flat_map(|cell| cell.index_range()).filter(|&s| chosen[s]).collect();
        let mut runs: Vec<Below> = Vec::new();
        let mut touched = vec![0; count];
        for &span in &spans {
            run_of[span] = match links.lower_x[span] {
                NONE => {
                    runs.push(Below { region: NONE, cells: 0, others: false });
                    runs.len() - 1
                }
                before => run_of[before as usize],
            };
            if links.lower_z[span] != NONE {
                let region = region_of[links.lower_z[span] as usize];
                touched[region as usize] += 1;
                runs[run_of[span]].add(region);
            }
        }
        let mut open = || {
            count += 1;
            count as u32 - 1
        };
        let regions: Vec<_> =
            runs.iter().map(|run| run.continued(&touched).unwrap_or_else(&mut open)).collect();
        spans.iter().for_each(|&span| region_of[span] = regions[run_of[span]]);
    }
    (region_of, count)
}
