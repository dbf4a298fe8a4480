//! Doors and open arches: a spanning tree of the rooms and about one loop more.

use super::{Opening, Rect, Room, RoomKind, WALL_M, layout::friendly};
use crate::procedural::rect::common;
use avln_geom::Rng;

/// Distance that a door keeps from the corners of a room, metres.
const CORNER_M: f32 = 0.12;
const DOOR_HEIGHT_M: f32 = 2.05;
const ARCH_HEIGHT_M: f32 = 2.2;

/// Openings that make all of `rooms` one connected floor.
pub(super) fn connect(rng: &mut Rng, rooms: &[Room]) -> Vec<Opening> {
    let mut shared = shared_walls(rooms);
    rng.shuffle(&mut shared);
    shared.sort_by_key(|wall| privacy(rooms, wall));
    let (tree, mut rest) = spanning_tree(rooms.len(), shared);
    rest.sort_by_key(|wall| !friendly(&wall.rooms.map(|room| rooms[room].kind)));
    let loops = if rng.chance(0.3) { 2 } else { 1 };
    let walls: Vec<SharedWall> = tree.into_iter().chain(rest.into_iter().take(loops)).collect();
    walls.iter().map(|wall| opening(rng, rooms, wall)).collect()
}

/// A wall that two rooms share, long enough for a door.
#[derive(Clone, Copy)]
struct SharedWall {
    rooms: [usize; 2],
    along_x: bool,
    line_m: f32,
    along: [f32; 2],
}

fn shared_walls(rooms: &[Room]) -> Vec<SharedWall> {
    let mut walls = Vec::new();
    for first in 0..rooms.len() {
        for second in first + 1..rooms.len() {
            walls.extend(shared_wall(rooms, [first, second]));
        }
    }
    walls
}

fn shared_wall(rooms: &[Room], pair: [usize; 2]) -> Option<SharedWall> {
    let [a, b] = pair.map(|room| rooms[room].cells[0]);
    let touching = |a: [f32; 2], b: [f32; 2]| [(a[1], b[0]), (a[0], b[1])].into_iter().find(|(p, q)| p == q);
    let wall = |along_x: bool, across: fn(&Rect) -> [f32; 2], along: fn(&Rect) -> [f32; 2]| {
        let (line_m, _) = touching(across(&a), across(&b))?;
        let (p, q) = (along(&a), along(&b));
        let usable = WALL_M / 2.0 + CORNER_M;
        let along = [p[0].max(q[0]) + usable, p[1].min(q[1]) - usable];
        (common(p, q) > 1.4).then_some(SharedWall { rooms: pair, along_x, line_m, along })
    };
    wall(true, |r| r.z, |r| r.x).or_else(|| wall(false, |r| r.x, |r| r.z))
}

/// How much one would rather not walk through this wall: 0 from the hallway, 1 from a public room, 2 otherwise.
fn privacy(rooms: &[Room], wall: &SharedWall) -> u8 {
    let kinds = wall.rooms.map(|room| rooms[room].kind);
    if kinds.contains(&RoomKind::Hallway) { 0 } else { 2 - u8::from(kinds.into_iter().any(is_public)) }
}

/// The walls, taken in order, that join rooms not joined before; then all the others.
fn spanning_tree(count: usize, walls: Vec<SharedWall>) -> (Vec<SharedWall>, Vec<SharedWall>) {
    let mut group: Vec<usize> = (0..count).collect();
    walls.into_iter().partition(|wall| {
        let [from, to] = wall.rooms.map(|room| group[room]);
        group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
        from != to
    })
}

fn opening(rng: &mut Rng, rooms: &[Room], wall: &SharedWall) -> Opening {
    let room_m = wall.along[1] - wall.along[0];
    let open = wall.rooms.iter().all(|&room| is_public(rooms[room].kind)) && rng.chance(0.6);
    let (width_m, height_m) = match open && room_m > 2.0 {
        true => (rng.range(1.3, 1.8).min(room_m), ARCH_HEIGHT_M),
        false => (rng.range(0.9, 1.0), DOOR_HEIGHT_M),
    };
    let play_m = room_m - width_m;
    // Doors near a corner leave longer walls for furniture.
    let from_end = rng.range(0.0, 0.35_f32.min(play_m).max(0.001));
    let start = wall.along[0] + if rng.chance(0.5) { from_end } else { play_m - from_end };
    let along = [start, start + width_m].map(|value| (value * 100.0).round() / 100.0);
    Opening { rooms: wall.rooms, along_x: wall.along_x, line_m: wall.line_m, along, height_m }
}

/// Whether open arches suit a room.
fn is_public(kind: RoomKind) -> bool {
    use RoomKind::*;
    matches!(kind, Hallway | LivingRoom | Kitchen | DiningRoom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::plan::Plan;

    #[test]
    fn doors_join_all_rooms_with_a_loop_or_two() {
        for seed in 0..200 {
            let count = 5 + seed as usize % 4;
            let plan = Plan::draw(&mut Rng::new(seed), count);
            let walls = plan.openings.iter().map(|opening| SharedWall {
                rooms: opening.rooms,
                along_x: opening.along_x,
                line_m: opening.line_m,
                along: opening.along,
            });
            let (tree, loops) = spanning_tree(count, walls.collect());
            assert_eq!(tree.len(), count - 1, "seed {seed}");
            assert!((1..=2).contains(&loops.len()), "seed {seed}: {} loops", loops.len());
        }
    }

    #[test]
    fn doors_lie_in_the_walls_of_both_rooms() {
        for seed in 0..200 {
            let plan = Plan::draw(&mut Rng::new(seed), 6);
            for opening in &plan.openings {
                let width_m = opening.along[1] - opening.along[0];
                assert!((0.89..1.81).contains(&width_m), "seed {seed}: {width_m} m wide");
                for room in opening.rooms.map(|room| plan.rooms[room].interior()) {
                    let wall = if opening.along_x { room.x } else { room.z };
                    assert!(wall[0] < opening.along[0] && opening.along[1] < wall[1], "seed {seed}");
                }
            }
        }
    }
}
