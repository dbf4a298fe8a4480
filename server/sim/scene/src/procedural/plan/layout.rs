//! Rooms on both sides of a straight hallway, with a living room across its end in some houses.

use super::{Rect, Room, RoomKind};
use avln_geom::Rng;

/// Lays the rooms side by side; the first one is the hallway where there is one.
pub(super) fn lay_out(rng: &mut Rng, kinds: &[RoomKind]) -> Vec<Room> {
    let strips = if kinds[0] == RoomKind::Hallway { corridor(rng, kinds) } else { row(rng, kinds) };
    placed(rng, strips)
}

/// A room in the frame of the hallway: u along it, v across it.
struct Strip {
    kind: RoomKind,
    u: [f32; 2],
    v: [f32; 2],
}

/// Floor area that a room should have, square metres.
fn target_area_m2(rng: &mut Rng, kind: RoomKind) -> f32 {
    let (low, high) = match kind {
        RoomKind::Hallway => (8.0, 12.0),
        RoomKind::LivingRoom => (21.0, 28.0),
        RoomKind::Kitchen => (13.0, 17.0),
        RoomKind::DiningRoom => (13.0, 17.0),
        RoomKind::Bedroom => (14.0, 18.0),
        RoomKind::Bathroom => (8.0, 10.0),
        RoomKind::Office => (10.0, 13.0),
        RoomKind::Gym => (11.0, 15.0),
        _ => (10.0, 13.0),
    };
    rng.range(low, high)
}

/// Houses without a hallway: one row of rooms.
fn row(rng: &mut Rng, kinds: &[RoomKind]) -> Vec<Strip> {
    let depth_m = rng.range(4.0, 4.8);
    let widths: Vec<f32> = kinds.iter().map(|&kind| target_area_m2(rng, kind) / depth_m).collect();
    side_by_side(kinds, &widths, [0.0, depth_m], 0.0)
}

fn side_by_side(kinds: &[RoomKind], widths: &[f32], v: [f32; 2], start: f32) -> Vec<Strip> {
    let mut edge = start;
    let strips = kinds.iter().zip(widths).map(|(&kind, &width)| {
        let u = [edge, edge + width];
        edge = u[1];
        Strip { kind, u, v }
    });
    strips.collect()
}

/// How the end of the hallway is closed.
#[derive(Clone, Copy, PartialEq)]
enum End {
    /// By an outer wall.
    Wall,
    /// By the living room, which spans the hallway and the deep side.
    LivingRoom,
}

fn corridor(rng: &mut Rng, kinds: &[RoomKind]) -> Vec<Strip> {
    let hall_m = rng.range(1.5, 1.9);
    let depths = [rng.range(3.3, 3.7), rng.range(4.1, 4.7)];
    let end = if kinds.len() > 5 && rng.chance(0.5) { End::LivingRoom } else { End::Wall };
    let mut rooms: Vec<RoomKind> = kinds[1..].to_vec();
    let mut end_m = 0.0;
    if end == End::LivingRoom {
        rooms.retain(|&kind| kind != RoomKind::LivingRoom);
        end_m = rng.range(4.0, 4.6);
    }
    let sides = split(rng, &rooms, depths, end_m);
    let total_m = sides.iter().map(|side| side.length_m()).sum::<f32>() / 2.0;
    let [shallow, deep] = sides.map(|side| side.scaled_to(total_m));
    let hall_end = total_m - end_m;
    let mut strips = vec![Strip { kind: RoomKind::Hallway, u: [0.0, hall_end], v: [0.0, hall_m] }];
    strips.extend(side_by_side(&shallow.kinds, &shallow.widths, [-depths[0], 0.0], 0.0));
    strips.extend(side_by_side(&deep.kinds, &deep.widths, [hall_m, hall_m + depths[1]], 0.0));
    if end == End::LivingRoom {
        let v = [0.0, hall_m + depths[1]];
        strips.push(Strip { kind: RoomKind::LivingRoom, u: [hall_end, total_m], v });
    }
    strips
}

/// Rooms along one side of the hallway.
struct Row {
    kinds: Vec<RoomKind>,
    widths: Vec<f32>,
    /// Length beyond the last room that another room takes.
    reserved_m: f32,
}

impl Row {
    fn length_m(&self) -> f32 {
        self.widths.iter().sum::<f32>() + self.reserved_m
    }

    /// How far the rooms fall short of a good width once they fill `length_m`, metres.
    fn narrowness_m(&self, length_m: f32) -> f32 {
        const WIDE_M: f32 = 2.2;
        let scale = self.scale_to(length_m);
        self.widths.iter().map(|width| (WIDE_M - width * scale).max(0.0)).sum()
    }

    fn scale_to(&self, length_m: f32) -> f32 {
        (length_m - self.reserved_m) / (self.length_m() - self.reserved_m)
    }

    fn scaled_to(mut self, length_m: f32) -> Self {
        let scale = self.scale_to(length_m);
        self.widths.iter_mut().for_each(|width| *width *= scale);
        self
    }
}

/// Deals the rooms to the shallow and the deep side; `end_m` of the deep side is taken already.
/// Of many random deals, the one with the best match of lengths, sides and neighbours is kept.
fn split(rng: &mut Rng, rooms: &[RoomKind], depths: [f32; 2], end_m: f32) -> [Row; 2] {
    const DEALS: usize = 200;
    let areas: Vec<f32> = rooms.iter().map(|&kind| target_area_m2(rng, kind)).collect();
    let mut best: Option<(f32, [Row; 2])> = None;
    for _ in 0..DEALS {
        let sides = deal(rng, rooms, &areas, depths, end_m);
        let cost = cost_of(&sides);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, sides));
        }
    }
    best.expect("there are deals").1
}

fn deal(rng: &mut Rng, rooms: &[RoomKind], areas: &[f32], depths: [f32; 2], end_m: f32) -> [Row; 2] {
    let mut order: Vec<usize> = (0..rooms.len()).collect();
    rng.shuffle(&mut order);
    let cut = 1 + rng.below(rooms.len().max(2) - 1);
    let row = |indices: &[usize], depth_m: f32, reserved_m: f32| Row {
        kinds: indices.iter().map(|&index| rooms[index]).collect(),
        widths: indices.iter().map(|&index| areas[index] / depth_m).collect(),
        reserved_m,
    };
    [row(&order[..cut], depths[0], 0.0), row(&order[cut..], depths[1], end_m)]
}

fn cost_of(sides: &[Row; 2]) -> f32 {
    let mismatch = (sides[0].length_m() - sides[1].length_m()).abs();
    let misplaced = sides[0].kinds.iter().filter(|kind| wants_depth(**kind)).count()
        + sides[1].kinds.iter().filter(|kind| !wants_depth(**kind)).count();
    let friends: usize = sides.iter().flat_map(|side| side.kinds.windows(2)).filter(|w| friendly(w)).count();
    let length_m = (sides[0].length_m() + sides[1].length_m()) / 2.0;
    let narrow: f32 = sides.iter().map(|side| side.narrowness_m(length_m)).sum();
    let empty = sides.iter().filter(|side| side.kinds.is_empty() && side.reserved_m == 0.0).count();
    2.0 * mismatch + 1.2 * misplaced as f32 - 1.0 * friends as f32 + 8.0 * narrow + 100.0 * empty as f32
}

/// Whether a room suits the deep side of the house.
fn wants_depth(kind: RoomKind) -> bool {
    matches!(kind, RoomKind::LivingRoom | RoomKind::Bedroom | RoomKind::DiningRoom | RoomKind::Gym)
}

/// Whether two neighbours suit each other.
pub(super) fn friendly(pair: &[RoomKind]) -> bool {
    use RoomKind::*;
    const FRIENDS: [[RoomKind; 2]; 6] = [
        [Kitchen, DiningRoom],
        [Kitchen, LivingRoom],
        [DiningRoom, LivingRoom],
        [Bedroom, Bathroom],
        [Bedroom, Office],
        [Gym, Bathroom],
    ];
    FRIENDS.iter().any(|[a, b]| pair == [*a, *b] || pair == [*b, *a])
}

/// Turns and mirrors the plan at random, in whole centimetres, the middle at the origin.
fn placed(rng: &mut Rng, strips: Vec<Strip>) -> Vec<Room> {
    let (swap, mirror_u, mirror_v) = (rng.chance(0.5), rng.chance(0.5), rng.chance(0.5));
    let middle = |range: fn(&Strip) -> [f32; 2]| {
        let low = strips.iter().map(|strip| range(strip)[0]).fold(f32::INFINITY, f32::min);
        let high = strips.iter().map(|strip| range(strip)[1]).fold(f32::NEG_INFINITY, f32::max);
        (low + high) / 2.0
    };
    let (middle_u, middle_v) = (middle(|strip| strip.u), middle(|strip| strip.v));
    let moved = |range: [f32; 2], middle: f32, mirror: bool| {
        let sign = if mirror { -1.0 } else { 1.0 };
        range.map(|value| sign * ((value - middle) * 100.0).round() / 100.0)
    };
    let room = |strip: &Strip| {
        let (u, v) = (moved(strip.u, middle_u, mirror_u), moved(strip.v, middle_v, mirror_v));
        let cell = if swap { Rect::new(v, u) } else { Rect::new(u, v) };
        Room { kind: strip.kind, storey: 0, cells: vec![cell] }
    };
    strips.iter().map(room).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::plan::Plan;

    #[test]
    fn rooms_do_not_overlap_and_are_wide_enough_to_turn_in() {
        for seed in 0..200 {
            let plan = Plan::draw(&mut Rng::new(seed), 5 + seed as usize % 4);
            for (index, room) in plan.rooms.iter().enumerate() {
                let [width, depth] = room.interior().size();
                assert!(width.min(depth) > 1.3, "seed {seed}: {:?} of {width} by {depth} m", room.kind);
                let others = &plan.rooms[index + 1..];
                assert!(others.iter().all(|other| !other.cells[0].overlaps(&room.cells[0])), "seed {seed}");
            }
        }
    }
}
