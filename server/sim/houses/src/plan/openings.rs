//! Doors and open arches: a spanning tree over the rooms, loops, and the resulting detours.

use super::programme::friendship;
use super::{Opening, Plan, Rect, Room, RoomKind, WALL_M};
use crate::rect::common;
use avln_geom::Rng;

/// Door distance from room corners, metres.
const CORNER_M: f32 = 0.12;
/// Door width range between jambs, metres.
const DOOR_M: [f32; 2] = [0.85, 0.95];
const DOOR_HEIGHT_M: f32 = 2.05;
const ARCH_HEIGHT_M: f32 = 2.25;

/// Doors added for loops, as a share of the tree's doors.
const LOOPS: [f32; 2] = [0.15, 0.25];

/// Draws openings that connect all `rooms`.
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

/// A wall between two rooms, long enough for a door.
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

/// Returns the longest straight wall between two rooms, if a door fits.
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

/// Returns the common edge of two cells.
fn touching(a: &Rect, b: &Rect) -> Option<SharedWall> {
    let line = |a: [f32; 2], b: [f32; 2]| {
        // Edges are whole centimetres from the same arithmetic, so equality is exact.
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

/// Returns true if one room is entered through the other.
fn belong(rooms: &[Room], [a, b]: [usize; 2]) -> bool {
    rooms[a].host == Some(b) || rooms[b].host == Some(a)
}

/// Prices a door in this wall: lowest between passages and into annexes, then from passages, then between
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
            // Day rooms are sometimes entered through each other, so that not all doors are at the hallway.
            let through = matches!(room, RoomKind::Kitchen | RoomKind::DiningRoom | RoomKind::Laundry);
            whim + if through && rng.chance(0.5) { 3.0 } else { 1.0 }
        }
        _ if is_public(a) && is_public(b) => 2.0 + whim,
        _ if friendship(a, b) > 0.0 => 6.0 + whim,
        _ if a == RoomKind::Bathroom || b == RoomKind::Bathroom => 40.0 + whim,
        _ => 20.0 + whim,
    }
}

/// Splits the walls into a spanning tree, taken in order, and the rest.
fn spanning_tree(rooms: &[Room], walls: Vec<SharedWall>) -> (Vec<SharedWall>, Vec<SharedWall>) {
    let stairs = rooms.iter().position(|room| room.kind == RoomKind::Stairs);
    let group = |(index, room): (usize, &Room)| match stairs {
        Some(first) if room.kind == RoomKind::Stairs => first,
        _ => index,
    };
    let mut group: Vec<usize> = rooms.iter().enumerate().map(group).collect();
    walls.into_iter().partition(|wall| {
        let [from, to] = wall.rooms.map(|room| group[room]);
        // Relabelling is quick enough for at most 24 rooms.
        group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
        from != to
    })
}

/// Draws some remaining walls, related rooms first.
fn loops(rng: &mut Rng, rooms: &[Room], tree: usize, rest: Vec<SharedWall>) -> Vec<SharedWall> {
    let wanted = (tree as f32 * rng.range(LOOPS[0], LOOPS[1])).round().max(1.0) as usize;
    let preference = |wall: &SharedWall| {
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
        rest.into_iter().filter_map(|wall| Some((preference(&wall)?, wall))).collect();
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

/// Draws true for an open arch between two rooms.
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

/// Distance between compared positions, metres.
const SPACING_M: f32 = 0.7;

/// Straight distance range of compared positions, metres.
// Closer pairs only measure the wall thickness.
const APART_M: [f32; 2] = [2.0, 3.2];

/// Returns the largest ratio of geodesic to straight distance on a storey.
pub(super) fn longest_detour(plan: &Plan) -> f32 {
    let ways = Ways::of(plan);
    let places = places(plan);
    let mut most = 1.0_f32;
    for (index, a) in places.iter().enumerate() {
        for b in &places[index + 1..] {
            let straight = distance_m(a.at, b.at);
            let near = (APART_M[0]..APART_M[1]).contains(&straight);
            if near && a.room != b.room && plan.rooms[a.room].storey == plan.rooms[b.room].storey {
                most = most.max(ways.between_m(a, b) / straight);
            }
        }
    }
    most
}

struct Place {
    room: usize,
    at: [f32; 2],
}

fn places(plan: &Plan) -> Vec<Place> {
    let mut places = Vec::new();
    for (room, rect) in
        plan.rooms.iter().enumerate().flat_map(|(room, all)| floor(all).map(move |r| (room, r)))
    {
        let steps = rect.size().map(|length| (length / SPACING_M).max(1.0) as usize);
        for i in 0..=steps[0] {
            for k in 0..=steps[1] {
                let at = |span: [f32; 2], step: usize, steps: usize| {
                    span[0] + (span[1] - span[0]) * step as f32 / steps as f32
                };
                places.push(Place { room, at: [at(rect.x, i, steps[0]), at(rect.z, k, steps[1])] });
            }
        }
    }
    places
}

/// Standing area inside the walls.
fn floor(room: &Room) -> impl Iterator<Item = Rect> {
    const BODY_M: f32 = 0.1;
    room.floor()
        .into_iter()
        .map(|rect| rect.inset(BODY_M))
        .filter(|rect| rect.size()[0].min(rect.size()[1]) > 0.0)
}

/// Walking distances between opening centres.
struct Ways {
    doors: Vec<[f32; 2]>,
    /// Openings per room.
    of_room: Vec<Vec<usize>>,
    metres: Vec<Vec<f32>>,
}

impl Ways {
    fn of(plan: &Plan) -> Self {
        let doors: Vec<[f32; 2]> = plan.openings.iter().map(middle).collect();
        let of_room: Vec<Vec<usize>> = (0..plan.rooms.len())
            .map(|room| (0..doors.len()).filter(|&door| plan.openings[door].rooms.contains(&room)).collect())
            .collect();
        let mut metres = vec![vec![f32::INFINITY; doors.len()]; doors.len()];
        for own in &of_room {
            for &a in own {
                own.iter().for_each(|&b| metres[a][b] = distance_m(doors[a], doors[b]));
            }
        }
        // Floyd-Warshall: a house has at most about 30 openings.
        for via in 0..doors.len() {
            for from in 0..doors.len() {
                for to in 0..doors.len() {
                    metres[from][to] = metres[from][to].min(metres[from][via] + metres[via][to]);
                }
            }
        }
        Self { doors, of_room, metres }
    }

    fn between_m(&self, a: &Place, b: &Place) -> f32 {
        let through = |from: usize, to: usize| {
            distance_m(a.at, self.doors[from]) + self.metres[from][to] + distance_m(self.doors[to], b.at)
        };
        let ways = self.of_room[a.room]
            .iter()
            .flat_map(|&from| self.of_room[b.room].iter().map(move |&to| through(from, to)));
        ways.fold(f32::INFINITY, f32::min)
    }
}

fn middle(opening: &Opening) -> [f32; 2] {
    let along = (opening.along[0] + opening.along[1]) / 2.0;
    if opening.along_x { [along, opening.line_m] } else { [opening.line_m, along] }
}

fn distance_m(a: [f32; 2], b: [f32; 2]) -> f32 {
    let [x, z] = [a[0] - b[0], a[1] - b[1]];
    (x * x + z * z).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::plan::RoomKind;

    fn plans() -> impl Iterator<Item = (u64, Plan)> {
        (0..100).map(|seed| {
            (seed, Plan::draw(&Rng::new(seed), 5 + seed as usize % 20, 1 + seed as usize / 20 % 2))
        })
    }

    #[test]
    fn doorways_connect_all_rooms_with_loops() {
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
    fn doorways_are_in_both_rooms_walls() {
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
    fn annexes_are_entered_only_through_hosts() {
        for (seed, plan) in plans() {
            for (index, room) in plan.rooms.iter().enumerate().filter(|(_, room)| room.host.is_some()) {
                let doors: Vec<_> = plan.openings.iter().filter(|door| door.rooms.contains(&index)).collect();
                assert_eq!(doors.len(), 1, "seed {seed}");
                assert!(doors[0].rooms.contains(&room.host.unwrap()), "seed {seed}");
            }
        }
    }

    /// Rooms with 4 m sides in a row, with doors at alternate ends.
    fn row(doors: &[f32]) -> Plan {
        let room = |index: usize| Room {
            kind: RoomKind::Office,
            storey: 0,
            cells: vec![Rect::new([4.0 * index as f32, 4.0 * index as f32 + 4.0], [0.0, 4.0])],
            host: None,
        };
        let opening = |(index, &start): (usize, &f32)| Opening {
            rooms: [index, index + 1],
            along_x: false,
            line_m: 4.0 * (index + 1) as f32,
            along: [start, start + 0.9],
            height_m: 2.05,
        };
        Plan {
            rooms: (0..=doors.len()).map(room).collect(),
            openings: doors.iter().enumerate().map(opening).collect(),
            windows: vec![],
            entrance: None,
        }
    }

    #[test]
    fn doorway_at_wall_end_causes_detour() {
        assert_eq!(longest_detour(&row(&[])), 1.0);
        // About 3.4 m to the door and back, 2 m in a straight line.
        let one = longest_detour(&row(&[3.0]));
        assert!((2.5..4.5).contains(&one), "{one}");
        let shut = Plan { openings: vec![], ..row(&[3.0]) };
        assert_eq!(longest_detour(&shut), f32::INFINITY);
    }
}
