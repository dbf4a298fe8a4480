//! Detours around walls, before furniture.

use super::{Opening, Plan, Room};
use crate::rect::Rect;

/// Distance between the places that are compared, metres.
const SPACING_M: f32 = 0.7;

/// Straight distances of compared positions, metres. Closer pairs only measure wall thickness.
const APART_M: [f32; 2] = [2.0, 3.2];

/// Largest ratio of geodesic to straight distance on a storey; paths inside a room are straight.
pub(super) fn longest(plan: &Plan) -> f32 {
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

/// Standing area next to the walls.
fn floor(room: &Room) -> impl Iterator<Item = Rect> {
    const BODY_M: f32 = 0.1;
    room.floor()
        .into_iter()
        .map(|rect| rect.inset(BODY_M))
        .filter(|rect| rect.size()[0].min(rect.size()[1]) > 0.0)
}

/// Walking distances between the middles of all openings.
struct Ways {
    doors: Vec<[f32; 2]>,
    /// The openings of each room.
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
    use crate::plan::RoomKind;

    /// Rooms of 4 m by 4 m in a row, with doors at alternate ends.
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
    fn a_door_at_the_end_of_a_wall_makes_a_detour() {
        assert_eq!(longest(&row(&[])), 1.0);
        // About 3.4 m to the door and back, 2 m as the crow flies.
        let one = longest(&row(&[3.0]));
        assert!((2.5..4.5).contains(&one), "{one}");
        let shut = Plan { openings: vec![], ..row(&[3.0]) };
        assert_eq!(longest(&shut), f32::INFINITY);
    }
}
