//! Storey shape: rows of rooms on both sides of hallways, and the stairs.
//!
//! Coordinates are in the main hallway's frame, which starts at x = 0. Row 0 has smaller z, row 1 larger z.

use super::RoomKind;
use crate::rect::{Rect, Side};
use avln_geom::Rng;

/// Stair cell width and smallest depth, metres.
const STAIRS_M: [f32; 2] = [2.24, 4.37];

/// Smallest room frontage, metres.
const LEAST_M: f32 = 2.6;

/// A rectangle to be divided into rooms on a hallway.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    pub(super) rect: Rect,
    pub(super) hall: Side,
    /// Hallway range on that side.
    pub(super) frontage: [f32; 2],
    /// True for a single room at the end of a hallway.
    pub(super) closes: bool,
}

/// A storey's hallways, stairs and blocks.
#[derive(Clone, Debug, Default)]
pub(super) struct Skeleton {
    pub(super) passages: Vec<(RoomKind, Rect)>,
    pub(super) blocks: Vec<Block>,
}

/// Dimensions common to all storeys, metres.
#[derive(Clone, Debug)]
pub(super) struct HouseFrame {
    hall: f32,
    rows: [f32; 2],
    length: f32,
    /// Entryway end; 0 without.
    entry: f32,
    /// Length of a row-1 room across the end of the main hallway; 0 without.
    stop: f32,
    /// Stairs start in row 0.
    stairs: Option<f32>,
    pub(super) wings: Vec<Wing>,
}

/// A perpendicular hallway with rooms.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wing {
    /// Row cut by the hallway.
    row: usize,
    /// Position on the main hallway.
    start: f32,
    hall: f32,
    /// Room depths at smaller and larger x; 0 for no rooms.
    sides: [f32; 2],
    length: f32,
    /// Length of the room across the end; 0 without.
    end: f32,
}

impl Wing {
    fn span(&self) -> [f32; 2] {
        [self.start - self.sides[0], self.start + self.hall + self.sides[1]]
    }

    fn width(&self) -> f32 {
        self.sides[0] + self.hall + self.sides[1]
    }

    fn rooms_m2(&self) -> f32 {
        (self.sides[0] + self.sides[1]) * self.length + self.end * self.hall
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    /// Floor area without passages, square metres.
    pub(super) rooms_m2: f32,
    pub(super) wings: usize,
    pub(super) entry: bool,
    pub(super) stairs: bool,
}

impl HouseFrame {
    /// Draws a frame; `None` if the draw is unsuitable.
    pub(super) fn draw(rng: &mut Rng, wanted: Wanted) -> Option<Self> {
        let deep = if wanted.rooms_m2 < 60.0 { [3.3, 4.0] } else { [3.8, 4.8] };
        let mut rows = [rng.range(deep[0], deep[1]), rng.range(deep[0], deep[1])];
        rows[0] = if wanted.stairs { rows[0].max(STAIRS_M[1]) } else { rows[0] };
        let hall = rng.range(1.42, 1.75);
        let mut wings: Vec<Wing> = (0..wanted.wings).map(|index| wing(rng, wanted, index)).collect();
        let through: f32 = wings.iter().map(|wing| wing.hall * rows[wing.row]).sum();
        let stairs_m2 = if wanted.stairs { STAIRS_M[0] * rows[0] } else { 0.0 };
        let in_wings: f32 = wings.iter().map(Wing::rooms_m2).sum();
        let stop = if rng.chance(0.55) { rng.range(3.6, 4.4) } else { 0.0 };
        let main_m2 = wanted.rooms_m2 - in_wings + through + stairs_m2 - stop * hall;
        let length = (main_m2 / (rows[0] + rows[1])).max(6.0);
        place(rng, &mut wings, length)?;
        let stop = if blocked(&wings, length - stop - LEAST_M, length) { 0.0 } else { stop };
        let stairs = if wanted.stairs { Some(stairs_start(rng, length, stop)?) } else { None };
        let entry = if wanted.entry { rng.range(2.0, 2.8) } else { 0.0 };
        let apart = wings.iter().all(|wing| wing.start >= entry);
        (apart && length < 26.0).then_some(Self { hall, rows, length, entry, stop, stairs, wings }.rounded())
    }

    fn rounded(mut self) -> Self {
        let round = |value: &mut f32| *value = (*value * 100.0).round() / 100.0;
        let own = [&mut self.hall, &mut self.length, &mut self.entry, &mut self.stop];
        own.into_iter().chain(&mut self.rows).chain(&mut self.stairs).for_each(round);
        for wing in &mut self.wings {
            let own = [&mut wing.start, &mut wing.hall, &mut wing.length, &mut wing.end];
            own.into_iter().chain(&mut wing.sides).for_each(round);
            // Nearly flush walls become flush, so that they form a single face.
            let flush = wing.span()[1] - self.length;
            wing.start -= if flush.abs() < 0.05 { flush } else { 0.0 };
            let flush = wing.span()[0];
            wing.start -= if flush.abs() < 0.05 { flush } else { 0.0 };
        }
        self
    }

    /// Builds a storey with the first `wings` wings; the lowest has the entryway.
    pub(super) fn storey(&self, wings: usize, lowest: bool) -> Skeleton {
        let mut skeleton = Skeleton::default();
        self.main_hall(&mut skeleton, lowest);
        let end = self.length - self.stop;
        for row in 0..2 {
            let reach = if row == 1 { end } else { self.length };
            let mut cuts: Vec<[f32; 2]> = self.wings[..wings]
                .iter()
                .filter(|wing| wing.row == row)
                .map(|wing| [wing.start, wing.start + wing.hall])
                .collect();
            if let Some(start) = self.stairs.filter(|_| row == 0) {
                cuts.push([start, start + STAIRS_M[0]]);
            }
            for x in super::remainder([0.0, reach], cuts.into_iter()) {
                let (z, hall) = (self.row_z(row), if row == 0 { Side::South } else { Side::North });
                let frontage = [x[0], x[1].min(end)];
                skeleton.blocks.push(Block { rect: Rect::new(x, z), hall, frontage, closes: false });
            }
        }
        if self.stop > 0.0 {
            let rect = Rect::new([end, self.length], [0.0, self.row_z(1)[1]]);
            let frontage = [0.0, self.hall];
            skeleton.blocks.push(Block { rect, hall: Side::West, frontage, closes: true });
        }
        for wing in &self.wings[..wings] {
            self.add_wing(&mut skeleton, wing);
        }
        skeleton
    }

    fn row_z(&self, row: usize) -> [f32; 2] {
        if row == 0 { [-self.rows[0], 0.0] } else { [self.hall, self.hall + self.rows[1]] }
    }

    fn main_hall(&self, skeleton: &mut Skeleton, lowest: bool) {
        let (z, end) = ([0.0, self.hall], self.length - self.stop);
        let entry = if lowest { self.entry } else { 0.0 };
        skeleton.passages.push((RoomKind::Hallway, Rect::new([entry, end], z)));
        if entry > 0.0 {
            skeleton.passages.push((RoomKind::Entryway, Rect::new([0.0, entry], z)));
        }
        if let Some(start) = self.stairs {
            let cell = Rect::new([start, start + STAIRS_M[0]], self.row_z(0));
            skeleton.passages.push((RoomKind::Stairs, cell));
        }
    }

    fn add_wing(&self, skeleton: &mut Skeleton, wing: &Wing) {
        // z grows from the main hallway; wings in row 0 are mirrored at the end.
        let outer = if wing.row == 1 { self.row_z(1)[1] } else { self.hall + self.rows[0] };
        let mirrored = |rect: Rect| match wing.row {
            1 => rect,
            _ => Rect::new(rect.x, rect.z.map(|z| self.hall - z)),
        };
        let (far, [low, high]) = (outer + wing.length, wing.span());
        let hall_x = [wing.start, wing.start + wing.hall];
        let stop = far - wing.end;
        skeleton.passages.push((RoomKind::Hallway, mirrored(Rect::new(hall_x, [self.hall, stop]))));
        // The end room takes one side of the hallway; the row on the other side continues next to it.
        let across = usize::from(wing.sides[1] > wing.sides[0]);
        for (side, x, hall) in [(0, [low, hall_x[0]], Side::East), (1, [hall_x[1], high], Side::West)] {
            if wing.sides[side] > 0.0 {
                let reach = if side == across { stop } else { far };
                let rect = mirrored(Rect::new(x, [outer, reach]));
                let frontage = mirrored(Rect::new(x, [outer, stop])).z;
                skeleton.blocks.push(Block { rect, hall, frontage, closes: false });
            }
        }
        if wing.end > 0.0 {
            let x = if across == 0 { [low, hall_x[1]] } else { [hall_x[0], high] };
            let hall = if wing.row == 1 { Side::North } else { Side::South };
            let rect = mirrored(Rect::new(x, [stop, far]));
            skeleton.blocks.push(Block { rect, hall, frontage: hall_x, closes: true });
        }
    }
}

fn wing(rng: &mut Rng, wanted: Wanted, index: usize) -> Wing {
    let share = if wanted.wings == 1 { rng.range(0.3, 0.42) } else { rng.range(0.22, 0.3) };
    let depths = [rng.range(3.4, 4.4), rng.range(3.4, 4.4)];
    let area = share * wanted.rooms_m2;
    // Small wings have rooms on a single side of the hallway.
    let sides = match (area < 34.0 || rng.chance(0.25), rng.chance(0.5)) {
        (true, true) => [depths[0], 0.0],
        (true, false) => [0.0, depths[1]],
        _ => depths,
    };
    let hall = rng.range(1.42, 1.7);
    let length = (area / (sides[0] + sides[1])).clamp(3.4, 11.0);
    let end = if length > 7.0 && rng.chance(0.5) { rng.range(3.4, 4.2) } else { 0.0 };
    let row = if wanted.stairs || index == 0 { 1 } else { rng.below(2) };
    Wing { row, start: 0.0, hall, sides, length, end }
}

/// Positions wings on the main hallway: flush with an end, or in between.
fn place(rng: &mut Rng, wings: &mut [Wing], length: f32) -> Option<()> {
    for index in 0..wings.len() {
        let wing = wings[index];
        let play = length - wing.width();
        let row: Vec<[f32; 2]> =
            wings[..index].iter().filter(|other| other.row == wing.row).map(Wing::span).collect();
        let fits = |from: &f32| {
            let span = [*from, *from + wing.width()];
            let hall = [span[0] + wing.sides[0], span[0] + wing.sides[0] + wing.hall];
            // No stretch next to the wing may be too short for a room.
            let whole = |gap: f32| !(1e-3..LEAST_M).contains(&gap);
            whole(hall[0])
                && whole(length - hall[1])
                && row.iter().all(|other| other[0] - span[1] > LEAST_M || span[0] - other[1] > LEAST_M)
        };
        let free = rng.range(0.0, play.max(0.01));
        let mut places = [0.0, play, free];
        rng.shuffle(&mut places);
        let from = places.into_iter().filter(|from| *from >= 0.0).find(fits)?;
        wings[index].start = from + wing.sides[0];
    }
    Some(())
}

/// Returns true if a wing hallway meets the range.
fn blocked(wings: &[Wing], from: f32, to: f32) -> bool {
    wings.iter().any(|wing| wing.start + wing.hall > from && wing.start < to)
}

/// Draws the stairs start without leaving a stretch too short for a room.
fn stairs_start(rng: &mut Rng, length: f32, stop: f32) -> Option<f32> {
    let last = length - stop - STAIRS_M[0];
    let free = rng.range(LEAST_M, last.max(LEAST_M + 0.1));
    let fits = |start: &f32| {
        let after = length - start - STAIRS_M[0];
        *start <= last + 1e-3 && (*start < 1e-3 || *start >= LEAST_M) && !(1e-3..LEAST_M).contains(&after)
    };
    let mut starts = [free, free, last];
    rng.shuffle(&mut starts);
    starts.into_iter().find(fits)
}
