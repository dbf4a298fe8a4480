//! Windows and the front door in outer walls.

use super::{CEILING_M, Face, Rect, Room, RoomKind, WALL_M, Window, remainder};
use crate::model::about;
use avln_geom::Rng;

/// Front door width and frame height, metres.
const DOOR_M: [f32; 2] = [1.1, 2.1];

/// Positions the front door at the centre of the shortest outer wall: in the entryway, otherwise in the first
/// ground-floor room with an outer wall.
pub(super) fn entrance(rooms: &[Room]) -> Option<Window> {
    let first = rooms.iter().position(|room| room.kind == RoomKind::Entryway);
    let mut order: Vec<usize> = first.into_iter().chain(0..rooms.len()).collect();
    order.retain(|&room| rooms[room].storey == 0);
    order.into_iter().find_map(|room| {
        let mut walls = outer_walls(rooms, room);
        walls.retain(|wall| wall.along[1] - wall.along[0] >= DOOR_M[0] + 0.1);
        walls.sort_by(|a, b| (a.along[1] - a.along[0]).total_cmp(&(b.along[1] - b.along[0])));
        let wall = walls.first()?;
        let along = about((wall.along[0] + wall.along[1]) / 2.0, DOOR_M[0]);
        Some(Window { room, side: wall.side, line_m: wall.line_m, along, y: [0.0, DOOR_M[1]] })
    })
}

pub(super) fn draw(rng: &mut Rng, rooms: &[Room], entrance: Option<Window>) -> Vec<Window> {
    let mut windows = Vec::new();
    for (index, room) in rooms.iter().enumerate() {
        for wall in outer_walls(rooms, index) {
            let door = entrance.filter(|door| {
                door.room == index && door.side == wall.side && (door.line_m - wall.line_m).abs() < 1e-3
            });
            let walls = remainder(wall.along, door.iter().map(|door| door.along));
            for along in walls {
                windows.extend(row(rng, room, index, Face { along, ..wall }));
            }
        }
    }
    windows
}

/// Sill, head and largest width; `None` without windows.
fn kind_of_window(room: &Room) -> Option<[f32; 3]> {
    match room.kind {
        RoomKind::Closet => None,
        // The flights are in the way.
        RoomKind::Stairs if room.storey == 0 => None,
        // Small and high: sinks and machines fit below.
        RoomKind::Bathroom | RoomKind::Laundry | RoomKind::Utility => Some([1.45, 2.1, 0.7]),
        RoomKind::Garage => Some([1.5, 2.1, 0.9]),
        // Above the counters (0.9 m).
        RoomKind::Kitchen => Some([1.12, 2.1, 1.3]),
        _ => Some([0.92, 2.15, 1.8]),
    }
}

/// Draws one or two windows in an outer wall, if it is long enough.
fn row(rng: &mut Rng, of: &Room, room: usize, wall: Face) -> Vec<Window> {
    let Some([sill, head, widest]) = kind_of_window(of) else { return vec![] };
    let length = wall.along[1] - wall.along[0];
    let least = if of.kind.is_passage() { 1.0 } else { 1.6 };
    if length < least {
        return vec![];
    }
    let count = (length / 2.6).floor().clamp(1.0, 2.0) as usize;
    let slot = length / count as f32;
    let window = |i: usize| {
        let width = (rng.range(0.6, 0.95) * widest).min(slot - 0.7);
        let width = (width * 100.0).round() / 100.0;
        let along = about(wall.along[0] + slot * (i as f32 + 0.5), width);
        Window { room, side: wall.side, line_m: wall.line_m, along, y: [sill, head.min(CEILING_M)] }
    };
    let windows: Vec<Window> = (0..count).map(window).collect();
    windows.into_iter().filter(|window| window.along[1] - window.along[0] >= 0.3).collect()
}

/// Wall stretches without another room behind.
pub(super) fn outer_walls(rooms: &[Room], index: usize) -> Vec<Face> {
    let room = &rooms[index];
    let others: Vec<&Rect> = rooms
        .iter()
        .enumerate()
        .filter(|(other, behind)| *other != index && behind.storey == room.storey)
        .flat_map(|(_, behind)| &behind.cells)
        .collect();
    let outer = |face: Face| {
        let line = face.line_m - face.side.inward() * WALL_M / 2.0;
        let behind = |rect: &&&Rect| (face.side.opposite().line_m(rect) - line).abs() < 1e-3;
        let grown = |rect: &&Rect| {
            let span = face.side.span(rect);
            [span[0] - WALL_M / 2.0, span[1] + WALL_M / 2.0]
        };
        let taken = others.iter().filter(behind).map(grown);
        remainder(face.along, taken).into_iter().map(move |along| Face { along, ..face })
    };
    room.faces().into_iter().flat_map(outer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{plan::Plan, rect::Side};

    #[test]
    fn windows_are_apart_in_outer_walls() {
        for seed in 0..60 {
            let plan = Plan::draw(&Rng::new(seed), 5 + seed as usize % 12, 1);
            let door = plan.entrance.expect("a front door");
            let all: Vec<Window> = plan.windows.iter().copied().chain([door]).collect();
            assert!(plan.windows.len() >= 4, "seed {seed}: {} windows", plan.windows.len());
            for (index, window) in all.iter().enumerate() {
                let holds = |wall: &Face| {
                    let within = wall.along[0] <= window.along[0] && window.along[1] <= wall.along[1];
                    wall.side == window.side && wall.line_m == window.line_m && within
                };
                assert!(outer_walls(&plan.rooms, window.room).iter().any(holds), "seed {seed}: {window:?}");
                let same = |other: &&Window| {
                    other.room == window.room && other.side == window.side && other.line_m == window.line_m
                };
                for other in all[index + 1..].iter().filter(same) {
                    let apart = crate::rect::common(window.along, other.along) < 0.0;
                    assert!(apart, "seed {seed}: {window:?} {other:?}");
                }
            }
        }
    }

    #[test]
    fn wall_without_room_behind_is_outer() {
        let room = |x: [f32; 2], z: [f32; 2]| Room {
            kind: RoomKind::Office,
            storey: 0,
            cells: vec![Rect::new(x, z)],
            host: None,
        };
        let rooms = [room([0.0, 4.0], [0.0, 3.0]), room([4.0, 6.0], [0.0, 1.0])];
        let east: Vec<Face> =
            outer_walls(&rooms, 0).into_iter().filter(|wall| wall.side == Side::East).collect();
        assert_eq!(east.len(), 1);
        assert!((east[0].along[0] - 1.06).abs() < 1e-5 && (east[0].along[1] - 2.94).abs() < 1e-5);
    }
}
