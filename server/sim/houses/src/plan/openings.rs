//! Doors and open arches: a spanning tree of the rooms and some loops.

use super::deal::friendship;
use super::{Opening, Rect, Room, RoomKind, WALL_M};
use crate::rect::common;
use avln_geom::Rng;

/// Distance of a door from room corners, metres.
const CORNER_M: f32 = 0.12;
/// Widths of doors between their jambs, metres.
const DOOR_M: [f32; 2] = [0.85, 0.95];
const DOOR_HEIGHT_M: f32 = 2.05;
const ARCH_HEIGHT_M: f32 = 2.25;

/// Share of the tree's doors that are added to make loops.
const LOOPS: [f32; 2] = [0.15, 0.25];

/// Openings that connect all `rooms`.
pub(super) fn connect(rng: &mut Rng, rooms: &[Room]) -> Vec<Opening> {
    let mut walls = shared_walls(rooms);
    rng.shuffle(&mut walls);
    let mut priced: Vec<(f32, SharedWall)> =
        walls.into_iter().map(|wall| (price(rng, rooms, &wall), wall)).collect();
    priced.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (tree, rest) = spanning_tree(rooms, priced.into_iter().map(|(_, wall)| wall).collect());
    let loops = loops(rng, rooms, tree.len(), rest);
    tree.iter().chain(&loops).map(|wall| opening(rng, rooms, wall)).collect()
}

/// A wall that two rooms share, long enough for a door.
#[derive(Clone, Copy, Debug)]
struct SharedWall {
    rooms: [usize; 2],
    along_x: bool,
    line_m: f32,
    /// Possible door range on the wall axis.
    along: [f32; 2],
}

fn shared_walls(rooms: &[Room]) -> Vec<SharedWall> {
    let mut walls = Vec::new();
    for first in 0..rooms.len() {
        for second in first + 1..rooms.len() {
            if rooms[first].storey == rooms[second].storey {
                walls.extend(shared_wall(rooms, [first, second]));
            }
        }
    }
    walls
}

/// The longest straight wall between two rooms, if a door fits into it.
fn shared_wall(rooms: &[Room], pair: [usize; 2]) -> Option<SharedWall> {
    let mut walls: Vec<SharedWall> = Vec::new();
    let [first, second] = pair.map(|room| &rooms[room].cells);
    let edges = first.iter().flat_map(|a| second.iter().filter_map(move |b| touching(a, b)));
    for wall in edges {
        let SharedWall { along_x, line_m, along, .. } = wall;
        let continued = walls.iter_mut().find(|other| {
            other.along_x == along_x && other.line_m == line_m && common(other.along, along) > -1e-3
        });
        match continued {
            Some(other) => other.along = [other.along[0].min(along[0]), other.along[1].max(along[1])],
            None => walls.push(SharedWall { rooms: pair, ..wall }),
        }
    }
    let longest = walls.into_iter().max_by(|a, b| length_m(a).total_cmp(&length_m(b)))?;
    let usable = WALL_M / 2.0 + CORNER_M;
    let along = [longest.along[0] + usable, longest.along[1] - usable];
    (along[1] - along[0] > DOOR_M[0]).then_some(SharedWall { along, ..longest })
}

fn length_m(wall: &SharedWall) -> f32 {
    wall.along[1] - wall.along[0]
}

/// The edge that two cells share.
fn touching(a: &Rect, b: &Rect) -> Option<SharedWall> {
    let line = |a: [f32; 2], b: [f32; 2]| {
        [(a[1], b[0]), (a[0], b[1])].into_iter().find(|(p, q)| p == q).map(|(line, _)| line)
    };
    let wall = |along_x: bool, line_m: f32, p: [f32; 2], q: [f32; 2]| {
        let along = [p[0].max(q[0]), p[1].min(q[1])];
        (along[1] - along[0] > 1e-3).then_some(SharedWall { rooms: [0; 2], along_x, line_m, along })
    };
    let across_z = line(a.z, b.z).and_then(|line_m| wall(true, line_m, a.x, b.x));
    across_z.or_else(|| line(a.x, b.x).and_then(|line_m| wall(false, line_m, a.z, b.z)))
}

fn kinds(rooms: &[Room], wall: &SharedWall) -> [RoomKind; 2] {
    wall.rooms.map(|room| rooms[room].kind)
}

/// Returns true if one of the rooms is entered through the other.
fn belong(rooms: &[Room], [a, b]: [usize; 2]) -> bool {
    rooms[a].host == Some(b) || rooms[b].host == Some(a)
}

/// Cost of a door in this wall: lowest between passages and into annexes, then from passages, then between
/// related rooms.
fn price(rng: &mut Rng, rooms: &[Room], wall: &SharedWall) -> f32 {
    let [a, b] = kinds(rooms, wall);
    let annexed = wall.rooms.into_iter().any(|room| rooms[room].host.is_some());
    let whim = rng.range(0.0, 1.0);
    match (a.is_passage(), b.is_passage()) {
        (true, true) => 0.0,
        _ if a == RoomKind::Stairs || b == RoomKind::Stairs => 1000.0,
        _ if belong(rooms, wall.rooms) => 0.5,
        _ if annexed => 90.0,
        (true, false) | (false, true) => {
            let room = if a.is_passage() { b } else { a };
            // Some rooms of the day are entered through each other, so that not all doors are at the hallway.
            let through = matches!(room, RoomKind::Kitchen | RoomKind::DiningRoom | RoomKind::Laundry);
            whim + if through && rng.chance(0.5) { 3.0 } else { 1.0 }
        }
        _ if is_public(a) && is_public(b) => 2.0 + whim,
        _ if friendship(a, b) > 0.0 => 6.0 + whim,
        _ if a == RoomKind::Bathroom || b == RoomKind::Bathroom => 40.0 + whim,
        _ => 20.0 + whim,
    }
}

/// The walls, taken in order, that join rooms not joined before; then all the others. Stairs join storeys.
fn spanning_tree(rooms: &[Room], walls: Vec<SharedWall>) -> (Vec<SharedWall>, Vec<SharedWall>) {
    let stairs = rooms.iter().position(|room| room.kind == RoomKind::Stairs);
    let group = |(index, room): (usize, &Room)| match stairs {
        Some(first) if room.kind == RoomKind::Stairs => first,
        _ => index,
    };
    let mut group: Vec<usize> = rooms.iter().enumerate().map(group).collect();
    walls.into_iter().partition(|wall| {
        let [from, to] = wall.rooms.map(|room| group[room]);
        group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
        from != to
    })
}

/// Some remaining walls, related rooms first.
fn loops(rng: &mut Rng, rooms: &[Room], tree: usize, rest: Vec<SharedWall>) -> Vec<SharedWall> {
    let wanted = (tree as f32 * rng.range(LOOPS[0], LOOPS[1])).round().max(1.0) as usize;
    let taste = |wall: &SharedWall| {
        let [a, b] = kinds(rooms, wall);
        let private = |kind: RoomKind| matches!(kind, RoomKind::Bathroom | RoomKind::Closet);
        match () {
            () if wall.rooms.into_iter().any(|room| rooms[room].host.is_some()) => None,
            () if a.is_passage() && b.is_passage() || [a, b].contains(&RoomKind::Stairs) => None,
            () if is_public(a) && is_public(b) && !(a.is_passage() || b.is_passage()) => Some(0),
            () if friendship(a, b) > 0.0 => Some(1),
            () if (a.is_passage() || b.is_passage()) && !(private(a) || private(b)) => Some(2),
            () if private(a) || private(b) || a == RoomKind::Bedroom && b == RoomKind::Bedroom => None,
            () => Some(3),
        }
    };
    let mut ranked: Vec<(i32, SharedWall)> =
        rest.into_iter().filter_map(|wall| Some((taste(&wall)?, wall))).collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.into_iter().take(wanted).map(|(_, wall)| wall).collect()
}

fn opening(rng: &mut Rng, rooms: &[Room], wall: &SharedWall) -> Opening {
    let room_m = length_m(wall);
    let (width_m, height_m) = match kinds(rooms, wall) {
        [a, b] if a.is_passage() && b.is_passage() => (room_m + 2.0 * CORNER_M - 0.02, ARCH_HEIGHT_M),
        kinds if open(rng, kinds) && room_m > 1.4 => (rng.range(1.2, 1.9).min(room_m), ARCH_HEIGHT_M),
        _ => (rng.range(DOOR_M[0], DOOR_M[1]).min(room_m), DOOR_HEIGHT_M),
    };
    let play_m = room_m - width_m;
    // Doors near a corner leave longer walls for furniture.
    let from_end = rng.range(0.0, 0.35).min(play_m.max(0.0));
    let start = match play_m < 0.0 {
        true => wall.along[0] + play_m / 2.0,
        false => wall.along[0] + if rng.chance(0.5) { from_end } else { play_m - from_end },
    };
    let along = [start, start + width_m].map(|value| (value * 100.0).round() / 100.0);
    Opening { rooms: wall.rooms, along_x: wall.along_x, line_m: wall.line_m, along, height_m }
}

/// Returns true for an open arch between two rooms.
fn open(rng: &mut Rng, [a, b]: [RoomKind; 2]) -> bool {
    let suits = is_public(a) && is_public(b)
        || [a, b].contains(&RoomKind::GameRoom) && (is_public(a) || is_public(b));
    suits && rng.chance(0.75)
}

/// Returns true if a room may have open arches.
fn is_public(kind: RoomKind) -> bool {
    use RoomKind::*;
    matches!(kind, Hallway | Entryway | LivingRoom | Kitchen | DiningRoom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;

    fn plans() -> impl Iterator<Item = (u64, Plan)> {
        (0..100).map(|seed| {
            (seed, Plan::draw(&Rng::new(seed), 5 + seed as usize % 20, 1 + seed as usize / 20 % 2))
        })
    }

    #[test]
    fn doors_join_all_rooms_with_some_loops() {
        let (mut trees, mut arches, mut extra) = (0, 0, 0);
        for (seed, plan) in plans() {
            let walls = plan.openings.iter().map(|opening| SharedWall {
                rooms: opening.rooms,
                along_x: opening.along_x,
                line_m: opening.line_m,
                along: opening.along,
            });
            let (tree, loops) = spanning_tree(&plan.rooms, walls.collect());
            assert_eq!(tree.len(), plan.rooms.len() - plan.storeys(), "seed {seed}");
            trees += tree.len();
            extra += loops.len();
            arches += plan.openings.iter().filter(|opening| opening.height_m == ARCH_HEIGHT_M).count();
        }
        let share = |count: usize| count as f32 / (trees + extra) as f32;
        assert!((0.10..0.25).contains(&share(extra)), "{} of the doors make loops", share(extra));
        assert!((0.2..0.45).contains(&share(arches)), "{} of the doors are open arches", share(arches));
    }

    #[test]
    fn doors_lie_in_the_walls_of_both_rooms() {
        for (seed, plan) in plans() {
            for opening in &plan.openings {
                let width_m = opening.along[1] - opening.along[0];
                assert!((0.84..2.3).contains(&width_m), "seed {seed}: {width_m} m wide");
                for room in opening.rooms {
                    let holds = |face: &super::super::Face| {
                        let line = face.line_m - face.side.inward() * WALL_M / 2.0;
                        let along = face.along[0] <= opening.along[0] && opening.along[1] <= face.along[1];
                        (line - opening.line_m).abs() < 1e-3 && along
                    };
                    assert!(plan.rooms[room].faces().iter().any(holds), "seed {seed}: {opening:?}");
                }
            }
        }
    }

    #[test]
    fn annexes_are_entered_through_their_hosts_alone() {
        for (seed, plan) in plans() {
            for (index, room) in plan.rooms.iter().enumerate().filter(|(_, room)| room.host.is_some()) {
                let doors: Vec<_> = plan.openings.iter().filter(|door| door.rooms.contains(&index)).collect();
                assert_eq!(doors.len(), 1, "seed {seed}");
                assert!(doors[0].rooms.contains(&room.host.unwrap()), "seed {seed}");
            }
        }
    }
}
