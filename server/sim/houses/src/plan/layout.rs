//! Room positions: storeys with rooms around hallways, or a single row in the smallest houses.

use super::programme::{self, CutRoom, RoomUnit};
use super::skeleton::{HouseFrame, Skeleton, Wanted};
use super::{Outline, Rect, Room, RoomKind, WALL_M, around};
use avln_geom::Rng;

/// Smallest room count with a hallway.
const HALLWAY_FROM: usize = 5;

/// Smallest room count with an entryway.
const ENTRYWAY_FROM: usize = 8;

/// Smallest room count with two storeys.
pub(crate) const STAIRS_FROM: usize = 11;

/// Floor area range of a storey's rooms without hallways, square metres.
const STOREY_M2: [f32; 2] = [46.0, 202.0];

/// Lays out `count` rooms (at least 1) on up to `storeys` storeys; returns the best draw.
pub(super) fn lay_out(rng: &Rng, count: usize, storeys: usize) -> Vec<Room> {
    const DRAWS: usize = 60;
    if count < HALLWAY_FROM {
        return row(&mut rng.fork("row"), count);
    }
    let storeys = if count < STAIRS_FROM { 1 } else { storeys };
    let mut best: Option<(f32, Vec<Room>)> = None;
    for draw in 0..DRAWS {
        let Some(rooms) = arms(&mut rng.fork(&format!("draw {draw}")), count, storeys) else { continue };
        let faults = faults(&rooms);
        if best.as_ref().is_none_or(|(least, _)| faults < *least) {
            best = Some((faults, rooms));
        }
        if faults == 0.0 {
            break;
        }
    }
    best.map_or_else(|| row(&mut rng.fork("row"), count), |(_, rooms)| rooms)
}

/// Lays out a single row of rooms without a hallway.
fn row(rng: &mut Rng, count: usize) -> Vec<Room> {
    let kinds = programme::programme(rng, count);
    let depth_m = rng.range(4.0, 4.8);
    let mut edge = 0.0;
    let pieces = kinds.iter().map(|&kind| {
        let width = programme::area_m2(rng, kind) / depth_m;
        let cell = Rect::new([edge, edge + width], [0.0, depth_m]);
        edge += width;
        Room { kind, storey: 0, cells: vec![cell], host: None }
    });
    let rooms = pieces.collect();
    placed(rng, rooms)
}

/// Lays out rooms along hallways.
fn arms(rng: &mut Rng, count: usize, storeys: usize) -> Option<Vec<Room>> {
    let wings = wing_count(rng, count, storeys);
    let entry = count >= ENTRYWAY_FROM;
    let upper_wings = if storeys == 2 { rng.below(wings + 1) } else { 0 };
    let passages = usize::from(entry) + wings + 1 + if storeys == 2 { upper_wings + 3 } else { 0 };
    let kinds = programme::programme(rng, count.checked_sub(passages)?);
    let mut by_storey = [programme::units(rng, &kinds), vec![]];
    if storeys == 2 {
        by_storey = programme::by_storey(rng, by_storey[0].clone());
    }
    // Without hallways, which come on top: `faults` accepts 60 to 250 square metres per storey.
    by_storey.iter_mut().for_each(|units| programme::fit(units, STOREY_M2[1]));
    let rooms_m2 = by_storey[0].iter().map(RoomUnit::total_m2).sum::<f32>().max(STOREY_M2[0]);
    let frame = HouseFrame::draw(rng, Wanted { rooms_m2, wings, entry, stairs: storeys == 2 })?;
    let mut rooms = Vec::new();
    for (storey, units) in by_storey[..storeys].iter().enumerate() {
        let skeleton = frame.storey(if storey == 0 { wings } else { upper_wings }, storey == 0);
        fill(rng, &mut rooms, storey, &skeleton, units)?;
    }
    let rooms = placed(rng, rooms);
    fit_together(&rooms).then_some(rooms)
}

/// Returns true if every room has a floor and no rooms overlap.
fn fit_together(rooms: &[Room]) -> bool {
    let apart = |index: usize, room: &Room| {
        let others = rooms[index + 1..].iter().filter(|other| other.storey == room.storey);
        let mut cells = others.flat_map(|other| &other.cells);
        cells.all(|other| room.cells.iter().all(|cell| !cell.overlaps(other)))
    };
    rooms.iter().enumerate().all(|(index, room)| room.outline().largest().is_some() && apart(index, room))
}

fn wing_count(rng: &mut Rng, count: usize, storeys: usize) -> usize {
    let per_storey = count / storeys;
    match per_storey {
        0..8 => usize::from(rng.chance(0.15)),
        8..11 => rng.below(2),
        11..16 => 1 + usize::from(rng.chance(0.4)),
        _ => 1 + usize::from(rng.chance(0.8)),
    }
}

/// Adds a storey's rooms; `None` if there are too few.
fn fill(
    rng: &mut Rng,
    rooms: &mut Vec<Room>,
    storey: usize,
    skeleton: &Skeleton,
    units: &[RoomUnit],
) -> Option<()> {
    if units.len() < skeleton.blocks.len() {
        return None;
    }
    for &(kind, cell) in &skeleton.passages {
        rooms.push(Room { kind, storey, cells: vec![cell], host: None });
    }
    let deal = programme::deal(rng, &skeleton.blocks, units);
    for (block, members) in skeleton.blocks.iter().zip(&deal) {
        for CutRoom { kind, cells, host } in programme::cut(rng, block, members, units) {
            let host = (host > 0).then(|| rooms.len() - host);
            rooms.push(Room { kind, storey, cells, host });
        }
    }
    deal.iter().all(|members| !members.is_empty()).then_some(())
}

/// Rates shape faults; 0 is good.
fn faults(rooms: &[Room]) -> f32 {
    let storey_m2 = |storey: usize| {
        let cells = rooms.iter().filter(|room| room.storey == storey).flat_map(|room| &room.cells);
        cells.map(Rect::area_m2).sum::<f32>()
    };
    let storeys = rooms.iter().map(|room| room.storey + 1).max().unwrap_or(0);
    let off = (0..storeys).map(storey_m2).map(|m2| (60.0 - m2).max(m2 - 250.0).max(0.0) / 10.0);
    off.sum::<f32>() + rooms.iter().map(room_faults).sum::<f32>()
}

fn room_faults(room: &Room) -> f32 {
    if room.kind.is_passage() {
        return 0.0;
    }
    let Some(inner) = Outline::inset(&room.cells, WALL_M / 2.0).largest() else { return 10.0 };
    let [short, long] = [inner.size()[0].min(inner.size()[1]), inner.size()[0].max(inner.size()[1])];
    let small =
        matches!(room.kind, RoomKind::Bathroom | RoomKind::Closet | RoomKind::Laundry | RoomKind::Utility);
    let narrow = (if small { 1.5 } else { 2.3 } - short).max(0.0);
    let area: f32 = room.cells.iter().map(Rect::area_m2).sum();
    let thin = (long / short.max(0.1) - 2.8).max(0.0);
    let broken = (0.5 - inner.area_m2() / area).max(0.0);
    4.0 * narrow + 2.0 * thin + 4.0 * broken
}

/// Turns and mirrors the rooms at random, in whole centimetres, the centre at the origin.
fn placed(rng: &mut Rng, rooms: Vec<Room>) -> Vec<Room> {
    let (swap, mirror_x, mirror_z) = (rng.chance(0.5), rng.chance(0.5), rng.chance(0.5));
    let cells: Vec<Rect> = rooms.iter().flat_map(|room| room.cells.iter().copied()).collect();
    let middle = around(&cells).center();
    let moved = |range: [f32; 2], middle: f32, mirror: bool| {
        let sign = if mirror { -1.0 } else { 1.0 };
        // Rounding makes common edges exactly equal, which the door search relies on.
        range.map(|value| sign * ((value - middle) * 100.0).round() / 100.0)
    };
    let cell = |cell: &Rect| {
        let (x, z) = (moved(cell.x, middle[0], mirror_x), moved(cell.z, middle[1], mirror_z));
        if swap { Rect::new(z, x) } else { Rect::new(x, z) }
    };
    rooms.into_iter().map(|room| Room { cells: room.cells.iter().map(cell).collect(), ..room }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn houses() -> impl Iterator<Item = (u64, Vec<Room>)> {
        (0..120).map(|seed| {
            let count = 5 + seed as usize % 20;
            (seed, lay_out(&Rng::new(seed), count, 1 + seed as usize / 20 % 2))
        })
    }

    #[test]
    fn room_count_is_exact_without_overlaps() {
        for (seed, rooms) in houses() {
            assert_eq!(rooms.len(), 5 + seed as usize % 20);
            for (index, room) in rooms.iter().enumerate() {
                let others = rooms[index + 1..].iter().filter(|other| other.storey == room.storey);
                for other in others.flat_map(|other| &other.cells) {
                    assert!(room.cells.iter().all(|cell| !cell.overlaps(other)), "seed {seed}");
                }
            }
        }
    }

    #[test]
    fn rooms_have_good_shapes_and_sizes() {
        let mut faulty = 0;
        for (seed, rooms) in houses() {
            faulty += usize::from(faults(&rooms) > 0.0);
            for room in &rooms {
                let inner = room.interior().size();
                let least = if room.kind.is_passage() { 1.2 } else { 1.35 };
                assert!(inner[0].min(inner[1]) > least, "seed {seed}: {room:?}");
            }
        }
        assert!(faulty <= 6, "{faulty} of 120 houses have rooms of bad shape");
    }

    #[test]
    fn stairs_are_aligned_between_storeys() {
        for (seed, rooms) in houses() {
            let stairs: Vec<&Room> = rooms.iter().filter(|room| room.kind == RoomKind::Stairs).collect();
            if rooms.iter().any(|room| room.storey == 1) {
                assert_eq!(stairs.len(), 2, "seed {seed}");
                assert_eq!(stairs[0].cells, stairs[1].cells, "seed {seed}");
            } else {
                assert!(stairs.is_empty(), "seed {seed}");
            }
        }
    }
}
